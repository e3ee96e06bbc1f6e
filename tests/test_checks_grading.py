"""What is handed in: read in pieces, judged in child processes, told on a terminal and in a table."""

import json
import os
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
import pytest
from program import call, start

from lab.checks import grading, submission
from lab.checks.grading import Limits, grade, questions_of
from lab.checks.questions import BY_KEY
from lab.checks.submission import Submission, cells, find, load
from lab.validation import InputError

ESS = "import numpy as np\ndef effective_sample_size(weights):\n    return 1 / np.sum(weights**2)\n"
WRONG_ESS = ESS.replace("1 / np", "np")
MOMENTS = "def moments(particles, weights):\n    mean = particles @ weights\n    d = particles - mean[:, None]\n    return mean, (d * weights) @ d.T\n"  # noqa: E501
GAP = "def mean_gap(filtered, exact):\n    d = (filtered.means - exact.means)[1:] / exact.stds[1:]\n    return np.sqrt(np.mean(d**2))\n"  # noqa: E501
SIR_STEP = """
def sis_step(particles, weights, noise, z, H, R, model):
    raise NotImplementedError


def select_ancestors(weights, points):
    return np.searchsorted(np.cumsum(weights), points)


def sir_step(particles, weights, noise, points, z, H, R, model, threshold):
    P = len(weights)
    if effective_sample_size(weights) <= threshold * P:
        particles, weights = particles[:, select_ancestors(weights, points)], np.ones(P) / P
    return sis_step(particles, weights, noise, z, H, R, model)
"""


def notebook(*sources: str, language: str = "code") -> str:
    made = [{"cell_type": language, "metadata": {}, "outputs": [], "source": source} for source in sources]
    words = {"cell_type": "markdown", "metadata": {}, "source": "def not_code(:"}
    return json.dumps({"cells": [words, *made], "metadata": {}, "nbformat": 4, "nbformat_minor": 5})


def graded(path, *keys, **limits):
    (handed_in,) = find(path)
    return {v.question: v for v in grade(handed_in, [BY_KEY[key] for key in keys], limits=Limits(**limits)).verdicts}


@pytest.fixture(autouse=True)
def _forget_what_submissions_import(monkeypatch):
    """A submission is loaded in a process of its own; here its neighbours must not be found by other tests."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in {"utils"} & (set(sys.modules) - before):
        del sys.modules[name]


@pytest.fixture
def handed_in(tmp_path):
    def write(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


# reading


def loaded(handed_in, *sources):
    path = handed_in("a.ipynb", notebook(*sources))
    return load(Submission("a", (path,)))


def test_a_cell_that_fails_leaves_the_others(handed_in):
    found = loaded(
        handed_in, "1 / 0\nx = 1 / 0", "def f(:\n    pass", "y = 3\ndef g():\n    return y", "%matplotlib inline\nz = 4"
    )
    assert found.scope["g"]() == 3
    assert found.scope["z"] == 4
    assert any("ZeroDivisionError" in fault for fault in found.faults)
    assert any("SyntaxError" in fault for fault in found.faults)


def test_a_syntax_error_takes_its_own_function_only(handed_in):
    path = handed_in("a.py", f"{ESS}\ndef broken(x)\n    return 3\n\n@staticmethod\ndef after():\n    return 5\n")
    found = load(Submission("a", (path,)))
    assert {"effective_sample_size", "after"} <= set(found.scope)
    assert any("(in broken)" in fault for fault in found.faults)


def test_bare_expressions_are_not_run(handed_in):
    found = loaded(handed_in, "results = []\nresults.append(1)\nprint('a')")
    assert found.scope["results"] == []


def test_magics_do_not_hide_a_cell(handed_in):
    found = loaded(
        handed_in, "%%time\ndef f():\n    return 1", "!pip list\nf?\ndef g():\n    return 7 \\\n    % 4", "%%bash\nls"
    )
    assert found.scope["f"]() == 1
    assert found.scope["g"]() == 3


def test_a_formula_may_go_on_with_an_operator_that_looks_like_a_magic(handed_in):
    formula = "def f(a, b):\n    return (\n        a\n        != b\n    )\ndef g(a, b):\n    return (a\n        %b)"
    for cell in (formula, f"%matplotlib inline\n{formula.partition('def g')[0]}"):
        found = loaded(handed_in, cell)
        assert found.scope["f"](1, 2)
        assert not found.faults
    assert loaded(handed_in, formula).scope["g"](7, 4) == 3


def test_checks_and_demonstrations_are_not_run(handed_in):
    """Each takes seconds, and is waited for in the child of every question; what has their names is run."""
    own = "def demonstration(key):\n    return open(os.devnull)\ndef check(x):\n    return x + 1"
    imports = "import os\nfrom lab.checks import check\nfrom lab.notebook import demonstration"
    shown = "with demonstration('q5'):\n    shown = 1\nverdict = check('q5', None)\nassert verdict.passed"
    found = loaded(handed_in, imports, shown)
    assert not {"shown", "verdict"} & set(found.scope)
    assert not found.faults
    found = loaded(handed_in, imports, own, "with demonstration('q5'):\n    shown = 1\nHALF = check(2)")
    assert (found.scope["shown"], found.scope["HALF"]) == (1, 3)


def test_of_a_cell_that_draws_only_definitions_are_run(handed_in):
    """Some of the course's own compute for seconds, outside a demonstration."""
    source = json.loads(
        notebook("import math\nruns = 1 / 0\nfor i in range(3):\n    pass\ndef f():\n    return math.pi")
    )
    source["cells"][1]["id"] = "switch-show"
    found = load(Submission("a", (handed_in("a.ipynb", json.dumps(source)),)))
    assert not found.faults
    assert found.scope["f"]() > 3
    assert "i" not in found.scope


def test_ones_own_function_goes_before_an_import_of_the_same_name(handed_in):
    found = loaded(handed_in, "def sir():\n    return 'mine'", "from lab.solvers import sir")
    assert found.answer("sir")() == "mine"


def test_neighbours_and_dataclasses(handed_in):
    handed_in("utils.py", "FACTOR = 2\n")
    found = loaded(
        handed_in,
        "from __future__ import annotations\nfrom dataclasses import dataclass\nfrom utils import FACTOR",
        "@dataclass\nclass Cloud:\n    w: list\ndef f():\n    return Cloud([FACTOR]).w",
    )
    assert found.scope["f"]() == [2]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"cells": 3}', '{"cells": ["a"]}'])
def test_what_is_no_notebook(handed_in, text):
    with pytest.raises(InputError, match=r"a\.ipynb is not a notebook"):
        cells(handed_in("a.ipynb", text))


def test_what_is_found_in_a_folder(handed_in, tmp_path):
    for name in ("anna.py", "berta/01.ipynb", "berta/02.ipynb", ".hidden/x.py", "carl/__pycache__/x.py", "notes.txt"):
        handed_in(name, notebook("x = 1") if name.endswith("b") else "x = 1")
    found = find(tmp_path)
    assert [one.name for one in found] == ["anna.py", "berta"]
    assert [file.name for file in found[1].files] == ["01.ipynb", "02.ipynb"]


def test_which_questions_are_asked(handed_in):
    only_02 = {question.notebook[:2] for question in questions_of(*find(handed_in("a.py", ESS)))}
    assert only_02 == {"02"}
    assert len(questions_of(*find(handed_in("b.py", "x = 1")))) == 34


# judging


def test_right_wrong_and_missing(handed_in):
    path = handed_in("a.ipynb", notebook(WRONG_ESS, MOMENTS))
    verdicts = graded(path, "q5", "q4a", "q4-step")
    assert verdicts["q5"].mistake == "ess-inverse"
    assert verdicts["q4a"].passed
    assert (verdicts["q4-step"].answered, verdicts["q4-step"].passed) == (False, False)


def test_a_name_that_was_mistyped_is_told(handed_in):
    path = handed_in("a.py", ESS.replace("effective_sample_size", "efective_sample_size") + MOMENTS)
    verdict = graded(path, "q5")["q5"]
    assert verdict.reason == "There is no function effective_sample_size yet; did you mean efective_sample_size?"
    assert not verdict.passed


def test_an_answer_is_judged_with_right_helpers(handed_in):
    """Neither the wrong effective sample size nor the missing step fails the resampling."""
    path = handed_in("a.py", WRONG_ESS + SIR_STEP)
    verdict = graded(path, "q6-step")["q6-step"]
    assert verdict.passed, verdict
    assert verdict.notes == (
        "judged with the laboratory's effective_sample_size, sis_step, since that of the submission fails",
    )


def test_a_wrong_answer_stays_wrong_with_right_helpers(handed_in):
    wrong = SIR_STEP.replace("<= threshold * P", "> threshold * P")
    verdict = graded(handed_in("a.py", WRONG_ESS + wrong), "q6-step")["q6-step"]
    assert verdict.mistake == "test-inverted"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("    import os\n    os._exit(0)", "it ended Python itself (status 0) instead of returning"),
        ("    import os, signal\n    os.kill(os.getpid(), signal.SIGKILL)", "was killed (signal 9)"),
        ("    return np.zeros((200_000, 200_000)).sum()", "MemoryError"),
        ("    input()", "EOFError"),
        (
            "    open('left', 'w').close()\n    print('x' * 10**6)\n    return 1 / np.sum(weights**2)",
            "public checks passed",
        ),
    ],
)
def test_a_child_bears_everything(handed_in, tmp_path, body, words):
    path = handed_in("a.py", f"import numpy as np\ndef effective_sample_size(weights):\n{body}\n{MOMENTS}")
    verdicts = graded(path, "q5", "q4a", seconds=25.0)
    assert words.lower() in verdicts["q5"].reason.lower()
    assert verdicts["q4a"].passed
    assert not (tmp_path / "left").exists()


def test_a_child_that_no_timer_stops_is_killed(handed_in, monkeypatch):
    """A loop inside compiled code never looks at signals."""
    monkeypatch.setattr(grading, "STARTING", 0.0)
    path = handed_in("a.py", "def effective_sample_size(weights):\n    return sum(iter(int, 1))\n")
    verdict = graded(path, "q5", seconds=15.0)["q5"]
    assert verdict.reason == "It did not come back within 15 s, and was stopped."


@pytest.mark.parametrize(
    "body",
    [
        "    return 1 / (weights**2).sum()",
        "    import os\n    os._exit(0)",
        "    import os, signal\n    os.kill(os.getpid(), signal.SIGKILL)",
    ],
)
def test_nothing_is_left_of_a_child(handed_in, tmp_path, monkeypatch, body):
    """Neither its folder, nor a process that it has started, nor the compiled files of its neighbours."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    handed_in(
        "a/neighbour.py", "import subprocess, sys\nCOMMAND = [sys.executable, '-c', 'import time; time.sleep(60)']"
    )
    start = "from neighbour import COMMAND, subprocess\nsleeper = subprocess.Popen(COMMAND)\n"
    note = f"open({str(tmp_path / 'pid')!r}, 'w').write(str(sleeper.pid))"
    path = handed_in("a/a.py", f"{start}def effective_sample_size(weights):\n    {note}\n{body}\n")
    graded(path, "q5")
    assert not list((tmp_path / "temporary").iterdir())
    assert sorted(file.name for file in (tmp_path / "a").iterdir()) == ["a.py", "neighbour.py"]
    sleeper, deadline = int((tmp_path / "pid").read_text()), time.monotonic() + 10
    while _alive(sleeper) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(sleeper)


def _alive(process):
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        os.kill(process, 0)
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_submission_that_hangs_when_loaded(handed_in, monkeypatch):
    monkeypatch.setattr(submission, "STATEMENT_SECONDS", 0.3)
    found = loaded(handed_in, "while True:\n    pass", ESS)
    assert "effective_sample_size" in found.scope
    assert any("did not come back" in fault for fault in found.faults)


# the command


def test_the_command_on_a_file(handed_in):
    path = handed_in("a.py", WRONG_ESS + MOMENTS)
    done = call("check", path, "--questions", "q5,q4a")
    assert done.status == 1
    assert done.err == ""
    assert "[+] q4a passed: public checks passed (3/3)." in done.out
    assert "[x] q5 not passed: This is the sum of the squared weights itself." in done.out
    assert "public checks of 1 of 2 questions passed, 2 of 3 points" in done.out
    assert call("check", path, "--questions", "q4a").status == 0


def test_the_command_as_a_process(handed_in, tmp_path):
    path = handed_in("a.ipynb", notebook(ESS))
    done = start("check", path, "--questions", "q5", cwd=tmp_path)
    assert (done.status, done.err) == (0, "")
    assert not (tmp_path / "results").exists()


def test_the_command_on_a_folder(handed_in, tmp_path, here):
    folder = tmp_path / "class"
    handed_in("class/anna.py", ESS + GAP)
    handed_in("class/berta/03.ipynb", notebook(WRONG_ESS, "def mean_gap(filtered, exact)\n    return 3"))
    handed_in("class/carl.ipynb", "{")
    handed_in("class/dora.py", "\ufeff" + ESS)
    done = call("check", folder, "--questions", "q5,q8-gap", "--jobs", "2")
    assert done.status == 1
    assert "anna.py: public checks of 2 of 2 questions passed, 3 of 3 points" in done.out
    table = pd.read_csv(here / "results" / "check" / "checks.csv")
    assert table["submission"].tolist() == [
        name for name in ("anna.py", "berta", "carl.ipynb", "dora.py") for _ in "12"
    ]
    by_name = table.set_index(["submission", "question"])
    assert by_name.loc[("berta", "q5"), "mistake"] == "ess-inverse"
    assert "mean_gap could not be run" in by_name.loc[("berta", "q8-gap"), "reason"]
    assert by_name.loc[("carl.ipynb", "q5"), "status"] == "not answered yet"
    assert by_name["points"].tolist() == [1, 2, 0, 0, 0, 0, 1, 0]
    assert (here / "results" / "check" / "config.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["absent.py"], "absent.py does not exist"),
        (["notes.txt"], "notes.txt: a submission ends in .ipynb or .py"),
        (["empty"], "empty holds no .ipynb and no .py"),
        (["broken.ipynb"], "broken.ipynb is not a notebook: its JSON cannot be read"),
        (["a.py", "--questions", "q77"], "There is no question 'q77'"),
        (["a.py", "--questions", "q1a"], "q1a asks for a text"),
        (["a.py", "--seconds", "0"], "--seconds must be positive"),
        (["a.py", "--jobs", "0"], "--jobs must be at least 1"),
        (["a.py", "--memory", "5"], "--memory must be at least 512"),
        ([""], "the name is empty"),
    ],
)
def test_bad_input_is_one_sentence(here, arguments, words):
    (here / "notes.txt").write_text("x")
    (here / "empty").mkdir()
    (here / "broken.ipynb").write_text("{")
    (here / "a.py").write_text(ESS)
    call("check", *arguments).assert_refused(words)
    assert not (here / "results").exists()
