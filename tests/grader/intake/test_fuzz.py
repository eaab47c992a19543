"""Whatever bytes are handed in: submissions or refusals of one printable line, and nothing else happens.

`FUZZ=50 python -m pytest tests/grader/intake/test_fuzz.py` runs fifty times as many examples, and new ones.
"""

import json
import os
import struct
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.intake import collect, notebook, source
from tests.fuzzing import fuzz
from tests.grader.intake.handing_in import ASSIGNMENT, GOOD, member, pack
from tests.grader.intake.handing_in import notebook as honest_notebook

pytestmark = pytest.mark.usefixtures("one_reader")

#: What executing, importing or writing anything would raise.
WATCHED = {"os.system", "os.mkdir", "os.rename", "os.remove", "os.symlink", "socket.connect", "shutil.copyfile"}
LIBRARY = os.path.dirname(os.__file__)
_watching = []


def _hook(event, arguments):
    if not _watching:
        return
    # A file descriptor is a pipe to the process that reads. What the standard library imports late may run.
    writes = event == "open" and not isinstance(arguments[0], int) and set(str(arguments[1])) & set("wax+")
    executes = event == "exec" and not arguments[0].co_filename.startswith((LIBRARY, "<frozen"))
    if writes or executes or event in WATCHED:
        _watching.append((event, arguments))


@pytest.fixture(scope="module", autouse=True)
def audit():
    # It cannot be taken off again, only put to sleep.
    sys.addaudithook(_hook)


def watched(function, *arguments):
    """What it returns, having executed, run and written nothing."""
    _watching[:] = [None]
    try:
        return function(*arguments)
    finally:
        events, _watching[:] = _watching[1:], []
        assert events == []


def hand_in(folder, name, content):
    """Everything that has to hold, whatever the content; the submissions."""
    path = folder / "in" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    before = sorted(folder.rglob("*"))
    results = []
    if path.suffix != ".zip":
        # What the other process does, where it can be watched.
        try:
            watched(source.read, content, path.suffix, ASSIGNMENT.entry_point, ASSIGNMENT.parameters)
        except (ValueError, RecursionError, MemoryError):
            pass
    for what in (path, path.parent):
        submissions, refusals = watched(collect.gather, [what], ASSIGNMENT)
        assert submissions or refusals
        names = [each.name for each in (*submissions, *refusals)]
        assert len(set(names)) == len(names)
        for refusal in refusals:
            assert refusal.reason.isprintable() and 0 < len(refusal.reason) <= 300
        for each in (*submissions, *refusals):
            assert each.name.isprintable() and each.path.isprintable() and (each.name + each.path).encode()
        for submission in submissions:
            assert submission.digest
            source.check_program(submission.source, ASSIGNMENT.entry_point, ASSIGNMENT.parameters)
        results.append(submissions)
    assert sorted(folder.rglob("*")) == before
    return results[0]


# Programs

pieces = st.sampled_from(
    [GOOD, "%x\n", "!y", "a = ", "(", "\\\n", "'''", "check(", "import ", "def ", ":\n ", "@", ";", "\ud800", "é", "\0"]
    + ["\r", "\f", "\u2028", "# coding: utf-16\n", "# coding: rot13\n", "f'{", "}'", "match a:\n case ", "9" * 5000]
)
programs = st.lists(pieces | st.text(max_size=5), max_size=8).map("".join)


@fuzz(250)
@given(st.binary(max_size=200) | programs.map(lambda text: text.encode("utf-8", "surrogatepass")))
def test_any_bytes_as_a_program(tmp_path, content):
    hand_in(tmp_path, "fuzz.py", content)


# Notebooks

constants = st.sampled_from([float("nan"), float("inf"), -float("inf"), 10**400, -(10**20), 1e308, True, ""])
values = st.recursive(
    st.none() | st.integers() | st.floats() | st.text(max_size=9) | constants,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
magics = st.sampled_from(
    ["!rm -rf ~", "%run x.py", "%%bash\nrm -rf ~", "%%time\n" + GOOD, "%%writefile est.py\n" + GOOD, "x = !ls", "?x"]
    + [
        "x??",
        "%%capture out\nimport os",
        "%load_ext evil",
        "get_ipython().system('rm')",
        "  %time x = 1",
        "%",
        "!",
        "%%",
    ]
)
cell_sources = programs | magics | st.lists(programs | magics | values, max_size=4) | values
cells = st.fixed_dictionaries(
    {"cell_type": st.sampled_from(["code", "code", "markdown", "raw"]) | values, "source": cell_sources},
    optional={"metadata": values, "outputs": values, "execution_count": values, "id": values},
)
nearly = st.fixed_dictionaries(
    {"nbformat": st.sampled_from([4, 4, 4, 5, 3]) | values, "cells": st.lists(cells | values, max_size=4) | values},
    optional={"metadata": values, "nbformat_minor": values, "worksheets": values},
)


@st.composite
def notebooks(draw):
    """Bytes of what is nearly a notebook, some with keys that come twice, bytes changed, or an end missing."""
    text = json.dumps(draw(nearly), ensure_ascii=draw(st.booleans()))
    if draw(st.booleans()):
        text = text[:-1] + ', "cells": ' + json.dumps(draw(st.lists(cells, max_size=2))) + ', "nbformat": 4}'
    data = bytearray(text.encode("utf-8", "surrogatepass"))
    for _ in range(draw(st.integers(0, 2))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return bytes(data[: draw(st.integers(0, len(data)) | st.just(len(data)))])


@fuzz(300)
@given(notebooks() | values.map(lambda data: json.dumps(data).encode()))
def test_any_bytes_as_a_notebook(tmp_path, content):
    hand_in(tmp_path, "fuzz.ipynb", content)


@fuzz(150)
@given(st.lists(magics | programs, max_size=5), st.lists(magics | programs, max_size=5))
def test_nothing_of_the_shell_is_left_in_a_program(tmp_path, before, after):
    content = honest_notebook(*before, GOOD, *after)
    for submission in hand_in(tmp_path, "fuzz.ipynb", content):
        compile(submission.source, "fuzz", "exec")


@fuzz(100)
@given(st.lists(magics, max_size=6), st.permutations(["import os\n", "A = os\n", GOOD.replace("1", "A")]))
def test_magics_around_a_program_change_nothing(magics, lines):
    plain = notebook.extract(honest_notebook(*lines), "Estimator", 10**6)
    # Those that are Python beneath bind names of their own.
    magics = [each for each in magics if "Estimator" not in each and "os" not in each]
    mixed = [cell for line in lines for cell in (*magics, line)]
    found = notebook.extract(honest_notebook(*mixed), "Estimator", 10**6)

    def code(text):
        return [line for line in text.splitlines() if not line.startswith("#")]

    assert code(found) == code(plain)


@pytest.mark.parametrize("opening", [b"[", b'{"cells":', b'[{"a":'])
def test_depth_is_no_way_in(tmp_path, opening):
    assert hand_in(tmp_path, "deep.ipynb", opening * 300_000) == []


# Zips

names = st.sampled_from(
    ["est.py", "a/est.py", "b/est.ipynb", "EST.py", "../est.py", "/est.py", "C:est.py", "a\\b.py", "\0.py", ".est.py"]
    + ["__MACOSX/est.py", "e.zip", "e.txt", "a/", "", "/", "..", "est.py/", "\x1b[2J.py", "=1+1.py", "\u202eyp.est"]
).map(str.encode) | st.binary(max_size=12)
contents = st.sampled_from([GOOD.encode(), b"x = 1\n", honest_notebook(GOOD), b"", b"\xff"]) | st.binary(max_size=30)
words = st.sampled_from([0, 1, 2, 7, 8, 0x1000, 0xFFFE, 0xFFFF])
longs = st.sampled_from([0, 1, 10**6, 10**6 + 1, 10**8 + 1, 2**31, 2**32 - 2, 2**32 - 1]) | st.integers(0, 400)
members = st.builds(
    lambda name, content, lies: member(name, content, **lies),
    names,
    contents,
    st.fixed_dictionaries(
        {},
        optional={
            "flags": words | st.just(0x800),
            "method": words,
            "size": longs,
            "packed": longs,
            "crc": longs,
            "mode": st.sampled_from([0, 0o120777, 0o020644, 0o040755, 0o100644, 0o140777, 0xFFFF]),
            "version": words.map(lambda word: word & 0xFF),
            "offset": longs,
            "local_name": names,
            "local_size": longs,
            "local_method": words,
            "local_flags": words,
            "extra": st.binary(max_size=20) | longs.map(lambda long: struct.pack("<HHQ", 1, 8, long)),
        },
    )
    | st.just({}),
)
honest = st.builds(member, st.sampled_from(["est.py", "a/est.py", "b/est.py", "c.py"]), st.just(GOOD))
forged = st.builds(
    lambda members, prefix, comment, lies: pack(*members, prefix=prefix, comment=comment, **lies),
    st.lists(members | honest, max_size=4),
    st.sampled_from([b"", b"", b"MZ", pack(member("old.py"))]),
    st.binary(max_size=9) | st.just(b"PK\5\6" + bytes(18)),
    st.just({})
    | st.fixed_dictionaries({}, optional={"count": words, "directory_size": longs, "directory_offset": longs}),
)


@st.composite
def mutated(draw):
    """A zip with bytes changed, cut or repeated."""
    data = bytearray(draw(forged))
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        match draw(st.integers(0, 3)):
            case 0:
                data[place : place + 1] = bytes([draw(st.integers(0, 255))])
            case 1:
                data[place : place + 4] = struct.pack("<I", draw(longs))
            case 2:
                del data[place : place + draw(st.integers(1, 30))]
            case 3:
                data[place:place] = data[place : place + draw(st.integers(1, 60))]
    return bytes(data)


@fuzz(400)
@given(forged | mutated() | st.binary(max_size=100))
def test_any_bytes_as_a_zip(tmp_path, content):
    hand_in(tmp_path, "fuzz.zip", content)


@fuzz(100)
@given(st.lists(members, max_size=3), st.data())
def test_a_bad_member_never_stops_a_good_one(tmp_path, bad, data):
    """Unless the zip as a whole cannot be believed, which is then its one refusal."""
    order = data.draw(st.permutations([*bad, member("good/ana.py")]))
    path = tmp_path / "class.zip"
    path.write_bytes(pack(*order))
    submissions, refusals = collect.gather([path], ASSIGNMENT)
    whole = len(refusals) == 1 and refusals[0].path == str(path)
    assert whole or any(submission.source == GOOD for submission in submissions)
