"""Solà's symbols: r robot, l landmark, y measurement, e and E expectation, z and Z innovation, H its Jacobian.

Question answered: who takes part?  A map has robots and landmarks, a robot has sensors, and each pair of a sensor and a
landmark is an observation.  These are plain records; what is done to them is in `map` and `filters`, and the loop that
leads them through the events is in `slam`.  Source: J. Solà (2014), sections 1.3 and 2.4.
"""

from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import cached_property

from lab.ekfslam.joint import whitening
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.sensor import Sensor
from lab.validation import Array


@dataclass(eq=False)
class Robot:
    """A robot in the map.

    Attributes
    ----------
    name : hashable
    rows : (3,) array of int
        Its slots: [x, y, a].
    sensors : list of Sensor
    Q : (2, 2) or (3, 3) array or None
        Covariance of the noise on its controls, where it is always the same.
    prior : (3,) array
        Its pose before the corrections since its last move: where `fej` linearises.
    """

    name: Hashable
    rows: Rows
    sensors: list[Sensor]
    Q: Array | None
    prior: Array


@dataclass(eq=False)
class Landmark:
    """A landmark in the map.

    Attributes
    ----------
    name : hashable
    rows : (2,) or (4,) array of int
        Its slots: a point, or [p0, alpha, rho].
    first : (2,) array or None
        Its first estimate, where `fej` linearises; None for inverse depth.
    searches, matches, inliers : int
        How often it should have been seen, was found, and passed the gate.
    """

    name: Hashable
    rows: Rows
    first: Array | None = None
    searches: int = 0
    matches: int = 0
    inliers: int = 0

    @property
    def inverse_depth(self) -> bool:
        """Whether it is kept as anchor, direction and inverse distance."""
        return len(self.rows) == 4


@dataclass(eq=False)
class Observation:
    """One measurement of one landmark (or robot) by one sensor, beside what the map expects.

    Attributes
    ----------
    robot : Robot
    sensor : Sensor
    target : Landmark or Robot
    y, z : (p,) array
        Measurement, and innovation y - e with the bearing wrapped.
    Z : (p, p) array
        H P H' + R.
    R : (p, p) array
    rows : (k,) array of int
        The slots it depends on.
    H : (p, k) array
    version : int
        Of the map; the innovation of an older map is worth nothing.
    """

    robot: Robot
    sensor: Sensor
    target: Landmark | Robot
    y: Array
    z: Array
    Z: Array
    R: Array = field(repr=False)
    rows: Rows = field(repr=False)
    H: Array = field(repr=False)
    version: int = field(repr=False)

    @cached_property
    def nis(self) -> float:
        """The normalised innovation squared z' Z^-1 z, chi-square with `dof` degrees of freedom."""
        white = whitening(self.Z) @ self.z
        return float(white @ white)

    @property
    def dof(self) -> int:
        """The number of components."""
        return len(self.z)
