"""A check finds one of four states, says it in a line, and never stands in the way of the rest of the notebook."""

import sys
import threading
import time
from types import ModuleType

import numpy as np
import pytest

import grader.check
from grader.check import Checker, Exercise, Verdict, judge


def _expects_double(function):
    x = np.arange(3.0)
    y = function(x)
    if y[1] != 2.0:  # not `assert`, whose message pytest would extend
        raise AssertionError(f"double(1.0)\nexpected 2, got {y[1]:g}")
    return "Twice as good."


def _double(x):
    return 2.0 * x


EXERCISE = Exercise("double", "Double <it>", _expects_double, _double, ("Nudge.", "Push.", "$2x$"))


@pytest.fixture
def check(monkeypatch):
    module = ModuleType("grader.assignments.sample.exercises")
    missing = Exercise("missing", "No copy", _expects_double, "grader.assignments.nowhere:double", ("1", "2", "3"))
    module.EXERCISES = (EXERCISE, missing)
    monkeypatch.setitem(sys.modules, "grader.assignments.sample", ModuleType("grader.assignments.sample"))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return Checker("sample")


def test_a_right_function_passes_and_is_returned(check, capsys):
    def mine(x):
        return x + x

    assert check("double", mine) is mine
    assert check.passed("double")
    assert capsys.readouterr().out == "✔ Passed: Double <it>\n    Twice as good.\n"


def test_a_wrong_one_is_replaced_by_the_courses(check, capsys):
    assert check("double", lambda x: 3 * x) is _double
    assert not check.passed("double")
    out = capsys.readouterr().out
    assert out.splitlines() == [
        "✘ Not right yet: Double <it>",
        "    double(1.0)",
        "    expected 2, got 3",
        "    The rest of the notebook goes on with the course's version.",
    ]


def test_a_failure_after_a_success_takes_the_success_back(check):
    check("double", _double)
    check("double", lambda x: 3 * x)
    assert not check.passed("double")


def test_without_a_copy_the_notebook_goes_on_with_the_students(check, capsys):
    def mine(x):
        raise NotImplementedError

    assert check("missing", mine) is mine
    assert "goes on with yours" in capsys.readouterr().out


def test_the_stub_is_not_attempted(check, capsys):
    def stub(x):
        raise NotImplementedError()

    assert check("double", stub) is _double
    assert capsys.readouterr().out.startswith("○ Not attempted: Double <it>\n    Replace the line")


def _recursive(x):
    return _recursive(x)


def _exits(x):
    sys.exit(3)


def _interrupted(x):
    raise KeyboardInterrupt


def _asserts(x):
    assert x[0] == 1.0, "my own assertion"


def _multi_line(x):
    raise ValueError("first\nsecond")


@pytest.mark.parametrize(
    "function, words",
    [
        (_recursive, "RecursionError: maximum recursion depth exceeded"),
        (_exits, "SystemExit: 3"),
        (_interrupted, "KeyboardInterrupt"),
        (_asserts, "AssertionError: my own assertion"),
        (_multi_line, "ValueError: first"),
    ],
)
def test_an_exception_names_type_message_and_line(function, words):
    state, message, _ = judge(EXERCISE, function)
    first, second = message.splitlines()
    assert state == "exception"
    assert first == words
    line = function.__code__.co_firstlineno + 1
    assert second.startswith(f"in {function.__name__}, line {line}: ")


def test_the_line_is_the_students_even_when_a_library_raised():
    def mine(x):
        return np.linalg.inv(np.zeros((2, 2)))

    state, message, _ = judge(EXERCISE, mine)
    assert state == "exception"
    assert message.splitlines()[0] == "LinAlgError: Singular matrix"
    assert "return np.linalg.inv" in message


def test_a_wrong_signature_is_an_exception():
    state, message, _ = judge(EXERCISE, lambda: 1)
    assert (state, message.splitlines()[0][:9]) == ("exception", "TypeError")


@pytest.mark.parametrize("value", [None, 7, "x", object()])
def test_what_is_no_function_or_returns_nonsense_fails(value):
    assert judge(EXERCISE, value)[0] == "failed"
    assert judge(EXERCISE, lambda x: value)[0] == "failed"


def test_an_argument_that_is_changed_is_named():
    def mine(values):
        values *= 2
        return values

    state, message, _ = judge(EXERCISE, mine)
    assert (state, message) == ("failed", "changes its argument values: copy it first, for the caller still needs it")


def test_what_the_function_returned_before_is_its_own_to_change():
    def twice(function):
        function(function(np.zeros(3)))

    def mine(x):
        if not x.any():
            return np.ones(3)
        x += 1
        return x

    assert judge(Exercise("own", "Own", twice, mine, ("1", "2", "3")), mine)[0] == "passed"


def test_printing_is_kept_short_and_out_of_the_way(capsys):
    def mine(x):
        print("hello", "x" * 10_000)
        print("to stderr", file=sys.stderr)
        return 3 * x

    state, message, printed = judge(EXERCISE, mine)
    assert state == "failed"
    assert printed.startswith("hello xxx") and printed.endswith(" ...") and len(printed) < 420
    assert capsys.readouterr() == ("", "")


def _endless(x):
    while True:
        sum(range(1000))


def _endless_and_deaf(x):
    try:
        _endless(x)
    except:  # noqa: E722
        _endless(x)


@pytest.mark.parametrize("function", [_endless, _endless_and_deaf])
def test_an_endless_loop_is_stopped(monkeypatch, function):
    monkeypatch.setattr(grader.check, "DEADLINE", 0.05)
    state, message, _ = judge(EXERCISE, function)
    assert state == "exception"
    assert message.startswith("It was stopped after 0.05 s of CPU time: does a loop never end?\nin _endless, line ")


def test_a_function_that_waits_is_not_stopped_and_threads_need_no_clock(monkeypatch):
    monkeypatch.setattr(grader.check, "DEADLINE", 0.05)

    def mine(x):
        time.sleep(0.1)
        return 2.0 * x

    assert judge(EXERCISE, mine)[0] == "passed"
    states = []
    thread = threading.Thread(target=lambda: states.append(judge(EXERCISE, _double)[0]))
    thread.start()
    thread.join()
    assert states == ["passed"]


def test_html_says_state_in_words_and_escapes_what_it_shows():
    verdict = Verdict(EXERCISE, "failed", "<script>alert(1)</script>", "note & more", "<b>")
    page = verdict._repr_html_()
    assert "Not right yet" in page and "✘" in page
    assert "Double &lt;it&gt;" in page and "<script>" not in page and "<pre>&lt;b&gt;</pre>" in page
    assert "note &amp; more" in page


def test_badges_are_readable():
    """WCAG AA asks for a contrast of 4.5 between white text and its background."""

    def luminance(colour):
        channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    for _, _, colour in grader.check.STATES.values():
        assert 1.05 / (luminance(colour) + 0.05) >= 4.5


def test_hints_come_in_turn_and_the_last_stays(check, capsys):
    for _ in range(4):
        check.hint("double")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("): ")[1] for line in lines] == ["Nudge.", "Push.", "$2x$", "$2x$"]
    assert lines[0].startswith("**Hint 1 of 3**") and lines[3].startswith("**Hint 3 of 3**")


def test_names_that_do_not_exist_are_the_notebooks_fault(check):
    with pytest.raises(ValueError, match="no exercise 'triple'; there are: double, missing"):
        check("triple", _double)
    with pytest.raises(ValueError, match="no exercises for unit 'nowhere'"):
        Checker("nowhere")


def test_in_a_kernel_a_check_shows_html_and_text(tmp_path):
    """As a student sees it: the display has both forms, and the traceback's line is the cell's."""
    import nbformat
    from nbclient import NotebookClient

    cells = [
        'from grader.check import Checker\ncheck = Checker("vacuum")',
        "def bounce_noise(p, v_bar):\n    return v * p",
        'bounce_noise = check("bounce-noise", bounce_noise)',
        "print(bounce_noise(0.5, 1.0))",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    NotebookClient(notebook, kernel_name="python3", timeout=120).execute(cwd=str(tmp_path))
    (shown,) = notebook.cells[2].outputs
    assert set(shown.data) == {"text/html", "text/plain"}
    assert shown.data["text/plain"].splitlines()[:3] == [
        "⚠ Stopped by an exception: Draw the bounce noise",
        "    NameError: name 'v' is not defined",
        "    in bounce_noise, line 2: return v * p",
    ]
    assert notebook.cells[3].outputs[0].text == "0.0\n"
