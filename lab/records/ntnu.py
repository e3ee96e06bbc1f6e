"""Simulations in the manner of NTNU's course TTK4250: odometry, and sightings that do not say of what.

Question answered: how did the robot move at each step, at which ranges and bearings did it see something, and where was
it really?  A .mat file holds, for K steps,

    odometry   3 x K       motion dx [m], dy [m], dtheta [rad] in the robot's frame, from step k to k + 1
    z          K cells     of 2 x n: ranges [m] and bearings [rad] seen at step k, before that motion
    poseGT     3 x K + 1   true x [m], y [m], theta [rad] (may be missing; K columns will do)
    landmarks  2 x M       true places [m] (may be missing)

each of them also transposed.  A .txt file says the same in lines, steps counted from 0 (comments begin with # or %):

    ODOMETRY k dx dy dtheta     SIGHTING k range bearing     POSE k x y theta     LANDMARK x y

Called by lab.ekfslam.  Source: E. Brekke, Fundamentals of Sensor Fusion (2020), assignments of TTK4250.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.records import mat
from lab.records.files import readable
from lab.records.lines import MALFORMED, Skipped, content, numbers
from lab.validation import Array, InputError, real_array

WIDTHS = {"ODOMETRY": 4, "SIGHTING": 3, "POSE": 4, "LANDMARK": 2}
UNUSABLE = "sighting without a finite bearing and a positive range"


@dataclass(frozen=True, eq=False)
class NtnuLog:
    """One simulation of K steps.

    Attributes
    ----------
    odometry : (K, 3) or (K - 1, 3) array
        Motion from step k to k + 1 in the robot's frame [m, m, rad].
    sightings : tuple of K arrays (n, 2)
        Ranges [m] and bearings [rad] seen at step k, before the motion.
    truth : (K, 3) array or None
        True poses at the K steps [m, m, rad].
    landmarks : (M, 2) array or None
        True places [m].
    skipped : Skipped
        Sightings (of a .mat) or lines (of a .txt) left out.
    """

    odometry: Array
    sightings: tuple[Array, ...]
    truth: Array | None
    landmarks: Array | None
    skipped: Skipped


def read(path: str | Path) -> NtnuLog:
    """Return what a .mat or .txt of a simulation says.

    Raises
    ------
    InputError
        The file is missing, of another kind or cannot be read; a variable is missing, has the wrong shape or is not
        finite; or the numbers of steps do not agree.

    TTK4250, simulated SLAM.
    """
    path = Path(path)
    readers = {".mat": _read_mat, ".txt": _read_txt}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: a simulation in the manner of NTNU ends in .mat or .txt.")
    with readable(path):
        odometry, sightings, truth, landmarks, skipped = readers[path.suffix.lower()](path)
    steps = len(sightings)
    if not steps or not any(len(seen) for seen in sightings):
        raise InputError(f"{path} holds no sighting of a landmark.")
    if len(odometry) not in (steps - 1, steps):
        raise InputError(f"{path} has sightings of {steps} steps, which need {steps} motions, but has {len(odometry)}.")
    if truth is not None and len(truth) < steps:
        raise InputError(f"{path} has {len(truth)} true poses for {steps} steps.")
    return NtnuLog(odometry, sightings, truth if truth is None else truth[:steps], landmarks, skipped)


Parts = tuple[Array, tuple[Array, ...], Array | None, Array | None, Skipped]


def _read_mat(path: Path) -> Parts:
    variables = mat.load(path)
    missing = [name for name in ("odometry", "z") if name not in variables]
    if missing:
        raise InputError(
            f"{path}: the variable {missing[0]} is missing; a simulation has odometry, z, poseGT, landmarks."
        )
    skipped = Skipped()
    sightings = _cells(path, variables["z"], skipped)
    truth = _by_rows(path, "poseGT", variables["poseGT"], 3) if "poseGT" in variables else None
    landmarks = _by_rows(path, "landmarks", variables["landmarks"], 2) if "landmarks" in variables else None
    return _by_rows(path, "odometry", variables["odometry"], 3), sightings, truth, landmarks, skipped


def _by_rows(path: Path, name: str, value: Any, width: int, *, finite: bool = True) -> Array:
    """Return a table of `width` columns, given as such or transposed; square, it counts as transposed."""
    given = np.asarray(value)
    if given.ndim == 2 and given.shape[0] == width:
        given = given.T
    return real_array(f"{path}: {name}", given, (-1, width), finite=finite)


def _cells(path: Path, value: Any, skipped: Skipped) -> tuple[Array, ...]:
    given = np.asarray(value)
    if given.dtype != object:
        raise InputError(f"{path}: z must be a cell array with the sightings of each step, not {given.dtype} numbers.")
    tables = [np.asarray(cell) for cell in given.ravel()]
    tables = [table if table.size else np.zeros((2, 0)) for table in tables]
    # where two sightings make a square, the other steps say which way the tables lie
    by_rows = any(table.ndim == 2 and table.shape[0] != 2 for table in tables)
    kept = []
    for k, table in enumerate(tables):
        rows = real_array(f"{path}: z{{{k + 1}}}", _finite_or_nan(table if by_rows else table.T), (-1, 2), finite=False)
        usable = np.isfinite(rows).all(axis=1) & (rows[:, 0] > 0)
        if not usable.all():
            skipped.add(UNUSABLE, f"{path.name}:z{{{k + 1}}}", int((~usable).sum()))
        kept.append(rows[usable])
    return tuple(kept)


def _finite_or_nan(table: Any) -> Any:
    return np.where(np.isinf(table), np.nan, table) if table.dtype.kind == "f" else table


def _read_txt(path: Path) -> Parts:
    skipped = Skipped()
    found: dict[str, list[tuple[str, list[float]]]] = {tag: [] for tag in WIDTHS}
    for line, text in content(path):
        tag, *rest = text.split()
        where = f"{path.name}:{line}"
        values = numbers(rest, WIDTHS[tag]) if tag in WIDTHS else None
        if values is None or (tag != "LANDMARK" and (values[0] < 0 or values[0] % 1)):
            skipped.add(MALFORMED, where)
        elif tag == "SIGHTING" and values[1] <= 0:
            skipped.add(UNUSABLE, where)
        else:
            found[tag].append((where, values))
    if not found["ODOMETRY"]:
        raise InputError(f"{path} has no line ODOMETRY k dx dy dtheta.")
    odometry = _by_steps(path, "ODOMETRY", found["ODOMETRY"], skipped)
    seen: Sequence[list[list[float]]] = [[] for _ in range(len(odometry) + 1)]
    for where, (k, *sighting) in found["SIGHTING"]:
        if k > len(odometry):
            skipped.add("sighting at an unknown step", where)
        else:
            seen[int(k)].append(sighting)
    poses = _by_steps(path, "POSE", found["POSE"], skipped) if found["POSE"] else None
    steps = len(seen) - (not seen[-1])  # whether anything is seen after the last motion
    landmarks = np.array([values for _, values in found["LANDMARK"]]) if found["LANDMARK"] else None
    sightings = tuple(np.array(rows).reshape(-1, 2) for rows in seen[:steps])
    return odometry, sightings, poses, landmarks, skipped


def _by_steps(path: Path, tag: str, lines: list[tuple[str, list[float]]], skipped: Skipped) -> Array:
    """Return the lines of a tag in the order of their steps, which must be 0, 1, 2 and so on."""
    by_step: dict[int, list[float]] = {}
    for where, (k, *values) in lines:
        if k in by_step:
            skipped.add("repeated step", where)
        else:
            by_step[int(k)] = values
    gap = next((k for k in range(len(by_step)) if k not in by_step), None)
    if gap is not None:
        raise InputError(f"{path} has no usable line {tag} of step {gap}, though it has some of later steps.")
    return np.array([by_step[k] for k in range(len(by_step))])
