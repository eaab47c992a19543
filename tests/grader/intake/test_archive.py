"""Zips handed in, honest and hostile: each bad one is a line, and costs nobody else anything."""

import io
import os
import struct
import sys
import zipfile
from types import SimpleNamespace

import pytest

from grader.intake import archive, collect
from tests.grader.intake.handing_in import ASSIGNMENT, GOOD, member, notebook, one, pack, zeros

pytestmark = pytest.mark.usefixtures("one_reader")
HELPER = "def helper(x):\n    return x\n"


def named(folder, content, name="class.zip"):
    """({name: source}, {name: reason}) of a zip that the instructor names."""
    (folder / name).write_bytes(content)
    submissions, refusals = collect.gather([folder / name], ASSIGNMENT)
    return {s.name: s.source for s in submissions}, {r.name: r.reason for r in refusals}


def found(folder, **zips):
    """The same of zips in a folder."""
    for name, content in zips.items():
        (folder / f"{name}.zip").write_bytes(content)
    submissions, refusals = collect.gather([folder], ASSIGNMENT)
    return {s.name: s.source for s in submissions}, {r.name: r.reason for r in refusals}


# What a zip means


def test_one_program_bears_the_name_of_its_zip(tmp_path):
    clutter = [
        member("est/", b"", mode=0o40755),
        member("est/essay.pdf", b"\0" * 9),
        member("est/.hidden.py"),
        member("__MACOSX/est/._filter.py"),
        member("est/__pycache__/filter.py"),
    ]
    submission, _ = one(tmp_path, "ana.zip", pack(*clutter, member("est/filter.py")))
    assert (submission.name, submission.path, submission.source) == ("ana", str(tmp_path / "ana.zip"), GOOD)
    submission, _ = one(tmp_path, "ben.ZIP", pack(member("est/filter.ipynb", notebook(GOOD))))
    assert submission.name == "ben" and GOOD in submission.source


def test_helpers_beside_the_program_are_passed_over(tmp_path):
    zipped = pack(member("tools.py", HELPER), member("est.py"), member("plots.ipynb", notebook("x = 1")))
    assert named(tmp_path, zipped) == ({"class": GOOD}, {})


def test_a_zip_that_is_named_may_hold_a_class(tmp_path):
    zipped = pack(member("ana/est.py"), member("ben/est.py", "def Estimator(:"), member("cem.ipynb", notebook(GOOD)))
    good, refused = named(tmp_path, zipped)
    assert sorted(good) == ["ana/est", "cem"]
    assert refused["ben/est"].startswith("line 1: syntax error")


def test_zips_in_a_folder_are_students(tmp_path):
    good, refused = found(
        tmp_path,
        ana=pack(member("est.py")),
        ben=pack(member("est.py"), member("old/est.py")),
        cem=pack(member("est.py"), member("draft.py", "def Estimator(:")),
        dora=pack(member("notes.txt", b"later")),
        emil=pack(member("est.py", "def estimator(): pass")),
        fay=pack(member("a.py", HELPER), member("b.py", HELPER)),
        gus=b"",
        hal=pack(),
    )
    assert sorted(good) == ["ana", "cem"]
    assert refused["ben"].startswith("holds 2 programs (est.py, old/est.py): leave one")
    assert "holds no .py or .ipynb file" in refused["dora"] == refused["hal"]
    assert refused["emil"].startswith("est.py: defines no Estimator at its top level: rename estimator")
    assert "defines no Estimator" in refused["fay"]
    assert "not a whole zip" in refused["gus"]


def test_what_ordinary_tools_write_is_read(tmp_path):
    for index, method in enumerate([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]):
        with zipfile.ZipFile(tmp_path / f"file{index}.zip", "w", method) as zipped:
            zipped.writestr("Zoë.py", GOOD)
            zipped.comment = b"PK"
        # Without a way back, the sizes follow the data.
        stream = io.BytesIO()
        no_way_back = SimpleNamespace(write=stream.write, flush=stream.flush)
        with zipfile.ZipFile(no_way_back, "w", method) as zipped, zipped.open("est.py", "w", force_zip64=True) as file:
            file.write(GOOD.encode())
        (tmp_path / f"stream{index}.zip").write_bytes(stream.getvalue())
    submissions, refusals = collect.gather([tmp_path], ASSIGNMENT)
    assert [s.source for s in submissions] == [GOOD] * 4 and not refusals


# What is refused


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (member("../../home/est.py"), "has a name that leads out of the zip"),
        (member("a/../../est.txt"), "has a name that leads out of the zip"),
        (member("/etc/est.py"), "has an absolute name"),
        (member("C:/est.py"), "has an absolute name"),
        (member("C:est.py"), "has an absolute name"),
        (member("..\\est.py"), "has a backslash"),
        (member("est\0.py"), "control character"),
        (member("est\n\x1b[31m.py"), "control character"),
        (member("est.py", "/etc/passwd", mode=0o120777), "is a link"),
        (member("etc", "/etc", mode=0o120777), "is a link"),
        (member("est.py", b"", mode=0o020666), "is a device"),
        (member("est.py", b"", mode=0o010666), "is a device"),
        (member("est.py", flags=0x801), "is encrypted"),
        (member("est.py", local_flags=0x801), "is not where or what the zip's directory says"),
        (member("est.py", local_name=b"ben.py"), "is not where or what the zip's directory says"),
        (member("est.py", local_size=7), "is not where or what the zip's directory says"),
        (member("est.py", local_method=0), "is not where or what the zip's directory says"),
        (member("est.py", offset=1), "is not where or what the zip's directory says"),
        (member("est.py", offset=2**32 - 2), "is not where or what the zip's directory says"),
        (member("est.py", method=14), "is compressed in an unusual way"),
        (member("est.py", size=1_000_001), "is larger than 1 MB"),
        (member("est.py", size=2**32 - 2), "is larger than 1 MB"),
        (member("est.ipynb", size=100_000_001), "is larger than 100 MB: clear its outputs"),
        (member("est.ipynb", size=1_100_000, packed_data=zeros(1_100_000)), "more than 500 times"),
        (member("est.py", size=7), "is damaged"),
        (member("est.py", size=10_000), "is damaged"),
        (member("est.py", crc=7), "is damaged"),
        (member("est.py", packed_data=b"\xff" * 9), "is damaged"),
        (member("est.py", packed_data=zeros(900_000)), "is damaged"),
        (member("est.py", packed_data=b""), "is damaged"),
        (member("est.py", method=0), "is damaged"),
        (member("est.zip", pack(member("est.py"))), "is a zip in a zip"),
        (member("est.py", b"\xff"), "is not text in the encoding it claims"),
        (member("x" * 65_000 + ".py", method=9), "unusual way"),
    ],
)
def test_a_bad_member_costs_its_student_and_nobody_else(tmp_path, bad, reason):
    others = [member("ana.py"), member("cem.py")]
    good, refused = named(tmp_path, pack(others[0], bad, others[1]))
    assert sorted(good) == ["ana", "cem"]
    assert [reason in line for line in refused.values()] == [True]
    folder = tmp_path / "folder"
    folder.mkdir()
    good, refused = found(folder, ana=pack(others[0]), ben=pack(others[0], bad), cem=pack(others[1]))
    if bad["name"] == b"est.py" and "encoding" in reason:
        return  # a draft beside the one right program
    assert sorted(good) == ["ana", "cem"]
    # Which zip, which member, what, and what to do.
    assert list(refused) == ["ben"] and reason in refused["ben"] and refused["ben"].count(": ") >= 1
    assert all(line.isprintable() and len(line) <= 300 for line in refused.values())


@pytest.mark.parametrize(
    "twins",
    [
        ["est.py", "est.py"],
        ["est.py", "EST.PY"],
        ["Zoë.py", "Zoe\u0308.py"],
        ["straße.py", "STRASSE.py"],
        ["a/est.py", "a//./est.py"],
    ],
)
def test_names_that_some_system_takes_for_one_are_refused(tmp_path, twins):
    good, refused = named(tmp_path, pack(*map(member, twins), member("ben.py")))
    assert list(good) == ["ben"]
    assert len(refused) == 2 and all("is there twice" in line for line in refused.values())


def zip64(**claims):
    """The extra field that holds 64-bit claims, in the order of the format."""
    data = b"".join(struct.pack("<Q", claims[key]) for key in ("size", "packed", "offset") if key in claims)
    return struct.pack("<HH", 1, len(data)) + data


ALL = 2**32 - 1
KERNEL = zeros(30_000_000)


def overlapping():
    """Members of one zip that all inflate the same bytes: the second's data begin with the third's header and so on."""
    inner = member("c.py")
    zipped = bytearray(pack(member("a.py"), inner))
    # The directory's first entry claims the second's header and data as part of its own.
    entry = zipped.index(b"PK\1\2")
    packed = struct.unpack_from("<I", zipped, entry + 20)[0]
    struct.pack_into("<I", zipped, entry + 20, packed + 60)
    struct.pack_into("<I", zipped, 18, packed + 60)
    return bytes(zipped)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is not a whole zip"),
        (b"PK", "is not a whole zip"),
        (pack(member("est.py"))[:-30], "is not a whole zip"),
        (pack(member("est.py"))[40:], "does not begin with its first member"),
        (pack(member(b"\xff.py")), "is not a whole zip"),
        (pack(member("est.py"), directory_size=2**32 - 2), "is not a whole zip"),
        (pack(member("est.py"), directory_offset=2**32 - 2), "does not begin with its first member"),
        (pack(member("est.py", version=64)), "is not a whole zip"),
        (pack(member("est.py", extra=b"\1\0\xff\xff")), "is not a whole zip"),
        (pack(member("est.py", size=ALL, extra=b"\1\0\0\0")), "is not a whole zip"),
        (pack(member("est.py"), prefix=b"#!/bin/sh\n"), "does not begin with its first member"),
        (pack(member("ana.py")) + pack(member("ben.py")), "does not begin with its first member"),
        (pack(member("ana.py"), member("ana.py", offset=0)), "overlap"),
        (overlapping(), "overlap"),
        (pack(member("est.py", packed=2**31)), "run past its end"),
        (pack(member("est.py", packed=ALL, extra=zip64(packed=2**63))), "run past its end"),
        (pack(*[member(f"{i}.py", b"") for i in range(10_001)]), "has 10001 members, at most 10000"),
    ],
)
def test_a_zip_that_contradicts_itself_is_refused_whole(tmp_path, content, reason):
    good, refused = found(tmp_path, ana=pack(member("est.py")), ben=content)
    assert sorted(good) == ["ana"]
    assert len(refused) == 1 and reason in refused["ben"]
    assert refused["ben"].isprintable() and len(refused["ben"]) <= 300


def test_zip64_claims_are_believed_no_more_than_others(tmp_path):
    for index, claims in enumerate([{"size": 2**63}, {"size": 10**6 + 1}, {"size": len(GOOD) + 1}]):
        bad = member("est.py", size=ALL, extra=zip64(**claims))
        _, refused = found(tmp_path, **{f"zip{index}": pack(bad)})
        assert ("is larger than 1 MB" if index < 2 else "is damaged") in refused[f"zip{index}"]


def test_a_long_directory_is_not_even_read(tmp_path):
    _, refused = found(tmp_path, ana=pack(*[member("x" * 60_000 + f"{i}.txt", b"") for i in range(70)]))
    assert "its directory is over 4 MB" in refused["ana"]


def test_programs_are_capped_together(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_BYTES", 3 * len(GOOD))
    assert len(named(tmp_path, pack(*[member(f"{i}.py") for i in range(3)]))[0]) == 3
    good, refused = named(tmp_path, pack(*[member(f"{i}.py") for i in range(4)]))
    assert not good and "GB of programs: unpack it" in refused["class"]


def test_no_more_is_inflated_than_was_claimed(tmp_path, monkeypatch):
    inflated = []

    class Counting:
        def __init__(self, wbits):
            self._real = real(wbits)

        def decompress(self, data, most):
            assert most > 0
            result = self._real.decompress(data, most)
            inflated.append(len(result))
            return result

        def __getattr__(self, name):
            return getattr(self._real, name)

    real = archive.zlib.decompressobj
    monkeypatch.setattr(archive.zlib, "decompressobj", Counting)
    _, reason = one(tmp_path, "bomb.zip", pack(member("est.py", size=100_000, packed_data=KERNEL)))
    assert "is damaged" in reason
    assert sum(inflated) <= 100_001


def test_nothing_is_written_and_nothing_is_left_open(tmp_path):
    content = pack(member("../escaped.py"), member("est.py"), member("ben/est.py"))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "class.zip").write_bytes(content)
    descriptors = os.listdir("/proc/self/fd") if sys.platform == "linux" else []
    collect.gather([tmp_path / "in" / "class.zip"], ASSIGNMENT)
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*")) == ["in", "in/class.zip"]
    if descriptors:
        assert len(os.listdir("/proc/self/fd")) == len(descriptors)
    assert (tmp_path / "in" / "class.zip").read_bytes() == content


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_named_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "ana.zip")
    assert "not a regular file" in collect.gather([tmp_path], ASSIGNMENT)[1][0].reason
