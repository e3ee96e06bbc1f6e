"""Solà's symbols: W landmarks of the world, r robot, u control, n and q its noise, y measurement, v and s its noise.

Question answered: what is there to be mapped, and what do the robot's instruments say of it?

    cloister   two rings of columns: n - 2 on each outer side, without the corners, and n - 3 on each inner side
    circle     the control u = (0.1, 0.05) at each of 200 steps: a circle of radius 2, 1.6 turns
    drive      y of every landmark at every step, v ~ N(0, s^2); the TRUE robot feels the noise n ~ N(0, q^2)

The guide's listing gives n to the estimator and drives the true robot along the same perfect circle in every run; that
is the same to first order, but the world is not random then.  ``perturb="estimator"`` does as the listing does.
Source: J. Solà (2014), functions ``cloister`` and the demo of the appendix.
"""

from dataclasses import dataclass

import numpy as np

from lab.ekfslam.motion import move
from lab.ekfslam.sensor import Sensor, observe
from lab.validation import Array, InputError, require_generator, whole_number

START = (0.0, -2.0, 0.0)
STEPS = 200
CONTROL = (0.1, 0.05)
CONTROL_NOISE = (0.01, 0.02)
PERTURBED = ("truth", "estimator")


def cloister(xmin: float = -4, xmax: float = 4, ymin: float = -4, ymax: float = 4, n: int = 9) -> Array:
    """Return the columns of a cloister, (8 n - 20, 2) [m].

    Parameters
    ----------
    xmin, xmax, ymin, ymax : float
        Its outer walls [m].
    n : int
        How many columns an outer side with both corners would have; at least 4.

    Raises
    ------
    InputError
        n is below 4, where there is no inner ring, or the walls have no extent.

    Source: J. Solà (2014), function ``cloister``.
    """
    whole_number("n", n, at_least=1)
    if n < 4:
        raise InputError(f"A cloister needs n of at least 4, not {n}: below, it has no inner ring.")
    if not (xmin < xmax and ymin < ymax):
        raise InputError("The walls of a cloister must satisfy xmin < xmax and ymin < ymax.")
    half = (n - 1) / 2
    outer = [(i - (n - 3) / 2, half) for i in range(n - 2)]
    inner = [(i - (n - 3) / 2, half - 1) for i in range(n - 3)]
    north = np.array(outer + inner)
    west = north @ np.array([[0, 1], [-1, 0]])  # a quarter turn to the left; the listing says East
    points = np.concatenate([north, west, -north, -west]) / (n - 1)
    return points * [xmax - xmin, ymax - ymin] + [(xmin + xmax) / 2, (ymin + ymax) / 2]


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive of a robot through a world.

    Attributes
    ----------
    W : (m, 2) array
        Landmarks [m].
    sensor : Sensor
    truth : (N + 1, 3) array
        True poses, the start first.
    u : (N, 2) array
        Controls as the estimator knows them.
    Q : (2, 2) array
        Covariance of their noise.
    y : (N, m, p) array
        Measurement of each landmark after each control.
    """

    W: Array
    sensor: Sensor
    truth: Array
    u: Array
    Q: Array
    y: Array


def drive(
    rng: np.random.Generator,
    *,
    W: Array | None = None,
    sensor: Sensor | None = None,
    steps: int = STEPS,
    control: tuple[float, float] = CONTROL,
    q: tuple[float, float] = CONTROL_NOISE,
    perturb: str = "truth",
) -> Drive:
    """Drive on a circle and measure every landmark at every step.

    Parameters
    ----------
    rng : numpy.random.Generator
    W : (m, 2) array, optional
        Landmarks [m]; the demo's cloister by default.
    sensor : Sensor, optional
        The demo's range-bearing sensor by default.
    steps : int
    control, q : (float, float)
        Step [m] and turn [rad], and the deviations of their noise.
    perturb : str
        Who gets the noise: "truth", or "estimator" as in the guide's listing.

    Raises
    ------
    InputError
        An argument is out of range.
    """
    require_generator(rng)
    whole_number("steps", steps, at_least=1)
    if perturb not in PERTURBED:
        raise InputError(f"perturb must be {' or '.join(PERTURBED)}, not {perturb!r}.")
    W = cloister(n=7) if W is None else W
    sensor = Sensor() if sensor is None else sensor
    u = np.tile(np.array(control, dtype=float), (steps, 1))
    perturbed = u + q * rng.standard_normal(u.shape)
    v = sensor.noise * rng.standard_normal((steps, len(W), sensor.size))
    felt, told = (perturbed, u) if perturb == "truth" else (u, perturbed)
    truth = [np.array(START)]
    for step in felt:
        truth.append(move(truth[-1], step)[0])
    poses = np.array(truth)
    y, _, _ = observe(poses[1:, None], W, sensor)
    return Drive(W, sensor, poses, told, np.diag(np.square(q)), sensor.difference(y + v, np.zeros(sensor.size)))
