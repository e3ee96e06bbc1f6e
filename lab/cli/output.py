"""Where results go: a folder that is filled at once or not at all, a record of how they were made, and the console."""

import hashlib
import json
import os
import platform
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

import lab
from lab.validation import InputError

if TYPE_CHECKING:
    from rich.progress import Progress

CONFIG = "config.json"
PROGRAM = "slam-lab"
PACKAGES = ("numpy", "scipy", "filterpy", "matplotlib", "pandas", "joblib")
UNBOUNDED = 10_000  # columns of a file, which has no width


class RunError(Exception):
    """What was asked for could not be computed, through no fault of the command: one sentence, and status 1."""


def console() -> Console:
    """Return a console for standard output: as wide as the terminal, or as its contents where there is none."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=UNBOUNDED)


def progress() -> "Progress":
    """Return a progress display on standard error, silent when that is no terminal."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


@contextmanager
def deaf_reader() -> Iterator[None]:
    """Go on when whoever reads the standard output stops, as `head` does: results are still to be written."""
    try:
        yield
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # the second is rich's answer to the first
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def result_folder(path: Path) -> Iterator[Path]:
    """Give a temporary folder; when the block ends well, its files move to `path`, else nothing remains of it.

    Files that an earlier result in `path` listed as its own and that are not written again are removed, so that a
    folder never mixes two results; files of others are left alone.

    Parameters
    ----------
    path : Path
        Made when missing, parents included.

    Raises
    ------
    InputError
        The folder cannot be made or written to, or holds another program's config.json; said before the block runs.
    """
    made = [folder for folder in (path, *path.parents) if not os.path.exists(folder)]
    try:
        with _named_in_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            earlier = _earlier_files(path)
            temporary = Path(tempfile.mkdtemp(prefix=".partial-", dir=path))
        try:
            yield temporary
            with _named_in_errors(path):
                _move(temporary, path, earlier)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    finally:
        for folder in made:
            with suppress(OSError):  # not empty
                folder.rmdir()


def fingerprints(files: dict[str, Path | None]) -> dict[str, dict[str, str]]:
    """Return name and SHA-256 of the input files, by what they are; taken before the work, in which they may change.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    found = {}
    for what, file in files.items():
        if file is not None:
            try:
                found[what] = {"file": str(file), "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
            except OSError as error:
                raise InputError(f"{file} cannot be read: {error.strerror}.") from None
    return found


def write_config(folder: Path, command: str, arguments: dict[str, Any], inputs: dict[str, dict[str, str]]) -> None:
    """Write config.json: the command that repeats the result, its input files, and the versions used.

    Parameters
    ----------
    folder : Path
        Holds the result's other files, which are listed.
    command : str
        Such as "compare".
    arguments : dict
        Every option by its long name; None for one that was not given.
    inputs : dict
        What `fingerprints` returned.
    """
    given = {name: value for name, value in arguments.items() if value is not None}
    words = [f"--{name}={value}" if name != "solver" else str(value) for name, value in given.items()]
    config = {
        "repeat": shlex.join([PROGRAM, command, *words]),
        "command": command,
        "arguments": {name: value if isinstance(value, int | float) else str(value) for name, value in given.items()},
        "inputs": inputs,
        "files": sorted([CONFIG, *(file.name for file in folder.iterdir())]),
        "versions": {"toy-slam-lab": lab.__version__, "python": platform.python_version()}
        | {name: version(name) for name in PACKAGES},
        "platform": platform.platform(),
    }
    (folder / CONFIG).write_text(json.dumps(config, indent=2) + "\n", encoding="utf-8")


@contextmanager
def _named_in_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"The folder {path} cannot be written to: {error.strerror or error}.") from None


def _earlier_files(path: Path) -> list[str]:
    """Return the plain file names that an earlier result in this folder lists as its own."""
    try:
        config = json.loads((path / CONFIG).read_text(encoding="utf-8"))
        ours = config["repeat"].startswith(f"{PROGRAM} ")
        names = [name for name in config["files"] if Path(name).name == name]
    except FileNotFoundError:
        return []
    except (ValueError, KeyError, TypeError, AttributeError):
        ours, names = False, []
    if not ours:
        raise InputError(f"The folder {path} holds a {CONFIG} that is not ours; choose another folder.")
    return names


def _move(temporary: Path, path: Path, earlier: list[str]) -> None:
    """Put the new files in place, config.json last: until then the old one still lists what a stopped move leaves."""
    fresh = sorted((file.name for file in temporary.iterdir()), key=lambda name: name == CONFIG)
    for name in fresh:
        if (path / name).is_dir():
            raise InputError(f"The folder {path} holds a folder {name} where a file of the result belongs.")
    for name in {*earlier} - {*fresh}:
        (path / name).unlink(missing_ok=True)
    for name in fresh:
        (temporary / name).replace(path / name)
