"""How far the replayed estimates are from the truth, as they are and after the best rigid motion.

Question answered: how wrong is the way, how wrong the map, and is the filter as sure as it should be?

    position, heading   root mean square over all noted steps that have a truth [m], [rad]
    landmark            root mean square over the final landmarks that have a truth [m]
    aligned             the same after the motion of SE(2) that fits the estimated way, or the landmarks, best
    nees_mean           mean of the poses' NEES over the steps that have a truth: 3 for a consistent filter
    nis_per_dof         normalised innovation squared by degree of freedom: 1 for one that knows its noise

Every map has a frame of its own, so where robots have separate maps each is aligned by itself.  What has no truth is
NaN.  Called by lab.ekfslam.app_data.
"""

from collections.abc import Sequence

import numpy as np

from lab.ekfslam.alignment import align, apply
from lab.ekfslam.frames import wrap
from lab.ekfslam.recording import Recording
from lab.ekfslam.replay import Replayed
from lab.validation import Array


def score(maps: Sequence[tuple[Recording, Replayed]]) -> dict[str, float]:
    """Return the errors and figures of consistency of one map, or of several together.

    Parameters
    ----------
    maps : sequence of (Recording, Replayed)

    Returns
    -------
    dict of str to float
        position_rmse, position_rmse_aligned, heading_rmse, landmark_rmse, landmark_rmse_aligned, nees_mean and
        nis_per_dof; NaN for what has no truth.
    """
    ways = [found_and_true(run) for _, run in maps]
    points = [landmarks_and_truth(recording, run) for recording, run in maps]
    turns = [wrap(run.truth[:, 2] - run.poses[:, 2]) for _, run in maps]
    nees = np.concatenate([run.nees for _, run in maps])
    dof = sum(float(run.dof.sum()) for _, run in maps)
    return {
        "position_rmse": rms(ways),
        "position_rmse_aligned": rms([aligned(*way) for way in ways]),
        "heading_rmse": _root_mean(np.square(np.concatenate(turns))),
        "landmark_rmse": rms(points),
        "landmark_rmse_aligned": rms([aligned(*pair) for pair in points]),
        "nees_mean": _mean(nees),
        "nis_per_dof": sum(float(run.nis.sum()) for _, run in maps) / dof if dof else np.nan,
    }


def found_and_true(run: Replayed) -> tuple[Array, Array]:
    """Return estimated and true positions (k, 2) of the noted steps that have a truth."""
    known = np.isfinite(run.truth).all(axis=1)
    return run.poses[known, :2], run.truth[known, :2]


def landmarks_and_truth(recording: Recording, run: Replayed) -> tuple[Array, Array]:
    """Return estimated and true positions (k, 2) of the final landmarks that have a truth."""
    pairs = [
        (point, recording.landmarks[identity])
        for name, point in run.landmarks.items()
        if (identity := run.identities[name]) in recording.landmarks
    ]
    return np.reshape([point for point, _ in pairs], (-1, 2)), np.reshape([truth for _, truth in pairs], (-1, 2))


def aligned(estimate: Array, truth: Array) -> tuple[Array, Array]:
    """Return the estimate (k, 2) moved as a rigid body to where it fits the truth best, and the truth."""
    return (apply(*align(estimate, truth), estimate) if len(estimate) else estimate), truth


def rms(pairs: Sequence[tuple[Array, Array]]) -> float:
    """Return the root mean square distance between points and points, over all pairs of arrays; NaN where none."""
    return _root_mean(np.concatenate([np.square(one - other).sum(axis=1) for one, other in pairs]))


def _root_mean(squares: Array) -> float:
    return float(np.sqrt(_mean(squares)))


def _mean(values: Array) -> float:
    """Return the mean of what is a number; NaN where nothing is."""
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else float("nan")
