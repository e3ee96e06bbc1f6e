"""``slam-lab run``: one filter, once, with its moments at every instant beside the exact ones."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.options import ExperimentFile, LandmarkNoise, OutputFolder, ScenarioName, Seed
from lab.validation import InputError, whole_number

if TYPE_CHECKING:
    import pandas as pd

    from lab.problem import Experiment
    from lab.result import Filtered


def run(
    solver: Annotated[
        str,
        typer.Argument(metavar="SOLVER", help="kalman, sis, sir, or FILE.py:FUNCTION; options follow as :NAME=VALUE."),
    ],
    experiment: ExperimentFile = None,
    scenario: ScenarioName = None,
    landmark_noise: LandmarkNoise = 0.0,
    particles: Annotated[int, typer.Option(metavar="N", help="Number of particles.")] = 1000,
    seed: Seed = 0,
    repetition: Annotated[
        int, typer.Option("--run", metavar="R", help="Which run: the same numbers as run R of compare.")
    ] = 0,
    out: OutputFolder = None,
) -> None:
    """Run one filter once and show where it is, and how far from exact."""
    from lab.cli import output, pictures

    source = options.load_experiment(experiment, scenario, seed, landmark_noise)
    whole_number("The number of particles", particles, at_least=1)
    whole_number("--run", repetition, at_least=0)
    whole_number("--seed", seed, at_least=0)
    with ExitStack() as stack:
        files: dict[str, Path | None] = {"experiment": experiment}
        if solver == "kalman":
            label, prepared = "kalman", None
        else:
            ((label, prepared),) = options.parse_solvers([solver], source).items()
            files |= options.student_files({label: prepared})
        folder = stack.enter_context(output.result_folder(out)) if out is not None else None
        filtered, exact, lines = _filter(source, label, prepared, particles, repetition, seed)
        table = _moments(filtered or exact, exact, source)
        _print(table, lines)
        if folder is not None:
            name = label if filtered is None else f"{label} (N = {particles}, run {repetition})"
            table.to_csv(folder / "moments.csv", index=False)
            source.save(folder / "experiment.npz")
            pictures.write_estimate(folder, "", filtered, exact, source, name)
            arguments: dict[str, Any] = {
                "solver": solver,
                "experiment": experiment,
                "scenario": None if experiment else scenario or "handout",
                "landmark-noise": landmark_noise,
                "particles": particles,
                "seed": seed,
                "run": repetition,
            }
            output.write_config(folder, "run", arguments, files)
    if out is not None:
        typer.echo(f"\nTables and figures are in {out}.")


def _filter(
    source: "Experiment", label: str, solver: Any, n_particles: int, repetition: int, seed: int
) -> tuple["Filtered | None", "Filtered", list[str]]:
    """Return the estimate (None for kalman itself), the exact answer, and what to say of the two."""
    from lab.compare import Comparison, Unit, run_unit, unit_seed
    from lab.findings import findings
    from lab.solvers import kalman

    exact = kalman(source.problem)
    if solver is None:
        return None, exact, [f"log-evidence {exact.log_evidence[-1]:.4f} (exact)"]
    unit = Unit(label, n_particles, repetition, unit_seed(seed, label, n_particles, repetition))
    record = run_unit(source.problem, exact, solver, unit, keep=True)
    if record.filtered is None:
        raise InputError(f"{label}, run {repetition}, seed {unit.seed} failed: {record.error}")
    lines = [
        f"log-evidence {record.filtered.log_evidence[-1]:.4f}, exact {exact.log_evidence[-1]:.4f}",
        f"mean_gap {record.metrics.mean_gap:.4g}, cov_gap {record.metrics.cov_gap:.4g},"
        f" {record.metrics.seconds:.3g} s, seed {unit.seed}",
        *findings(Comparison(source.problem, exact, (record,))),
    ]
    return record.filtered, exact, lines


def _moments(filtered: "Filtered", exact: "Filtered", source: "Experiment") -> "pd.DataFrame":
    """Return one row per instant and component, in metres."""
    import numpy as np
    import pandas as pd

    N, n = exact.means.shape
    names = ["r_x", "r_y", *(f"m{i}_{axis}" for i in range(1, n // 2) for axis in "xy")]
    columns = {
        "k": np.repeat(np.arange(N), n),
        "component": names * N,
        "mean": filtered.means.ravel(),
        "std": filtered.stds.ravel(),
        "exact_mean": exact.means.ravel(),
        "exact_std": exact.stds.ravel(),
    }
    if source.truth is not None:
        columns["truth"] = source.truth.ravel()
    return pd.DataFrame(columns)


def _print(table: "pd.DataFrame", lines: list[str]) -> None:
    """Print the moments at the last instant, and the lines below."""
    from rich.table import Table

    from lab.cli.output import console

    last = table[table["k"] == table["k"].max()].drop(columns="k")
    shown = Table(box=None, pad_edge=False, title=f"k = {table['k'].max()} [m]", title_justify="left")
    for name in last.columns:
        shown.add_column(str(name), justify="left" if name == "component" else "right")
    for row in last.itertuples(index=False):
        shown.add_row(row[0], *(f"{value:.4f}" for value in row[1:]))
    out = console()
    out.print(shown)
    out.print()
    for line in lines:
        out.print(line, markup=False, soft_wrap=not out.is_terminal)
