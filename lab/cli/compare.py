"""``slam-lab compare``: particle moments against exact moments, over several N, several runs, several data sets."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.options import Backend, ExperimentFile, LandmarkNoise, OutputFolder, ScenarioName, Seed
from lab.errors import ClusterError, InputError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from lab.comparison import Comparison, Record
    from lab.execution import Execute
    from lab.problem import Experiment
    from lab.solvers import Solver
    from lab.sweep import Unfinished
    from lab.workers import Crew


def compare(
    context: typer.Context,
    experiment: ExperimentFile = None,
    scenario: ScenarioName = None,
    datasets: Annotated[int, typer.Option(metavar="D", help="Data sets: this many simulations of the scenario.")] = 1,
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
    runs: Annotated[int, typer.Option(metavar="R", help="Runs of each solver with each N on each data set.")] = 20,
    seed: Seed = 0,
    backend: Backend = "auto",
    jobs: Annotated[int, typer.Option(metavar="J", help="Runs at a time; -1 for one per processor.")] = 1,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on the Dask cluster whose scheduler is there instead.")
    ] = None,
    moments: Annotated[
        bool, typer.Option("--moments", help="Write the moments of all runs at every instant, too (moments.parquet).")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the comparison that was stopped in --out DIR.")
    ] = False,
    out: OutputFolder = None,
) -> None:
    """Say how far the particle moments are from the exact Kalman moments.

    With --out every finished run is kept at once: after Ctrl-C, a kill or a power cut, the same command with --resume
    goes on where it was, to the same numbers.
    """
    crew = None
    if out is not None and (jobs > 1 or jobs == -1):
        from lab.workers import Crew

        # the one that is to draw gets ready while this process does, and then waits, with 100 MB of its own
        crew = context.with_resource(Crew("lab.cli.pictures")).call(1)
    from lab.cli import output, tables
    from lab.sweep import Unfinished

    unfinished = Unfinished(out) if out is not None else None
    asked = _asked(context, unfinished, resume=resume)
    sources = options.load_data_sets(
        asked["experiment"], asked["scenario"], asked["seed"], asked["landmark-noise"], asked["datasets"]
    )
    named = options.parse_solvers(asked["solvers"].split(","), sources[0])
    asked["backend"] = options.settle_backend(asked["backend"], options.parse_particles(asked["particles"]))
    named = options.with_backend(named, asked["backend"])
    asked["scenario"] = None if asked["experiment"] else asked["scenario"] or options.DEFAULT_SCENARIO
    inputs = output.fingerprints({"experiment": asked["experiment"], **options.student_files(named)})
    config = output.describe("compare", asked, inputs, options.compiled_with(named))
    with ExitStack() as stack:
        if out is not None and unfinished is not None:
            if resume and unfinished.config is None and output.is_complete(out, config):
                typer.echo(f"The comparison in {out} is complete; there is nothing to resume.")
                raise typer.Exit(1 if output.has_failures(out) else 0)
            output.earlier_files(out)  # refused now rather than after the work
            stack.enter_context(unfinished.begun(config))
        with _execution(jobs, dask, named, max(options.parse_particles(asked["particles"]))) as execute:
            comparison = _run(sources, named, asked, execute, unfinished)
        with output.deaf_reader():
            tables.print_comparison(comparison)
        if out is not None and unfinished is not None:
            try:
                with output.result_folder(out) as folder:
                    _write(folder, comparison, sources, config, moments=asked["moments"], jobs=jobs, crew=crew)
            except KeyboardInterrupt:
                kept = f"all {len(comparison.records)} runs are finished and kept in {unfinished.folder}"
                raise output.Stopped(f"stopped; {kept}; --resume writes the result.") from None
            with output.deaf_reader():
                typer.echo(f"\nTables and figures are in {out}.")
            if any(record.died for record in comparison.failures):
                with output.deaf_reader():
                    typer.echo("The runs whose worker died can be tried again: the same command with --resume.")
            else:
                unfinished.remove()
    if comparison.failures:
        raise typer.Exit(1)


def _asked(context: typer.Context, unfinished: "Unfinished | None", *, resume: bool) -> dict[str, Any]:
    """Return what decides the numbers, by the options' long names; --resume takes what is not given from the folder."""
    from lab.cli import output

    names = [name for name in context.params if name not in ("jobs", "dask", "resume", "out")]
    asked = {name.replace("_", "-"): context.params[name] for name in names}
    if unfinished is None:
        if resume:
            raise InputError("--resume goes on with what is in --out DIR; say which folder.")
        return asked
    earlier = unfinished.config
    if not resume:
        if earlier is not None:
            raise InputError(
                f"{unfinished.folder.parent} holds {len(unfinished.finished())} finished runs of a comparison that was"
                f" stopped; go on with it by --resume, or remove {unfinished.folder} to begin again."
            )
        return asked
    earlier = earlier or output.earlier_config(unfinished.folder.parent)
    if earlier is not None and earlier.get("command") != "compare":
        raise InputError(f"{unfinished.folder.parent} holds no comparison, which --resume could go on with.")
    if earlier is None:
        typer.echo(f"Nothing to resume in {unfinished.folder.parent}: beginning.", err=True)
        return asked
    origins = {name.replace("_", "-"): context.get_parameter_source(name) for name in names}
    given = {name for name, origin in origins.items() if origin is not None and origin.name != "DEFAULT"}
    if given & {"experiment", "scenario"}:
        given |= {"experiment", "scenario"}
    recorded = asked | {"experiment": None, "scenario": None, "moments": False}
    recorded |= {name: value for name, value in earlier["arguments"].items() if name in asked}
    if recorded["experiment"] is not None:
        recorded["experiment"] = Path(recorded["experiment"])
    return {name: asked[name] if name in given else recorded[name] for name in asked}


def _execution(
    jobs: int, address: str | None, solvers: "dict[str, Solver]", largest: int
) -> "AbstractContextManager[Execute]":
    """Return the way to run units; a student's function, which may end Python, never runs in this process."""
    from contextlib import nullcontext
    from functools import partial

    from lab import execution
    from lab.compare import way_to_run

    if jobs < 1 and jobs != -1:
        raise InputError(f"--jobs must be at least 1, or -1 for one per processor, not {jobs}.")
    if address is not None:
        from lab import cluster  # brings joblib

        return cluster.connect(address, options.compiled_with(solvers))
    if options.student_files(solvers):
        return nullcontext(partial(execution.processes, jobs=jobs))
    return way_to_run(solvers, largest, jobs)


def _run(
    sources: "list[Experiment]",
    solvers: "dict[str, Solver]",
    asked: dict[str, Any],
    execute: "Execute",
    unfinished: "Unfinished | None",
) -> "Comparison":
    """Compare behind a progress bar; a stop leaves what is finished, and says so."""
    from functools import partial

    import lab.compare
    from lab.cli import tables
    from lab.cli.output import RunError, Stopped, deaf_reader
    from lab.solvers import kalman
    from lab.sweep import resumable

    # the form that needs no FilterPy, the import of which takes as long as a thousand of its steps
    exact = partial(kalman, method="structured")
    problems = [source.problem for source in sources]
    records: list[Record] = []
    settings = {"n_particles": options.parse_particles(asked["particles"]), "runs": asked["runs"]}
    if unfinished is not None:
        execute = resumable(execute, unfinished)
    try:
        return lab.compare.compare(
            problems,
            solvers,
            **settings,
            seed=asked["seed"],
            keep_moments=asked["moments"],
            progress=True,
            exact=exact,
            execute=execute,
            on_done=records.append,
        )
    except (KeyboardInterrupt, ClusterError) as error:
        if not records:
            raise
        n_units = len(problems) * len(solvers) * len(settings["n_particles"]) * settings["runs"]
        with deaf_reader():
            tables.print_comparison(lab.compare.partial_comparison(problems, solvers, records, exact))
        share = f"{len(records)} of {n_units} runs are finished"
        kept = f"kept in {unfinished.folder}; --resume goes on with the others" if unfinished else "in the table"
        if isinstance(error, ClusterError):
            raise RunError(f"{error}; {share} and {kept}.") from None
        raise Stopped(f"stopped; {share} and {kept}.") from None


def _write(
    folder: Path,
    comparison: "Comparison",
    sources: "list[Experiment]",
    config: dict[str, Any],
    *,
    moments: bool,
    jobs: int,
    crew: "Crew | None",
) -> None:
    """Write tables, figures, data and configuration."""
    from lab.cli import album, output
    from lab.findings import findings
    from lab.progress import progress_bar
    from lab.sweep import moments_table

    comparison.summary().to_csv(folder / "summary.csv", index=False)
    comparison.runs.to_csv(folder / "runs.csv", index=False)
    comparison.runs.to_parquet(folder / "runs.parquet", index=False)
    if moments:
        moments_table(comparison).to_parquet(folder / "moments.parquet", index=False)
    for i, source in enumerate(sources):
        source.save(folder / ("experiment.npz" if len(sources) == 1 else f"experiment-{i}.npz"))
    with progress_bar("drawing", 1) as advance:
        figures = album.write_comparison(
            folder, comparison, sources[0], lambda _, total: advance(1 / total), jobs=jobs, crew=crew
        )
    from lab.report import write_report  # not before: it imports matplotlib

    write_report(folder / "report.html", comparison, figures, config, findings(comparison))
    output.write_config(folder, config)
