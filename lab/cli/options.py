"""Options that the commands share, and what they turn into."""

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.errors import InputError

if TYPE_CHECKING:
    from data_simulation import Scenario, Simulation
    from lab.problem import Experiment
    from lab.solvers import Solver

DEFAULT_SCENARIO = "handout"


def a_path(text: str) -> Path:
    """Return a path; an empty text, such as that of an unset shell variable, does not mean the current folder.

    Raises
    ------
    typer.BadParameter
        The text is empty.
    """
    if not text:
        raise typer.BadParameter("the name is empty.")
    return Path(text)


ExperimentFile = Annotated[
    Path | None,
    typer.Option("--experiment", metavar="FILE", parser=a_path, help="Data: a .mat of the original lab, or our .npz."),
]
ScenarioName = Annotated[
    str | None, typer.Option("--scenario", metavar="NAME", help="Simulate instead: handout (default) or two-landmarks.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="S", help="Seed of the simulation and of the filters.")]
LandmarkNoise = Annotated[
    float,
    typer.Option(
        "--landmark-noise", metavar="STD", help="Jitter of the landmarks per step, in metres, part of the model."
    ),
]
OutputFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", parser=a_path, help="Write tables and figures there.")
]
Backend = Annotated[
    str,
    typer.Option(
        "--backend",
        metavar="NAME",
        help="Who runs the filters: numpy, numba (compiled), or auto: compiled where it is installed and pays.",
    ),
]


def scenario_named(name: str) -> "Scenario":
    """Return a scenario of the simulator.

    Raises
    ------
    InputError
        The scenario is not known.
    """
    from data_simulation import HANDOUT, TWO_LANDMARKS

    scenarios = {DEFAULT_SCENARIO: HANDOUT, "two-landmarks": TWO_LANDMARKS}
    if name not in scenarios:
        raise InputError(f"Unknown scenario {name!r}; known are {', '.join(scenarios)}.")
    return scenarios[name]


def simulate_scenario(name: str, seed: int) -> "Simulation":
    """Return one simulation of a scenario by name.

    Raises
    ------
    InputError
        The scenario is not known, or the seed is negative.
    """
    from data_simulation import data_simulation
    from lab.validation import whole_number

    return data_simulation(scenario=scenario_named(name), rng=whole_number("--seed", seed, at_least=0))


def load_data_sets(
    file: Path | None, scenario: str | None, seed: int, landmark_noise: float, n_data_sets: int
) -> "list[Experiment]":
    """Return the experiment that the options ask for, followed by fresh simulations where several are wanted.

    Raises
    ------
    InputError
        As `load_experiment`, or several are wanted of a file.
    """
    from lab.units import data_set_seeds

    if file is not None and n_data_sets > 1:
        raise InputError("--datasets simulates afresh, and --experiment is one data set; give one of the two.")
    seeds = data_set_seeds(seed, n_data_sets)
    return [load_experiment(file, scenario, each, landmark_noise) for each in seeds]


def load_experiment(file: Path | None, scenario: str | None, seed: int, landmark_noise: float) -> "Experiment":
    """Return the experiment that the options ask for, with landmark jitter in its model.

    Raises
    ------
    InputError
        Both sources are named, the file cannot be used, or nothing is ever seen in it.
    """
    import numpy as np

    from lab.problem import Experiment

    if file is not None and scenario is not None:
        raise InputError("Give either --experiment or --scenario, not both.")
    if file is not None:
        experiment = Experiment.load(file)
        if np.isnan(experiment.problem.z).all():
            raise InputError(f"{file}: no landmark is ever seen, the measurements are NaN throughout.")
    else:
        name = DEFAULT_SCENARIO if scenario is None else scenario
        experiment = Experiment.from_simulation(simulate_scenario(name, seed))
    if landmark_noise == 0:
        return experiment
    try:
        problem = experiment.problem.with_landmark_noise(landmark_noise)
    except OverflowError:
        raise InputError(f"--landmark-noise is too large: {landmark_noise}.") from None
    return Experiment(problem, experiment.truth, experiment.centre)


def parse_particles(text: str) -> list[int]:
    """Return the numbers of a list like 100,1000,10000.

    Raises
    ------
    InputError
        One of them is not a whole number of at least 1.
    """
    from lab.validation import whole_number

    sizes = []
    for part in text.split(","):
        try:
            size = int(part)
        except ValueError:
            raise InputError(f"--particles takes whole numbers, separated by commas, not {part.strip()!r}.") from None
        sizes.append(whole_number("The number of particles", size, at_least=1))
    return list(dict.fromkeys(sizes))


def parse_solvers(texts: Iterable[str], experiment: "Experiment") -> "dict[str, Solver]":
    """Return solvers by label, each of the laboratory's own tried once with its options.

    Raises
    ------
    InputError
        A specification cannot be read, names something unknown, or an option's value is refused; or a label is taken.
    """
    import numpy as np

    from lab.solvers import resolve

    solvers: dict[str, Solver] = {}
    for text in texts:
        if not text.strip():
            raise InputError("--solvers has an empty entry: a comma too many.")
        if text.partition("=")[2].strip() == "kalman" or text.strip() == "kalman":
            raise InputError("kalman is what the others are compared with: it always runs, and is no choice here.")
        label, solver = resolve(text)
        if label in solvers:
            raise InputError(f"Two solvers are called {label!r}; give one another label, as in other={text.strip()}.")
        if _is_ours(solver):
            try:
                with np.errstate(all="ignore"):  # what the data do to it shows in the comparison
                    solver(experiment.problem, np.random.default_rng(0), n_particles=1)
            except InputError as error:
                raise InputError(f"{text.strip()}: {error}") from None
        solvers[label] = solver
    return solvers


def settle_backend(name: str, sizes: list[int]) -> str:
    """Return the backend that these numbers of particles will have: numpy where nothing is to be compiled.

    What `lab.fast` has to say of a machine without working kernels goes to standard error, once.

    Raises
    ------
    InputError
        The backend is not known.
    """
    import warnings

    from lab.solvers.backends import BACKENDS, is_compiled

    if name not in BACKENDS:
        raise InputError(f"--backend is one of {', '.join(BACKENDS)}, not {name!r}.")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        compiled = [is_compiled(name, size) for size in sizes]
    for each in said:
        if each.category is RuntimeWarning:
            typer.echo(f"slam-lab: {each.message}.", err=True)
    return name if any(compiled) else "numpy"


def with_backend(solvers: "dict[str, Solver]", backend: str) -> "dict[str, Solver]":
    """Bind the backend to each solver of the laboratory that was not given one."""
    from functools import partial

    if backend == "numpy":  # which they have by themselves
        return solvers
    return {
        label: partial(solver, backend=backend)  # type: ignore[call-arg]
        if _is_ours(solver) and "backend" not in getattr(solver, "keywords", {})
        else solver
        for label, solver in solvers.items()
    }


def compiled_with(solvers: "dict[str, Solver]") -> tuple[str, ...]:
    """Return the packages, beyond those that are always there, on which the numbers of these solvers depend."""
    backends = {getattr(solver, "keywords", {}).get("backend", "numpy") for solver in solvers.values()}
    return ("numba",) if backends - {"numpy"} and find_spec("numba") else ()


def student_files(solvers: "dict[str, Solver]") -> dict[str, Path]:
    """Return the file of each solver that comes from one, by "solver LABEL"."""
    from lab.solvers.registry import FileSolver

    found = {label: getattr(solver, "func", solver) for label, solver in solvers.items()}
    return {f"solver {label}": Path(solver.path) for label, solver in found.items() if isinstance(solver, FileSolver)}


def _is_ours(solver: Any) -> bool:
    from lab.solvers import SOLVERS

    return getattr(solver, "func", solver) in SOLVERS.values()
