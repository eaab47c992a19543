"""Secrets: made with care, read with suspicion, named without giving them away."""

import hashlib
import os
import stat

import pytest
from typer.testing import CliRunner

from grader.assignment import PUBLIC_SECRET
from grader.cli import NOTHING_DONE, app
from grader.grading.secret import SecretError, fingerprint, new_secret, read_secret


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["secret", *map(str, words)])


def test_a_new_secret_is_random_its_owners_and_readable_as_text(tmp_path):
    one, other = (new_secret(tmp_path / name) for name in ("one", "other"))
    assert one != other and read_secret(tmp_path / "one") == one
    assert len(bytes.fromhex((tmp_path / "one").read_text())) == 32
    assert (tmp_path / "one").read_bytes().endswith(b"\n")
    assert stat.S_IMODE((tmp_path / "one").stat().st_mode) == 0o600


def test_a_secret_is_never_overwritten(tmp_path):
    (tmp_path / "course").write_text("what grades depend on")
    os.symlink(tmp_path / "elsewhere", tmp_path / "link")
    for name in ("course", "link"):
        with pytest.raises(SecretError, match="exists and is left as it is"):
            new_secret(tmp_path / name)
    assert (tmp_path / "course").read_text() == "what grades depend on"
    assert not (tmp_path / "elsewhere").exists()


def test_a_disk_that_is_full_leaves_no_half_a_secret(tmp_path, monkeypatch):
    def full(handle, mode):
        os.close(handle)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("builtins.open", full)
    with pytest.raises(SecretError, match="No space left"):
        new_secret(tmp_path / "course")
    assert not (tmp_path / "course").exists()


@pytest.mark.parametrize("ending", [b"", b"\n", b"\r\n", b"\n\n"])
def test_an_editors_newline_changes_no_grade(tmp_path, ending):
    (tmp_path / "course").write_bytes(b"0123456789abcdef" + ending)
    assert read_secret(tmp_path / "course") == b"0123456789abcdef"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "0 bytes"),
        (b"tooshort\n\n\n\n\n\n\n\n\n\n", "8 bytes"),
        (b"a" * 64, "only repeats one byte"),
        (b"abcd" * 16, "only repeats 4 bytes"),
        (bytes(range(256)) * 17, "more than 4096 bytes"),
    ],
)
def test_what_could_be_guessed_is_refused(tmp_path, content, words):
    (tmp_path / "weak").write_bytes(content)
    with pytest.raises(SecretError, match=words):
        read_secret(tmp_path / "weak")


def test_a_fingerprint_names_a_secret_and_is_no_digest_of_it():
    one, other = b"one secret of the course", b"another secret of the course"
    assert fingerprint(one) == fingerprint(one) != fingerprint(other)
    assert len(fingerprint(one)) == 12 and int(fingerprint(one), 16) >= 0
    assert fingerprint(one) not in hashlib.sha256(one).hexdigest()
    assert fingerprint(PUBLIC_SECRET) == "public"


def test_the_commands(run, tmp_path):
    made = run("new", "course.secret")
    [written, advice] = made.stdout.splitlines()
    mark = fingerprint(read_secret(tmp_path / "course.secret"))
    assert made.exit_code == 0 and mark in written
    assert "--secret course.secret" in advice and "cannot" not in advice
    assert (tmp_path / "course.secret").read_text().strip() not in made.output
    assert run("show", "course.secret").stdout == mark + "\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["new", "taken"], "taken exists"),
        (["new", "absent/course"], "no folder absent"),
        (["new", "taken/course"], "cannot write taken/course"),
        (["show", "absent"], "cannot read the secret absent"),
        (["show", "taken"], "7 bytes"),
    ],
)
def test_commands_that_cannot_be_done(run, tmp_path, words, message):
    (tmp_path / "taken").write_text("a filed")
    result = run(*words)
    assert result.exit_code == NOTHING_DONE
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert (tmp_path / "taken").read_text() == "a filed"
