"""Files of experiments: the original lab's .mat (both editions) and our .npz.

Question answered: how does an experiment get in and out of a file?  Readers return plain dictionaries of arrays, time
first, which `lab.problem` checks; writers take the same.  A file is written under a temporary name and renamed, so a
half-written one never carries the real name.
"""

from pathlib import Path
from typing import Any

from lab.records import mat, npz
from lab.records.files import atomic_path, readable
from lab.records.mat import from_handout, write_simulation
from lab.validation import InputError

__all__ = ["atomic_path", "from_handout", "read", "write", "write_simulation"]

FORMATS = {".mat": mat, ".npz": npz}


def read(path: str | Path) -> dict[str, Any]:
    """Return the fields F, B, Q, m0, P0, z, H, R, truth (or None) and centre of an experiment file.

    Raises
    ------
    InputError
        The file is missing, unreadable, of another kind, or lacks a variable.
    """
    path = Path(path)
    form = _format_of(path)
    with readable(path):
        fields: dict[str, Any] = form.read(path)
    return fields


def write(path: str | Path, fields: dict[str, Any]) -> None:
    """Write the fields that `read` returns.

    Raises
    ------
    InputError
        The ending is not .mat or .npz, or the file cannot be written.
    """
    path = Path(path)
    form = _format_of(path)
    with atomic_path(path) as temporary:
        form.write(temporary, fields)


def _format_of(path: Path) -> Any:
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: an experiment file ends in .mat or .npz.")
    return FORMATS[path.suffix.lower()]
