"""Solà's symbols: y range, l landmark, z innovation, Z its covariance, s prior on what is not measured.

Question answered: how does a landmark enter the map when only its distance is known?  It lies on a ring:

    s_j ~ N(2 pi j / n, (pi / n)^2)            a ring of n Gaussians on the bearing, each a hypothesis in the map
    w_j <- w_j N(z_j; 0, Z_j)                  every later range weighs them,
    l_j learns from it as if j were true       while robot and landmarks wait (Schmidt's consider update: gain 0)

Hypotheses that are too light leave the map and free their slots, two that have met are joined, and the last one is a
landmark like any other.  What the ranges taught it is in P, correlations included.
Source: J. Solà (2014), section 2.3.5 for the prior; the weighing is the common Gaussian sum.
"""

from collections.abc import Hashable

import numpy as np

from lab.ekfslam.entities import Landmark, Robot
from lab.ekfslam.filters import RINGS
from lab.ekfslam.map import Map
from lab.ekfslam.sensor import Sensor
from lab.validation import Array, InputError

LIGHT = 1e-3  # weight below which a hypothesis is given up
JOINED = 0.25  # squared Mahalanobis distance below which two are the same
SURE = 0.999  # weight above which the heaviest is the landmark
STRAIGHT = 0.3  # of the range's deviation: how far it may still bow
BOW = 0.5  # of the range's deviation: how far an arc may bow from its Gaussian's straight axis
FEWEST, MOST = 12, 60


def ring_size(distance: float, noise: float) -> int:
    """Return how many hypotheses a ring needs so that no arc of one deviation bows by more than BOW of the noise."""
    spread = np.sqrt(2 * BOW * noise / max(distance, noise))
    return int(np.clip(np.ceil(np.pi / spread), FEWEST, MOST))


class Ring:
    """The hypotheses of one landmark.

    Parameters
    ----------
    m : Map
    robot : Robot
        Who measured.
    sensor : Sensor
        Range-only.
    y : (1,) array
        The first range [m].
    name : hashable
        Of the landmark to be.

    Raises
    ------
    InputError
        The sensor measures more than a range, or the filter does not know rings.
    """

    def __init__(self, m: Map, robot: Robot, sensor: Sensor, y: Array, name: Hashable) -> None:
        if sensor.kind != "range":
            raise InputError("Rings are for landmarks of which only the range is measured.")
        m.filter.allow(RINGS)
        self.name = name
        n = ring_size(float(y[0]), float(sensor.noise[0]))
        full = Sensor("range-bearing", (sensor.noise[0], np.pi / n), sensor.mount)
        self.hypotheses: list[Landmark] = []
        for j in range(n):
            guess = np.array([y[0], 2 * np.pi * j / n])
            self.hypotheses.append(m.hypothesise(robot, full, guess, (name, j)))
        self.log_weights = np.full(n, -np.log(n))

    @property
    def weights(self) -> Array:
        """The probabilities of the hypotheses (n,), summing to 1."""
        return np.asarray(np.exp(self.log_weights))

    def refine(self, m: Map, robot: Robot, sensor: Sensor, y: Array) -> Landmark | None:
        """Weigh and sharpen the hypotheses by a range; return the landmark as soon as one is left, now in the map.

        Parameters
        ----------
        m : Map
        robot : Robot
        sensor : Sensor
        y : (1,) array
            Range [m].
        """
        for i, observation in enumerate(m.observe_all(robot, sensor, self.hypotheses, [y] * len(self.hypotheses))):
            log_determinant = np.linalg.slogdet(observation.Z)[1]
            self.log_weights[i] -= 0.5 * (observation.nis + log_determinant)
            m.refine(observation)
        self._normalise()
        self._join(m)
        self._thin(m, self.log_weights >= np.log(LIGHT))
        best = int(np.argmax(self.log_weights))
        if self.weights[best] < SURE or self._bow(m, robot, best) > STRAIGHT * sensor.noise[0]:
            return None
        self._thin(m, np.arange(len(self.hypotheses)) == best)
        return m.adopt(self.hypotheses[0], self.name)

    def give_up(self, m: Map) -> None:
        """Take all hypotheses out of the map."""
        self._thin(m, np.zeros(len(self.hypotheses), dtype=bool))

    def _bow(self, m: Map, robot: Robot, i: int) -> float:
        """Return how far the circle around the robot bows over one deviation of a hypothesis [m]."""
        mean, cov = m.point(self.hypotheses[i])
        distance = np.linalg.norm(mean - m.x[robot.rows[:2]])
        return float(np.linalg.eigvalsh(cov)[-1] / (2 * distance))

    def _join(self, m: Map) -> None:
        """Give the weight of a hypothesis to a heavier one that says the same."""
        order = np.argsort(-self.log_weights)
        means, covs = m.points(self.hypotheses)
        kept: list[int] = []
        for i in order:
            for k in kept:
                d = means[i] - means[k]
                if d @ np.linalg.solve(covs[i] + covs[k], d) < JOINED:
                    self.log_weights[k] = np.logaddexp(self.log_weights[k], self.log_weights[i])
                    self.log_weights[i] = -np.inf
                    break
            else:
                kept.append(i)

    def _thin(self, m: Map, keep: Array) -> None:
        for hypothesis, stays in zip(self.hypotheses, keep, strict=True):
            if not stays:
                m.withdraw(hypothesis)
        self.hypotheses = [h for h, stays in zip(self.hypotheses, keep, strict=True) if stays]
        self.log_weights = self.log_weights[keep]
        if self.hypotheses:
            self._normalise()

    def _normalise(self) -> None:
        top = self.log_weights.max()
        self.log_weights = self.log_weights - (top + np.log(np.exp(self.log_weights - top).sum()))
