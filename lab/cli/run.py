"""``slam-lab run``: one filter, once, with its moments at every instant beside the exact ones."""

from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.options import Backend, ExperimentFile, LandmarkNoise, OutputFolder, ScenarioName, Seed
from lab.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from lab.problem import Experiment
    from lab.result import Filtered
    from lab.solvers import Solver


def run(
    solver: Annotated[
        str,
        typer.Argument(
            metavar="SOLVER", help="kalman, sis, sir, guided, rbpf, or FILE.py:FUNCTION; options follow as :NAME=VALUE."
        ),
    ],
    experiment: ExperimentFile = None,
    scenario: ScenarioName = None,
    landmark_noise: LandmarkNoise = 0.0,
    particles: Annotated[int, typer.Option(metavar="N", help="Number of particles.")] = 1000,
    seed: Seed = 0,
    repetition: Annotated[
        int, typer.Option("--run", metavar="R", help="Which run: the same numbers as run R of compare.")
    ] = 0,
    backend: Backend = "auto",
    out: OutputFolder = None,
) -> None:
    """Run one filter once and show where it is, and how far from exact."""
    from lab.cli import output, tables
    from lab.validation import whole_number

    source = options.load_experiment(experiment, scenario, seed, landmark_noise)
    whole_number("The number of particles", particles, at_least=1)
    whole_number("--run", repetition, at_least=0)
    whole_number("--seed", seed, at_least=0)
    prepared = _prepare(solver, source)
    backend = options.settle_backend(backend, [particles] if prepared else [])
    prepared = options.with_backend(prepared, backend)
    arguments = {
        "solver": solver,
        "experiment": experiment,
        "scenario": None if experiment else scenario or options.DEFAULT_SCENARIO,
        "landmark-noise": landmark_noise,
        "particles": particles,
        "seed": seed,
        "run": repetition,
        "backend": backend,
    }
    inputs = output.fingerprints({"experiment": experiment, **options.student_files(prepared)})
    with ExitStack() as stack:
        folder = stack.enter_context(output.result_folder(out)) if out is not None else None
        filtered, exact, lines = _filter(source, prepared, particles, repetition, seed)
        table = _moments(filtered, exact, source)
        with output.deaf_reader():
            tables.print_moments(table, lines)
        if folder is not None:
            from lab.cli import pictures

            (name,) = [f"{label} (N = {particles}, run {repetition})" for label in prepared] or ["kalman"]
            table.to_csv(folder / "moments.csv", index=False)
            source.save(folder / "experiment.npz")
            pictures.write_estimate(folder, "", filtered, exact, source, name)
            output.write_config(folder, output.describe("run", arguments, inputs, options.compiled_with(prepared)))
    if out is not None:
        with output.deaf_reader():
            typer.echo(f"\nTables and figures are in {out}.")


def _prepare(text: str, source: "Experiment") -> "dict[str, Solver]":
    """Return the solver under its label, or nothing for kalman, which runs in any case."""
    if text.strip() == "kalman":
        return {}
    if text.strip().startswith("kalman:"):
        raise InputError("kalman has no options.")
    try:
        return options.parse_solvers([text], source)
    except InputError as error:
        raise InputError(str(error).replace("; known are ", "; known are kalman, ")) from None


def _filter(
    source: "Experiment", prepared: dict[str, Any], n_particles: int, repetition: int, seed: int
) -> tuple["Filtered | None", "Filtered", list[str]]:
    """Return the estimate (None for kalman itself), the exact answer, and what to say of the two."""
    from lab.cli.output import RunError
    from lab.comparison import Comparison, Unit
    from lab.findings import findings
    from lab.solvers import kalman
    from lab.units import unit_seed
    from lab.work import Work

    exact = kalman(source.problem)
    if not prepared:
        return None, exact, [f"log-evidence {exact.log_evidence[-1]:.4f} (exact)"]
    (label,) = prepared
    unit = Unit(label, n_particles, repetition, unit_seed(seed, label, n_particles, repetition))
    (record,) = Work((source.problem,), (exact,), prepared, keep_moments=True)((unit,))
    if record.filtered is None:
        raise RunError(f"{label}, N = {n_particles}, run {repetition}, seed {unit.seed} failed: {record.error}")
    lines = [
        f"log-evidence {record.filtered.log_evidence[-1]:.4f}, exact {exact.log_evidence[-1]:.4f}",
        f"mean gap {record.metrics.mean_gap:.4g} [exact std], cov gap {record.metrics.cov_gap:.4g} [relative],"
        f" {record.metrics.seconds:.2g} s, seed {unit.seed}",
        *findings(Comparison((source.problem,), (exact,), (record,))),
    ]
    return record.filtered, exact, lines


def _moments(filtered: "Filtered | None", exact: "Filtered", source: "Experiment") -> "pd.DataFrame":
    """Return one row per instant and component, in metres."""
    import numpy as np
    import pandas as pd

    N, n = exact.means.shape
    names = ["r_x", "r_y", *(f"m{i}_{axis}" for i in range(1, n // 2) for axis in "xy")]
    columns: dict[str, Any] = {"k": np.repeat(np.arange(N), n), "component": names * N}
    if filtered is not None:
        columns |= {"mean": filtered.means.ravel(), "std": filtered.stds.ravel()}
    columns |= {"exact_mean": exact.means.ravel(), "exact_std": exact.stds.ravel()}
    if source.truth is not None:
        columns["truth"] = source.truth.ravel()
    return pd.DataFrame(columns)
