"""``slam-lab ekf-slam --data``: the options of recorded data, and what becomes of them."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.options import a_path
from lab.errors import InputError

if TYPE_CHECKING:
    from lab.ekfslam.app_data import Choices, Loaded, Outcome

PANEL = "Recorded data"
MRCLAM, VICTORIA_PARK, NTNU = "mrclam", "victoria-park", "ntnu"


def option(*names: str, **settings: Any) -> Any:
    """Return an option that the help lists among those of recorded data."""
    return typer.Option(*names, rich_help_panel=PANEL, **settings)


Data = Annotated[
    tuple[str, str] | None,
    option(
        "--data",
        metavar="KIND PATH",
        help="Recorded data instead of the cloister: mrclam FOLDER, victoria-park FILE or ntnu FILE.",
    ),
]
Robots = Annotated[str | None, option("--robots", metavar="LIST", help="mrclam: robots such as 1,2,3; all by default.")]
Separate = Annotated[bool, option("--separate", help="mrclam: a map for each robot, instead of one for all.")]
RobotSightings = Annotated[
    bool,
    option("--robot-sightings/--no-robot-sightings", help="mrclam: whether robots in one map see each other."),
]
CommandDelay = Annotated[
    float,
    option("--command-delay", metavar="S", help="mrclam: seconds by which motion follows its command, such as 0.22."),
]
RotationScale = Annotated[
    float, option("--rotation-scale", metavar="F", help="mrclam: how much of a commanded turn is made, such as 0.9.")
]
MotionNoise = Annotated[
    str | None,
    option("--motion-noise", metavar="X,Y,A", help="ntnu: deviations a step, metres and radians; 0.05,0.05,0.01745."),
]
SensorNoise = Annotated[
    str | None, option("--sensor-noise", metavar="R,B", help="ntnu: deviations of range and bearing; 0.05,0.01745.")
]
Reference = Annotated[
    Path | None,
    option(
        "--reference",
        metavar="FILE",
        parser=a_path,
        help="victoria-park: an optimum (VERTEX_SE2, VERTEX_XY lines) to measure errors against, for want of a truth.",
    ),
]

SHARED = ("data", "filter", "association", "out")  # with the cloister, whose other options have no use here
BELONGS = {
    "robots": MRCLAM,
    "separate": MRCLAM,
    "robot_sightings": MRCLAM,
    "command_delay": MRCLAM,
    "rotation_scale": MRCLAM,
    "motion_noise": NTNU,
    "sensor_noise": NTNU,
    "reference": VICTORIA_PARK,
}


def check_options(context: typer.Context, data: tuple[str, str] | None) -> None:
    """Refuse options that the chosen work has no use for, instead of passing over them.

    Raises
    ------
    InputError
        One was given.
    """
    given = [name for name in context.params if _was_given(context, name)]
    for name in given:
        flag = f"--{name.replace('_', '-')}"
        if name in BELONGS and (data is None or data[0] != BELONGS[name]):
            raise InputError(f"{flag} belongs to --data {BELONGS[name]} PATH.")
        if data is not None and name not in (*SHARED, *BELONGS):
            raise InputError(f"{flag} belongs to the cloister and has no use with --data.")
        if data is not None and name == "association" and data[0] != NTNU:
            raise InputError(
                f"--association belongs to the cloister and to --data {NTNU}: {data[0]} names what it saw."
            )


def _was_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def replay_data(options: dict[str, Any]) -> None:
    """Read, replay, print, and write to the folder of results where one is wanted.

    Parameters
    ----------
    options : dict
        Of the command, by parameter.
    """
    from lab.cli import output, tables
    from lab.ekfslam import app_data_report
    from lab.ekfslam.app_report import write_summary

    kind, text = options["data"]
    path = a_path(text)
    choices = _choices(options)
    with ExitStack() as stack:
        folder = stack.enter_context(output.result_folder(options["out"])) if options["out"] is not None else None
        loaded, outcome, inputs = _run(kind, path, choices)
        title = f"{choices.filter} on {kind} data of {path}: {loaded.steps} steps"
        with output.deaf_reader():
            tables.print_slam(title, app_data_report.rows(outcome), app_data_report.words(outcome, choices))
        if folder is not None:
            write_summary(folder, outcome.summary())
            app_data_report.write_tables(folder, outcome)
            app_data_report.write_figures(folder, outcome)
            output.write_config(folder, output.describe("ekf-slam", _arguments(options), inputs))
    if options["out"] is not None:
        with output.deaf_reader():
            typer.echo(f"\nSummary, tables and figures are in {options['out']}.")


def _run(kind: str, path: Path, choices: "Choices") -> "tuple[Loaded, Outcome, dict[str, dict[str, str]]]":
    """Read and replay behind a progress bar; return what the input files were, too."""
    import time

    from lab.cli.output import RunError, fingerprints
    from lab.ekfslam import app_data
    from lab.progress import progress_bar

    started = time.perf_counter()
    with progress_bar("reading"):
        loaded = app_data.load(kind, path, choices)
        inputs = fingerprints(_files(path, choices.reference))
    with progress_bar("mapping", loaded.steps) as advance:
        shown = 0

        def show(done: int) -> None:
            nonlocal shown
            advance(done - shown)
            shown = done

        try:
            outcome = app_data.run(loaded, choices, started=started, on_step=show)
        except app_data.Breakdown as error:
            raise RunError(f"{error}; nothing is written.") from None
    return loaded, outcome, inputs


def _choices(options: dict[str, Any]) -> "Choices":
    from lab.ekfslam import drives, fleet
    from lab.ekfslam.app_data import Choices
    from lab.ekfslam.slam import Settings

    Settings(association=options["association"])  # refuses what is not known, as in the cloister
    return Choices(
        filter=options["filter"],
        robots=_robots(options["robots"]),
        separate=options["separate"],
        driving=fleet.Options(options["robot_sightings"], options["command_delay"], options["rotation_scale"]),
        association=options["association"],
        motion=_deviations("--motion-noise", options["motion_noise"], drives.COURSE_MOTION),
        sensor=_deviations("--sensor-noise", options["sensor_noise"], drives.COURSE_SENSOR),
        reference=options["reference"],
    )


def _robots(text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    try:
        return tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        raise InputError(f"--robots takes numbers of robots, separated by commas, not {text!r}.") from None


def _deviations(name: str, text: str | None, default: tuple[float, ...]) -> Any:
    if text is None:
        return default
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != len(default) or not all(0 < value < float("inf") for value in values):
        raise InputError(f"{name} takes {len(default)} positive numbers, separated by commas, not {text!r}.")
    return values


def _files(path: Path, reference: Path | None) -> dict[str, Path | None]:
    """Return the files that were read, by name."""
    files = sorted([*path.glob("*.dat"), *path.glob("*.dat.gz")]) if path.is_dir() else [path]
    return {file.name: file for file in files} | {"reference": reference}


def _arguments(options: dict[str, Any]) -> dict[str, Any]:
    """Return what was chosen, by long names, for the command that repeats it."""
    kind = options["data"][0]
    used = ["robots", "command_delay", "rotation_scale", "motion_noise", "sensor_noise", "reference"]
    arguments = {"data": options["data"], "filter": options["filter"]}
    arguments |= {"association": options["association"] if kind == NTNU else None}
    arguments |= {name.replace("_", "-"): options[name] for name in used if BELONGS[name] == kind}
    if kind == MRCLAM:
        arguments["separate"] = options["separate"] or None
        arguments["no-robot-sightings"] = not options["robot_sightings"] or None
    return arguments
