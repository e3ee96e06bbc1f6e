"""Solà's symbols: x and P of the map, r robot, l landmark; the map manager's book: who is in the map, and where.

Question answered: which robots and landmarks are there, which slots do they hold, and what is known of each?  Adding
takes slots and removing frees them; what is removed leaves the marginal of the rest.  The covariance is kept in the
filter's own error; `pose`, `point` and `points` give ordinary coordinates whatever the filter.  `map` adds the events.
Source: J. Solà (2014), sections 1.3 and 2.4.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from lab.ekfslam import inverse_depth
from lab.ekfslam.entities import Landmark, Robot
from lab.ekfslam.filters import SEVERAL, make_filter
from lab.ekfslam.joint import Joint
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.sensor import Sensor
from lab.validation import Array, InputError, check_covariance, real_array


class Roster:
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
