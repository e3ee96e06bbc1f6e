"""A recording run through a map: x and P of the guide, y measurements, u controls, with a filter of one's choice.

Question answered: what does a filter make of recorded data?  Each step is the loop of the guide: robots move; what is
known is corrected; what is new is initialised.  The measurements of one instant are taken in one joint update, so that
the order of a file's lines does not matter: taken one by one, it changes the error of `ekf` by a third.  Which
landmark a measurement belongs to is told by its name (known association) or found by `association`, which sees the map
and never the names; these then only count how often it was wrong.
Called by lab.ekfslam.app_data; the truth enters the errors that are noted, and nothing else.
Source: J. Solà (2014), section 1.3.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.map import Map
from lab.ekfslam.recording import Recording, Step
from lab.ekfslam.sensor import Sensor
from lab.ekfslam.slam import ASSOCIATIONS
from lab.validation import Array, InputError

KNOWN = "known"
GATE = 0.999  # chi-square of two components below 13.8
NEW_BEYOND = 25.0  # squared deviations from every landmark
MATCHES, INLIER_RATIO = 10, 0.5  # a landmark is corrupted when it refuses most of so many measurements


@dataclass(frozen=True, eq=False)
class Replayed:
    """What a filter made of a recording.

    Attributes
    ----------
    filter : str
    robots : (N,) array of object
        Whose estimate each noted step holds.
    poses, truth : (N, 3) array
        Estimates after each noted step, and true poses [m, m, rad]; NaN where there is no truth.
    nees : (N,) array
        Of the poses; NaN where there is no truth or no uncertainty yet.
    nis, dof : (N,) array
        Normalised innovations squared of what the robot has seen since it was noted last, summed, and their dimension.
    landmarks : dict of hashable to (2,) array
        Final estimates [m], by name or, where association had to be found, by number.
    covs : dict of hashable to (2, 2) array
        Their covariances.
    identities : dict of hashable to hashable
        The true name of each landmark; None where it is not known.
    updates : int
        Corrections.
    wrong : int
        Corrections with another landmark than the measurement's name says.
    unused : int
        Measurements that were neither corrected with nor initialised from.
    deleted : int
        Landmarks taken out of the map again.
    """

    filter: str
    robots: np.ndarray[tuple[int], np.dtype[np.object_]]
    poses: Array
    truth: Array
    nees: Array
    nis: Array
    dof: Array
    landmarks: dict[Hashable, Array]
    covs: dict[Hashable, Array]
    identities: dict[Hashable, Hashable]
    updates: int
    wrong: int
    unused: int
    deleted: int


def replay(
    recording: Recording,
    filter: str = "ekf",
    *,
    association: str = KNOWN,
    probability: float = GATE,
    new_beyond: float = NEW_BEYOND,
    on_step: Callable[[int], None] | None = None,
) -> Replayed:
    """Run a recording through a map.

    Parameters
    ----------
    recording : Recording
    filter : str
        "ekf", "fej" or "ri"; the last knows one robot only.
    association : str
        "known", "nearest" or "jcbb".
    probability : float
        Of the gate of an association that has to be found.
    new_beyond : float
        Squared deviations from every landmark beyond which a measurement is of a new one; in between it is not used.
    on_step : function of int, optional
        Called after each step with the number of steps done.

    Raises
    ------
    InputError
        The association is not known to the laboratory, needs names that are not there, or the filter does not know
        several robots.
    """
    if association not in ASSOCIATIONS:
        raise InputError(f"Unknown association {association!r}; known are {', '.join(ASSOCIATIONS)}.")
    if association == KNOWN and all(name is None for step in recording.steps for name in step.names):
        raise InputError("The association is not known: the data name no landmark; choose nearest or jcbb.")
    run = _Run(recording, filter, association, probability, new_beyond)
    for done, step in enumerate(recording.steps, start=1):
        run.take(step)
        if on_step is not None:
            on_step(done)
    return run.result()


class _Run:
    """The map on its way through a recording, and what has been noted."""

    def __init__(
        self, recording: Recording, filter: str, association: str, probability: float, new_beyond: float
    ) -> None:
        self.map = Map(filter)
        self.sensor = Sensor(recording.sensor, (1.0, 1.0))  # the noise comes with each measurement
        self.robots: dict[Hashable, Robot] = {
            name: self.map.add_robot(pose, name=name, sensors=[self.sensor]) for name, pose in recording.starts.items()
        }
        self.association, self.probability, self.new_beyond = association, probability, new_beyond
        self.recording = recording
        self.noted: list[tuple[Hashable, Array, Array, float, float, int]] = []
        self.identities: dict[Hashable, Hashable] = {}
        self.corrupted: list[Landmark] = []
        self.nis = dict.fromkeys(self.robots, 0.0)  # of each robot, since it was noted last
        self.dof = dict.fromkeys(self.robots, 0)
        self.updates = self.wrong = self.unused = self.initialised = self.deleted = 0

    def take(self, step: Step) -> None:
        """Go through one step."""
        for motion in step.motions:
            self.map.move(self.robots[motion.robot], motion.u, motion.Q)
        robot = self.robots[step.robot]
        if len(step.ys):
            self._see(robot, step)
        if step.noted:
            self._note(robot, step)

    def _see(self, robot: Robot, step: Step) -> None:
        """Correct with what is known, initialise what is new."""
        targets, new = self._match(robot, step)
        old = [i for i, target in enumerate(targets) if target is not None]
        chosen = [target for target in targets if target is not None]
        passed = []
        if chosen:
            for i, observation in zip(
                old, self.map.observe_all(robot, self.sensor, chosen, list(step.ys[old]), step.Rs[old]), strict=True
            ):
                if self._passes(observation):
                    passed.append(observation)
                    landmark = isinstance(observation.target, Landmark)
                    self.wrong += landmark and self.identities[observation.target.name] != step.names[i]
        self.nis[robot.name] += self.map.correct(*passed)
        self.dof[robot.name] += sum(observation.dof for observation in passed)
        self.updates += len(passed)
        for i in new:
            name = step.names[i] if self.association == KNOWN else self.initialised
            self.map.initialise(robot, self.sensor, step.ys[i], name, R=step.Rs[i])
            self.identities[name] = step.names[i]
            self.initialised += 1
        self.unused += len(step.ys) - len(passed) - len(new)
        while self.corrupted:
            self.map.delete(self.corrupted.pop())
            self.deleted += 1

    def _match(self, robot: Robot, step: Step) -> tuple[Sequence[Landmark | Robot | None], list[int]]:
        """Return what each measurement is of, and which of them show something new."""
        method = ASSOCIATIONS[self.association]
        if method is not None:
            settings = {"R": step.Rs[0], "probability": self.probability}
            matching = method(self.map, robot, self.sensor, list(step.ys), **settings)
            return matching.targets, matching.new(self.new_beyond)
        targets = [self._named(name) for name in step.names]
        first = {name: i for i, name in reversed([*enumerate(step.names)])}
        return targets, sorted(i for name, i in first.items() if name is not None and targets[i] is None)

    def _passes(self, observation: Observation) -> bool:
        """Gate where names may be misread, and delete a landmark that most of its measurements contradict.

        Without the deletion, a landmark that was begun with a misread name would refuse its own measurements for ever.
        """
        if np.isinf(self.recording.gate):
            return True
        passes = observation.nis <= self.recording.gate
        landmark = observation.target
        if isinstance(landmark, Landmark):
            landmark.matches += 1
            landmark.inliers += passes
            if self._corrupted(landmark) and landmark not in self.corrupted:
                self.corrupted.append(landmark)
        return passes

    @staticmethod
    def _corrupted(landmark: Landmark) -> bool:
        return landmark.matches >= MATCHES and landmark.inliers < INLIER_RATIO * landmark.matches

    def _named(self, name: Hashable) -> Landmark | Robot | None:
        return self.robots.get(name) or self.map.landmarks.get(name)

    def _note(self, robot: Robot, step: Step) -> None:
        pose = self.map.x[robot.rows]
        truth = np.full(3, np.nan) if step.truth is None else step.truth
        nees = np.nan if step.truth is None else self.map.nees(robot, step.truth)
        nees = nees if np.isfinite(nees) else np.nan  # no uncertainty yet
        self.noted.append((robot.name, pose, truth, nees, self.nis[robot.name], self.dof[robot.name]))
        self.nis[robot.name], self.dof[robot.name] = 0.0, 0

    def result(self) -> Replayed:
        """Return what has been noted, and the final map."""
        names, poses, truth, nees, nis, dof = zip(*self.noted, strict=True)
        robots = np.empty(len(names), dtype=object)
        robots[:] = names
        means, covs = self.map.points()
        return Replayed(
            self.map.filter.name,
            robots,
            np.array(poses),
            np.array(truth),
            np.array(nees),
            np.array(nis),
            np.array(dof, dtype=float),
            dict(zip(self.map.landmarks, [*means], strict=True)),
            dict(zip(self.map.landmarks, [*covs], strict=True)),
            self.identities,
            self.updates,
            self.wrong,
            self.unused,
            self.deleted,
        )
