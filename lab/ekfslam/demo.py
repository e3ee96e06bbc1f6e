"""Solà's symbols: r robot, W landmarks of the world, y measurement, z innovation, Z its covariance; one demo run.

Question answered: how far is a filter's map from the cloister, and how far does the filter believe that it is?  A run
drives once through the world (`world.drive`), feeds the guide's loop (`slam.Slam`), and keeps what happened.
The world comes from a generator of its own, so that filters with the same seed see the same world.
Source: J. Solà (2014), the demo of the appendix.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from lab.ekfslam.map import Map
from lab.ekfslam.sensor import DEGREE, Sensor
from lab.ekfslam.slam import Feed, Raw, Settings, Slam
from lab.ekfslam.world import Drive, drive
from lab.validation import Array, InputError

SENSORS = {
    "range-bearing": Sensor(),
    "bearing": Sensor("bearing", (DEGREE,)),
    "range": Sensor("range", (0.1,)),
}
SKIPPED = 2  # steps without NEES: of P = 0 and two noises the covariance has rank 2 after the first
LAST = 20  # steps over which the figures of NEES are means


@dataclass(frozen=True, eq=False)
class Frame:
    """The map at one step, for pictures: pose and covariance, landmarks and theirs, hypotheses of rings."""

    r: Array
    P: Array
    points: Array
    covs: Array
    hypotheses: Array


@dataclass(frozen=True, eq=False)
class Run:
    """What one run leaves.

    Attributes
    ----------
    filter : str
    drive : Drive
        The world with its truth.
    r : (N + 1, 3) array
        Estimated poses, the start first.
    P : (N + 1, 3, 3) array
        Their covariances, in ordinary coordinates.
    nees : (N + 1,) array
        Of the pose, 3 degrees of freedom; NaN at the first SKIPPED steps.
    nis, dof : (N + 1,) array
        Sums over the known landmarks of each step, the rejected ones included.
    mapped : (N + 1,) array of int
        How many landmarks are in the map, those that are still a ring included.
    points : (m, 2) array
        Landmarks at the end [m].
    covs : (m, 2, 2) array
    whose : (m,) array of int
        Which landmark of the world each of them is.
    updates, rejected, wrong, deleted : int
        Corrections, measurements that did not pass the gate, corrections by a wrong landmark, deletions.
    frames : list of Frame
        One per step, where they were asked for.
    """

    filter: str
    drive: Drive = field(repr=False)
    r: Array
    P: Array
    nees: Array
    nis: Array
    dof: Array
    mapped: Array
    points: Array
    covs: Array
    whose: Array
    updates: int
    rejected: int
    wrong: int
    deleted: int
    frames: list[Frame] = field(repr=False)

    @property
    def heading_std(self) -> Array:
        """Deviations (N + 1,) of the heading [rad]."""
        return np.asarray(np.sqrt(np.maximum(self.P[:, 2, 2], 0)))

    @property
    def nees_mean(self) -> float:
        """Mean of the NEES over the last steps; NaN where a drive is too short to have one."""
        last = self.nees[-LAST:]
        counted = last[~np.isnan(last)]
        return float(counted.mean()) if len(counted) else float("nan")

    @property
    def errors(self) -> Array:
        """Distances (N + 1,) of the estimated from the true positions [m]."""
        return np.asarray(np.linalg.norm(self.r[:, :2] - self.drive.truth[:, :2], axis=1))


def run(
    filter: str = "ekf",
    *,
    seed: int = 0,
    sensor: str = "range-bearing",
    settings: Settings | None = None,
    perturb: str = "truth",
    world: Callable[[np.random.Generator, Sensor], Drive] | None = None,
    frames: bool = False,
) -> Run:
    """Run the demo once.

    Parameters
    ----------
    filter : str
        "ekf", "fej" or "ri".
    seed : int
        Of the world and of the choice of landmarks.
    sensor : str
        "range-bearing", "bearing" or "range".
    settings : Settings, optional
    perturb : str
        Who feels the noise of the controls: "truth", or "estimator" as in the guide's listing.
    world : function of a generator and a sensor, optional
        Another world than the demo's.
    frames : bool
        Whether to keep the map at every step.

    Raises
    ------
    InputError
        A name is not known, or filter and sensor do not go together.
    """
    if sensor not in SENSORS:
        raise InputError(f"Unknown sensor {sensor!r}; known are {', '.join(SENSORS)}.")
    rng, chooser = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    route = drive(rng, sensor=SENSORS[sensor], perturb=perturb) if world is None else world(rng, SENSORS[sensor])
    return follow(filter, route, chooser, settings, frames=frames)


def follow(
    filter: str, route: Drive, rng: np.random.Generator, settings: Settings | None = None, *, frames: bool = False
) -> Run:
    """Filter one drive; `rng` chooses which landmark is initialised."""
    m = Map(filter)
    robot = m.add_robot(route.truth[0], sensors=[route.sensor], Q=route.Q)
    slam = Slam(m, rng, settings)
    N = len(route.u)
    r, P = np.zeros((N + 1, 3)), np.zeros((N + 1, 3, 3))
    nees, nis, dof = np.full(N + 1, np.nan), np.zeros(N + 1), np.zeros(N + 1, dtype=int)
    mapped = np.zeros(N + 1, dtype=int)
    r[0] = route.truth[0]
    known = list(range(len(route.W)))
    origin: dict[Hashable, int] = {}
    counts = {"corrected": 0, "rejected": 0, "wrong": 0, "deleted": 0}
    kept: list[Frame] = []
    for k in range(1, N + 1):
        for event in slam.step([Feed(robot, route.u[k - 1], [Raw(route.y[k - 1], known)])]):
            counts[event.what] = counts.get(event.what, 0) + 1
            if event.observation is not None:
                nis[k] += event.observation.nis
                dof[k] += event.observation.dof
            if event.what == "initialised":
                origin[event.name] = event.measurement
            elif event.what == "corrected" and origin[event.name] != event.measurement:
                counts["wrong"] += 1
        r[k], P[k] = m.pose(robot)
        mapped[k] = len(m.landmarks) + len(slam.rings)
        if k > SKIPPED:
            nees[k] = m.nees(robot, route.truth[k])
        if frames:
            kept.append(Frame(r[k], P[k], *m.points(), m.points(m.hypotheses)[0]))
    points, covs = m.points()
    whose = np.array([origin[name] for name in m.landmarks], dtype=int)
    corrected, rejected, wrong, deleted = (counts[name] for name in ("corrected", "rejected", "wrong", "deleted"))
    return Run(
        filter, route, r, P, nees, nis, dof, mapped, points, covs, whose, corrected, rejected, wrong, deleted, kept
    )
