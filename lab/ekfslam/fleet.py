"""A MRCLAM folder as recordings: several robots in one map, or each in a map of its own.

Question answered: where do the commands take each robot between two sightings, how sure is that, and who sees whom?
A command (v, w) holds until the next, and its arc is integrated exactly:

    dx = v sin(w t) / w,  dy = v (1 - cos(w t)) / w,  da = w t

so the increment u of a step is that of all commands in between, however many.  Its noise grows with time: FORWARD^2,
SIDEWAYS^2 and TURN^2 per second, and an error of the turn also carries sideways what is driven after it.  Sightings
repeated within a second share their error, so one of each landmark or robot per second is kept.  The estimate is noted
once a second, whether something was seen or not: at sightings alone it would look better than it is.
Called by lab.ekfslam.app_data.  Source: K. Leung et al., IJRR 30(8):969-974, 2011.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.ekfslam.frames import wrap
from lab.ekfslam.recording import Motion, Recording, Step
from lab.records.mrclam import Mrclam, RobotLog
from lab.validation import Array, InputError

# of the wheels against the commands [m, m, rad] per root of a second: measured against the truth of set 7, and rounded
FORWARD, SIDEWAYS, TURN = 0.02, 0.005, 0.05
RANGE = (0.06, 0.06)  # deviation of a range [m], and what each metre adds to it
BEARING = 0.02  # [rad]
BETWEEN = 1.0  # seconds between sightings of the same thing, and between notes
MISREAD = 25.0  # z' Z^-1 z beyond which a barcode was misread: a handful of thousands are, each ruinous
GAP = 1.0  # seconds without truth beyond which it is not interpolated


@dataclass(frozen=True)
class Options:
    """How the data are read; the delay and the scale were measured on such robots, and are no part of the data.

    Attributes
    ----------
    robot_sightings : bool
        Whether robots correct with sightings of each other, where they share a map.
    delay : float
        Seconds by which the motion follows its command.
    rotation_scale : float
        How much of the commanded rotation is made.
    """

    robot_sightings: bool = True
    delay: float = 0.0
    rotation_scale: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 0 <= self.delay <= LONGEST_DELAY:
            raise InputError(f"The delay of the commands must lie between 0 and {LONGEST_DELAY:g} s, not {self.delay}.")
        if not 0 < self.rotation_scale <= LARGEST_SCALE:
            raise InputError(f"The scale of rotation must lie above 0 and up to 2, not {self.rotation_scale}.")


LONGEST_DELAY, LARGEST_SCALE = 5.0, 2.0


class Track:
    """Where commands alone take a robot from the origin, at any time.

    Parameters
    ----------
    commands : (n, 3) array
        Time [s], strictly increasing, forward velocity [m/s] and angular velocity [rad/s].
    """

    def __init__(self, commands: Array) -> None:
        self.times, self.v, self.w = commands.T
        turns = np.append(0, np.cumsum(self.w[:-1] * np.diff(self.times)))
        steps = self._arc(self.v[:-1], self.w[:-1], np.diff(self.times), turns[:-1])
        self.knots = np.column_stack([np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]), turns])

    def at(self, times: Array) -> Array:
        """Return the poses (k, 3) at times (k,); before the first command the robot stands."""
        i = np.maximum(np.searchsorted(self.times, times, side="right") - 1, 0)
        dt = np.maximum(times - self.times[i], 0)
        shift = self._arc(self.v[i], self.w[i], dt, self.knots[i, 2])
        return np.column_stack([self.knots[i, :2] + shift, self.knots[i, 2] + self.w[i] * dt])

    @staticmethod
    def _arc(v: Array, w: Array, dt: Array, heading: Array) -> Array:
        """Return the displacement (k, 2) along arcs: the chord v dt sinc(w dt / 2), halfway through the turn."""
        chord = v * dt * np.sinc(w * dt / 2 / np.pi)
        middle = heading + w * dt / 2
        return np.column_stack([chord * np.cos(middle), chord * np.sin(middle)])


def increment(before: Array, after: Array, dt: float) -> tuple[Array, Array]:
    """Return the motion (3,) between two poses, in the frame of the first, and its covariance over dt seconds."""
    shift, c, s = after[:2] - before[:2], np.cos(before[2]), np.sin(before[2])
    u = np.array([c * shift[0] + s * shift[1], c * shift[1] - s * shift[0], wrap(after[2] - before[2])])
    # an error of the turn made at an even rate: half of it, on average, acts on the displacement
    lever = np.array([-u[1], u[0], 0.0])
    Q = np.diag([FORWARD**2, SIDEWAYS**2, TURN**2])
    Q += TURN**2 * (np.outer(lever, lever) / 3 + (np.outer(lever, [0, 0, 1]) + np.outer([0, 0, 1], lever)) / 2)
    return u, Q * dt


def together(data: Mrclam, options: Options = Options()) -> Recording:
    """Return all chosen robots as one recording, for one map.

    Parameters
    ----------
    data : Mrclam
    options : Options

    Returns
    -------
    Recording
        Robots and landmarks are named by their subjects.  Each robot starts at its true pose; a single one without
        truth at the origin.

    Raises
    ------
    InputError
        One of several robots has no truth to start from, or nothing is seen.
    """
    start, end = _interval(data, options)
    tracks = {robot: Track(_executed(log, options)) for robot, log in data.robots.items()}
    events: list[tuple[float, int, int, list[int]]] = []
    for order, (robot, log) in enumerate(data.robots.items()):
        wanted = _wanted(data, robot, options)
        events += [(t, order, robot, rows) for t, rows in _thinned(log, wanted) if start <= t <= end]
        events += [(float(t), len(tracks) + order, robot, []) for t in np.arange(start + BETWEEN, end, BETWEEN)]
    if not any(rows for _, _, _, rows in events):
        raise InputError(
            "The chosen robots see no landmark between the start and the end of the commands and the truth."
        )
    events.sort(key=lambda event: event[:2])
    starts: dict[Hashable, Array] = {robot: _start(data, robot, start) for robot in data.robots}
    landmarks: dict[Hashable, Array] = dict(data.landmarks.items())
    moved = dict.fromkeys(data.robots, start)
    last = {robot: track.at(np.array([start]))[0] for robot, track in tracks.items()}
    steps = []
    for t, _, robot, rows in events:
        log = data.robots[robot]
        seen = log.subjects[rows].tolist()
        motions = []
        for mover in [robot, *(name for name in dict.fromkeys(seen) if name in tracks)]:
            if t > moved[mover]:
                now = tracks[mover].at(np.array([t]))[0]
                motions.append(Motion(mover, *increment(last[mover], now, t - moved[mover])))
                moved[mover], last[mover] = t, now
        ys = log.sightings[rows].reshape(-1, 2)
        deviations = np.column_stack([RANGE[0] + RANGE[1] * ys[:, 0], np.full(len(ys), BEARING)])
        Rs = np.eye(2) * np.square(deviations)[:, np.newaxis]
        truth = None if rows else true_pose(log, t)
        steps.append(Step(robot, tuple(motions), ys, Rs, tuple(seen), truth, noted=not rows))
    return Recording(starts, tuple(steps), landmarks, gate=MISREAD)


def apart(data: Mrclam, options: Options = Options()) -> dict[int, Recording]:
    """Return one recording for each chosen robot, each for a map of its own, without sightings of other robots."""
    alone = replace(options, robot_sightings=False)
    return {
        robot: together(replace(data, robots={robot: log}, others=data.others | ({*data.robots} - {robot})), alone)
        for robot, log in data.robots.items()
    }


def true_pose(log: RobotLog, t: float) -> Array | None:
    """Return the true pose (3,) at a time, between the two nearest; None outside the truth or in a gap of it."""
    if log.truth is None:
        return None
    times = log.truth[:, 0]
    i = int(np.searchsorted(times, t, side="right"))
    if i == len(times) and t == times[-1]:
        return np.array(log.truth[-1, 1:])
    if i in (0, len(times)) or times[i] - times[i - 1] > GAP:
        return None
    before, after = log.truth[i - 1, 1:], log.truth[i, 1:]
    change = after - before
    change[2] = wrap(change[2])
    pose = before + change * (t - times[i - 1]) / (times[i] - times[i - 1])
    pose[2] = wrap(pose[2])
    return np.asarray(pose)


def _interval(data: Mrclam, options: Options) -> tuple[float, float]:
    """Return when the first robot is commanded and the last command is given, cut to where there is truth."""
    logs = data.robots.values()
    start = min(log.commands[0, 0] for log in logs) + options.delay
    end = max(log.commands[-1, 0] for log in logs)
    truths = [log.truth for log in logs if log.truth is not None]
    start = max([start, *(truth[0, 0] for truth in truths)])
    end = min([end, *(truth[-1, 0] for truth in truths)])
    return float(start), float(end)


def _executed(log: RobotLog, options: Options) -> Array:
    """Return the commands as the robot follows them."""
    return log.commands * [1, 1, options.rotation_scale] + [options.delay, 0, 0]


def _wanted(data: Mrclam, robot: int, options: Options) -> set[int]:
    """Return the subjects whose sightings are used: landmarks, and robots of the same map."""
    subjects = set(data.robots[robot].subjects.tolist()) - data.others - {*data.robots}
    return subjects | ({*data.robots} - {robot} if options.robot_sightings else set())


def _thinned(log: RobotLog, wanted: set[int]) -> Sequence[tuple[float, list[int]]]:
    """Return instants and the rows of what was seen then, each subject at most once in BETWEEN seconds."""
    last: dict[int, float] = {}
    instants: dict[float, list[int]] = {}
    for row, (t, subject) in enumerate(zip(log.sighting_times.tolist(), log.subjects.tolist(), strict=True)):
        if subject in wanted and t - last.get(subject, -np.inf) >= BETWEEN:
            last[subject] = t
            instants.setdefault(t, []).append(row)
    return list(instants.items())


def _start(data: Mrclam, robot: int, t: float) -> Array:
    log = data.robots[robot]
    pose = true_pose(log, t)
    if pose is None and log.truth is not None:  # a gap: the nearest pose is better than none
        pose = np.array(log.truth[np.argmin(np.abs(log.truth[:, 0] - t)), 1:])
    if pose is None and len(data.robots) > 1:
        raise InputError(
            f"Robot {robot} has no ground truth to start from, so that it cannot share a map; choose one robot, or"
            " separate maps."
        )
    return np.zeros(3) if pose is None else pose
