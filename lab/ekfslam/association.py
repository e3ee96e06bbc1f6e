"""Solà's symbols: y measurement, e expectation, z = y - e innovation, Z its covariance; z' Z^-1 z is chi-square.

Question answered: which landmark does a measurement belong to?

    compatible   z' Z^-1 z <= chi2(p, dof): 9.21 at 99 % for two components, 6.63 for one; not "9 for everything"
    nearest      one to one, least sum of z' Z^-1 z, by assignment
    jcbb         the most pairs that are JOINTLY compatible, branch and bound: errors of the robot's pose move all
                 measurements together, which the cross-covariances know and single gates do not

A measurement without a landmark is new only when it is far from all; in between it is better dropped.
Source: J. Solà (2014), section 2.4; Neira and Tardós (2001) for jcbb.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import linear_sum_assignment

from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.map import Map
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.sensor import Sensor
from lab.gaussian import chi2_quantile
from lab.validation import Array, InputError

PROBABILITY = 0.99
NEW_BEYOND = 25.0
MOST_NODES = 20_000  # of the search of jcbb; beyond it the best found so far is returned


@lru_cache(maxsize=1024)
def gate(dof: int, probability: float = PROBABILITY) -> float:
    """Return the value that chi-square with `dof` degrees of freedom exceeds with probability 1 - `probability`."""
    if not 0 < probability < 1:
        raise InputError(f"The probability of a gate must lie strictly between 0 and 1, not {probability}.")
    return float(chi2_quantile(probability, dof))


def compatible(observation: Observation, probability: float = PROBABILITY) -> bool:
    """Return whether an observation passes its gate."""
    return observation.nis <= gate(observation.dof, probability)


@dataclass(frozen=True, eq=False)
class Matching:
    """Which landmark each measurement belongs to.

    Attributes
    ----------
    targets : list of Landmark or None
        One per measurement.
    nearest : (k,) array
        The least z' Z^-1 z of each measurement over all landmarks; infinite when there are none.
    """

    targets: list[Landmark | None]
    nearest: Array

    def new(self, beyond: float = NEW_BEYOND) -> list[int]:
        """Return which measurements have no landmark and are far from all."""
        return [i for i, t in enumerate(self.targets) if t is None and self.nearest[i] > beyond]


@dataclass(frozen=True, eq=False)
class Table:
    """All measurements against all landmarks: z (k, m, p), Z (m, p, p), z' Z^-1 z (k, m); landmarks' rows and H."""

    z: Array
    Z: Array
    distances: Array
    rows: Rows
    H: Array
    R: Array


def nearest(
    m: Map,
    robot: Robot,
    sensor: Sensor,
    ys: Sequence[Array],
    landmarks: Sequence[Landmark] | None = None,
    *,
    R: Array | None = None,
    probability: float = PROBABILITY,
) -> Matching:
    """Match by assignment, each pair within its gate.

    Parameters
    ----------
    m : Map
    robot : Robot
    sensor : Sensor
    ys : sequence of (p,) array
        Measurements of one instant.
    landmarks : sequence of Landmark, optional
        Candidates, all of one kind; by default the whole map.
    R : (p, p) array, optional
        The sensor's own by default.
    probability : float
        Of the gate.

    Returns
    -------
    Matching
    """
    landmarks = list(m.landmarks.values()) if landmarks is None else list(landmarks)
    if not len(ys) or not landmarks:
        return Matching([None] * len(ys), np.full(len(ys), np.inf))
    distances = _table(m, robot, sensor, ys, landmarks, R).distances
    limit = gate(sensor.size, probability)
    targets: list[Landmark | None] = [None] * len(ys)
    # a pair beyond the gate costs as much as no pair, so that it is never bought at the price of a good one
    for i, j in zip(*linear_sum_assignment(np.minimum(distances, limit)), strict=True):
        if distances[i, j] <= limit:
            targets[i] = landmarks[j]
    return Matching(targets, distances.min(axis=1))


def jcbb(
    m: Map,
    robot: Robot,
    sensor: Sensor,
    ys: Sequence[Array],
    landmarks: Sequence[Landmark] | None = None,
    *,
    R: Array | None = None,
    probability: float = PROBABILITY,
) -> Matching:
    """Match by joint compatibility, branch and bound; parameters as for `nearest`.

    Among matchings that are jointly compatible at `probability` the one with the most pairs, then the least joint
    distance, is returned; where the search exceeds MOST_NODES, the best found.
    """
    landmarks = list(m.landmarks.values()) if landmarks is None else list(landmarks)
    if not len(ys) or not landmarks:
        return Matching([None] * len(ys), np.full(len(ys), np.inf))
    table = _table(m, robot, sensor, ys, landmarks, R)
    search = _Search(m, table, sensor.size, probability)
    targets: list[Landmark | None] = [None] * len(ys)
    for i, j in search.best_pairs:
        targets[i] = landmarks[j]
    return Matching(targets, table.distances.min(axis=1))


class _Search:
    """Depth-first over measurements, those with few candidates first; the joint distance by a growing factor."""

    def __init__(self, m: Map, table: Table, size: int, probability: float) -> None:
        self.table, self.size, self.probability = table, size, probability
        allowed = table.distances <= gate(size, probability)
        options = [np.flatnonzero(row)[np.argsort(table.distances[i][row])] for i, row in enumerate(allowed)]
        self.order = sorted((i for i in range(len(options)) if len(options[i])), key=lambda i: len(options[i]))
        self.options = options
        # one joint covariance of all expectations that are candidates at all
        used = np.unique(np.concatenate([*options, np.empty(0, dtype=np.intp)])).astype(np.intp)
        self.place = {j: k for k, j in enumerate(used.tolist())}
        H, rows = table.H[used], table.rows[used]
        self.E = (
            H[:, None] @ m.joint.block(rows[:, None], rows[None, :]) @ np.swapaxes(H, -1, -2)[None]
            if len(used)
            else np.empty((0, 0, size, size))
        )
        self.best_pairs: list[tuple[int, int]] = []
        self.best_distance = np.inf
        self.nodes = 0
        self._descend(0, [], set(), np.empty((0, 0)), np.empty(0))

    def _descend(self, depth: int, pairs: list[tuple[int, int]], taken: set[int], inverse: Array, white: Array) -> None:
        """Try all options of the next measurement; `inverse` is L^-1 of Z = L L' of the pairs, `white` = L^-1 z."""
        distance = float(white @ white)
        if len(pairs) > len(self.best_pairs) or (len(pairs) == len(self.best_pairs) and distance < self.best_distance):
            self.best_pairs, self.best_distance = list(pairs), distance
        self.nodes += 1
        possible = len(pairs) + len(self.order) - depth
        if depth == len(self.order) or self.nodes > MOST_NODES:
            return
        i = self.order[depth]
        for j in self.options[i].tolist():
            if j in taken:
                continue
            grown = self._grow(pairs, i, j, inverse, white)
            if grown is not None:
                self._descend(depth + 1, [*pairs, (i, j)], taken | {j}, *grown)
                if possible < len(self.best_pairs) or (
                    possible == len(self.best_pairs) and distance >= self.best_distance
                ):
                    return
        if possible - 1 > len(self.best_pairs) or (
            possible - 1 == len(self.best_pairs) and distance < self.best_distance
        ):
            self._descend(depth + 1, pairs, taken, inverse, white)

    def _grow(
        self, pairs: list[tuple[int, int]], i: int, j: int, inverse: Array, white: Array
    ) -> tuple[Array, Array] | None:
        """Return L^-1 and L^-1 z with the pair added, or None when the set is no longer jointly compatible."""
        p, k = self.size, self.size * len(pairs)
        own = self.E[self.place[j], self.place[j]] + self.table.R
        cross = np.concatenate([self.E[self.place[b], self.place[j]] for _, b in pairs]) if pairs else np.empty((0, p))
        B = inverse @ cross
        factor = np.linalg.inv(np.linalg.cholesky(own - B.T @ B))
        fresh = factor @ (self.table.z[i, j] - B.T @ white)
        if white @ white + fresh @ fresh > gate(k + p, self.probability):
            return None
        larger = np.zeros((k + p, k + p))
        larger[:k, :k] = inverse
        larger[k:, :k] = -factor @ B.T @ inverse
        larger[k:, k:] = factor
        return larger, np.concatenate([white, fresh])


def _table(
    m: Map, robot: Robot, sensor: Sensor, ys: Sequence[Array], landmarks: Sequence[Landmark], R: Array | None
) -> Table:
    R = sensor.R if R is None else R
    expected = m.expect(robot, sensor, landmarks)
    e, E = np.array([x[0] for x in expected]), np.array([x[1] for x in expected])
    Z = E + R
    z = sensor.difference(np.asarray(ys, dtype=float)[:, None, :], e)
    distances = np.einsum("kmi,mij,kmj->km", z, np.linalg.inv(Z), z)
    return Table(z, Z, distances, np.array([x[2] for x in expected]), np.array([x[3] for x in expected]), R)
