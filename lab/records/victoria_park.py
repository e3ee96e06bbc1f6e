"""Factor files of a robot and landmarks in the plane, such as the Victoria Park drive in GTSAM's collection.

Question answered: which motion joins each pose to the next, and what was seen from it?  A line is a factor:

    ODOMETRY i j dx dy dtheta  xx xy xt yy yt tt          covariance, upper triangle by rows
    EDGE_SE2 i j dx dy dtheta  xx xy xt yy yt tt          information (g2o)
    EDGE2 or EDGE i j dx dy dtheta  xx xy yy tt xt yt     information (TORO)
    LANDMARK pose id x y  xx xy yy                        covariance; the landmark's place in the robot's frame
    EDGE_SE2_XY or LANDMARK2 pose id x y  xx xy yy        information
    BR pose id bearing range  deviation of bearing, of range

Poses are numbered in the order of time.  Whether a number means a pose or a landmark follows from its place in the
line: Victoria Park numbers both in one series, other files use the same number for both.  Initial guesses (VERTEX...)
are not read; an edge between poses that do not follow each other closes a loop without a landmark, which a filter that
keeps only the newest pose cannot use: it is counted and left out.  Called by lab.ekfslam.
Source: GTSAM, gtsam/slam/dataset.cpp; G. Grisetti et al., g2o, file format.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.records.lines import MALFORMED, Skipped, content, numbers
from lab.validation import Array, InputError

TAG = re.compile(r"[A-Z][A-Z0-9_:]{1,30}")
PASSED_OVER = ("VERTEX", "FIX", "PARAMS")
MOST_KINDS = 4  # of lines left out that an error names
CLOSURE = "edge between poses that do not follow each other"


@dataclass(frozen=True, eq=False)
class FactorGraph:
    """The factors, in the order of time.

    Attributes
    ----------
    pose_ids : (N,) array of int
        The file's numbers of the poses.
    odometry : (N - 1, 3) array
        Motion from each pose to the next in its frame, dx [m], dy [m], dtheta [rad].
    odometry_covs : (N - 1, 3, 3) array
        Its covariance.
    landmark_ids : (L,) array of int
        The file's numbers of the landmarks, in the order in which they are first seen.
    poses_of : (S,) array of int
        Row of `pose_ids` from which each sighting was made; never decreases.
    landmarks_of : (S,) array of int
        Row of `landmark_ids` that was seen.
    sightings : (S, 2) array
        Where it was seen in the robot's frame, x forward and y to the left [m].
    sighting_covs : (S, 2, 2) array
        Its covariance [m^2].
    polar : (S, 2) array or None
        Ranges [m] and bearings [rad], where the file gives nothing else (BR).
    polar_covs : (S, 2, 2) array or None
        Their covariances.
    skipped : Skipped
        Lines left out.
    sorted_lines : int
        Sightings that stood after one of a later pose.
    """

    pose_ids: NDArray[np.int64]
    odometry: Array
    odometry_covs: Array
    landmark_ids: NDArray[np.int64]
    poses_of: NDArray[np.int64]
    landmarks_of: NDArray[np.int64]
    sightings: Array
    sighting_covs: Array
    polar: Array | None
    polar_covs: Array | None
    skipped: Skipped
    sorted_lines: int


Edge = tuple[Array, Array]  # mean and covariance
Seen = tuple[int, int, Edge, Edge | None, str]  # pose, landmark, place, the same as range and bearing, file:line


def read(path: str | Path) -> FactorGraph:
    """Return the factors of a file.

    Raises
    ------
    InputError
        The file is missing, cannot be read, or holds no motion or no sighting of a landmark; or two poses that follow
        each other are joined by no usable line.

    GTSAM's load2D and g2o's file format.
    """
    path = Path(path)
    skipped = Skipped()
    edges: dict[tuple[int, int], tuple[Edge, str]] = {}
    seen: list[Seen] = []
    for line, text in content(path):
        tag, *rest = text.split()
        where = f"{path.name}:{line}"
        if tag.startswith(PASSED_OVER):
            continue
        if tag not in LINES:
            skipped.add(f"unknown tag {tag}" if TAG.fullmatch(tag) else MALFORMED, where)
            continue
        length, parse = LINES[tag]
        values = numbers(rest, length)
        factor = parse(np.array(values[2:])) if values and values[0] % 1 == values[1] % 1 == 0 else None
        if values is None or factor is None:
            skipped.add(MALFORMED, where)
            continue
        i, j = int(values[0]), int(values[1])
        if tag in EDGES:
            if i == j or (i, j) in edges or (j, i) in edges:
                skipped.add("edge of a pose to itself" if i == j else "repeated edge", where)
            else:
                edges[i, j] = factor, where
        else:
            seen.append((i, j, factor, _polar(values[2:]) if tag == POLAR else None, where))
    return _assembled(path, edges, seen, skipped)


def _assembled(
    path: Path,
    edges: dict[tuple[int, int], tuple[Edge, str]],
    seen: list[Seen],
    skipped: Skipped,
) -> FactorGraph:
    """Put the factors in the order of time."""
    if not edges or not seen:
        what = (
            "motion (ODOMETRY, EDGE_SE2, EDGE2)" if not edges else "sighting of a landmark (LANDMARK, BR, EDGE_SE2_XY)"
        )
        raise InputError(f"{path} holds no {what}{_because(skipped)}.")
    poses = sorted({pose for pair in edges for pose in pair})
    chain = []
    for before, after in pairwise(poses):
        if (before, after) in edges:
            chain.append(edges.pop((before, after))[0])
        elif (after, before) in edges:
            chain.append(_reversed(*edges.pop((after, before))[0]))
        else:
            raise InputError(f"{path} has no motion from pose {before} to pose {after}{_because(skipped)}.")
    for _, where in edges.values():
        skipped.add(CLOSURE, where)
    row_of = {pose: row for row, pose in enumerate(poses)}
    known = [entry for entry in seen if entry[0] in row_of]
    for entry in seen:
        if entry[0] not in row_of:
            skipped.add("sighting from an unknown pose", entry[-1])
    if not known:
        raise InputError(f"{path} has no sighting from a pose of its own{_because(skipped)}.")
    n_sorted = sum(later[0] < earlier[0] for earlier, later in pairwise(known))
    known.sort(key=lambda entry: entry[0])
    landmark_ids = list(dict.fromkeys(entry[1] for entry in known))
    polar = [entry[3] for entry in known if entry[3] is not None]
    whole = len(polar) == len(known)
    column_of = {landmark: column for column, landmark in enumerate(landmark_ids)}
    return FactorGraph(
        pose_ids=np.array(poses),
        odometry=np.array([mean for mean, _ in chain]),
        odometry_covs=np.array([cov for _, cov in chain]),
        landmark_ids=np.array(landmark_ids),
        poses_of=np.array([row_of[entry[0]] for entry in known]),
        landmarks_of=np.array([column_of[entry[1]] for entry in known]),
        sightings=np.array([entry[2][0] for entry in known]),
        sighting_covs=np.array([entry[2][1] for entry in known]),
        polar=np.array([mean for mean, _ in polar]) if whole else None,
        polar_covs=np.array([cov for _, cov in polar]) if whole else None,
        skipped=skipped,
        sorted_lines=n_sorted,
    )


def _because(skipped: Skipped) -> str:
    told = skipped.sentences()[:MOST_KINDS]
    return f" (left out: {'; '.join(told)}{', ...' if len(told) < len(skipped.counts) else ''})" if told else ""


def _reversed(mean: Array, cov: Array) -> Edge:
    """Return the motion that undoes this one, with its covariance to first order."""
    dx, dy, turn = mean
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, s], [-s, c]])  # R(turn)'
    place = -back @ mean[:2]
    jacobian = np.zeros((3, 3))
    jacobian[:2, :2] = -back
    jacobian[:2, 2] = [s * dx - c * dy, c * dx + s * dy]
    jacobian[2, 2] = -1
    return np.array([*place, -turn]), jacobian @ cov @ jacobian.T


def _symmetric(size: int, order: str, entries: Array) -> Array:
    """Return the matrix whose upper triangle is given, by rows or in TORO's order xx xy yy tt xt yt."""
    matrix = np.zeros((size, size))
    upper = np.triu_indices(size) if order == "rows" else (np.array([0, 0, 1, 2, 0, 1]), np.array([0, 1, 1, 2, 2, 2]))
    matrix[upper] = entries
    matrix.T[upper] = entries
    return matrix


def _factor(size: int, kind: str, order: str = "rows") -> Callable[[Array], Edge | None]:
    """Return the function that turns the numbers after the two ids into a mean and a covariance, or None."""

    def parse(values: Array) -> Edge | None:
        matrix = _symmetric(size, order, values[size:])
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            return None
        cov = np.linalg.inv(matrix) if kind == "information" else matrix
        return values[:size], (cov + cov.T) / 2

    return parse


def _bearing_range(values: Array) -> Edge | None:
    """Return the place that a bearing and a range point to, with its covariance to first order."""
    bearing, distance, bearing_std, distance_std = values
    if distance <= 0 or bearing_std <= 0 or distance_std <= 0:
        return None
    along, across = np.array([np.cos(bearing), np.sin(bearing)]), np.array([-np.sin(bearing), np.cos(bearing)])
    cov = distance_std**2 * np.outer(along, along) + (distance * bearing_std) ** 2 * np.outer(across, across)
    return distance * along, cov


def _polar(values: list[float]) -> Edge:
    bearing, distance, bearing_std, distance_std = values
    return np.array([distance, bearing]), np.diag([distance_std**2, bearing_std**2])


# how many numbers follow each tag, and how they are read
POLAR = "BR"
EDGES = ("ODOMETRY", "EDGE_SE2", "EDGE2", "EDGE")
LINES: dict[str, tuple[int, Callable[[Array], Edge | None]]] = {
    "ODOMETRY": (11, _factor(3, "covariance")),
    "EDGE_SE2": (11, _factor(3, "information")),
    "EDGE2": (11, _factor(3, "information", "TORO")),
    "EDGE": (11, _factor(3, "information", "TORO")),
    "LANDMARK": (7, _factor(2, "covariance")),
    "EDGE_SE2_XY": (7, _factor(2, "information")),
    "LANDMARK2": (7, _factor(2, "information")),
    POLAR: (6, _bearing_range),
}
