"""The mark `tier(number)`: a test that needs a tier of isolation."""

from tests.tiers import need


def pytest_configure(config):
    config.addinivalue_line("markers", "tier(number): needs this tier of isolation")


def pytest_runtest_setup(item):
    for mark in item.iter_markers("tier"):
        need(*mark.args)
