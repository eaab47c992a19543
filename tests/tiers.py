"""Tiers of isolation, for tests that need one.

The environment variable GRADER_REQUIRE_TIERS, such as "0,1,2", names those whose absence is a failure.
"""

import os

import pytest

from grader.sandbox import isolation

REQUIRED = {int(number) for number in os.environ.get("GRADER_REQUIRE_TIERS", "").split(",") if number}


def need(number):
    """Skip what follows where the tier is not available, with the reason; fail where it is required."""
    tier = isolation.probe()[number]
    if not tier.available:
        reason = f"tier {number} is not available: {tier.reason}"
        (pytest.fail if number in REQUIRED else pytest.skip)(reason)
