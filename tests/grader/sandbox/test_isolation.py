"""What each tier keeps a program from, and how the tiers are found."""

import ctypes
import errno
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader import doctor
from grader.assignments import assignments
from grader.sandbox import isolation, landlock, seccomp, syscalls
from grader.sandbox.cgroup import Cgroup
from grader.sandbox.program import Escape
from grader.sandbox.server import Server

VACUUM = assignments()["vacuum"]
COURSE = Path(isolation.__file__).parents[2] / "course_lib"


# Tiers


def test_a_tier_needs_the_one_below_it(monkeypatch):
    isolation.probe.cache_clear()
    monkeypatch.setattr(isolation, "kernel", lambda: ("the kernel is too old", "a newer one"))
    try:
        tiers = isolation.probe()
        assert [found.available for found in tiers] == [True, False, False, False]
        assert isolation.strongest() == 0
        assert (tiers[1].reason, tiers[1].remedy) == ("the kernel is too old", "a newer one")
        assert all(found.reason and found.remedy for found in tiers[1:])
    finally:
        isolation.probe.cache_clear()


def test_every_tier_says_what_it_is_and_an_available_one_asks_for_nothing():
    for number, found in enumerate(isolation.probe()):
        assert found.number == number and isolation.describe(number) == f"tier {number}: {found.title}"
        assert bool(found.reason) is bool(found.remedy) is not found.available


@pytest.mark.parametrize("number", [pytest.param(number, marks=pytest.mark.tier(number)) for number in (1, 2, 3)])
def test_no_attempt_to_break_out_succeeds(number):
    assert doctor.attempt(number, VACUUM) == []


def test_the_attempts_succeed_where_nothing_stops_them(monkeypatch):
    monkeypatch.setattr(doctor, "ATTEMPTS", dict.fromkeys(doctor.ATTEMPTS, 0))
    assert set(doctor.attempt(0, VACUUM)) == set(doctor.ATTEMPTS)


# Files


def beneath(path, roots):
    return any(path == root or path.startswith(f"{root}{os.sep}") for root in roots)


def test_a_policy_holds_what_may_be_imported_and_nothing_that_answers():
    policy = isolation.policy(1, VACUUM.withheld, "/tmp")
    readable = policy["readable"]
    for module in VACUUM.withheld:
        path = COURSE.parent.joinpath(*module.split("."))
        assert not beneath(f"{path}.py", readable)
        for product in path.parent.glob(f"__pycache__/{path.name}.*"):
            assert not beneath(str(product), readable)
    for public in ("filters/bootstrap.py", "vacuum/constants.py", "scoring.py"):
        assert beneath(str(COURSE / public), readable)
    assert beneath(os.path.realpath(os.__file__), readable)
    for closed in (COURSE.parent / "grader/cli.py", COURSE.parent / "solutions", COURSE.parent, Path.home()):
        assert not beneath(str(closed), readable)
    # Imports look at the names in a directory first.
    assert str(COURSE / "vacuum") in policy["listable"]
    assert all(beneath(path, policy["roots"]) for path in readable)


def confined(directory, *lines):
    """What a process prints that may read `open`, list `listed` and write in `own`."""
    setup = [
        "import os, socket",
        "from grader.sandbox import landlock",
        "landlock.restrict(['open', 'missing'], ['listed'], ['own'])",
        "def tries(attempt, *arguments):",
        "    try: attempt(*arguments); print('done')",
        "    except PermissionError: print('refused')",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join([*setup, *lines])], cwd=directory, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.tier(1)
def test_landlock_leaves_what_it_was_told_and_nothing_else(tmp_path):
    for name in ("open", "listed", "own", "closed"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("words")
    for name, expected in {
        "open": ["done", "done", "refused", "refused", "refused"],
        "listed": ["done", "refused", "refused", "refused", "refused"],
        "own": ["done", "done", "done", "done", "done"],
        "closed": ["refused", "refused", "refused", "refused", "refused"],
    }.items():
        assert expected == confined(
            tmp_path,
            f"tries(os.listdir, '{name}')",
            f"tries(open, '{name}/file')",
            f"tries(open, '{name}/file', 'w')",
            f"tries(os.mkdir, '{name}/new')",
            f"tries(os.remove, '{name}/file')",
        )


@pytest.mark.tier(1)
def test_landlock_makes_no_links_devices_or_sockets_and_moves_nothing_in(tmp_path):
    for name in ("open", "listed", "own"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("words")
    assert ["refused"] * 4 == confined(
        tmp_path,
        "tries(os.symlink, '/', 'own/link')",
        "tries(os.mkfifo, 'own/pipe')",
        "tries(lambda: socket.socket(socket.AF_UNIX).bind('own/socket'))",
        "tries(lambda: os.truncate('open/file', 0))",
    )


# System calls


def decision(code, architecture, number, arguments):
    """What a filter answers: classic BPF as the kernel runs it on its record of a call."""
    data = struct.pack("<iIQ6Q", number, architecture, 0, *arguments)
    program = list(struct.iter_unpack("<HBBI", code))
    accumulator, at = 0, 0
    while True:
        operation, if_true, if_false, value = program[at]
        at += 1
        if operation == 0x20:
            (accumulator,) = struct.unpack_from("<I", data, value)
        elif operation == 0x15:
            at += if_true if accumulator == value else if_false
        elif operation == 0x45:
            at += if_true if accumulator & value else if_false
        elif operation == 0x06:
            return value
        else:
            raise AssertionError(f"an instruction of unknown kind {operation:#x}")


ALLOWED, REFUSED, ABSENT, KILLED = 0x7FFF0000, 0x50000 | errno.EPERM, 0x50000 | errno.ENOSYS, 0x80000000
PID = 4242
machines = pytest.mark.parametrize("machine", sorted(syscalls.PLAIN))


def asked(monkeypatch, machine):
    monkeypatch.setattr(seccomp.platform, "machine", lambda: machine)
    code = seccomp.program(PID)
    return lambda number, *arguments: decision(
        code, syscalls.AUDIT[machine], number, [*arguments, *[0] * (6 - len(arguments))]
    )


@machines
def test_a_call_is_allowed_if_and_only_if_it_is_listed(monkeypatch, machine):
    ask = asked(monkeypatch, machine)
    special = set(syscalls.SPECIAL[machine].values())
    for number in [*range(1024), *range(0x40000000, 0x40000400), -1]:
        if number not in special:
            assert ask(number) == (ALLOWED if number in syscalls.PLAIN[machine].values() else REFUSED)


@machines
def test_another_architectures_calls_kill(monkeypatch, machine):
    monkeypatch.setattr(seccomp.platform, "machine", lambda: machine)
    code = seccomp.program(PID)
    i386 = 0x40000003
    assert decision(code, i386, 0, [0] * 6) == KILLED


@machines
def test_some_calls_are_allowed_with_some_arguments(monkeypatch, machine):
    ask = asked(monkeypatch, machine)
    call = syscalls.SPECIAL[machine]
    thread, child, namespace = 0x3D0F00, 17, 0x10000000
    assert ask(call["clone"], thread) == ALLOWED
    assert {ask(call["clone"], flags) for flags in (child, 0x4111, thread | namespace, child | namespace)} == {REFUSED}
    assert ask(call["clone3"]) == ABSENT
    assert ask(call["kill"], PID, 9) == ask(call["tgkill"], PID, 7, 6) == ALLOWED
    others = (0, 1, PID + 1, 2**32 - 1, 2**32 - PID)
    assert {ask(call[name], other, 0) for name in ("kill", "tgkill") for other in others} == {REFUSED}
    set_flags, asynchronous = 4, 0x2000
    assert ask(call["fcntl"], 3, set_flags, 0x800) == ask(call["fcntl"], 3, 1) == ask(call["fcntl"], 3, 1030) == ALLOWED
    assert ask(call["fcntl"], 3, set_flags, asynchronous | 0x800) == REFUSED
    # Owners and numbers of signals, leases, notifications, larger pipes.
    assert {ask(call["fcntl"], 3, command) for command in (8, 10, 15, 1024, 1026, 1031)} == {REFUSED}
    assert ask(call["ioctl"], 1, 0x5401) == ALLOWED
    assert {ask(call["ioctl"], 1, request) for request in (0x5412, 0x5452, 0x8901, 0x8902)} == {REFUSED}
    assert ask(call["prctl"], 15) == ALLOWED
    assert {ask(call["prctl"], option) for option in (1, 4, 8, 22, 36, 38, 0x59616D61)} == {REFUSED}
    assert ask(call["prlimit64"], 0) == ask(call["prlimit64"], PID) == ALLOWED
    assert ask(call["prlimit64"], PID + 1) == REFUSED


@given(number=st.integers(0, 2**31 - 1), arguments=st.lists(st.integers(0, 2**64 - 1), min_size=6, max_size=6))
def test_the_filter_decides_every_call(number, arguments):
    code = seccomp.program(PID)
    machine = seccomp.platform.machine()
    assert decision(code, syscalls.AUDIT[machine], number, arguments) in (ALLOWED, REFUSED, ABSENT)


@pytest.mark.tier(1)
def test_the_numbers_are_those_of_this_machine():
    # The C library knows some by name: asked by number, they say the same.
    libc = ctypes.CDLL(None)
    calls = syscalls.PLAIN[seccomp.platform.machine()]
    for name, value in {
        "getpid": os.getpid(),
        "getppid": os.getppid(),
        "getuid": os.getuid(),
        "geteuid": os.geteuid(),
        "getgid": os.getgid(),
        "getegid": os.getegid(),
    }.items():
        assert libc.syscall(calls[name]) == value


@pytest.mark.tier(1)
def test_landlock_is_new_enough_to_cover_truncation():
    assert landlock.abi() >= landlock.LEAST_ABI


# Control groups


def in_group(group, program):
    return subprocess.run([*group.entering(), sys.executable, "-c", program], capture_output=True, text=True)


@pytest.fixture
def group():
    group = Cgroup(100 << 20, 20)
    yield group
    group.remove()


@pytest.mark.tier(3)
def test_a_group_has_memory_and_no_more(group):
    assert in_group(group, "print(len(bytearray(20 << 20)))").stdout == f"{20 << 20}\n"
    assert group.out_of_memory() == 0
    assert in_group(group, "bytearray(300 << 20)").returncode == -9
    assert group.out_of_memory() == 1


@pytest.mark.tier(3)
def test_a_group_has_a_number_of_processes_and_no_more(group):
    bomb = "import os\nfor count in range(100):\n    try:\n        if os.fork() == 0: os._exit(0)\n"
    done = in_group(group, bomb + "    except BlockingIOError: print(count); break")
    assert int(done.stdout) == 19


@pytest.mark.tier(3)
def test_removing_a_group_ends_what_is_in_it(group):
    with subprocess.Popen([*group.entering(), "sleep", "600"]) as process:
        while process.pid not in group.processes() or b"sleep" not in Path(f"/proc/{process.pid}/cmdline").read_bytes():
            pass
        paths = set(group._paths.values())
        group.remove()
        assert process.wait(20) == -9
    assert not any(path.exists() for path in paths)


# Escapes


@pytest.mark.tier(1)
def test_what_outlives_a_program_is_an_escape(monkeypatch):
    with Server(tier=1) as server:
        monkeypatch.setattr(server, "_ask", lambda *_, **__: {"status": None, "left": True})
        server._workers = set()
        with pytest.raises(Escape, match="had started processes"):
            server.end(1, 0.0)
        assert server._process is None


# Large pages


@pytest.mark.skipif(sys.platform != "linux", reason="looks at its own memory as Linux shows it")
def test_memory_in_large_pages_is_the_same_memory():
    program = [
        "import numpy as np",
        "from grader.sandbox import pages",
        "numbers = np.arange(4_000_000.0)",
        "made = pages.gather()",
        "print(made >= 0, (numbers == np.arange(4_000_000.0)).all())",
    ]
    done = subprocess.run([sys.executable, "-c", "\n".join(program)], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]
