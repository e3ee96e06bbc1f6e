"""What a person types becomes the solver that was meant, or one sentence."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from worlds import problem

from lab.solvers import SOLVERS, resolve, sir
from lab.validation import InputError

FILTERS = """
from neighbour import factor
from lab.result import Filtered
from lab.solvers import sir

def my_sir(problem, rng, *, n_particles, ess_threshold=0.5):
    return sir(problem, rng, n_particles=n_particles * factor, ess_threshold=ess_threshold)

def too_few(problem):
    pass

def anything(*args, **options):
    return sir(*args, **options)

number = 3
"""


@pytest.fixture
def filters(tmp_path):
    (tmp_path / "neighbour.py").write_text("factor = 1\n")
    file = tmp_path / "my_filters.py"
    file.write_text(FILTERS)
    return file


def test_names():
    assert resolve("sir") == ("sir", SOLVERS["sir"])
    assert resolve(" low=sir ") == ("low", SOLVERS["sir"])


def test_options_are_bound_with_their_types():
    label, solver = resolve("low=sir:ess_threshold=0.2:resample=residual")
    assert label == "low"
    assert solver.func is sir
    assert solver.keywords == {"ess_threshold": 0.2, "resample": "residual"}
    assert resolve("sir:ess_threshold=1")[0] == "sir:ess_threshold=1"


def test_a_students_function(filters):
    label, solver = resolve(f"mine={filters}:my_sir:ess_threshold=1")
    assert label == "mine"
    answer = solver(problem(), np.random.default_rng(0), n_particles=20)
    expected = sir(problem(), np.random.default_rng(0), n_particles=20, ess_threshold=1)
    np.testing.assert_array_equal(answer.means, expected.means)
    assert resolve(f"{filters}:my_sir")[0] == "my_sir"
    assert resolve(f"{filters}:anything:ess_threshold=0.1")[0] == "anything:ess_threshold=0.1"


def test_a_students_function_is_found_again_in_another_process(filters):
    _, solver = resolve(f"{filters}:my_sir")
    code = (
        "import pickle, sys, numpy as np; solver, problem = pickle.load(sys.stdin.buffer);"
        "print(solver(problem, np.random.default_rng(0), n_particles=5).means.shape)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=pickle.dumps((solver, problem())),
        capture_output=True,
        check=True,
        cwd=Path(__file__).parent.parent,
    )
    assert done.stdout.split() == [b"(50,", b"12)"]


def test_two_students_may_have_neighbours_of_one_name(tmp_path):
    code = "from utils import number\nfrom lab.solvers import sir\n\n\ndef f(problem, rng, *, n_particles):\n"
    code += "    import later\n    return sir(problem, rng, n_particles=number + later.number)\n"
    before = list(sys.path)
    for name, size in (("alice", 3), ("bob", 5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "utils.py").write_text(f"number = {size}\n")
        (tmp_path / name / "later.py").write_text(f"number = {10 * size}\n")
        (tmp_path / name / "my.py").write_text(code)
    solvers = [resolve(f"{tmp_path / name / 'my.py'}:f")[1] for name in ("alice", "bob")]
    for solver, expected in (*zip(solvers, (33, 55), strict=True), (solvers[0], 33)):
        assert solver(problem(), np.random.default_rng(0), n_particles=1).ess[0] == pytest.approx(expected)
    assert sys.path == before
    assert "utils" not in sys.modules


def test_a_path_as_windows_writes_it():
    with pytest.raises(InputError, match="does not exist"):
        resolve(r"mine=C:\students\my_filters.py:my_sir:ess_threshold=0.2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bogus", f"Unknown solver 'bogus'; known are {', '.join(SOLVERS)}, or your own as FILE.py:FUNCTION"),
        ("", "Cannot read ''"),
        ("sir:", "Cannot read 'sir:'"),
        ("sir:ess_threshold", "Cannot read 'sir:ess_threshold'"),
        ("my filter=sir", "Cannot read 'my filter=sir'"),
        ("sir:threshold=1", "unexpected keyword argument 'threshold'.*its options are ess_threshold, resample"),
        ("sis:resample=residual", "its options are backend"),
        ("sir:n_particles=5", "n_particles"),
        ("sir:problem=5", "problem"),
        ("absent.py:f", "absent.py does not exist"),
        ("{file}:no_such", "has no function named no_such"),
        ("{file}:number", "has no function named number"),
        ("{file}:too_few", "called as solver"),
        ("{file}:my_sir:power=3", "unexpected keyword argument 'power'.*its options are ess_threshold"),
    ],
)
def test_bad_specifications(filters, text, message):
    with pytest.raises(InputError, match=message):
        resolve(text.format(file=filters))


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("1 / 0", "cannot be imported: ZeroDivisionError"),
        ("def f(:", "cannot be imported: SyntaxError"),
        ("import no_such_module_anywhere", "cannot be imported: ModuleNotFoundError"),
        ("import sys; sys.exit(3)", "cannot be imported: SystemExit"),
    ],
)
def test_files_that_cannot_be_imported(tmp_path, code, message):
    file = tmp_path / "broken.py"
    file.write_text(code)
    with pytest.raises(InputError, match=message):
        resolve(f"{file}:f")
