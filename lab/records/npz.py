"""Our own experiment files: the fields of `lab.problem`, time first, in one compressed .npz."""

from pathlib import Path
from typing import Any

import numpy as np

from lab.validation import InputError

FIELDS = ("F", "B", "Q", "m0", "P0", "z", "H", "R", "centre")


def read(path: Path) -> dict[str, Any]:
    """Return the fields of an .npz; `truth` is None where the file has none.

    Raises
    ------
    InputError
        Not an .npz of experiments.
    """
    with path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        fields: dict[str, Any] = dict(archive) if isinstance(archive, np.lib.npyio.NpzFile) else {}
    missing = [name for name in FIELDS if name not in fields]
    if missing:
        raise InputError(f"{path} is not an experiment: it has no {', '.join(missing)}.")
    return {"truth": None, **fields}


def write(path: Path, fields: dict[str, Any]) -> None:
    """Write the fields; `truth` may be None and is then left out."""
    np.savez_compressed(
        path, allow_pickle=False, **{name: value for name, value in fields.items() if value is not None}
    )
