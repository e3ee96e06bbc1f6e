"""Solà's symbols: x and P of the map, r robot, l landmark, u control, y measurement, z innovation, Z its covariance.

Question answered: what happens to the map in each of the guide's events?

    move         a robot moves                 prediction
    initialise   a landmark is discovered      state augmentation
    observe, correct   a known one is seen     correction (the observation may be gated in between)
    delete       a landmark is corrupted       state reduction

The filter (`filters`) says where to linearise and what an error is; the arithmetic is in `joint`.  The covariance is
kept in the filter's own error; `pose`, `point` and `points` give ordinary coordinates whatever the filter.
Source: J. Solà (2014), sections 1.3 and 2.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from lab.ekfslam import inverse_depth
from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.filters import INVERSE_DEPTH, SEVERAL, make_filter
from lab.ekfslam.joint import Joint
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.sensor import Sensor
from lab.validation import Array, InputError, check_covariance, real_array


class Map:
    """Robots and landmarks in one Gaussian.

    Parameters
    ----------
    filter : str
        "ekf", "fej" or "ri".
    limit : int, optional
        The most slots the map may ever have; by default it grows.

    Attributes
    ----------
    robots : list of Robot
    landmarks : dict of hashable to Landmark
        By name, in the order in which they were mapped.
    hypotheses : list of Landmark
        Points that are no landmarks yet (`rings`).
    """

    def __init__(self, filter: str = "ekf", *, limit: int | None = None) -> None:
        self.filter = make_filter(filter)
        self.joint = Joint(limit)
        self.robots: list[Robot] = []
        self.landmarks: dict[Hashable, Landmark] = {}
        self.hypotheses: list[Landmark] = []
        self.version = 0
        self._changed()

    @property
    def x(self) -> Array:
        """The mean in all slots (n,); free ones hold 0."""
        return self.joint.x

    @property
    def P(self) -> Array:
        """The covariance of all slots (n, n), in the filter's error; a copy."""
        return self.joint.covariance()

    def add_robot(
        self,
        pose: Array,
        P: Array | None = None,
        *,
        name: Hashable = None,
        sensors: Sequence[Sensor] = (),
        Q: Array | None = None,
    ) -> Robot:
        """Put a robot into the map.

        Parameters
        ----------
        pose : (3,) array
            [m, m, rad].
        P : (3, 3) array, optional
            Its covariance, 0 by default: the map's frame is where the robot starts.
        name : hashable, optional
            By default its number.
        sensors : sequence of Sensor
        Q : array, optional
            Covariance of the noise on its controls.

        Raises
        ------
        InputError
            An argument is no pose or covariance, or the filter has one robot only.
        """
        pose = real_array("pose", pose, (3,))
        P = real_array("P", np.zeros((3, 3)) if P is None else P, (3, 3))
        check_covariance("P", P)
        if self.robots:
            self.filter.allow(SEVERAL)
        rows = self.joint.take(3)
        self.x[rows] = pose
        T = np.eye(3)
        T[:2, 2] = -self.filter.to_ordinary(pose[:2])
        self.joint.settle(rows, T @ P @ T.T)
        robot = Robot(len(self.robots) if name is None else name, rows, list(sensors), Q, pose)
        self.robots.append(robot)
        self._changed()
        return robot

    def move(self, robot: Robot, u: Array, Q: Array | None = None) -> None:
        """Move a robot by a control.

        Parameters
        ----------
        robot : Robot
        u : (2,) or (3,) array
            [m, rad] or [m, m, rad].
        Q : array, optional
            Covariance of its noise, (2, 2) or (3, 3); the robot's own by default.

        Raises
        ------
        InputError
            The control has another size, or no covariance was given.
        """
        Q = robot.Q if Q is None else Q
        if Q is None or np.shape(Q) != (len(u), len(u)):
            raise InputError("A control needs the covariance Q of its noise, of the control's size.")
        self.filter.predict(self, robot, np.asarray(u, dtype=float), np.asarray(Q, dtype=float))
        self.version += 1

    def expect(
        self, robot: Robot, sensor: Sensor, targets: Sequence[Landmark | Robot]
    ) -> list[tuple[Array, Array, Rows, Array]]:
        """Return for each target the expectation e (p,), E (p, p) without the sensor's noise, its rows and H.

        Points and robots are done at once; landmarks by inverse depth one after the other.
        """
        found: dict[int, tuple[Array, Array, Rows, Array]] = {}
        plain = [i for i, t in enumerate(targets) if isinstance(t, Robot) or not t.inverse_depth]
        if plain:
            chosen = [targets[i] for i in plain]
            rows = np.array([t.rows[:2] for t in chosen])
            e, H = self.filter.linearise(self, robot, sensor, chosen, rows)
            rows = np.concatenate([np.tile(robot.rows, (len(rows), 1)), rows], axis=1)
            E = H @ self.joint.block(rows) @ np.swapaxes(H, -1, -2)
            found = {i: (e[k], E[k], rows[k], H[k]) for k, i in enumerate(plain)}
        for i, target in enumerate(targets):
            if i not in found:
                own = np.concatenate([robot.rows, target.rows])
                y, Y_r, Y_L = inverse_depth.observe(self.x[robot.rows], self.x[target.rows], sensor)
                Y = np.concatenate([Y_r, Y_L], axis=1)
                found[i] = (y, Y @ self.joint.block(own) @ Y.T, own, Y)
        return [found[i] for i in range(len(targets))]

    def observe_all(
        self,
        robot: Robot,
        sensor: Sensor,
        targets: Sequence[Landmark | Robot],
        ys: Sequence[Array],
        R: Array | None = None,
    ) -> list[Observation]:
        """Return the observation of each target that measurement y of the same place in `ys` would be.

        R is one covariance (p, p) or one for each (k, p, p); the sensor's own by default.
        """
        R = sensor.R if R is None else np.asarray(R)
        Rs = R if R.ndim == 3 else [R] * len(targets)
        return [
            Observation(robot, sensor, target, y, sensor.difference(y, e), E + R, R, rows, H, self.version)
            for target, y, R, (e, E, rows, H) in zip(targets, ys, Rs, self.expect(robot, sensor, targets), strict=True)
        ]

    def observe(
        self, robot: Robot, sensor: Sensor, target: Landmark | Robot, y: Array, R: Array | None = None
    ) -> Observation:
        """Return a measurement of a landmark, or of another robot, beside what the map expects: O(1).

        Parameters
        ----------
        robot : Robot
            Who sees.
        sensor : Sensor
        target : Landmark or Robot
            What is seen.
        y : (p,) array
            Distance [m], bearing [rad], or one of them.
        R : (p, p) array, optional
            Its covariance; the sensor's own by default.

        Raises
        ------
        InputError
            The robot would see itself.

        Source: J. Solà (2014), eqs. 26-28.
        """
        if target is robot:
            raise InputError(f"Robot {robot.name!r} cannot see itself.")
        (observation,) = self.observe_all(robot, sensor, [target], [y], R)
        return observation

    def correct(self, *observations: Observation) -> float:
        """Take observations into the map: O(n^2); several at once share the linearisation and one joint update.

        Returns
        -------
        float
            Their joint z' Z^-1 z, chi-square with the sum of their degrees of freedom.

        Raises
        ------
        InputError
            The map has changed since they were made.

        Source: J. Solà (2014), eqs. 29-30.
        """
        if not observations:
            return 0.0
        if any(observation.version != self.version for observation in observations):
            raise InputError("This observation belongs to an older map: observe again before correcting.")
        if len(observations) == 1:
            (o,) = observations
            rows, H, z, Z, nis = o.rows, o.H, o.z, o.Z, o.nis
        else:
            rows, H = stacked(observations)
            z = np.concatenate([o.z for o in observations])
            Z = H @ self.joint.block(rows) @ H.T
            at = 0
            for o in observations:
                Z[at : at + o.dof, at : at + o.dof] += o.R
                at += o.dof
            nis = float(z @ np.linalg.solve(Z, z))
        self.filter.inject(self, self.joint.correct(rows, H, z, Z))
        if self._rays:
            self._repair()
        self.version += 1
        return nis

    def initialise(
        self,
        robot: Robot,
        sensor: Sensor,
        y: Array,
        name: Hashable,
        *,
        R: Array | None = None,
        rho: tuple[float, float] = (0.5, 0.25),
    ) -> Landmark:
        """Add a landmark where its first measurement puts it: O(n).

        Parameters
        ----------
        robot : Robot
        sensor : Sensor
        y : (p,) array
            Range and bearing give a point; a bearing a ray of inverse depth.  A range alone needs `rings`.
        name : hashable
            Not yet in the map.
        R : (p, p) array, optional
            Covariance of y; the sensor's own by default.
        rho : (float, float)
            Mean and deviation of the prior on rho [1/m], for a bearing.

        Raises
        ------
        InputError
            The name is taken, or filter and sensor do not go together.

        Source: J. Solà (2014), eqs. 31-38, and 2.3.5 for partial measurements.
        """
        R = sensor.R if R is None else R
        if sensor.kind == "bearing":
            self.filter.allow(INVERSE_DEPTH)
            L, L_r, L_y, L_s = inverse_depth.inv_observe(self.x[robot.rows], np.asarray(y), rho[0], sensor)
            return self.augment(name, robot, L, L_r, L_y @ R @ L_y.T + rho[1] ** 2 * L_s @ L_s.T, None)
        l, L_r, L_y, first = self.filter.seed(self, robot, sensor, y)  # noqa: E741
        return self.augment(name, robot, l, L_r, L_y @ R @ L_y.T, first)

    def augment(
        self,
        name: Hashable,
        robot: Robot,
        mean: Array,
        L_r: Array,
        noise: Array,
        first: Array | None,
    ) -> Landmark:
        """Add a landmark with this mean (k,), P_lx = L_r P_rx and P_ll = L_r P_rr L_r' + noise.

        Raises
        ------
        InputError
            The name is taken.
        """
        if name in self.landmarks:
            raise InputError(f"Landmark {name!r} is in the map already.")
        rows = self.joint.augment(robot.rows, L_r, noise)
        self.x[rows] = mean
        landmark = self.landmarks[name] = Landmark(name, rows, first)
        self._changed()
        return landmark

    def hypothesise(self, robot: Robot, sensor: Sensor, y: Array, name: Hashable) -> Landmark:
        """Add a point that is no landmark yet: it can be observed and refined, and is adopted or withdrawn later."""
        l, L_r, L_y, first = self.filter.seed(self, robot, sensor, y)  # noqa: E741
        rows = self.joint.augment(robot.rows, L_r, L_y @ sensor.R @ L_y.T)
        self.x[rows] = l
        hypothesis = Landmark(name, rows, first)
        self.hypotheses.append(hypothesis)
        self._changed()
        return hypothesis

    def refine(self, observation: Observation) -> None:
        """Let a hypothesis alone learn from an observation: O(n); the rest of the map keeps mean and covariance.

        Other observations of the same instant stay valid: what they say of the rest of the map has not changed.
        """
        o = observation
        self.x[o.target.rows] += self.joint.refine(o.target.rows, o.rows, o.H, o.z, o.Z)

    def adopt(self, hypothesis: Landmark, name: Hashable) -> Landmark:
        """Make a hypothesis a landmark under this name.

        Raises
        ------
        InputError
            The name is taken.
        """
        if name in self.landmarks:
            raise InputError(f"Landmark {name!r} is in the map already.")
        hypothesis.name, hypothesis.first = name, self.x[hypothesis.rows].copy()
        self.hypotheses.remove(hypothesis)
        self.landmarks[name] = hypothesis
        self._changed()
        return hypothesis

    def withdraw(self, hypothesis: Landmark) -> None:
        """Remove a hypothesis; its slots are free."""
        self.hypotheses.remove(hypothesis)
        self.joint.release(hypothesis.rows)
        self._changed()

    def delete(self, landmark: Landmark) -> None:
        """Remove a landmark; the others keep their marginal, and its slots are free.

        Raises
        ------
        InputError
            The landmark is not in the map.
        """
        if self.landmarks.get(landmark.name) is not landmark:
            raise InputError(f"Landmark {landmark.name!r} is not in the map.")
        del self.landmarks[landmark.name]
        self.joint.release(landmark.rows)
        self._changed()

    def to_point(self, landmark: Landmark) -> None:
        """Turn a landmark of inverse depth into a point, 4 slots into 2: O(n)."""
        p, P_L = inverse_depth.point(self.x[landmark.rows])
        rows = self.joint.augment(landmark.rows, P_L, np.zeros((2, 2)))
        self.x[rows] = p
        self.joint.release(landmark.rows)
        landmark.rows, landmark.first = rows, p
        self._changed()

    def pose(self, robot: Robot) -> tuple[Array, Array]:
        """Return pose (3,) [m, m, rad] and covariance (3, 3) of a robot, in ordinary coordinates."""
        T = np.eye(3)
        r = self.x[robot.rows]
        T[:2, 2] = self.filter.to_ordinary(r[:2])
        return r, T @ self.joint.block(robot.rows) @ T.T

    def point(self, landmark: Landmark) -> tuple[Array, Array]:
        """Return position (2,) [m] and covariance (2, 2) of a landmark, in ordinary coordinates."""
        if landmark.inverse_depth:
            p, P_L = inverse_depth.point(self.x[landmark.rows])
            return p, P_L @ self.joint.block(landmark.rows) @ P_L.T
        means, covs = self.points([landmark])
        return means[0], covs[0]

    def points(self, landmarks: Sequence[Landmark] | None = None) -> tuple[Array, Array]:
        """Return positions (m, 2) and covariances (m, 2, 2) of landmarks, by default of all, in their order."""
        landmarks = list(self.landmarks.values()) if landmarks is None else list(landmarks)
        if any(landmark.inverse_depth for landmark in landmarks) or not landmarks:
            pairs = [self.point(landmark) for landmark in landmarks]
            return np.reshape([m for m, _ in pairs], (-1, 2)), np.reshape([P for _, P in pairs], (-1, 2, 2))
        rows = np.array([landmark.rows for landmark in landmarks])
        means = self.x[rows]
        columns = self.filter.to_ordinary(means)
        if not columns.any():
            return means, self.joint.block(rows)
        heading = np.broadcast_to(self.robots[0].rows[2:], (len(rows), 1))
        T = np.concatenate([columns[..., None], np.broadcast_to(np.eye(2), (len(rows), 2, 2))], axis=-1)
        P = self.joint.block(np.concatenate([heading, rows], axis=1))
        return means, T @ P @ np.swapaxes(T, -1, -2)

    def nees(self, robot: Robot, truth: Array) -> float:
        """Return the normalised squared error of a robot's pose, in the filter's own error; infinite if P is singular.

        Parameters
        ----------
        robot : Robot
        truth : (3,) array
            In the map's frame [m, m, rad].
        """
        error = self.filter.pose_error(self.x[robot.rows], truth)
        P = self.joint.block(robot.rows)
        if np.linalg.matrix_rank(P, hermitian=True) < 3:
            return float("inf")
        return float(error @ np.linalg.solve(P, error))

    def _changed(self) -> None:
        """Note who is in the map now."""
        self.version += 1
        points = [landmark for landmark in self.landmarks.values() if not landmark.inverse_depth]
        plain = [point.rows for point in points + self.hypotheses]
        self._rays = [landmark for landmark in self.landmarks.values() if landmark.inverse_depth]
        self.point_rows: Rows = np.reshape(np.array(plain, dtype=np.intp), (-1, 2))
        headings = [robot.rows[2] for robot in self.robots]
        self.angle_rows: Rows = np.array(headings + [ray.rows[2] for ray in self._rays], dtype=np.intp)

    def _repair(self) -> None:
        """Set what a correction has pushed below zero to a point far away: a negative rho would flip its ray."""
        for ray in self._rays:
            if self.x[ray.rows[3]] < inverse_depth.NEAR_ZERO:
                self.x[ray.rows[3]] = inverse_depth.NEAR_ZERO


def stacked(observations: Sequence[Observation]) -> tuple[Rows, Array]:
    """Return the rows that observations touch together (k,) and their common H (p, k)."""
    rows = np.unique(np.concatenate([o.rows for o in observations]))
    H = np.zeros((sum(o.dof for o in observations), len(rows)))
    at = 0
    for o in observations:
        H[at : at + o.dof, np.searchsorted(rows, o.rows)] = o.H
        at += o.dof
    return rows, H
