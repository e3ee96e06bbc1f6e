"""``slam-lab ekf-slam``: EKF-SLAM in the cloister of Solà's guide, and how honest its filter is."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.cli import ekf_slam_data as recorded
from lab.cli.options import OutputFolder, Seed, a_path
from lab.errors import InputError

if TYPE_CHECKING:
    from lab.ekfslam.app import Demo
    from lab.ekfslam.slam import Settings

FilterName = Annotated[
    str, typer.Option("--filter", metavar="NAME", help="ekf, fej (first-estimate Jacobians) or ri (right-invariant).")
]


def ekf_slam(
    context: typer.Context,
    filter: FilterName = "ekf",
    sensor: Annotated[str, typer.Option(metavar="NAME", help="range-bearing, bearing or range.")] = "range-bearing",
    association: Annotated[
        str, typer.Option(metavar="NAME", help="Whose a measurement is: known, nearest or jcbb.")
    ] = "known",
    perturb: Annotated[
        str, typer.Option(metavar="WHO", help="Who feels the noise: truth, or estimator as in the guide's listing.")
    ] = "truth",
    runs: Annotated[int, typer.Option(metavar="R", help="Worlds to run through.")] = 60,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(metavar="J", help="Worker processes; -1 for one per processor.")] = 1,
    animate: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=a_path, help="Write the first run's live map: .gif, or .mp4 with ffmpeg."),
    ] = None,
    live: Annotated[bool, typer.Option("--live", help="Show the first run's live map in a window.")] = False,
    out: OutputFolder = None,
    data: recorded.Data = None,
    robots: recorded.Robots = None,
    separate: recorded.Separate = False,
    robot_sightings: recorded.RobotSightings = True,
    command_delay: recorded.CommandDelay = 0.0,
    rotation_scale: recorded.RotationScale = 1.0,
    motion_noise: recorded.MotionNoise = None,
    sensor_noise: recorded.SensorNoise = None,
    reference: recorded.Reference = None,
) -> None:
    """Map a cloister or recorded data with an extended Kalman filter, and say whether it is as sure as it should be."""
    recorded.check_options(context, data)
    if data is not None:
        recorded.replay_data(context.params)
        return
    from lab import records
    from lab.cli import output, tables
    from lab.ekfslam import app_report
    from lab.ekfslam.slam import Settings

    settings = Settings(association=association)
    _check(filter, sensor, settings, perturb, animate)
    if live:
        from lab.plots.live import require_screen

        require_screen()
    arguments: dict[str, str | int] = {
        "filter": filter,
        "sensor": sensor,
        "association": association,
        "perturb": perturb,
    }
    arguments |= {"runs": runs, "seed": seed}
    with ExitStack() as stack:
        folder = stack.enter_context(output.result_folder(out)) if out is not None else None
        picture = stack.enter_context(records.atomic_path(animate)) if animate is not None else None
        found = _run(filter, sensor, settings, perturb, runs, seed, jobs)
        with output.deaf_reader():
            worlds = "one world" if runs == 1 else f"{runs} worlds"
            title = f"{found.label}: {worlds} of {len(found.runs[0].drive.u)} steps"
            tables.print_slam(title, app_report.rows(found), app_report.words(found))
        if picture is not None:
            _animate(found, picture)
        if folder is not None:
            app_report.write_summary(folder, found.summary())
            app_report.write_runs(folder, found)
            app_report.write_figures(folder, found)
            output.write_config(folder, output.describe("ekf-slam", arguments, {}))
    with output.deaf_reader():
        if animate is not None:
            typer.echo(f"\nWritten: {animate}")
        if out is not None:
            typer.echo(f"\nSummary and figures are in {out}.")
    if live:
        from lab.plots.live import show_run

        show_run(found.runs[0])


def _check(filter: str, sensor: str, settings: "Settings", perturb: str, animate: Path | None) -> None:
    """Refuse before any work what cannot be done."""
    from lab.ekfslam.demo import SENSORS
    from lab.ekfslam.filters import INVERSE_DEPTH, RINGS, make_filter
    from lab.ekfslam.world import PERTURBED

    chosen = make_filter(filter)
    if sensor not in SENSORS:
        raise InputError(f"Unknown sensor {sensor!r}; known are {', '.join(SENSORS)}.")
    if sensor != "range-bearing":
        chosen.allow(INVERSE_DEPTH if sensor == "bearing" else RINGS)
        if settings.association != "known":
            raise InputError(
                f"Association {settings.association} is implemented for range-bearing; with {sensor} it must be known."
            )
    if perturb not in PERTURBED:
        raise InputError(f"--perturb must be {' or '.join(PERTURBED)}, not {perturb!r}.")
    if animate is not None:
        from lab.plots.slam import check_animation

        check_animation(animate)


def _animate(found: "Demo", path: Path) -> None:
    from lab.plots.slam import save_animation
    from lab.progress import progress_bar

    with progress_bar("animating", 1) as advance:
        save_animation(found.runs[0], path, on_frame=lambda _, total: advance(1 / total))


def _run(filter: str, sensor: str, settings: "Settings", perturb: str, runs: int, seed: int, jobs: int) -> "Demo":
    """Run behind a progress bar; a worker that dies takes the demo with it."""
    from concurrent.futures.process import BrokenProcessPool

    from lab.cli.output import RunError
    from lab.ekfslam import app
    from lab.progress import progress_bar

    with progress_bar("mapping", runs) as advance:
        try:
            return app.demo(
                filter,
                sensor=sensor,
                settings=settings,
                perturb=perturb,
                runs=runs,
                seed=seed,
                jobs=jobs,
                on_done=lambda: advance(1),
            )
        except BrokenProcessPool:
            raise RunError("a worker process died: it was killed or ran out of memory; nothing is written.") from None
