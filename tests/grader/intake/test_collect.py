"""From files to programs, without executing any."""

import json
import os

import pytest

from grader.intake import collect
from grader.intake.submission import Submission
from tests.grader.intake.handing_in import ASSIGNMENT, GOOD, SIGNATURE, notebook, one

pytestmark = pytest.mark.usefixtures("one_reader")


@pytest.mark.parametrize(
    "source",
    [
        GOOD,
        "def Estimator(a, b, c, d, e, extra=1): pass",
        "def Estimator(*args): pass",
        "def Estimator(a, b, *rest, key=1, **more): pass",
        "class Filter:\n    def __call__(self, *a): pass\nEstimator = Filter()",
        "from math import sin as Estimator",
        "try:\n    import numba\nexcept ImportError:\n    def Estimator(a, b, c, d, e): pass",
        "import functools\n@functools.lru_cache\ndef Estimator(): pass",
        "def Estimator(): pass\n" + GOOD,
    ],
)
def test_accepts_whatever_can_be_called_with_the_parameters(tmp_path, source):
    submission, _ = one(tmp_path, "ana.py", source)
    assert submission == Submission("ana", str(tmp_path / "ana.py"), source)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("def Estimator(prev, obs): pass", f"line 1: defines Estimator(prev, obs): expected {SIGNATURE}"),
        ("def Estimator(a, b, c, d, e, f): pass", "defines Estimator(a, b, c, d, e, f): expected"),
        ("def Estimator(a, b, c, d, *, e): pass", "defines Estimator(a, b, c, d, *, e): expected"),
        ("async " + GOOD, "line 1: Estimator is an async function"),
        (GOOD + "def Estimator(): pass", "line 3: defines Estimator(): expected"),
        ("", f"defines no Estimator at its top level: please define {SIGNATURE}"),
        ("def estimator(): pass", "rename estimator"),
        ("def make():\n    def Estimator(a, b, c, d, e): pass", "defines no Estimator"),
        ("[Estimator for Estimator in range(3)]", "defines no Estimator"),
        ("x = 1\ndef Estimator(:\n", "line 2: syntax error, invalid syntax: def Estimator(:"),
        ("return 3\n" + GOOD, "line 1: syntax error, 'return' outside function"),
        ("\0", "null bytes"),
        (b"\xff\xfe", "is not text in the encoding it claims"),
        (b"# coding: latin-17\n", "latin-17"),
        (b"# coding: punycode\n" + b"a-" * 9, "save it as UTF-8"),
        ("-" * 200_000 + "1", "nested too deeply"),
        ("#" * 1_000_001, "is larger than 1 MB"),
    ],
)
def test_refuses_in_one_line_that_says_what_to_do(tmp_path, source, reason):
    submission, told = one(tmp_path, "ana.py", source)
    assert submission is None
    assert reason in told
    assert "\n" not in told and len(told) <= 300


def test_reads_declared_encodings_and_byte_order_marks(tmp_path):
    submission, _ = one(tmp_path, "ana.py", b"# -*- coding: latin-1 -*-\nname = 'Zo\xeb'\n" + GOOD.encode())
    assert "Zoë" in submission.source
    submission, _ = one(tmp_path, "ben.py", b"\xef\xbb\xbf" + GOOD.encode())
    assert submission.source == GOOD


def test_nothing_is_executed(tmp_path):
    assert one(tmp_path, "ana.py", f"open({str(tmp_path / 'ran')!r}, 'w')\n" + GOOD)[0]
    assert one(tmp_path, "ben.ipynb", notebook(f"f = open({str(tmp_path / 'ran')!r}, 'w')", GOOD.replace("1", "f")))[0]
    assert not (tmp_path / "ran").exists()


def test_other_endings_and_missing_files_are_refused(tmp_path):
    assert "unknown file type .docx" in one(tmp_path, "ana.docx", b"PK")[1]
    assert "unknown file type (no ending)" in one(tmp_path, "ana", GOOD)[1]
    assert collect.gather([tmp_path / "absent.py"], ASSIGNMENT)[1][0].reason.startswith("no such file")


def test_a_folder_is_searched_for_programs_only(tmp_path):
    hidden = [".git/x.py", ".ipynb_checkpoints/x-checkpoint.ipynb", "__pycache__/x.py", "ana/._est.py"]
    for name in ["ben/est.py", "ana/est.PY", "ana/notes.txt", *hidden]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(GOOD)
    submissions, refusals = collect.gather([tmp_path], ASSIGNMENT)
    assert [s.name for s in submissions] == ["ana/est", "ben/est"]
    assert not refusals


def test_an_empty_folder_is_one_refusal(tmp_path):
    (tmp_path / "ana").mkdir()
    (tmp_path / "ana" / "notes.txt").write_text(GOOD)
    submissions, [refusal] = collect.gather([tmp_path], ASSIGNMENT)
    assert not submissions
    assert "holds no .py, .ipynb or .zip file" in refusal.reason


def test_links_out_of_the_folder_are_not_followed(tmp_path):
    outside, inside = tmp_path / "outside", tmp_path / "class"
    outside.mkdir()
    inside.mkdir()
    (outside / "secret.py").write_text(GOOD)
    (inside / "ana.py").symlink_to(outside / "secret.py")
    (inside / "folder").symlink_to(outside)
    submissions, [refusal] = collect.gather([inside], ASSIGNMENT)
    assert not submissions
    assert refusal.name == "ana" and "leads out of the folder" in refusal.reason


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "ana.py")
    assert "not a regular file" in collect.gather([tmp_path], ASSIGNMENT)[1][0].reason


def test_names_are_the_shortest_that_differ(tmp_path):
    files = ["ana/a/x.py", "ben/b/x.py", "ana/y.py", "z.py", "z.ipynb", "cem/z.py.py"]
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(notebook(GOOD) if name.endswith("ipynb") else GOOD.encode())
    submissions, _ = collect.gather([tmp_path], ASSIGNMENT)
    names = {os.path.relpath(s.path, tmp_path): s.name for s in submissions}
    assert names["ana/a/x.py"] == "ana/a/x" and names["ben/b/x.py"] == "ben/b/x"
    assert names["ana/y.py"] == "y" and names["z.ipynb"] == "z.ipynb"
    assert len(set(names.values())) == len(files)


def test_a_file_named_twice_is_one_submission(tmp_path):
    (tmp_path / "ana.py").write_text(GOOD)
    submissions, refusals = collect.gather([tmp_path, tmp_path / "ana.py"], ASSIGNMENT)
    assert len(submissions) == 1 and not refusals


def test_names_cannot_break_lines_or_encodings(tmp_path):
    path = os.fsencode(tmp_path) + b"/a\nb\xff\xe2\x80\xae.py"
    with open(path, "w") as file:
        file.write(GOOD)
    [submission], _ = collect.gather([tmp_path], ASSIGNMENT)
    assert submission.name == "a\\nb\\udcff\\u202e"
    submission.path.encode()


def test_a_notebook_keeps_what_the_entry_point_needs_and_nothing_else(tmp_path):
    submission, _ = one(
        tmp_path,
        "ana.ipynb",
        notebook(
            "%matplotlib inline\nimport numpy as np\nimport matplotlib.pyplot as plt\nfrom grader.check import check",
            "from __future__ import annotations\nSIZE = 100; SEED = experiment()",
            "def bounce_noise(p):\n    return np.cbrt(p)",
            "bounce_noise = check('bounce-noise', bounce_noise)",
            "%%time\ndef step(x):\n    # SEED is local\n    SEED = x\n    return bounce_noise(SEED)\nplt.plot(step(1))",
            "%%bash\nrm -rf /",
            "table = {}\nfor i in range(SIZE):\n    table[i] = step(i)\nplt.imshow(table)",
            f"def {SIGNATURE}:\n    return table",
            "files = !ls\nnp.cbrt?\nrun = World().simulate(rng)\nplt.show()",
            "Estimator = check('estimator', Estimator)",
        ),
    )
    expected = [
        "# code cell 2\nfrom __future__ import annotations",
        "# code cell 1\nimport numpy as np",
        "# code cell 2\nSIZE = 100",
        "# code cell 3\ndef bounce_noise(p):\n    return np.cbrt(p)",
        "# code cell 5\ndef step(x):\n    # SEED is local\n    SEED = x\n    return bounce_noise(SEED)",
        "# code cell 7\ntable = {}",
        "for i in range(SIZE):\n    table[i] = step(i)",
        f"# code cell 8\ndef {SIGNATURE}:\n    return table",
    ]
    assert submission.source == "\n".join(expected) + "\n"


def test_a_notebook_keeps_decorators_stars_and_what_fills_a_table(tmp_path):
    submission, _ = one(
        tmp_path,
        "ana.ipynb",
        notebook(
            "import numba, json\nfrom math import *\nä = 'é'; rows = []",
            "@numba.njit\ndef kernel(x): return x",
            "for x in range(3):\n    rows.append(x)\njson.dumps(rows)",
            GOOD.replace("1", "kernel(sin(len(rows))), ä\nEstimator.cache = {}"),
        ),
    )
    lines = [line for line in submission.source.splitlines() if not line.startswith("#")]
    assert lines == [
        "import numba, json",
        "from math import *",
        "ä = 'é'",
        "rows = []",
        "@numba.njit",
        "def kernel(x): return x",
        "for x in range(3):",
        "    rows.append(x)",
        f"def {SIGNATURE}:",
        "    return kernel(sin(len(rows))), ä",
        "Estimator.cache = {}",
    ]


def test_an_imported_check_is_dropped_under_any_name(tmp_path):
    cells = ["from grader.check import check as verify\nimport grader", GOOD, "Estimator = verify('x', Estimator)"]
    submission, _ = one(tmp_path, "ana.ipynb", notebook(*cells, "Estimator = grader.check('x', Estimator)"))
    assert "verify" not in submission.source and "grader" not in submission.source


def test_a_modulo_at_the_start_of_a_line_is_no_magic(tmp_path):
    submission, _ = one(tmp_path, "ana.ipynb", notebook(GOOD.replace("1", "(7\n% 4)")))
    assert "% 4)" in submission.source


def test_a_broken_cell_matters_only_when_the_entry_point_needs_it(tmp_path):
    broken = "x = 1\ndef helper(:\n    pass"
    assert one(tmp_path, "ana.ipynb", notebook(broken, GOOD))[0]
    _, reason = one(tmp_path, "ben.ipynb", notebook(broken, GOOD.replace("1", "helper()")))
    assert reason.startswith("line 2: syntax error, invalid syntax in code cell 1: def helper(:")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"not json", "is not a notebook (not JSON)"),
        (b"[" * 200_000, "nested too deeply"),
        (b"[]", "no nbformat"),
        (json.dumps({"nbformat": 3, "worksheets": []}).encode(), "old notebook format 3"),
        (notebook(), "has no code cells"),
        (notebook("", " \n"), "has no code cells"),
        (notebook("x = 1"), f"defines no Estimator at its top level: please define {SIGNATURE}"),
        (notebook("def Estimator(prev, obs): pass"), "defines Estimator(prev, obs): expected"),
        (notebook("%%bash\n" + GOOD), "defines no Estimator"),
        (notebook("#" * 1_000_001), "its code cells hold more than 1 MB"),
        (notebook('Estimator = "\ud800"'), "syntax error"),
    ],
)
def test_notebooks_without_a_program_are_refused(tmp_path, content, reason):
    submission, told = one(tmp_path, "ana.ipynb", content)
    assert submission is None
    assert reason in told and "\n" not in told
