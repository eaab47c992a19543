"""How many examples the fuzz tests take: the same every time, or with `FUZZ=50` fifty times as many, and new ones."""

import os

from hypothesis import HealthCheck, settings

_TIMES = int(os.environ.get("FUZZ", "0"))


def fuzz(examples):
    """Settings of a test that takes so many examples; nothing is timed, and fixtures are shared by the examples."""
    return settings(
        max_examples=examples * max(_TIMES, 1),
        derandomize=not _TIMES,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
