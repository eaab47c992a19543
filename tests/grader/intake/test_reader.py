"""What exhausts the process that reads is refused, and the next file is read."""

import os
import signal

import pytest

from grader.intake import reader, source
from grader.intake.reader import Reader
from tests.grader.intake.handing_in import ASSIGNMENT, GOOD, notebook


@pytest.fixture
def reading():
    with Reader(ASSIGNMENT.entry_point, ASSIGNMENT.parameters) as opened:
        yield opened


def nested_finally(depth):
    """Every `finally` is compiled twice, also the ones within."""
    lines = [" " * i + ("try: a" if j == 0 else "finally:") for i in range(depth) for j in range(2)]
    return "\n".join([*lines, " " * depth + "a\n"]) + GOOD


@pytest.mark.skipif(os.name != "posix", reason="needs limits")
@pytest.mark.parametrize(
    ("text", "reason"),
    [
        # 600 bytes that become a million copies.
        (nested_finally(19), "takes more than 1 s to be read: simplify it"),
        ("[0" + " for a in a" * 80_000 + "]", "Python's compiler fails on it"),
        ("lambda:0\n" * 100_000, "takes more than 1 s to be read: simplify it"),
        ("-" * 900_000 + "1", "is too large or nested too deeply"),
    ],
)
def test_what_costs_too_much_is_refused_and_the_next_is_read(reading, monkeypatch, text, reason):
    monkeypatch.setattr(reader, "CPU_SECONDS", 1)
    monkeypatch.setattr(reader, "MEMORY_BYTES", 1 << 29)
    assert reading.read(GOOD.encode(), ".py") == GOOD
    with pytest.raises(ValueError) as caught:
        reading.read(text.encode(), ".py")
    # Which of the limits is hit first, and whether the compiler crashes, differs between versions of Python.
    assert any(words in str(caught.value) for words in (reason, "takes more than", "too deeply", "compiler fails"))
    assert reading.read(GOOD.encode(), ".py") == GOOD


def test_a_crash_costs_one_file(reading):
    assert reading.read(GOOD.encode(), ".py") == GOOD
    os.kill(reading._process.pid, signal.SIGSEGV)
    reading._process.wait()
    with pytest.raises(ValueError, match="compiler fails on it"):
        reading.read(GOOD.encode(), ".py")
    assert reading.read(GOOD.encode(), ".py") == GOOD


def test_time_is_counted_for_each_file_anew(reading, monkeypatch):
    monkeypatch.setattr(reader, "CPU_SECONDS", 1)
    text = ("0\n" * 12_000 + GOOD).encode()
    for _ in range(20):
        reading.read(text, ".py")


@pytest.mark.parametrize("filler", ["", "\U0001f600"])
def test_the_largest_notebook_is_read(reading, filler):
    cells = notebook(f"import math{filler and '  # '}{filler}", GOOD)
    outputs = b'"outputs": ["' + b"iVBORw0KGgo" * 9_000_000 + b'"]'
    large = cells.replace(b'"outputs": []', outputs, 1)
    assert 99_000_000 < len(large) <= source.SIZE_LIMITS[".ipynb"]
    assert GOOD in reading.read(large, ".ipynb")
    with pytest.raises(ValueError, match="larger than 100 MB"):
        reading.read(large + b" " * 2_000_000, ".ipynb")


@pytest.mark.parametrize("unit", [b"[],", b"{},", b'"",', b"[", b'{"":', b"0,", b'"\\ud83d\\ude00",'])
def test_a_notebook_of_nothing_but_json_is_refused(reading, monkeypatch, unit):
    """A hundred million bytes would be thirty million lists: what they need is limited, here to an eighth."""
    monkeypatch.setattr(reader, "MEMORY_BYTES", 1 << 28)
    content = b'{"nbformat": 4, "cells": [' + unit * (12_000_000 // len(unit))
    with pytest.raises(ValueError, match="not JSON|too large or nested too deeply|takes more than"):
        reading.read(content, ".ipynb")
    assert reading.read(GOOD.encode(), ".py") == GOOD


def test_nothing_of_the_instructors_folder_is_imported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("ast.py", "json.py", "sitecustomize.py"):
        (tmp_path / name).write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with Reader(ASSIGNMENT.entry_point, ASSIGNMENT.parameters) as opened:
        assert opened.read(GOOD.encode(), ".py") == GOOD
    assert not (tmp_path / "ran").exists()


def test_a_process_that_does_not_start_is_no_ones_program(monkeypatch):
    monkeypatch.setattr(reader.sys, "executable", "false")
    with Reader("Estimator", ()) as opened, pytest.raises(RuntimeError, match="did not start"):
        opened.read(b"", ".py")


def test_it_ends_with_its_user():
    with Reader("Estimator", ()) as opened:
        with pytest.raises(ValueError):
            opened.read(b"", ".py")
        process = opened._process
    assert process.poll() is not None
