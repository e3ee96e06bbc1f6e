"""``slam-lab compare``: particle moments against exact moments, over several N and several runs."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.options import ExperimentFile, LandmarkNoise, OutputFolder, ScenarioName, Seed

if TYPE_CHECKING:
    from lab.compare import Comparison
    from lab.problem import Experiment


def compare(
    experiment: ExperimentFile = None,
    scenario: ScenarioName = None,
    solvers: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Comma-separated: sis, sir, guided, rbpf, mine=my_filters.py:my_sir, low=sir:ess_threshold=0.2.",
        ),
    ] = "sis,sir,guided,rbpf",
    landmark_noise: LandmarkNoise = 0.0,
    particles: Annotated[str, typer.Option(metavar="LIST", help="Numbers of particles, comma-separated.")] = (
        "100,1000,10000"
    ),
    runs: Annotated[int, typer.Option(metavar="R", help="Runs of each solver with each N.")] = 20,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(metavar="J", help="Worker processes; -1 for one per processor.")] = 1,
    out: OutputFolder = None,
) -> None:
    """Say how far the particle moments are from the exact Kalman moments."""
    from contextlib import ExitStack

    from lab.cli import output, tables

    source = options.load_experiment(experiment, scenario, seed, landmark_noise)
    named = options.parse_solvers(solvers.split(","), source)
    sizes = options.parse_particles(particles)
    arguments = {
        "experiment": experiment,
        "scenario": None if experiment else scenario or options.DEFAULT_SCENARIO,
        "solvers": solvers,
        "landmark-noise": landmark_noise,
        "particles": particles,
        "runs": runs,
        "seed": seed,
    }
    inputs = output.fingerprints({"experiment": experiment, **options.student_files(named)})
    with ExitStack() as stack:
        folder = stack.enter_context(output.result_folder(out)) if out is not None else None
        comparison = _run(source, named, sizes, runs, seed, jobs)
        with output.deaf_reader():
            tables.print_comparison(comparison)
        if folder is not None:
            comparison.summary().to_csv(folder / "summary.csv", index=False)
            comparison.runs.to_csv(folder / "runs.csv", index=False)
            source.save(folder / "experiment.npz")
            _draw(folder, comparison, source)
            output.write_config(folder, "compare", arguments, inputs)
    if out is not None:
        with output.deaf_reader():
            typer.echo(f"\nTables and figures are in {out}.")
    if comparison.failures:
        raise typer.Exit(1)


def _run(
    source: "Experiment", solvers: dict[str, Any], sizes: list[int], runs: int, seed: int, jobs: int
) -> "Comparison":
    """Compare behind a progress bar; a worker that dies takes the comparison with it."""
    from concurrent.futures.process import BrokenProcessPool

    import lab.compare
    from lab.cli import output

    with output.progress() as progress:
        # the work of a run grows with N, beside an overhead of about 1000 particles' worth
        bar = progress.add_task("comparing", total=sum(size + 1000 for size in sizes) * runs * len(solvers))
        try:
            return lab.compare.compare(
                source.problem,
                solvers,
                n_particles=sizes,
                runs=runs,
                seed=seed,
                jobs=jobs,
                on_done=lambda record: progress.advance(bar, record.unit.n_particles + 1000),
            )
        except BrokenProcessPool:
            raise output.RunError(
                "a worker process died: it was killed, ran out of memory, or a solver ended Python itself;"
                " nothing is written."
            ) from None


def _draw(folder: Any, comparison: "Comparison", source: "Experiment") -> None:
    from lab.cli import output, pictures

    with output.progress() as progress:
        bar = progress.add_task("drawing")
        pictures.write_comparison(
            folder, comparison, source, lambda done, total: progress.update(bar, completed=done, total=total)
        )
