"""Solà's symbols: u control, y measurement, r robot, l landmark; the loop of the guide, in one place: `Slam.step`.

Question answered: what is done in which order?  For each robot: get the control and move.  For each of its sensors: get
raw data; for each measurement of a known landmark: observe, gate, correct; delete corrupted landmarks; then discover:
initialise one of the new landmarks, chosen at random.

The map manager's rules: a landmark is corrupted when, after at least 10 searches, fewer than 10 % were matched or fewer
than half of the matches passed the gate; inverse depth becomes a point when its index of linearity is below 0.1.
Source: J. Solà (2014), sections 1.3 and 2.4.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.ekfslam.association import NEW_BEYOND, PROBABILITY, compatible, jcbb, nearest
from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.inverse_depth import LINEAR, linearity_index, sensor_frame
from lab.ekfslam.map import Map
from lab.ekfslam.rings import Ring
from lab.ekfslam.sensor import Sensor
from lab.validation import Array, InputError, require_generator

ASSOCIATIONS = {"known": None, "nearest": nearest, "jcbb": jcbb}


@dataclass(frozen=True)
class Settings:
    """How a map is managed.

    Attributes
    ----------
    association : str
        "known" (the data name their landmarks), "nearest" or "jcbb".
    probability : float
        Of the gate.
    new_beyond : float
        z' Z^-1 z beyond which a measurement without a landmark is new, where the association is not known.
    rho : (float, float)
        Prior mean and deviation of inverse depth [1/m].
    searches, match_ratio, inlier_ratio : int, float, float
        When a landmark is corrupted.
    feasible : function of a sensor and an expectation, optional
        Whether a landmark expected there could be seen at all, and so counts as searched; by default always.
    """

    association: str = "known"
    probability: float = PROBABILITY
    new_beyond: float = NEW_BEYOND
    rho: tuple[float, float] = (0.5, 0.25)
    searches: int = 10
    match_ratio: float = 0.1
    inlier_ratio: float = 0.5
    feasible: Callable[[Sensor, Array], bool] | None = None

    def __post_init__(self) -> None:
        """Check the choice."""
        if self.association not in ASSOCIATIONS:
            known = ", ".join(ASSOCIATIONS)
            raise InputError(f"Unknown association {self.association!r}; known are {known}.")


@dataclass(frozen=True, eq=False)
class Raw:
    """What one sensor gives at one instant: measurements (k, p), and whose they are where that is known."""

    ys: Array
    names: Sequence[Hashable] | None = None


@dataclass(frozen=True, eq=False)
class Feed:
    """What one robot gives at one instant: its control, None for none, and the raw data of each of its sensors."""

    robot: Robot
    u: Array | None
    raws: Sequence[Raw]


class Event(NamedTuple):
    """Something that happened: what, to which landmark, by which measurement (-1 for none), and the observation."""

    what: str  # corrected, rejected, refined, initialised, deleted
    name: Hashable
    measurement: int = -1
    observation: Observation | None = None


class Slam:
    """A map, its manager, and the loop.

    Parameters
    ----------
    m : Map
    rng : numpy.random.Generator
        Chooses which new landmark is initialised.
    settings : Settings
    """

    def __init__(self, m: Map, rng: np.random.Generator, settings: Settings | None = None) -> None:
        self.map = m
        self.rng = require_generator(rng)
        self.settings = Settings() if settings is None else settings
        self.rings: dict[Hashable, Ring] = {}
        self.named = 0  # landmarks that were given a number, for want of a name

    def step(self, feeds: Sequence[Feed]) -> list[Event]:
        """Do one instant of the guide's loop.

        Parameters
        ----------
        feeds : sequence of Feed
            One per robot that has something to say.

        Returns
        -------
        list of Event
            In the order in which they happened.
        """
        events: list[Event] = []
        for robot, u, raws in ((feed.robot, feed.u, feed.raws) for feed in feeds):
            if u is not None:
                self.map.move(robot, u)
            for sensor, raw in zip(robot.sensors, raws, strict=True):
                known, fresh = self._match(robot, sensor, raw)
                for i, landmark in known:
                    events.append(self._correct(robot, sensor, landmark, raw.ys[i], i))
                for i, ring in self._ringed(raw):
                    events.append(self._refine(robot, sensor, ring, raw.ys[i], i))
                events += self._tend(robot, sensor)
                if fresh:
                    i = int(fresh[self.rng.integers(len(fresh))])
                    events.append(self._discover(robot, sensor, raw, i))
        return events

    def _match(self, robot: Robot, sensor: Sensor, raw: Raw) -> tuple[list[tuple[int, Landmark]], list[int]]:
        """Return which measurements belong to which landmarks of the map, and which to none at all."""
        landmarks, method = self.map.landmarks, ASSOCIATIONS[self.settings.association]
        for landmark in self._searched(robot, sensor):
            landmark.searches += 1
        if method is None:
            if raw.names is None:
                raise InputError("Known association needs the names of the landmarks that were measured.")
            known = [(i, landmarks[name]) for i, name in enumerate(raw.names) if name in landmarks]
            fresh = [i for i, name in enumerate(raw.names) if name not in landmarks and name not in self.rings]
            return known, fresh
        if sensor.kind != "range-bearing":
            raise InputError("Association is implemented for range and bearing; name the landmarks otherwise.")
        matching = method(self.map, robot, sensor, list(raw.ys), probability=self.settings.probability)
        known = [(i, target) for i, target in enumerate(matching.targets) if target is not None]
        return known, matching.new(self.settings.new_beyond)

    def _searched(self, robot: Robot, sensor: Sensor) -> list[Landmark]:
        """Return the landmarks that the sensor should see."""
        landmarks, feasible = list(self.map.landmarks.values()), self.settings.feasible
        if feasible is None:
            return landmarks
        expected = self.map.expect(robot, sensor, landmarks)
        return [landmark for landmark, (e, *_) in zip(landmarks, expected, strict=True) if feasible(sensor, e)]

    def _correct(self, robot: Robot, sensor: Sensor, landmark: Landmark, y: Array, index: int) -> Event:
        """Observe, gate, correct."""
        landmark.matches += 1
        observation = self.map.observe(robot, sensor, landmark, y)
        if not compatible(observation, self.settings.probability):
            return Event("rejected", landmark.name, index, observation)
        landmark.inliers += 1
        self.map.correct(observation)
        return Event("corrected", landmark.name, index, observation)

    def _ringed(self, raw: Raw) -> list[tuple[int, Ring]]:
        if not self.rings or raw.names is None:
            return []
        return [(i, self.rings[name]) for i, name in enumerate(raw.names) if name in self.rings]

    def _refine(self, robot: Robot, sensor: Sensor, ring: Ring, y: Array, index: int) -> Event:
        if ring.refine(self.map, robot, sensor, y) is None:
            return Event("refined", ring.name, index)
        del self.rings[ring.name]
        return Event("initialised", ring.name, index)

    def _tend(self, robot: Robot, sensor: Sensor) -> list[Event]:
        """Delete corrupted landmarks, and turn rays that are linear enough into points."""
        rules, events = self.settings, []
        for landmark in list(self.map.landmarks.values()):
            few = landmark.matches < rules.match_ratio * landmark.searches
            bad = landmark.inliers < rules.inlier_ratio * landmark.matches
            if landmark.searches >= rules.searches and (few or bad):
                self.map.delete(landmark)
                events.append(Event("deleted", landmark.name))
            elif landmark.inverse_depth:
                t = sensor_frame(self.map.x[robot.rows], sensor)[0][:2]
                variance = float(self.map.joint.block(landmark.rows[3:])[0, 0])
                if linearity_index(t, self.map.x[landmark.rows], variance) < LINEAR:
                    self.map.to_point(landmark)
        return events

    def _discover(self, robot: Robot, sensor: Sensor, raw: Raw, index: int) -> Event:
        """Initialise a landmark: a point, a ray, or a ring of hypotheses that has still to become one."""
        name: Hashable = self.named
        if raw.names is not None and self.settings.association == "known":
            name = raw.names[index]
        self.named += 1
        if sensor.kind == "range":
            self.rings[name] = Ring(self.map, robot, sensor, raw.ys[index], name)
            return Event("refined", name, index)
        self.map.initialise(robot, sensor, raw.ys[index], name, rho=self.settings.rho)
        return Event("initialised", name, index)
