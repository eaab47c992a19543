"""Programs that fail in every way there is, each in its own process; and what is left of them."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from course_lib.filters import Gaussian, Particles
from course_lib.vacuum.constants import Constants
from grader.sandbox.channel import MOST_PATIENCE, patience
from grader.sandbox.program import Limits, Program, SandboxError, StudentError
from grader.sandbox.server import Server
from tests.tiers import need

linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

CLOUD = """
import numpy as np
def Estimator(previous, observation, control, constants, rng):
    return rng.normal(size=(50, 2))
"""


@contextmanager
def serving(tier):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COURSE_SECRET", "the instructor's")
        modules = {"preload": ["course_lib.vacuum.constants"], "withheld": ["course_lib.vacuum.models"]}
        with Server(**modules, tier=tier) as server:
            yield server


@pytest.fixture(scope="module", params=range(4))
def server(request):
    need(request.param)
    with serving(request.param) as server:
        yield server


@pytest.fixture(scope="module")
def plain_server():
    """One that keeps a program from nothing: it shows what happens to what got through."""
    with serving(0) as server:
        yield server


def program(source, seed=2**127 + 1, **changes):
    return Program(source, "Estimator", Constants(**changes), seed)


def estimator(*body):
    """Source of an Estimator with this body, its first line the second of the file."""
    return "def Estimator(previous, observation, control, constants, rng):\n" + "".join(
        f"    {line}\n" for line in body
    )


def run(server, source, steps=2, dimension=2, **limits):
    """Posteriors of some steps, and what was printed."""
    with server.start(program(source), Limits(**limits), dimension=dimension) as worker:
        posteriors = [worker.step(None, None)]
        posteriors += [worker.step(np.array([k, np.inf]), np.array([1.0])) for k in range(1, steps)]
        return posteriors, worker.printed


def failure(server, source, **arguments):
    """Status and message of a program that must fail."""
    with pytest.raises(StudentError) as caught:
        run(server, source, **arguments)
    assert "\n" not in caught.value.message
    return caught.value.status, caught.value.message


# What works


def test_a_program_gets_what_the_contract_says(server):
    source = estimator(
        "import numpy as np",
        "print(constants, type(rng).__name__)",
        "if previous is None:",
        "    assert observation is None and control is None",
        "    return np.full((3, 2), constants.L)",
        "assert isinstance(previous, np.ndarray) and previous.flags.writeable and observation.flags.writeable",
        "assert observation.dtype == control.dtype == float and observation[1] == np.inf and control.shape == (1,)",
        "previous += observation[0]",
        "return previous",
    )
    with server.start(program(source, L=3.5, w_bar=0.1), Limits(), dimension=2) as worker:
        assert worker.step(None, None).states.tolist() == [[3.5, 3.5]] * 3
        assert worker.step(np.array([1.0, np.inf]), np.array([1.0])).states.tolist() == [[4.5, 4.5]] * 3
        assert worker.printed.startswith(f"{Constants(L=3.5, w_bar=0.1)} Generator")


@pytest.mark.parametrize(
    ("returned", "kinds"),
    [
        ("states", Particles),
        ("states.view(Sub)", Particles),
        ("Particles(states, np.zeros(4))", Particles),
        ("Gaussian(np.zeros(2), np.eye(2))", Gaussian),
        ("Step(states, memory=lambda: 1)", Particles),
        ("[states, Gaussian(np.zeros(2), np.eye(2))]", [Particles, Gaussian]),
    ],
)
def test_every_kind_of_posterior_arrives_as_plain_checked_arrays(server, returned, kinds):
    source = (
        "import numpy as np\nfrom course_lib.filters import Gaussian, Particles, Step\n"
        "class Sub(np.ndarray):\n    def all(self): return True\n"
        + estimator("states = np.ones((4, 2))", f"return {returned}")
    )
    (posterior, _), _ = run(server, source)
    assert type(posterior) is kinds if not isinstance(kinds, list) else [type(p) for p in posterior] == kinds
    for target in posterior if isinstance(posterior, list) else [posterior]:
        assert all(type(part) is np.ndarray and part.dtype == float for part in target)


def test_previous_is_what_was_returned_memory_included(server):
    source = "import numpy as np\nfrom course_lib.filters import Step\n" + estimator(
        "count = previous.memory['count'] + 1 if previous else 0",
        "return Step(np.full((1, 2), count), {'count': count})",
    )
    posteriors, _ = run(server, source, steps=4)
    assert [posterior.states[0, 0] for posterior in posteriors] == [0.0, 1.0, 2.0, 3.0]


def test_an_episode_repeats_bit_for_bit_even_with_the_global_generators(server):
    source = "import random\nimport numpy as np\n" + estimator(
        "return rng.normal(size=(5, 2)) + np.random.normal(size=(5, 2)) + random.random() + hash('word') % 7"
    )
    first, second = (np.array([p.states for p in run(server, source, steps=3)[0]]) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_the_reference_runs_by_its_name_and_returns_what_it_returns_here():
    from course_lib.vacuum.reference import Estimator

    reference = "course_lib.vacuum.reference:Estimator"
    task = Program(None, "Estimator", Constants(), 7, trusted=reference)
    rng = np.random.default_rng(7)
    expected = Estimator(None, None, None, Constants(), rng)
    expected = Estimator(expected, np.array([2.0, np.inf, np.inf, 3.0]), np.ones(2), Constants(), rng)
    with Server(trusted=reference) as server, server.start(task, Limits(), dimension=6) as worker:
        worker.step(None, None)
        received = worker.step(np.array([2.0, np.inf, np.inf, 3.0]), np.ones(2))
    np.testing.assert_array_equal(received.states, getattr(expected, "posterior", expected).states)


def test_kernels_may_be_cached_and_figures_drawn(server):
    source = "import matplotlib.pyplot as plt\nfrom numba import njit\n" + (
        "@njit('float64(float64)', cache=True)\ndef double(x): return 2 * x\n"
        + estimator("import numpy as np", "plt.plot([1, 2]); plt.show()", "return np.full((1, 2), double(4))")
    )
    assert run(server, source)[0][0].states.tolist() == [[8.0, 8.0]]


def test_threads_are_on_the_clock_that_the_parent_reads(server):
    source = "import threading, time\n" + estimator(
        "def spin():",
        "    while time.thread_time() < 0.1: pass",
        "thread = threading.Thread(target=spin); thread.start(); thread.join()",
        "return rng.normal(size=(3, 2))",
    )
    with server.start(program(source), Limits(), dimension=2) as worker:
        worker.step(None, None)
        before = worker.cpu_seconds()
        worker.step(np.zeros(1), np.zeros(1))
        assert worker.cpu_seconds() - before >= 0.1
    assert worker.cpu_seconds() >= 0.2  # also when it is gone


# What the student did wrong


def test_a_crash_names_the_line_of_the_student(server):
    source = estimator("import numpy as np", "if observation is not None:", "    np.linalg.inv(np.zeros((2, 2)))") + (
        "    return rng.normal(size=(3, 2))\n"
    )
    assert failure(server, source) == (
        "crashed",
        "Estimator crashed at step 1: LinAlgError: Singular matrix (line 4: np.linalg.inv(np.zeros((2, 2))))",
    )


@pytest.mark.parametrize(
    ("source", "status", "words"),
    [
        ("x = (1\n", "crashed", "SyntaxError: '(' was never closed (line 1: x = (1)"),
        ("def f():\nreturn 1\n", "crashed", "IndentationError: expected an indented block"),
        ("x = 1\0", "crashed", "null bytes"),
        ("1 / 0", "crashed", "Estimator crashed at step 0: ZeroDivisionError: division by zero (line 1: 1 / 0)"),
        ("estimator = 1", "crashed", "defines no function Estimator: write def Estimator(previous, observation,"),
        ("Estimator = 1", "crashed", "defines no function Estimator"),
        ("def Estimator(z, u): pass", "crashed", "constants, rng), got def Estimator(z, u)"),
        (estimator("raise NotImplementedError"), "crashed", "NotImplementedError (line 2: raise NotImplementedError)"),
        (estimator("class E(Exception):", "  def __str__(self): 1 / 0", "raise E"), "crashed", "step 0: E (line 4"),
        (estimator(r"raise ValueError('a\nb\x1b[2Jc' + 'x' * 10**7)"), "crashed", "ValueError: a b [2Jcxxx"),
        (estimator("return Estimator(*[None] * 5)"), "crashed", "RecursionError"),
        ("import course_lib.vacuum.models", "crashed", "models holds the answer to this assignment: write your own"),
        ("from course_lib.vacuum import models", "crashed", "models holds the answer to this assignment"),
        ("raise SystemExit", "exited", "Estimator ended the process at step 0: SystemExit"),
        (estimator("import sys", "sys.exit(0)"), "exited", "SystemExit: 0 (line 3: sys.exit(0))"),
        (estimator("import os", "os._exit(3)"), "exited", "step 0 with exit status 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed", "was killed at step 0 by SIGSEGV"),
        ("import os; os.closerange(3, 9)\n" + CLOUD, "exited", "at step 0"),
        ("import os, time; os.close(4); time.sleep(60)", "exited", "closed its connection at step 0"),
        ("import os, shutil; shutil.rmtree(os.getcwd(), ignore_errors=True); 1 / 0", "crashed", "ZeroDivisionError"),
        (estimator("raise MemoryError"), "memory", "Estimator ran out of memory at step 0: MemoryError (line 2"),
        (estimator("return None"), "invalid posterior", "step 0: expected Particles, an (N, d) array, a Gaussian or"),
        (estimator("return rng.normal(size=(2, 9))"), "invalid posterior", "step 0: expected particles of shape"),
        (estimator("return rng.normal(size=(3, 2)) / 0 * 0"), "invalid posterior", "the particles hold 6 NaN"),
        (estimator("return rng.normal(size=(3, 2)).astype(object)"), "invalid posterior", "got dtype object"),
        (estimator("return rng.normal(size=(2001, 2))"), "invalid posterior", "between 1 and 2000 particles, got 2001"),
        (estimator("return rng.normal(size=(10**6, 2))"), "invalid posterior", "16000072 bytes, over the cap"),
    ],
)
def test_each_failure_has_its_status_and_one_line(server, source, status, words):
    got, message = failure(server, source, particles=2000)
    assert got == status
    assert words in message
    assert message.isprintable() and len(message) < 600


@pytest.mark.parametrize(
    "body", ["while True: pass", "import signal; signal.pause()", "import sys; sys.stdin.read(); 1 + ''"]
)
def test_a_hang_ends_at_the_deadline_of_its_call(server, body):
    if "stdin" in body:
        assert failure(server, estimator(body))[0] == "crashed"  # there is nothing to wait for on stdin
        return
    assert failure(server, body, first_call=0.3) == (
        "timeout",
        "step 0: loading the file and the first call took longer than 0.3 s",
    )
    later = estimator("if observation is not None:", f"    {body}", "return rng.normal(size=(3, 2))")
    assert failure(server, later, call=0.3) == ("timeout", "step 1: the call took longer than 0.3 s")


@linux
def test_memory_is_limited(server):
    status, message = failure(server, estimator("import numpy as np", "x = np.ones(2**40)"))
    assert status == "memory" and message.endswith("(line 3: x = np.ones(2**40))")
    greedy = estimator("import numpy as np", "x = [np.empty(2**22) for _ in range(1000)]")
    assert failure(server, greedy, memory_bytes=3 << 30)[0] == "memory"


@pytest.mark.parametrize("how", ["print('x' * 99)", "sys.stderr.write('x' * 99)", "os.write(1, b'x' * 99999)"])
def test_a_flood_of_output_is_stopped_and_its_beginning_kept(server, how):
    source = f"import os, sys\nwhile True: {how}"
    with server.start(program(source), Limits(printed_bytes=200_000), dimension=2) as worker:
        with pytest.raises(StudentError) as caught:
            worker.step(None, None)
        assert (caught.value.status, caught.value.message) == ("flooded", "printed over 0.2 MB; remove the print calls")
        assert len(worker.printed) == 4096 and set(worker.printed) <= {"x", "\n"}


def test_printing_frames_and_json_is_only_printing(server):
    source = "import os\nos.write(1, b'bay\\x01' + bytes(9)); print('{\"score\": 100}')\n" + CLOUD
    posteriors, printed = run(server, source)
    assert len(posteriors) == 2 and '{"score": 100}' in printed


# What a cheat did


FORGE = """
import os, threading, time
import numpy as np
from grader.sandbox import wire
def forge(token=1.0):
    os.write(4, b"".join(bytes(part) for part in wire.encode_posterior(token, np.zeros((3, 2)))))
"""


def test_an_answer_made_before_the_question_is_refused(server):
    status, message = failure(server, FORGE + estimator("forge()", "return np.ones((3, 2))"))
    assert (status, message) == ("invalid posterior", "step 0: expected a posterior, got an answer to another step")


def test_an_answer_that_lies_in_the_pipe_before_the_step_is_refused(server):
    source = FORGE + estimator("threading.Timer(0.05, forge).start()", "return np.ones((3, 2))")
    with server.start(program(source), Limits(), dimension=2) as worker:
        worker.step(None, None)
        time.sleep(0.5)
        with pytest.raises(StudentError, match="step 1: an answer came before the step was sent") as caught:
            worker.step(np.zeros(1), np.zeros(1))
    assert caught.value.status == "invalid posterior"


@pytest.mark.parametrize(
    "forged",
    [
        "b'garbage that is no frame'",
        "b'bay\\x07' + bytes(4)",
        "b'bay\\x01' + bytes(4)",
        "b'bay\\x01\\xff\\xff\\xff\\xff'",
        "b'bay\\x02\\x04\\x00\\x00\\x00full'",
        "b'bay\\x02\\x02\\x00\\x00\\x00\\xff\\xff'",
        "b'bay\\x01\\x08\\x00\\x00\\x00' + b'\\xff' * 8",
    ],
)
def test_garbage_on_the_wire_is_an_invalid_posterior(server, forged):
    status, message = failure(server, f"import os\nos.write(4, {forged})\n" + CLOUD)
    assert status == "invalid posterior" and message.startswith("step 0: expected a posterior, got ")


def test_a_frame_that_never_ends_meets_the_deadline(server):
    source = "import os, time\nos.write(4, b'bay\\x01\\x00\\x01\\x00\\x00' + bytes(99))\ntime.sleep(60)"
    assert failure(server, source, first_call=0.3)[0] == "timeout"


@linux
def test_a_program_finds_no_environment_no_descriptors_and_no_files_of_others(plain_server):
    source = "import os, sys\n" + estimator(
        "print(sorted(os.listdir('.')), os.environ['MPLBACKEND'], os.getcwd() == os.environ['HOME'])",
        "print(len(os.listdir('/proc/self/fd')) - 1)",  # without the one that lists
        "print('course_lib.vacuum.models' in sys.modules, 'grader.sandbox.host' in sys.modules)",
        "print('SECRET' in str(os.environ), 'SECRET' in open('/proc/self/environ').read())",
        "print('SECRET' in open(f'/proc/{os.getppid()}/environ').read())",
        "return rng.normal(size=(3, 2))",
    )
    _, printed = run(plain_server, source, steps=1)
    assert printed.splitlines() == ["['submission.py'] Agg True", "5", "False False", "False False", "False"]


@linux
@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["for k in range(30): open(f'{k}', 'wb').write(bytes(1 << 20))"], "keeps over 16 MB of files"),
        (["for k in range(1100): open(f'{k}', 'wb').close()"], "keeps over 1000 files"),
        (["os.umask(0o777)", "os.mkdir('closed')", "while True: pass"], "keeps a directory that cannot be looked into"),
    ],
)
def test_a_program_keeps_few_files(server, lines, message):
    if "looked into" in message and os.geteuid() == 0:
        pytest.skip("nothing is closed to root")
    source = "import os\n" + estimator(*lines, "import time; time.sleep(60)")
    assert failure(server, source) == ("disk", f"step 0: {message}")


@linux
def test_a_file_that_grows_too_long_is_an_error_of_the_program(server):
    source = "import os\n" + estimator("open('long', 'wb').write(bytes(20 << 20))")
    status, message = failure(server, source)
    assert status == "crashed" and "File too large" in message


def test_calls_may_not_take_too_long_together(server):
    source = "import time\n" + CLOUD.replace("    return", "    time.sleep(0.2)\n    return")
    status, message = failure(server, source, steps=100, episode=0.5)
    assert status == "timeout" and message.endswith("all calls up to this one took longer than 0.5 s")


def test_a_busy_machine_lengthens_deadlines_within_reason():
    assert 1.0 <= patience() <= MOST_PATIENCE


# What is left


def state(pid):
    """One letter, as in proc(5); X when there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return "X"


def reached(pid, letters):
    """Whether the process comes into one of these states; a generous wait for the kernel, not a measurement."""
    deadline = time.monotonic() + 20.0
    while state(pid) not in letters and time.monotonic() < deadline:
        time.sleep(0.01)
    return state(pid) in letters


FAMILY = "import os, signal, sys, time\n" + estimator(
    "print(os.getpid())",
    "for daemon in (False, True):",
    "    child = os.fork()",
    "    if child == 0:",
    "        signal.signal(signal.SIGTERM, signal.SIG_IGN)",
    "        if daemon:",
    "            os.setsid()",
    "            if os.fork(): os._exit(0)",
    "        print(os.getpid())",
    "        time.sleep(600)",
    "        os._exit(0)",
    "time.sleep(0.3)",
    "os.mkdir('closed'); open('closed/file', 'w').close(); os.symlink('/', 'closed/root')",
    "os.chmod('closed', 0); os.chmod('.', 0)",
    "return rng.normal(size=(3, 2))",
)


@linux
def test_close_leaves_no_process_and_no_file_behind(plain_server):
    with plain_server.start(program(FAMILY), Limits(), dimension=2) as worker:
        worker.step(None, None)
        pids = [int(line) for line in worker.printed.split()]
        assert len(pids) == 3 and all(state(pid) in "SR" for pid in pids)
        assert len(os.listdir(plain_server.directory)) == 1
    assert [state(pid) for pid in pids] == ["X"] * 3
    assert os.listdir(plain_server.directory) == []


@linux
def test_a_stopped_program_waits_and_goes_on(server):
    with server.start(program(CLOUD), Limits(), dimension=2) as worker:
        worker.step(None, None)
        pid = worker._pid
        worker.stop()
        assert reached(pid, "T")
        worker.cont()
        worker.step(np.zeros(1), np.zeros(1))
        worker.stop()
    assert state(pid) == "X"


def test_two_programs_run_side_by_side_and_one_that_fails_leaves_the_other_alone(server):
    with (
        server.start(program(CLOUD), Limits(), dimension=2) as good,
        server.start(program("1 / 0"), Limits(), dimension=2) as bad,
    ):
        good.step(None, None)
        with pytest.raises(StudentError):
            bad.step(None, None)
        with pytest.raises(SandboxError, match="has ended"):
            bad.step(None, None)
        good.step(np.zeros(1), np.zeros(1))


# What is the instructor's to repair


@linux
def test_a_fork_server_that_died_takes_its_workers_along_and_is_started_again(server):
    directory = server.directory
    with server.start(program(CLOUD), Limits(), dimension=2) as worker:
        worker.step(None, None)
        os.kill(server._process.pid, signal.SIGKILL)
        assert reached(worker._pid, "XZ")
        worker.stop()  # to no effect; nor does the clock fail
        assert worker.cpu_seconds() >= 0.0
        with pytest.raises(SandboxError, match="the fork server"):
            worker.step(np.zeros(1), np.zeros(1))
    assert len(run(server, CLOUD)[0]) == 2
    assert not os.path.exists(directory)


def test_a_withheld_module_that_was_preloaded_is_refused():
    # It would be inherited by every worker, import hook or not.
    modules = ["course_lib.vacuum.constants"]
    with (
        Server(preload=modules, withheld=modules) as server,
        pytest.raises(SandboxError, match="course_lib.vacuum.constants is withheld .* preloaded"),
    ):
        server.start(program(CLOUD), Limits(), dimension=2)


@pytest.mark.parametrize("modules", [{"preload": ["no_such_module"]}, {"trusted": "no_such_module:Estimator"}])
def test_a_module_that_cannot_be_preloaded_is_named(modules):
    with Server(**modules) as server, pytest.raises(SandboxError, match="No module named 'no_such_module'"):
        server.start(program(CLOUD), Limits(), dimension=2)


@linux
def test_when_the_host_is_gone_so_are_its_processes_and_its_directory(plain_server):
    # The last test: the server is not used again. A host that is killed closes its socket and does no more.
    with plain_server.start(program(FAMILY), Limits(), dimension=2) as worker:
        worker.step(None, None)
        pids = [plain_server._process.pid, *worker.printed.split()]
        assert len(pids) == 4 and os.path.isdir(plain_server.directory)
        plain_server._control.close()
        assert all(reached(pid, "XZ") for pid in pids)
        assert not os.path.exists(plain_server.directory)


KILLED = """
import sys, time
from course_lib.vacuum.constants import Constants
from grader.sandbox.program import Limits, Program
from grader.sandbox.server import Server
server = Server(tier=int(sys.argv[1])).__enter__()
source = "def Estimator(previous, observation, control, constants, rng): return rng.normal(size=(3, 2))"
worker = server.start(Program(source, "Estimator", Constants(), 1), Limits(), dimension=2)
worker.step(None, None)
print(server.directory, server._process.pid, worker._pid, flush=True)
time.sleep(600)
"""


@linux
@pytest.mark.parametrize("tier", range(4))
def test_what_a_killed_host_leaves_the_next_one_removes(tier, tmp_path, monkeypatch):
    need(tier)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    tmp_path.chmod(0o755)
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tier)], stdout=subprocess.PIPE, text=True) as host:
        directory, *pids = host.stdout.readline().split()
        host.kill()
        assert all(reached(pid, "XZ") for pid in pids)
    with Server(tier=tier):
        assert not os.path.exists(directory)
        assert len(os.listdir(tmp_path)) == 1
    assert os.listdir(tmp_path) == []
