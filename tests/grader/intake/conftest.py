"""What the tests of the grader share."""

from contextlib import nullcontext

import pytest

from grader.intake import collect
from grader.intake.reader import Reader


@pytest.fixture(scope="module")
def one_reader():
    """One process reads for all tests of a module: starting it takes longer than most files."""
    opened = {}
    with pytest.MonkeyPatch.context() as patch:

        def reader(entry_point, parameters):
            if "reader" not in opened:
                opened["reader"] = Reader(entry_point, parameters)
            return nullcontext(opened["reader"])

        patch.setattr(collect, "Reader", reader)
        yield
    if opened:
        opened["reader"].__exit__()
