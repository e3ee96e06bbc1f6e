"""Solà's symbols: x and P of the map, r robot, l landmark, u control, y measurement, z innovation, Z its covariance.

Question answered: what happens to the map in each of the guide's events?

    move         a robot moves                 prediction
    initialise   a landmark is discovered      state augmentation
    observe, correct   a known one is seen     correction (the observation may be gated in between)
    delete       a landmark is corrupted       state reduction (of the `roster`)

The filter (`filters`) says where to linearise and what an error is; the arithmetic is in `joint`.
Source: J. Solà (2014), sections 1.3 and 2.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from lab.ekfslam import inverse_depth
from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.filters import INVERSE_DEPTH
from lab.ekfslam.mapspace import Rows
from lab.ekfslam.roster import Roster
from lab.ekfslam.sensor import Sensor
from lab.validation import Array, InputError


class Map(Roster):
    """Robots and landmarks in one Gaussian, and the events that change it; made as its `Roster` is."""

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
