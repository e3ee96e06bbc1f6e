"""What students are given: a folder that installs and runs by itself, and holds nothing of the instructors'.

Question answered: which files does a student need?  The student notebooks with their pictures, the laboratory, the
simulator, the pins of what is run, and how to begin.  Not in it: solutions, hidden tests, the suite of tests, the
release.
"""

import re
import shutil
import tomllib
from pathlib import Path

from lab.release.course import NOTEBOOKS, Course
from lab.validation import InputError

FILES = ("data_simulation.py", "pyproject.toml", "LICENSE")
PINS = "environment.txt"
README = "README.md"
LAB = "lab"
SECRET = ("release",)  # folders of lab/ that serve instructors only
NAME = re.compile(r"[A-Za-z0-9._-]+")


def write_bundle(course: Course, target: Path) -> list[str]:
    """Write the bundle into an empty or new folder and return the files' paths inside it.

    Parameters
    ----------
    course : Course
    target : Path

    Raises
    ------
    InputError
        The folder holds something, lies inside what is copied, or a notebook cannot be released.
    """
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InputError(f"{target} is not an empty folder.")
    root = course.root.resolve()
    if any(target.resolve().is_relative_to(root / folder) for folder in (LAB, NOTEBOOKS)):
        raise InputError(f"{target} lies inside the course itself; choose a folder elsewhere.")
    derived = course.derived()  # before anything is written
    for name in FILES:
        _copy(root / name, target / name)
    for path in sorted((root / LAB).rglob("*")):
        parts = path.relative_to(root / LAB).parts
        if path.is_file() and "__pycache__" not in parts and parts[0] not in SECRET:
            _copy(path, target / LAB / Path(*parts))
    for name, content in derived.items():
        (target / NOTEBOOKS / name).parent.mkdir(parents=True, exist_ok=True)
        (target / NOTEBOOKS / name).write_bytes(content)
    _copy(root / NOTEBOOKS / README, target / README)
    (target / PINS).write_text("".join(f"{line}\n" for line in _pins(root)), encoding="utf-8", newline="\n")
    return sorted(path.relative_to(target).as_posix() for path in target.rglob("*") if path.is_file())


def _pins(root: Path) -> list[str]:
    """Return the lines of environment.txt for what is run, those for tests and checks left out."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {_plain(line) for line in project["dependencies"]}
    return [line for line in (root / PINS).read_text(encoding="utf-8").splitlines() if _plain(line) in needed]


def _plain(requirement: str) -> str:
    match = NAME.match(requirement)
    return re.sub(r"[-_.]+", "-", match[0]).lower() if match else ""


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
