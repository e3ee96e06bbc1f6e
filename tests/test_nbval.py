"""The solutions run again under nbval, changes that must turn it red, and the students' copies run from top to bottom.

nbval passes a cell that was never run and ignores pictures; tests/test_solutions.py demands what makes up for that.
"""

import copy
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import nbformat
import pytest

from lab.checks import QUESTIONS
from lab.release import as_text
from lab.release.regions import HIDDEN_TESTS, regions
from lab.release.student import TEXT_STUB

ROOT = Path(__file__).resolve().parents[1]
NAMES = sorted({question.notebook for question in QUESTIONS})
AT_ONCE = 2  # processors of a small machine
pytestmark = pytest.mark.xdist_group("nbval")  # one worker: its notebooks are run once
OPTIONS = ["--nbval", "--nbval-current-env", "--nbval-sanitize-with", ROOT / "solutions" / "nbval.cfg"]
OPTIONS += ["--nbval-cell-timeout", "120", "-p", "no:cacheprovider", "--color=no", "-q", "--tb=no"]


def nbval(*arguments, cwd=ROOT, path=""):
    """Return the exit status of pytest --nbval and the numbers of the code cells that failed."""
    command = [sys.executable, "-m", "pytest", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTEST_ADDOPTS", None)
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=590)
    failed = {int(number) for number in re.findall(r"^(?:FAILED|ERROR) .*::Cell (\d+)", done.stdout, re.MULTILINE)}
    return done.returncode, failed, done.stdout[-3000:] + done.stderr[-2000:]


@pytest.fixture(scope="module")
def graded():
    """All solutions under nbval, as many at once as there are processors; each is waited for in its own test."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        longest_first = sorted(NAMES, key=lambda name: name[:2] not in ("03", "04", "06"))
        yield {name: pool.submit(nbval, *OPTIONS, f"solutions/{name}.ipynb") for name in longest_first}


@pytest.mark.parametrize("name", NAMES)
def test_a_solution_gives_its_stored_outputs_again(graded, name):
    status, failed, said = graded[name].result()
    assert status == 0, said
    assert not failed


def read(name, folder="solutions"):
    return nbformat.read(ROOT / folder / f"{name}.ipynb", as_version=4)


def put(tmp_path, name, notebook):
    """Write a notebook where nbval finds it; the pictures to expect are found in the checkout all the same."""
    path = tmp_path / f"{name}.ipynb"
    path.write_text(as_text(notebook), encoding="utf-8")
    return path


def numbered(notebook):
    """Yield nbval's numbers of the code cells with the cells."""
    return enumerate(cell for cell in notebook.cells if cell.cell_type == "code")


def with_a_digit_changed(notebook):
    """Change the last digit in the outputs of every cell that has one; return which cells these are."""
    changed = set()
    for number, cell in numbered(notebook):
        for output in cell.outputs:
            where, field = (output, "text") if "text" in output else (output.get("data", {}), "text/plain")
            text = where.get(field, "")
            last = re.search(r"\d(?=\D*\Z)", text)
            if last:
                where[field] = text[: last.start()] + str((int(last[0]) + 1) % 10) + text[last.end() :]
                changed.add(number)
                break
    return changed


def sparing(names):
    """Mark all but the first as long: what one of them shows, the others confirm."""
    return [names[0], *(pytest.param(name, marks=pytest.mark.long) for name in names[1:])]


@pytest.mark.parametrize("name", sparing(["02_sis", *(name for name in NAMES if name != "02_sis")]))
def test_a_digit_changed_in_a_stored_output_turns_its_cell_red_and_no_other(tmp_path, name):
    notebook = read(name)
    changed = with_a_digit_changed(notebook)
    path = put(tmp_path, name, notebook)
    (tmp_path / "conftest.py").touch()
    status, failed, said = nbval(*OPTIONS, "--rootdir", tmp_path, "-c", ROOT / "pyproject.toml", path)
    assert status == 1, said
    assert failed == changed
    assert len(changed) >= sum(question.notebook == name and question.kind == "code" for question in QUESTIONS)


SIGNS = [  # file, what stands there, what it becomes, and a notebook that must notice
    ("lab/gaussian.py", "return np.asarray(-0.5 *", "return np.asarray(0.5 *", 2),
    ("lab/gaussian.py", "left = np.eye(len(cov)) - K @ H", "left = np.eye(len(cov)) + K @ H", 5),
    ("lab/gaussian.py", "left = cov - spread @ spread.T", "left = cov + spread @ spread.T", 5),
    ("lab/solvers/plan.py", "constants[k] = -np.log(np.diag(L)).sum()", "constants[k] = np.log(np.diag(L)).sum()", 5),
    ("lab/solvers/blocked.py", "logs[rows] -= square", "logs[rows] += square", 5),
    ("lab/solvers/steps.py", "to_y = -H[:, :a] @", "to_y = H[:, :a] @", 5),
    ("lab/solvers/steps.py", "z - H @ path", "z + H @ path", 5),
    ("lab/solvers/steps.py", "-H[:, a:],", "H[:, a:],", 3),
    ("lab/solvers/clones.py", "x -= means[:, :, np.newaxis]", "x += means[:, :, np.newaxis]", 5),
    ("lab/solvers/clones.py", "second / total - np.outer", "second / total + np.outer", 3),
    ("lab/resampling.py", "scaled -= shifts", "scaled += shifts", 3),
    ("lab/metrics.py", "(filtered.means - exact.means)[1:]", "(filtered.means + exact.means)[1:]", 3),
    ("lab/metrics.py", "(filtered.covs - exact.covs)[1:]", "(filtered.covs + exact.covs)[1:]", 3),
    ("lab/consistency.py", "truth[k] - filtered.means[k], filtered", "truth[k] + filtered.means[k], filtered", 1),
    ("lab/theory.py", "2 * log_mean - log_square", "2 * log_mean + log_square", 2),
    ("lab/checks/reference.py", "return means - reach, means + reach", "return means + reach, means - reach", 2),
    ("lab/ekfslam/frames.py", "P_F[..., 0, 2] = -turned[..., 1]", "P_F[..., 0, 2] = turned[..., 1]", 6),
    ("lab/ekfslam/filters.py", "J @ (r[:2] - robot.prior[:2])", "-J @ (r[:2] - robot.prior[:2])", 6),
    ("lab/ekfslam/filters.py", "R_n[:2] - np.outer(J @ r[:2]", "R_n[:2] + np.outer(J @ r[:2]", 6),
    ("lab/checks/ekf_recipes.py", "Z, z: P - K @ Z @ K.T", "Z, z: P + K @ Z @ K.T", 6),
    ("data_simulation.py", "np.array((-o[1], o[0]))", "np.array((o[1], o[0]))", 1),
]


def test_the_signs_to_flip_are_all_there():
    for file, before, _, _ in SIGNS:
        assert (ROOT / file).read_text(encoding="utf-8").count(before) == 1, (file, before)


@pytest.mark.parametrize("sign", sparing(SIGNS), ids=lambda sign: f"{sign[0]}: {sign[1]}")
def test_a_sign_flipped_in_the_laboratory_turns_a_solution_red(tmp_path, sign):
    file, before, after, number = sign
    shutil.copytree(ROOT / "lab", tmp_path / "lab", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "data_simulation.py", tmp_path)
    changed = tmp_path / file
    changed.write_text(changed.read_text(encoding="utf-8").replace(before, after), encoding="utf-8")
    name = NAMES[number - 1]
    path = put(tmp_path, name, read(name))
    status, failed, said = nbval(
        *OPTIONS, "-x", "--rootdir", tmp_path, "-c", ROOT / "pyproject.toml", path, path=tmp_path
    )
    assert status == 1, said
    assert failed


def as_graded(name):
    """Return the student's copy with the hidden part of every check in a cell after it, and these cells' ids."""
    notebook, hidden = read(name, "notebooks"), []
    found = {cell.id: cell for cell in read(name).cells}
    result = copy.deepcopy(notebook)
    result.cells = []
    for cell in notebook.cells:
        result.cells.append(cell)
        parts = regions(found[cell.id].source, name).get(HIDDEN_TESTS, [])
        for part in parts:
            hidden.append(f"{cell.id}-hidden")
            result.cells.append(nbformat.v4.new_code_cell(part, id=hidden[-1]))
    return result, hidden


EXECUTE = """
import sys
from pathlib import Path
from lab.release import as_text, read_notebook
from lab.release.execute import run
path = Path(sys.argv[1])
notebook = read_notebook(path)
run(notebook, Path("notebooks"), go_on=True)
path.write_text(as_text(notebook), encoding="utf-8")
"""  # in a process of its own: the sockets of a kernel that ran here would be closed too late


@pytest.fixture(scope="module")
def untouched(tmp_path_factory):
    """Every student's copy, run as it is, with the hidden tests beside it."""

    folder = tmp_path_factory.mktemp("untouched")

    def execute(name):
        notebook, hidden = as_graded(name)
        path = put(folder, name, notebook)
        done = subprocess.run(
            [sys.executable, "-c", EXECUTE, path], cwd=ROOT, capture_output=True, text=True, timeout=590
        )
        assert done.returncode == 0, done.stderr[-2000:]
        return nbformat.read(path, as_version=4), hidden

    return cache(execute)


COPIES = sparing(["03_sir", *(name for name in NAMES if name != "03_sir")])


@pytest.mark.parametrize("name", COPIES)
def test_an_untouched_copy_runs_through_and_earns_nothing(untouched, name):
    notebook, hidden = untouched(name)
    errors = {cell.id: output for cell in notebook.cells for output in cell.get("outputs", []) if "ename" in output}
    assert not {key: output.evalue for key, output in errors.items() if key not in hidden}
    assert sorted(errors) == sorted(hidden)  # each check that gives points fails
    assert {output.ename for output in errors.values()} == {"AssertionError"}
    assert len(hidden) == sum(question.notebook == name and question.kind == "code" for question in QUESTIONS)
    words = [cell.source for cell in notebook.cells if cell.metadata.get("nbgrader", {}).get("solution")]
    assert [
        text for text in words if "BEGIN" not in text and (TEXT_STUB in text or "NotImplementedError" in text)
    ] == words


@pytest.mark.parametrize("name", COPIES)
def test_an_untouched_copy_says_what_to_do_and_shows_what_to_expect(untouched, name):
    notebook, _ = untouched(name)
    found = {cell.id: cell for cell in notebook.cells}
    for question in QUESTIONS:
        if question.notebook == name and question.kind == "code":
            said = str(found[f"{question.key}-test"].outputs)
            assert "not answered yet" in said
            shown = str(found[f"{question.key}-show"].outputs)
            assert re.search(r"Q\d+[a-d]? not answered yet\. Write `\w+` in its cell above", shown), question.key
            assert '<img alt="Expected: ' in shown
    for cell in notebook.cells:  # a comparison would go on after an answer that is a stub
        if "with demonstration(" in cell.source:
            assert "not answered yet" in str(cell.outputs), cell.source
