"""MATLAB files of the original lab: its names and shapes outside, time-first arrays inside.

Question answered: what does a .mat of `dataSimulation` say?  Time comes last there, vectors are (n, 1) columns and
scalars (1, 1).  The older edition lacks M, B, CC, arrayH, arrayR and in_fov: B and CC are then 0, and H and R are
Hfull and Rv without what Z hides.  Source: figure 2 of the handout.
"""

from pathlib import Path
from typing import Any

import numpy as np

from data_simulation import Simulation
from lab.validation import Array, InputError, check_covariance, real_array

REQUIRED = ("Z", "F", "mX0", "PX0", "Qw")
NEWER = ("M", "arrayH", "arrayR", "in_fov")  # what the older edition lacks, beside B and CC
SINGULAR = 1e-12


def read(path: Path) -> dict[str, Any]:
    """Return the fields of a .mat of either edition; variables of other names are left alone.

    Raises
    ------
    InputError
        A -v7.3 file, a file in Octave's own format, or a variable that is missing or of the wrong kind or shape.
    """
    return from_handout(load(path))


def load(path: Path) -> dict[str, Any]:
    """Return the variables of a MATLAB file as scipy reads them, sparse matrices made dense.

    Raises
    ------
    InputError
        A -v7.3 file, or a file in Octave's own format.
    """
    from scipy.io import loadmat
    from scipy.sparse import issparse

    with path.open("rb") as file:
        if file.read(80).startswith((b"# Created by Octave", b"Octave-1-")):
            raise InputError(f"{path} is a file of Octave's own: in Octave, save it with '-v7'.")
    try:
        variables = loadmat(path)
    except NotImplementedError:
        raise InputError(f"{path} is a -v7.3 file, which cannot be read: in MATLAB, save it with '-v7'.") from None
    return {name: value.toarray() if issparse(value) else value for name, value in variables.items()}


def from_handout(variables: dict[str, Any]) -> dict[str, Any]:
    """Turn the handout's variables into time-first fields.

    Parameters
    ----------
    variables : dict
        By the handout's names, from MATLAB or from `data_simulation`: columns and (1, 1) scalars, or vectors.

    Raises
    ------
    InputError
        A variable is missing or has the wrong shape; the message names it.
    """
    missing = [name for name in REQUIRED if name not in variables]
    missing += [" or ".join(pair) for pair in (("arrayH", "Hfull"), ("arrayR", "Rv")) if not {*pair} & {*variables}]
    if missing:
        raise InputError(f"the variable {missing[0]} is missing." if len(missing) == 1 else _list_missing(missing))
    Z = real_array("Z", variables["Z"], (-1, -1), finite=False)
    rows, N = Z.shape
    for name, expected, meaning in (("M", rows / 2, "landmarks"), ("N", N, "instants")):
        if name in variables and np.asarray(variables[name]).ravel().tolist() != [expected]:
            given = np.asarray(variables[name]).ravel().tolist()
            raise InputError(f"Z has shape ({rows}, {N}), which does not fit {name} = {given} {meaning}.")
    n = rows + 2
    F = real_array("F", variables["F"], (n, n))
    B, centre = _input_and_centre(variables, F)
    for name in ("Qw", "PX0"):
        check_covariance(name, real_array(name, variables[name], (n, n)))
    return {
        "z": Z.T,
        "H": _over_time(variables, "arrayH", "Hfull", (rows, n), N),
        "R": _over_time(variables, "arrayR", "Rv", (rows, rows), N),
        "F": F,
        "B": B,
        "Q": real_array("Qw", variables["Qw"], (n, n)),
        "m0": _vector(variables, "mX0", n),
        "P0": real_array("PX0", variables["PX0"], (n, n)),
        "truth": real_array("X", variables["X"], (n, N)).T if "X" in variables else None,
        "centre": centre,
    }


def write(path: Path, fields: dict[str, Any]) -> None:
    """Write an experiment's fields under the handout's names and shapes."""
    rows = fields["z"].shape[1]
    variables = {
        "N": len(fields["z"]),
        "M": rows // 2,
        "Z": fields["z"].T,
        "arrayH": np.moveaxis(fields["H"], 0, -1),
        "arrayR": np.moveaxis(fields["R"], 0, -1),
        "in_fov": np.where(np.isnan(fields["z"].T), np.nan, 1.0),
        "F": fields["F"],
        "B": fields["B"],
        "CC": fields["centre"],
        "mX0": fields["m0"],
        "PX0": fields["P0"],
        "Qw": fields["Q"],
    }
    if fields["truth"] is not None:
        variables["X"] = fields["truth"].T
    _save(path, variables)


def write_simulation(path: Path, simulation: Simulation) -> None:
    """Write all 16 variables of a simulation, as the original does."""
    _save(path, {**simulation._asdict(), "T": simulation.T[np.newaxis, :]})


def _save(path: Path, variables: dict[str, Any]) -> None:
    from scipy.io import savemat  # takes a tenth of a second, for which few commands have a use

    doubles = {name: np.asarray(value, dtype=np.float64) for name, value in variables.items()}
    savemat(path, doubles, oned_as="column", do_compression=True)


def _over_time(variables: dict[str, Any], name: str, constant: str, shape: tuple[int, int], N: int) -> Array:
    """Return a matrix for each instant; MATLAB drops a last axis of length 1."""
    if name in variables:
        given = np.asarray(variables[name])
        array = real_array(
            name, given[:, :, np.newaxis] if given.ndim == 2 and N == 1 else given, (*shape, N), finite=False
        )
        return np.moveaxis(array, -1, 0)
    return np.broadcast_to(real_array(constant, variables[constant], shape), (N, *shape))


def _input_and_centre(variables: dict[str, Any], F: Array) -> tuple[Array, Array]:
    """Return B (n,) and CC (2,); either follows from the other, and both are 0 in the older edition, which has neither.

    Raises
    ------
    InputError
        Both are missing from a file of the newer edition, or CC does not follow from B.
    """
    away = np.eye(2) - F[:2, :2]
    if "B" in variables and "CC" in variables:
        return _vector(variables, "B", len(F)), _vector(variables, "CC", 2)
    if "CC" in variables:
        centre = _vector(variables, "CC", 2)
        return np.concatenate([away @ centre, np.zeros(len(F) - 2)]), centre
    if "B" in variables:
        B = _vector(variables, "B", len(F))
        if abs(np.linalg.det(away)) < SINGULAR:
            raise InputError("the variable CC is missing, and does not follow from B.")
        return B, np.asarray(np.linalg.solve(away, B[:2]), dtype=np.float64)
    newer = [name for name in NEWER if name in variables]
    if newer:
        raise InputError(f"the variables B and CC are missing (only the older edition, without {newer[0]}, has none).")
    return np.zeros(len(F)), np.zeros(2)


def _vector(variables: dict[str, Any], name: str, length: int) -> Array:
    """Return a vector given as (n,), (n, 1) or (1, n)."""
    given = np.asarray(variables[name])
    return real_array(name, given.ravel() if given.ndim == 2 and 1 in given.shape else given, (length,))


def _list_missing(missing: list[str]) -> str:
    return f"the variables {', '.join(missing[:-1])} and {missing[-1]} are missing."
