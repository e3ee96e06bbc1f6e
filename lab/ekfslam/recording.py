"""A recorded drive as the filter meets it: step by step, what moved, what was seen, and where everything really was.

Question answered: what have a folder of MRCLAM, a factor file and a simulation in common?  Each becomes a `Recording`:
a sequence of steps in the order of time, in each of which some robots move and one of them sees something, in the
symbols of the guide: u control with covariance Q, y measurement with covariance R.  The truth rides along for `scores`
and for known association, and never reaches the filter otherwise.
Made by `fleet` (MRCLAM) and `drives` (the two others), replayed by `replay`.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

import numpy as np

from lab.validation import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """One robot moves.

    Attributes
    ----------
    robot : hashable
    u : (3,) array
        Increment dx, dy, da in the robot's frame [m, m, rad].
    Q : (3, 3) array
        Covariance of its noise.
    """

    robot: Hashable
    u: Array
    Q: Array


@dataclass(frozen=True, eq=False)
class Step:
    """What happens at one instant.

    Attributes
    ----------
    robot : hashable
        Who sees, and whose estimate is noted afterwards.
    motions : tuple of Motion
        What moved since the step before, the robot itself or others that it sees.
    ys : (k, 2) array
        Ranges [m] and bearings [rad], or places in the robot's frame [m, m], as the recording's sensor measures.
    Rs : (k, 2, 2) array
        Their covariances.
    names : tuple of k hashable
        What was seen, by name; None where that is not known.
    truth : (3,) array or None
        True pose of the robot after the motions [m, m, rad].
    noted : bool
        Whether the estimate after this step counts in the scores.
    """

    robot: Hashable
    motions: tuple[Motion, ...] = ()
    ys: Array = field(default_factory=lambda: np.zeros((0, 2)))
    Rs: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    names: tuple[Hashable, ...] = ()
    truth: Array | None = None
    noted: bool = True


@dataclass(frozen=True, eq=False)
class Recording:
    """All steps, and what is known beside them.

    Attributes
    ----------
    starts : dict of hashable to (3,) array
        Pose of each robot before the first step, known exactly: it fixes the frame of the map.
    steps : tuple of Step
    landmarks : dict of hashable to (2,) array
        True positions [m] of the landmarks that have one, by name.
    sensor : str
        Kind of the measurements, "range-bearing" or "position".
    gate : float
        z' Z^-1 z beyond which a measurement is not of what its name says; infinite where names are trusted, for a
        filter that has lost its way would refuse the very measurements that lead it back.
    """

    starts: Mapping[Hashable, Array]
    steps: tuple[Step, ...]
    landmarks: Mapping[Hashable, Array]
    sensor: str = "range-bearing"
    gate: float = np.inf
