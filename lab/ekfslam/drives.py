"""Simulations of NTNU and factor files as recordings: one robot that starts at the origin of its map, or at the truth.

Question answered: which control, which measurement and which noise does each line of the data stand for?  A simulation
gives ranges and bearings without names; the true poses and landmarks tell which landmark each is, by assignment.  A
factor file gives places in the robot's frame, each with its covariance, or ranges and bearings, and they are taken as
they are: turned into each other the noise would not be the file's.
Called by lab.ekfslam.app_data.
"""

from collections.abc import Hashable

import numpy as np
from scipy.optimize import linear_sum_assignment

from lab.ekfslam.frames import polar, to_frame, wrap
from lab.ekfslam.recording import Motion, Recording, Step
from lab.records.lines import Skipped
from lab.records.ntnu import NtnuLog
from lab.records.vertices import Values
from lab.records.victoria_park import FactorGraph
from lab.validation import Array

# the noise that the course's simulations were made with, deviations
COURSE_MOTION = (0.05, 0.05, np.pi / 180)  # [m, m, rad] a step
COURSE_SENSOR = (0.05, np.pi / 180)  # [m, rad]
CLUTTER = 50.0  # squared deviations from every true landmark (of 2 degrees of freedom) beyond which it is none of them


def from_simulation(
    log: NtnuLog, *, motion: tuple[float, float, float] = COURSE_MOTION, sensor: tuple[float, float] = COURSE_SENSOR
) -> Recording:
    """Return a simulation as a recording.

    Parameters
    ----------
    log : NtnuLog
    motion : (float, float, float)
        Deviation of the noise on each motion, forward, left [m] and turn [rad].
    sensor : (float, float)
        Deviation of range [m] and bearing [rad].

    Returns
    -------
    Recording
        It starts at the true pose, at the origin where there is none.  Landmarks are named by their row; without a
        truth the names are None.
    """
    Q, R = np.diag(np.square(motion)), np.diag(np.square(sensor))
    steps = []
    for k, seen in enumerate(log.sightings):
        truth = None if log.truth is None else log.truth[k]
        names: tuple[Hashable, ...] = (None,) * len(seen)
        if truth is not None and log.landmarks is not None:
            names = true_names(truth, log.landmarks, seen, np.asarray(sensor))
        motions = (Motion("robot", log.odometry[k - 1], Q),) if k else ()
        steps.append(Step("robot", motions, seen, np.broadcast_to(R, (len(seen), 2, 2)), names, truth))
    start = np.zeros(3) if log.truth is None else log.truth[0]
    landmarks: dict[Hashable, Array] = {} if log.landmarks is None else dict(enumerate(log.landmarks))
    return Recording({"robot": start}, tuple(steps), landmarks)


def true_names(pose: Array, landmarks: Array, seen: Array, deviations: Array) -> tuple[int | None, ...]:
    """Return which landmark each sighting (k, 2) from a true pose belongs to; None where none is near.

    Assignment of least squared distance, in deviations (2,) of the sensor.
    """
    names: list[int | None] = [None] * len(seen)
    rows = np.flatnonzero(np.any(landmarks != pose[:2], axis=1))  # where the robot stands nothing can be seen
    if len(seen) and len(rows):
        expected, _ = polar(to_frame(pose, landmarks[rows])[0])
        gap = seen[:, np.newaxis] - expected
        gap[..., 1] = wrap(gap[..., 1])
        cost = np.square(gap / deviations).sum(axis=-1)
        for i, j in zip(*linear_sum_assignment(np.minimum(cost, CLUTTER)), strict=True):
            if cost[i, j] < CLUTTER:
                names[i] = int(rows[j])
    return tuple(names)


def from_factors(graph: FactorGraph, reference: Values | None = None) -> Recording:
    """Return a factor file as a recording; landmarks carry the file's numbers.

    Parameters
    ----------
    graph : FactorGraph
    reference : Values, optional
        What stands in for the truth, by the file's numbers.

    Returns
    -------
    Recording
        It starts where the reference does, at the origin without one.
    """
    known = Values({}, {}, Skipped()) if reference is None else reference
    names = graph.landmark_ids[graph.landmarks_of].tolist()
    ys, Rs = graph.sightings, graph.sighting_covs
    sensor = "position"
    if graph.polar is not None and graph.polar_covs is not None:
        ys, Rs, sensor = graph.polar, graph.polar_covs, "range-bearing"
    at = np.searchsorted(graph.poses_of, np.arange(len(graph.pose_ids) + 1))
    steps = []
    for k, pose in enumerate(graph.pose_ids.tolist()):
        motions = (Motion("robot", graph.odometry[k - 1], graph.odometry_covs[k - 1]),) if k else ()
        part = slice(at[k], at[k + 1])
        steps.append(Step("robot", motions, ys[part], Rs[part], tuple(names[part]), known.poses.get(pose)))
    start = known.poses.get(int(graph.pose_ids[0]), np.zeros(3))
    return Recording({"robot": start}, tuple(steps), dict(known.landmarks.items()), sensor)
