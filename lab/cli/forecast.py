"""``slam-lab forecast``: how each filter will fare on these data, before a particle is drawn."""

from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.options import ExperimentFile, LandmarkNoise, OutputFolder, ScenarioName, Seed

if TYPE_CHECKING:
    import pandas as pd

    from lab.problem import Problem

INSTANTS = (1, 2, 5, 10, 20)  # and the last
SIZES = (10**3, 10**4, 10**5, 10**6, 10**7, 10**8)


def forecast(
    experiment: ExperimentFile = None,
    scenario: ScenarioName = None,
    landmark_noise: LandmarkNoise = 0.0,
    ess: Annotated[float, typer.Option(metavar="E", help="Effective particles wanted.")] = 10.0,
    seed: Seed = 0,
    out: OutputFolder = None,
) -> None:
    """Forecast each filter's degeneracy and the bootstrap filter's error on the data."""
    from lab import theory
    from lab.cli import output, pictures, tables

    source = options.load_experiment(experiment, scenario, seed, landmark_noise)
    forecasts = {name: theory.forecast(source.problem, name) for name in theory.PROPOSALS}
    needed = {name: theory.particles_needed(source.problem, name, ess) for name in theory.PROPOSALS}
    with ExitStack() as stack:
        folder = stack.enter_context(output.result_folder(out)) if out is not None else None
        errors, bootstrap = _predicted(source.problem)
        with output.deaf_reader():
            tables.print_forecast(forecasts, needed, ess, _instants(source.problem), errors, bootstrap)
        if folder is not None:
            arguments = {
                "experiment": experiment,
                "scenario": None if experiment else scenario or options.DEFAULT_SCENARIO,
                "landmark-noise": landmark_noise,
                "ess": ess,
                "seed": seed,
            }
            _table(forecasts, needed, bootstrap).to_csv(folder / "forecast.csv", index=False)
            source.save(folder / "experiment.npz")
            pictures.write_forecast(folder, forecasts, errors, theory.VALID_GAP)
            output.write_config(
                folder, output.describe("forecast", arguments, output.fingerprints({"experiment": experiment}))
            )
    if out is not None:
        with output.deaf_reader():
            typer.echo(f"\nTables and figures are in {out}.")


def _instants(problem: "Problem") -> list[int]:
    last = problem.n_instants - 1
    return [k for k in INSTANTS if k < last] + [last]


def _predicted(problem: "Problem") -> tuple[dict[int, Any], Any]:
    """Return, per N, the rms over components of the predicted error in exact deviations, and the N needed per k."""
    import numpy as np

    from lab import theory

    logs = theory.relative_log_variance(problem)
    needed = theory.particles_for_validity(logs)
    errors = {}
    for size in SIZES:
        known = np.isneginf(logs)
        squares = np.exp(np.minimum(logs - np.log(size), 0))
        rms = np.sqrt(squares.sum(axis=1) / np.maximum((~known).sum(axis=1), 1))
        errors[size] = np.where(needed <= size, rms, np.nan)
    return {size: values for size, values in errors.items() if np.isfinite(values[1:]).any()}, needed


def _table(forecasts: dict[str, Any], needed: dict[str, Any], bootstrap: Any) -> "pd.DataFrame":
    """Return one row per proposal and instant, and the bootstrap filter's N."""
    import pandas as pd

    frames = [
        pd.DataFrame({"proposal": name, "log10_ess_ratio": values, "log10_particles_needed": needed[name]})
        for name, values in forecasts.items()
    ]
    table = pd.concat(frames).rename_axis("k").reset_index()
    table["bootstrap_particles_needed"] = table["k"].map(dict(enumerate(bootstrap)))
    return table
