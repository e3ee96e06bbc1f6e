"""The floors of the house: imports only go down, inside functions and under TYPE_CHECKING too.

A module belongs to the longest name of FLOORS that begins its own; a module that no name covers fails.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

FLOORS = {
    "data_simulation": 0,
    "lab": 0,  # lab/__init__.py itself: every import of a module runs it, so it imports nothing
    "lab.errors": 0,
    "lab.validation": 0,
    "lab.gaussian": 1,
    "lab.weights": 1,
    "lab.resampling": 1,
    "lab.fast": 1,
    "lab.blocks": 1,
    "lab.triangle": 1,
    "lab.problem": 2,
    "lab.sparse": 2,
    "lab.simulation": 2,
    "lab.result": 2,
    "lab.records": 2,
    "lab.solvers": 3,
    "lab.theory": 3,
    "lab.ekfslam": 3,
    "lab.compare": 4,
    "lab.cluster": 4,
    "lab.comparison": 4,
    "lab.execution": 4,
    "lab.metrics": 4,
    "lab.units": 4,
    "lab.work": 4,
    "lab.workers": 4,
    "lab.progress": 4,
    "lab.warming": 4,
    "lab.consistency": 4,
    "lab.plots": 4,
    "lab.cli": 5,
    "lab.sweep": 5,
    "lab.ledger": 5,
    "lab.findings": 5,
    "lab.report": 5,
    "lab.checks": 5,
    "lab.release": 5,
    "lab.notebook": 5,
    "lab.given": 5,
    "lab.ekfslam.app": 5,
    "lab.ekfslam.app_data": 5,
    "lab.ekfslam.app_data_report": 5,
    "lab.ekfslam.app_report": 5,
    "lab.__main__": 5,
}
# One way only, within a floor.
SIDEWAYS = {
    "lab.validation": {"lab.errors"},
    "lab.problem": {"lab.records"},  # Experiment.load and save
    "lab.sparse": {"lab.problem"},  # the same, with matrices
    "lab.simulation": {"lab.problem", "lab.sparse"},
    "lab.compare": {
        *("lab.comparison", "lab.execution", "lab.metrics", "lab.progress", "lab.units", "lab.warming", "lab.work"),
    },
    "lab.units": {"lab.comparison"},
    "lab.work": {"lab.comparison", "lab.metrics", "lab.units"},
    "lab.execution": {"lab.workers"},
    "lab.warming": {"lab.workers"},
    "lab.cluster": {"lab.execution"},
    "lab.comparison": {"lab.metrics"},
    "lab.plots": {"lab.comparison"},  # a result
    "lab.theory": {"lab.solvers"},  # the laws of the proposals, and the exact moments
    "lab.cli": {
        *("lab.sweep", "lab.findings", "lab.report", "lab.checks", "lab.release"),
        *("lab.ekfslam.app", "lab.ekfslam.app_data", "lab.ekfslam.app_report", "lab.ekfslam.app_data_report"),
    },
    "lab.ekfslam.app_data": {"lab.ekfslam.app"},
    "lab.ekfslam.app_data_report": {"lab.ekfslam.app_data"},
    "lab.ekfslam.app_report": {"lab.ekfslam.app"},
    "lab.sweep": {"lab.ledger"},
    "lab.given": {"lab.checks"},
    "lab.notebook": {"lab.checks"},  # which function belongs to which question
    "lab.__main__": {"lab.cli"},
}
# Down, but never: ekfslam is a sister wing of the solvers, and figures know results only.
FORBIDDEN = {
    "lab.solvers": {f"lab.ekfslam{part}" for part in ("", ".app", ".app_data", ".app_report", ".app_data_report")},
    "lab.ekfslam": {"lab.solvers"},
    "lab.ekfslam.app": {"lab.solvers"},
    "lab.ekfslam.app_data": {"lab.solvers"},
    "lab.ekfslam.app_data_report": {"lab.solvers"},
    "lab.ekfslam.app_report": {"lab.solvers"},
    "lab.plots": {"lab.solvers"},
}


def room(name: str) -> str:
    """Return the longest key of FLOORS that begins the dotted `name`, or ''."""
    parts = name.split(".")
    prefixes = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next((prefix for prefix in prefixes if prefix in FLOORS), "")


def imports(tree: ast.Module, package: str) -> Iterator[tuple[str, int, bool]]:
    """Yield what is imported: dotted name, line, whether importing the file runs it."""
    later = set()
    for node in ast.walk(tree):
        typing_only = isinstance(node, ast.If) and ast.unparse(node.test) in {"TYPE_CHECKING", "typing.TYPE_CHECKING"}
        if typing_only or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            later.update(inner for statement in node.body for inner in ast.walk(statement))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{origin}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            yield name, node.lineno, node not in later


def faults(module: str, source: str, *, is_package: bool = False) -> list[str]:
    """Return one sentence for each import of `module` that breaks a rule."""
    here = room(module)
    if not here or (here == "lab" and module != "lab"):
        return [f"{module} stands on no floor: add it to FLOORS"]
    package = module if is_package else module.rpartition(".")[0]
    found = []
    for name, line, at_once in imports(ast.parse(source), package):
        there, top = room(name), name.split(".")[0]
        where = f"{module}:{line} imports {name}"
        if top == "matplotlib" and here != "lab.plots" and (here != "data_simulation" or at_once):
            found.append(f"{where}: matplotlib belongs in lab.plots and in functions of data_simulation")
        elif here == "data_simulation":
            if top not in {"numpy", "matplotlib", *sys.stdlib_module_names}:
                found.append(f"{where}: data_simulation needs nothing but numpy")
        elif there in FORBIDDEN.get(here, ()):
            found.append(f"{where}: these two never meet")
        elif there and there != here and there not in SIDEWAYS.get(here, ()) and FLOORS[there] >= FLOORS[here]:
            found.append(f"{where}: floor {FLOORS[here]} may not import floor {FLOORS[there]}")
    return found


def modules() -> Iterator[tuple[str, Path]]:
    for path in [ROOT / "data_simulation.py", *sorted((ROOT / "lab").rglob("*.py"))]:
        parts = path.relative_to(ROOT).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


@pytest.mark.parametrize(("module", "path"), [pytest.param(m, p, id=m) for m, p in modules()])
def test_imports_go_down(module, path):
    found = faults(module, path.read_text(encoding="utf-8"), is_package=path.name == "__init__.py")
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("lab.attic", ""),
        ("lab", "import lab.problem"),
        ("lab.weights", "from lab import solvers"),
        ("lab.weights", "from lab.gaussian import update"),
        ("lab.gaussian", "def f():\n    import lab.compare as c"),
        ("lab.problem", "if TYPE_CHECKING:\n    from lab.solvers import sir"),
        ("lab.problem", "from .solvers import sir"),
        ("lab.records.mat", "from ..problem import Problem"),
        ("lab.records.mat", "from .. import problem"),
        ("lab.solvers.exact", "from lab.ekfslam import frames"),
        ("lab.ekfslam.slam", "import lab.solvers.exact"),
        ("lab.ekfslam.slam", "from lab.ekfslam import app"),
        ("lab.ekfslam.app", "from lab.solvers import kalman"),
        ("lab.plots.clouds", "from lab.solvers import sir"),
        ("lab.compare", "from lab.plots import corridor"),
        ("lab.cli.compare", "import matplotlib.pyplot as plt"),
        ("lab.sweep", "from lab.cli import main"),
        ("data_simulation", "from lab import problem"),
        ("data_simulation", "import scipy"),
        ("data_simulation", "import matplotlib.pyplot as plt"),
        ("data_simulation", "def animate():\n    import lab.plots"),
    ],
)
def test_a_breach_is_found(module, source):
    assert faults(module, source)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("lab.cli", "from lab import __version__"),
        ("lab.plots.clouds", "from . import style\nfrom lab.result import Filtered\nimport matplotlib"),
        ("lab.solvers.particle", "from .proposals import prior\nimport data_simulation"),
        ("lab.ekfslam.app", "from lab.ekfslam import slam\nfrom lab.plots import ellipse"),
        ("data_simulation", "import math\nimport numpy as np\ndef animate():\n    import matplotlib"),
        ("data_simulation", "if typing.TYPE_CHECKING:\n    from matplotlib.figure import Figure"),
    ],
)
def test_a_step_down_is_allowed(module, source):
    assert not faults(module, source)
