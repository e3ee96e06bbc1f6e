"""Folders of the UTIAS multi-robot data sets (MRCLAM): commands, sightings of barcodes, and what a camera system saw.

Question answered: what did each robot do and see, and where was it really?  A folder holds, as .dat or .dat.gz,

    Barcodes              subject  barcode
    Landmark_Groundtruth  subject  x [m]  y [m]  deviation of x [m]  deviation of y [m]      (may be missing)
    RobotN_Odometry       t [s]  v [m/s]  w [rad/s]       the command from t on
    RobotN_Measurement    t [s]  barcode  range [m]  bearing [rad]
    RobotN_Groundtruth    t [s]  x [m]  y [m]  theta [rad]                                   (may be missing)

A subject is a robot when the folder has files of it, or when its number is that of a robot of the original fleet (1 to
5) and the landmarks' file does not list it; every other subject is a landmark.  Time counts from the folder's first
command.  Called by lab.ekfslam.
Source: K. Leung, Y. Halpern, T. Barfoot, H. Liu, The UTIAS multi-robot cooperative localization and mapping dataset,
IJRR 30(8):969-974, 2011.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.records.lines import Skipped, table
from lab.validation import Array, InputError

FLEET = range(1, 6)
COMMANDS = re.compile(r"Robot(\d+)_Odometry\.dat(\.gz)?")


@dataclass(frozen=True, eq=False)
class RobotLog:
    """What one robot did and saw; every array is sorted by time.

    Attributes
    ----------
    commands : (n, 3) array
        Time [s], strictly increasing, forward velocity [m/s] and angular velocity [rad/s], held until the next.
    sighting_times : (m,) array
        [s]; several sightings may share one.
    subjects : (m,) array of int
        What was seen, by subject.
    sightings : (m, 2) array
        Range [m] and bearing [rad].
    truth : (k, 4) array or None
        Time [s], strictly increasing, x [m], y [m], theta [rad].
    """

    commands: Array
    sighting_times: Array
    subjects: NDArray[np.int64]
    sightings: Array
    truth: Array | None


@dataclass(frozen=True, eq=False)
class Mrclam:
    """One folder, or the part of it that concerns the chosen robots.

    Attributes
    ----------
    robots : dict
        Log of each chosen robot, by its subject.
    others : frozenset of int
        Subjects that are robots too, but were not chosen.
    landmarks : dict
        True position (2,) [m] of each landmark that has one, by subject.
    skipped : Skipped
        Lines left out.
    sorted_lines : int
        Lines whose time stamp runs backwards, put in order.
    """

    robots: dict[int, RobotLog]
    others: frozenset[int]
    landmarks: dict[int, Array]
    skipped: Skipped
    sorted_lines: int


def read(path: str | Path, robots: Sequence[int] | None = None) -> Mrclam:
    """Return what a MRCLAM folder says about the chosen robots.

    Parameters
    ----------
    path : path
        The folder.
    robots : sequence of int, optional
        Subjects of the robots wanted; all that the folder has files of by default.

    Raises
    ------
    InputError
        The folder or a file is missing, cannot be read or holds nothing usable, a barcode stands for two subjects, or
        a robot is not there.

    Leung et al. (2011), section 4.
    """
    folder = Path(path)
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "does not exist"
        raise InputError(
            f"{folder} {what}: a MRCLAM data set is a folder with Barcodes.dat and the files of the robots."
        )
    present = sorted({int(match[1]) for file in folder.iterdir() if (match := COMMANDS.fullmatch(file.name))})
    if not present:
        raise InputError(f"{folder} holds no RobotN_Odometry.dat or .dat.gz: it is no MRCLAM data set.")
    chosen = present if robots is None else list(dict.fromkeys(robots))
    absent = [robot for robot in chosen if robot not in present]
    if absent or not chosen:
        listed = ", ".join(map(str, present))
        raise InputError(f"{folder} has no robot {absent[0]}: there are {listed}." if absent else "No robot is chosen.")
    skipped = Skipped()
    subject_of = _read_barcodes(_file(folder, "Barcodes"), skipped)
    landmark_file = _find(folder, "Landmark_Groundtruth")
    landmarks = _read_landmarks(landmark_file, skipped) if landmark_file else {}
    crew = {*present, *(number for number in FLEET if number not in landmarks)}
    logs, n_sorted = {}, 0
    for robot in chosen:
        logs[robot], n = _read_robot(folder, robot, subject_of, skipped)
        n_sorted += n
    origin = min(log.commands[0, 0] for log in logs.values())
    shifted = {robot: _shifted(log, origin) for robot, log in logs.items()}
    return Mrclam(shifted, frozenset(crew - {*chosen}), landmarks, skipped, n_sorted)


def _find(folder: Path, stem: str) -> Path | None:
    return next((file for ending in (".dat", ".dat.gz") if (file := folder / f"{stem}{ending}").exists()), None)


def _file(folder: Path, stem: str) -> Path:
    found = _find(folder, stem)
    if found is None:
        raise InputError(f"{folder} has no {stem}.dat or {stem}.dat.gz.")
    return found


def _read_barcodes(file: Path, skipped: Skipped) -> dict[float, int]:
    """Return the subject of each barcode."""
    subject_of: dict[float, int] = {}
    for (subject, barcode), line in zip(*table(file, 2, skipped), strict=True):
        taken = subject_of.setdefault(float(barcode), int(subject))
        if taken != subject:
            raise InputError(f"{file}, line {line}: barcode {barcode:g} belongs to subject {taken} already.")
    return subject_of


def _read_landmarks(file: Path, skipped: Skipped) -> dict[int, Array]:
    landmarks: dict[int, Array] = {}
    for (subject, x, y, _, _), line in zip(*table(file, 5, skipped), strict=True):
        if int(subject) in landmarks:
            skipped.add("repeated landmark", f"{file.name}:{line}")
        else:
            landmarks[int(subject)] = np.array([x, y])
    return landmarks


def _read_robot(folder: Path, robot: int, subject_of: dict[float, int], skipped: Skipped) -> tuple[RobotLog, int]:
    """Return the log of one robot, and how many of its lines had to be sorted."""
    commands, n_commands = _read_series(_file(folder, f"Robot{robot}_Odometry"), 3, skipped)
    file = _file(folder, f"Robot{robot}_Measurement")
    seen = []
    for (t, barcode, distance, bearing), line in zip(*table(file, 4, skipped), strict=True):
        subject = subject_of.get(barcode)
        if subject is None or subject == robot:
            skipped.add("unknown barcode" if subject is None else "sighting of itself", f"{file.name}:{line}")
        elif distance <= 0:
            skipped.add("range not positive", f"{file.name}:{line}")
        else:
            seen.append((t, float(subject), distance, bearing))
    sighted, n_sightings = _in_order(np.array(seen).reshape(-1, 4))
    truth_file = _find(folder, f"Robot{robot}_Groundtruth")
    truth, n_truth = _read_series(truth_file, 4, skipped) if truth_file else (None, 0)
    log = RobotLog(commands, sighted[:, 0], sighted[:, 1].astype(np.int64), sighted[:, 2:], truth)
    return log, n_commands + n_sightings + n_truth


def _read_series(file: Path, width: int, skipped: Skipped) -> tuple[Array, int]:
    """Return a table whose times strictly increase: of lines with the same stamp the last counts."""
    values, lines = table(file, width, skipped)
    ordered, n_sorted = _in_order(np.column_stack([values, lines]))
    last = np.append(np.diff(ordered[:, 0]) > 0, True)
    for line in ordered[~last, -1]:
        skipped.add("repeated time stamp", f"{file.name}:{line:g}")
    return ordered[last, :-1], n_sorted


def _in_order(values: Array) -> tuple[Array, int]:
    """Sort by the first column, and say how many rows came before an earlier one."""
    backwards = int((np.diff(values[:, 0]) < 0).sum())
    return values[np.argsort(values[:, 0], kind="stable")], backwards


def _shifted(log: RobotLog, origin: float) -> RobotLog:
    def since(values: Array) -> Array:
        return np.column_stack([values[:, 0] - origin, values[:, 1:]])

    truth = None if log.truth is None else since(log.truth)
    return RobotLog(since(log.commands), log.sighting_times - origin, log.subjects, log.sightings, truth)
