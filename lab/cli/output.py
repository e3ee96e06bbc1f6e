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
from pathlib import Path
from typing import Any

from rich.console import Console

import lab
from lab.errors import InputError

CONFIG = "config.json"
PROGRAM = "slam-lab"
PACKAGES = ("numpy", "scipy", "filterpy", "matplotlib", "pandas", "pyarrow", "joblib", "loky")
UNBOUNDED = 10_000  # columns of a file, which has no width


class RunError(Exception):
    """What was asked for could not be computed, through no fault of the command: one sentence, and status 1."""


class Stopped(Exception):
    """Ctrl-C, or the polite end that batch systems ask for, and what remains of the work: one sentence."""


def console() -> Console:
    """Return a console for standard output: as wide as the terminal, or as its contents where there is none."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=UNBOUNDED)


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
    from lab.records.files import TEMPORARY  # whose package reads .mat files, and so is slow to import

    made = [folder for folder in (path, *path.parents) if not os.path.exists(folder)]
    try:
        with _named_in_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            earlier = earlier_files(path)
            for left_over in path.glob(f"{TEMPORARY}*"):  # of a process that was killed
                shutil.rmtree(left_over, ignore_errors=True)
            temporary = Path(tempfile.mkdtemp(prefix=TEMPORARY, dir=path))
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


def describe(
    command: str, arguments: dict[str, Any], inputs: dict[str, dict[str, str]], also: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return how a result is made: the command that repeats it, its input files, and the versions used.

    Parameters
    ----------
    command : str
        Such as "compare".
    arguments : dict
        Every option by its long name; None for one that was not given, True for a switch, a tuple for several words.
    inputs : dict
        What `fingerprints` returned.
    also : tuple of str
        Packages used this time, whose versions matter.
    """
    from importlib.metadata import version  # reads much that --help need not wait for

    given = {name: value for name, value in arguments.items() if value is not None and value is not False}
    words = [word for name, value in given.items() for word in _typed(name, value)]
    return {
        "repeat": shlex.join([PROGRAM, command, *words]),
        "command": command,
        "arguments": {name: _recorded(value) for name, value in given.items()},
        "inputs": inputs,
        "versions": {"toy-slam-lab": lab.__version__, "python": platform.python_version()}
        | {name: version(name) for name in (*PACKAGES, *also)},
        "platform": platform.platform(),
    }


def write_config(folder: Path, config: dict[str, Any]) -> None:
    """Write config.json: what `describe` returned, and the names of the result's other files, which are there."""
    files = sorted([CONFIG, *(file.name for file in folder.iterdir())])
    (folder / CONFIG).write_text(json.dumps(config | {"files": files}, indent=2) + "\n", encoding="utf-8")


def _recorded(value: Any) -> Any:
    """Return what JSON keeps of an argument."""
    if isinstance(value, tuple):
        return [str(word) for word in value]
    return value if isinstance(value, int | float) else str(value)


def _typed(name: str, value: Any) -> list[str]:
    """Return the words with which an argument is given."""
    if name == "solver":
        return [str(value)]
    if value is True:
        return [f"--{name}"]
    return [f"--{name}", *map(str, value)] if isinstance(value, tuple) else [f"--{name}={value}"]


@contextmanager
def _named_in_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"The folder {path} cannot be written to: {error.strerror or error}.") from None


def earlier_config(path: Path) -> dict[str, Any] | None:
    """Return the config.json of an earlier result in this folder; None when there is none.

    Raises
    ------
    InputError
        It is another program's.
    """
    try:
        config = json.loads((path / CONFIG).read_text(encoding="utf-8"))
        ours = config["repeat"].startswith(f"{PROGRAM} ") and isinstance(config["files"], list)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        ours = False
    if not ours:
        raise InputError(f"The folder {path} holds a {CONFIG} that is not ours; choose another folder.")
    return config  # type: ignore[no-any-return]


def has_failures(path: Path) -> bool:
    """Whether some runs of the comparison in this folder failed."""
    import pandas as pd

    try:
        return bool((pd.read_parquet(path / "runs.parquet")["error"] != "").any())
    except (OSError, KeyError, ValueError):
        return False


def is_complete(path: Path, config: dict[str, Any]) -> bool:
    """Whether the folder holds the result that `config` asks for.

    Raises
    ------
    InputError
        It holds another one.
    """
    earlier = earlier_config(path)
    if earlier is None:
        return False
    if all(_decisive(earlier, part) == _decisive(config, part) for part in ("command", "arguments", "inputs")):
        return True
    raise InputError(f"The folder {path} holds another finished result; leave out --resume to replace it.")


def _decisive(config: dict[str, Any], part: str) -> Any:
    """Return the part of a config without the names of files, which may be written in several ways."""
    if part == "inputs":
        return {what: file["sha256"] for what, file in config["inputs"].items()}
    return {k: v for k, v in config[part].items() if k != "experiment"} if part == "arguments" else config[part]


def earlier_files(path: Path) -> list[str]:
    """Return the plain file names that an earlier result in this folder lists as its own."""
    config = earlier_config(path)
    return [name for name in config["files"] if Path(name).name == name] if config else []


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
