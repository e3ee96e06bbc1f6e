"""Solà's symbols: y measurement, r robot, l landmark, q point in the robot's frame; the value, then Y_r = dy/dr ...

Question answered: what does a sensor on the robot measure of a point, and where is the point that gave a measurement?

    scan(p)        distance and bearing of p in the sensor's own frame, or one of the two; or p itself
    project(q)     = scan(to_frame(mount, q)):  of q in the robot's frame
    observe(r, l)  = project(to_frame(r, l))              inv_observe(r, y) = from_frame(r, retroject(y))

A sensor sits at its own pose, the mount, on the robot.  Bearing-only and range-only measurements are partial: their
points need a prior (`inverse_depth`, `rings`), so `retroject` is refused.  PRESETS is the guide's table of sensors.
Source: J. Solà (2014), sections 1.1, 2.3 and functions ``scan``, ``observe``.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from lab.ekfslam.frames import from_frame, polar, rectangular, to_frame, wrap
from lab.validation import Array, InputError, real_array

COMPONENTS = {"range-bearing": slice(0, 2), "range": slice(0, 1), "bearing": slice(1, 2)}  # of [distance, bearing]
POSITION = "position"  # what comes out of a detector that has worked in rectangular coordinates already
KINDS = (*COMPONENTS, POSITION)
DEGREE = float(np.pi / 180)


def scan(p: Array, kind: str = "range-bearing") -> tuple[Array, Array]:
    """Return what a sensor of this kind at the origin measures of points p (..., 2), and Y_p.

    Parameters
    ----------
    p : (..., 2) array
        In the sensor's frame [m].
    kind : str
        "range-bearing", "bearing", "range" or "position".

    Returns
    -------
    y : (..., 2) or (..., 1) array
        Distance [m] and bearing [rad], or one of them; or the point [m].
    Y_p : (..., 2, 2) or (..., 1, 2) array

    Raises
    ------
    InputError
        A point lies in the sensor, whose kind is not "position".
    """
    if kind == POSITION:
        return p.copy(), np.broadcast_to(np.eye(2), (*p.shape, 2))
    y, Y_p = polar(p)
    part = COMPONENTS[kind]
    return y[..., part], Y_p[..., part, :]


def inv_scan(y: Array, kind: str = "range-bearing") -> tuple[Array, Array]:
    """Return the point (..., 2) of a whole measurement in the sensor's frame, and P_y (..., 2, 2)."""
    return scan(y, kind) if kind == POSITION else rectangular(y)


@dataclass(frozen=True, eq=False)
class Sensor:
    """What is measured, how well, and from where on the robot.

    Attributes
    ----------
    kind : str
        "range-bearing", "bearing", "range" or "position".
    noise : array_like
        Standard deviation of each component: [m, rad], [rad], [m] or [m, m].
    mount : (3,) array_like
        Pose in the robot's frame [m, m, rad].
    name : str
        For people.
    """

    kind: str = "range-bearing"
    noise: Any = (0.1, DEGREE)
    mount: Any = (0.0, 0.0, 0.0)
    name: str = ""
    R: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and turn into arrays."""
        if self.kind not in KINDS:
            raise InputError(f"A sensor's kind is one of {', '.join(KINDS)}, not {self.kind!r}.")
        noise = real_array("noise", self.noise, (self.size,))
        if not (noise > 0).all():
            raise InputError("The noise of a sensor must be positive in each component.")
        object.__setattr__(self, "noise", noise)
        object.__setattr__(self, "mount", real_array("mount", self.mount, (3,)))
        object.__setattr__(self, "R", np.diag(noise**2))

    @property
    def size(self) -> int:
        """Number of components of a measurement."""
        return 2 if self.kind in ("range-bearing", POSITION) else 1

    @cached_property
    def at_centre(self) -> bool:
        """Whether the mount is the robot's own frame, where a transformation can be left out."""
        return not np.any(self.mount)

    def difference(self, y: Array, e: Array) -> Array:
        """Return y - e with the bearing wrapped."""
        z = np.asarray(y, dtype=float) - e
        if self.kind in ("range-bearing", "bearing"):
            z[..., -1] = wrap(z[..., -1])
        return z

    def project(self, q: Array) -> tuple[Array, Array]:
        """Return the measurement of points q (..., 2) of the robot's frame, and Y_q."""
        if self.at_centre:
            return scan(q, self.kind)
        p, _, P_q = to_frame(self.mount, q)
        y, Y_p = scan(p, self.kind)
        return y, Y_p @ P_q

    def retroject(self, y: Array) -> tuple[Array, Array]:
        """Return the points (..., 2) of the robot's frame that give the measurements y, and Q_y.

        Raises
        ------
        InputError
            One measurement does not determine a point.
        """
        if self.size < 2:
            raise InputError(f"A measurement of {self.kind} alone does not determine a point.")
        p, P_y = inv_scan(np.asarray(y, dtype=float), self.kind)
        if self.at_centre:
            return p, P_y
        q, _, Q_p = from_frame(self.mount, p)
        return q, Q_p @ P_y


def observe(r: Array, l: Array, sensor: Sensor) -> tuple[Array, Array, Array]:  # noqa: E741 - the guide's letter
    """Return what the robot's sensor measures of landmarks.

    Parameters
    ----------
    r : (..., 3) array
        Robot.
    l : (..., 2) array
        Landmarks [m].
    sensor : Sensor

    Returns
    -------
    y : (..., p) array
        Distance [m], bearing [rad].
    Y_r : (..., p, 3) array
    Y_l : (..., p, 2) array
        By the chain rule, dy/dl = Y_q Q_l.

    Raises
    ------
    InputError
        A landmark lies in the sensor.
    """
    q, Q_r, Q_l = to_frame(r, l)
    y, Y_q = sensor.project(q)
    return y, Y_q @ Q_r, Y_q @ Q_l


def inv_observe(r: Array, y: Array, sensor: Sensor) -> tuple[Array, Array, Array]:
    """Return the landmarks (..., 2) that a whole measurement saw, L_r (..., 2, 3) and L_y (..., 2, 2)."""
    q, Q_y = sensor.retroject(y)
    l, L_r, L_q = from_frame(r, q)  # noqa: E741
    return l, L_r, L_q @ Q_y


PRESETS = {
    "laser": Sensor("range-bearing", (0.03, 0.25 * DEGREE), name="laser range finder"),
    "sonar": Sensor("range-bearing", (0.05, 15 * DEGREE), name="sonar: good range, poor bearing"),
    "camera": Sensor("bearing", (0.5 * DEGREE,), name="camera: bearing only"),
    "rgbd": Sensor("range-bearing", (0.05, 0.5 * DEGREE), name="RGBD camera"),
    "arva": Sensor("range-bearing", (2.0, 30 * DEGREE), name="ARVA avalanche beacon: poor in both"),
    "rfid": Sensor("range-bearing", (1.0, 45 * DEGREE), name="RFID antenna: poor in both"),
    "demo": Sensor("range-bearing", (0.1, DEGREE), name="the guide's demo"),
}
