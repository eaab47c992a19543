"""Names from untrusted files: on one line, told apart, and files of any file system."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.intake.names import FILE_NAME_BYTES, file_name, one_line, same, unique
from tests.fuzzing import fuzz

HOSTILE = [
    "\x1b[31mred\x1b[0m",
    "two\nlines\r",
    "left\u202eright\u2066",
    "\u200bunseen",
    "null\0",
    "\udcff invalid UTF-8",
    "tab\tbell\a",
    "\u2028separated",
]
anything = st.text(st.characters(), max_size=20) | st.text("aAäÄ/.%~ \\x", max_size=6)


@pytest.mark.parametrize("text", HOSTILE)
def test_what_cannot_be_printed_is_escaped(text):
    assert one_line(text).isprintable()
    one_line(text).encode()
    # Strangers keep their letters.
    assert one_line("Zoë Бородин 王") == "Zoë Бородин 王"


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("ana", "ana"),
        ("Zoë (2)", "Zoë (2)"),
        ("ana/est", "ana%2Fest"),
        ("ana%2Fest", "ana%252Fest"),
        ("../../etc/passwd", "%2E.%2F..%2Fetc%2Fpasswd"),
        (".hidden", "%2Ehidden"),
        ("C:\\est", "C%3A%5Cest"),
        ("<b>&=cmd|'x'!A0", "%3Cb%3E&=cmd%7C'x'!A0"),
        ("a\nb\0", "a%0Ab%00"),
    ],
)
def test_a_record_bears_its_submissions_name(name, file):
    assert file_name(name) == file


def test_long_names_become_files_and_stay_apart(tmp_path):
    names = ["x" * 1000, "x" * 999, "ü" * 251, "ü" * 250, "\U0001f600" * 200]
    names.append(file_name(names[0]))  # one that poses as another's
    files = {file_name(name) for name in names}
    assert len(files) == len(names)
    for file in files:
        (tmp_path / f"{file}.partial").write_text("")


@fuzz(200)
@given(st.lists(anything, min_size=2, max_size=2, unique=True))
def test_no_two_names_share_a_record(names):
    files = [file_name(name) for name in names]
    assert files[0] != files[1]
    for file in files:
        assert len(file.encode()) <= FILE_NAME_BYTES and file.isprintable() and not set(file) & set('/\\<>:"|?*')
        assert file[:1] not in (".", " ")


@fuzz(100)
@given(st.lists(anything.filter(lambda name: name.strip("/.")), max_size=6))
def test_submissions_names_differ_and_stay_on_a_line(names):
    result = unique([Path("class") / name.strip("/") for name in names])
    assert len({same(name) for name in result}) == len(names)
    assert all(name.isprintable() and name.encode() for name in result)


def test_names_that_only_case_or_escapes_tell_apart():
    result = unique([Path("Ana.py"), Path("ana.py"), Path("a\nb.py"), Path("a\\nb.py"), Path("a\\nb.ipynb")])
    assert len({same(name) for name in result}) == 5


def test_many_equal_names_are_numbered_in_no_time():
    result = unique([Path("x.py")] * 20_000)
    assert len(set(result)) == 20_000
