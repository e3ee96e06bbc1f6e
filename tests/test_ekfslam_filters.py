"""ekf, fej, ri: what each can and cannot observe, and what each is refused for."""

import numpy as np
import pytest
from scipy.linalg import expm
from slam_worlds import difference, measured, se2, wrapped

from lab.ekfslam import FILTERS, Map, Sensor
from lab.ekfslam.filters import RightInvariant, left_jacobian
from lab.ekfslam.frames import J, rotation
from lab.validation import InputError

SENSOR = Sensor(noise=(0.1, 0.03))
MOUNTED = Sensor(noise=(0.1, 0.03), mount=(0.2, -0.1, 0.7))
Q = np.diag([0.02, 0.03]) ** 2
U = np.array([0.3, 0.2])
POINTS = np.array([[3.0, 1.0], [-2.0, 2.0], [1.0, -4.0], [0.5, 3.0], [2.0, 5.0]])
START = np.array([1.0, -0.5, 2.0])
P0 = np.diag([0.02, 0.03, 0.01])


class Watched:
    """Carries the unobservable directions N through a map by what it does, and keeps H N of every correction."""

    def __init__(self, m, N):
        self.N = np.zeros((512, 3))
        self.N[: len(N)] = N
        self.products = []
        joint = m.joint
        self.originals = joint.predict, joint.augment, joint.correct
        joint.predict, joint.augment, joint.correct = self.predict, self.augment, self.correct

    def predict(self, rows, F, noise):
        self.N[rows] = F @ self.N[rows]
        self.originals[0](rows, F, noise)

    def augment(self, sources, G, noise):
        rows = self.originals[1](sources, G, noise)
        self.N[rows] = G @ self.N[sources]
        return rows

    def correct(self, rows, H, z, Z):
        self.products.append(np.abs(H @ self.N[rows]).max())
        return self.originals[2](rows, H, z, Z)


def directions(filter, pose):
    """Return the robot's rows of N in the filter's own error: a shift along x, along y, and a turn of everything."""
    N = np.eye(3)
    if filter != "ri":  # in ri's error a turn of everything is xi_theta alone
        N[:2, 2] = J @ pose[:2]
    return N


def drive(m, robots, sensor, rng, steps=40, sightings=False):
    """Drive along noisy truths that the filter has to correct for, so that its estimates move at every step."""
    truths = [m.x[robot.rows].copy() for robot in robots]
    for k in range(steps):
        for a, robot in enumerate(robots):
            u = U + 0.1 * np.array([np.sin(k), np.cos(k + a)])
            truth = se2(truths[a]) @ se2([u[0] + 0.05 * rng.standard_normal(), 0, u[1] + 0.05 * rng.standard_normal()])
            truths[a] = np.array([*truth[:2, 2], np.arctan2(truth[1, 0], truth[0, 0])])
            m.move(robot, u, Q)
            for i, point in enumerate(POINTS):
                y = measured(truths[a], point, mount=sensor.mount) + sensor.noise * rng.standard_normal(2)
                if i in m.landmarks:
                    m.correct(m.observe(robot, sensor, m.landmarks[i], y))
                elif k >= i:
                    m.initialise(robot, sensor, y, i)
        if sightings:
            y = measured(truths[0], truths[1][:2], mount=sensor.mount) + sensor.noise * rng.standard_normal(2)
            m.correct(m.observe(robots[0], sensor, robots[1], y))
    return truths


@pytest.mark.parametrize("sensor", [SENSOR, MOUNTED])
@pytest.mark.parametrize(("filter", "holds"), [("ekf", False), ("fej", True), ("ri", True)])
def test_null_space(filter, holds, sensor):
    """H_k Phi_(k-1) ... Phi_0 N = 0 for all k, initialisations included."""
    m = Map(filter)
    robot = m.add_robot(START, P0)
    watched = Watched(m, directions(filter, START))
    drive(m, [robot], sensor, np.random.default_rng(0))
    assert len(watched.products) > 150
    assert max(watched.products) < 1e-10 if holds else max(watched.products) > 1e-2


def test_null_space_of_two_robots():
    other = np.array([2.0, 2.0, -1.0])
    found = {}
    for filter in ("ekf", "fej"):
        m = Map(filter)
        robots = [m.add_robot(START, P0), m.add_robot(other, P0)]
        watched = Watched(m, np.vstack([directions(filter, START), directions(filter, other)]))
        drive(m, robots, SENSOR, np.random.default_rng(1), sightings=True)
        found[filter] = max(watched.products)
    assert found["fej"] < 1e-10
    assert found["ekf"] > 1e-2


def test_a_rigid_motion_of_the_frame_commutes_with_ri():
    """Estimates move with the frame, and its covariance, in its own error, moves by the adjoint of the motion."""
    T = np.array([10.0, -7.0, 2.2])
    answers = {}
    for name in FILTERS:
        pair = []
        for moved in (False, True):
            m = Map(name)
            pose = START.copy()
            if moved:
                pose = np.array([*(rotation(T[2]) @ START[:2] + T[:2]), START[2] + T[2]])
            block = np.eye(3)
            block[:2, :2] = rotation(T[2]) if moved else np.eye(2)
            P = block @ (P0 + 0.005) @ block.T
            robot = m.add_robot(pose, P)
            rng = np.random.default_rng(3)
            truth = START.copy()
            for k in range(25):
                truth += np.array([0.1, 0.05, 0.1])
                m.move(robot, U, Q)
                for i, point in enumerate(POINTS):
                    y = measured(truth, point) + SENSOR.noise * rng.standard_normal(2)
                    if i in m.landmarks:
                        m.correct(m.observe(robot, SENSOR, m.landmarks[i], y))
                    elif k >= i:
                        m.initialise(robot, SENSOR, y, i)
            pair.append((m.pose(robot), m.points()))
        (r, P), (points, covs) = pair[0]
        (r_moved, P_moved), (points_moved, covs_moved) = pair[1]
        R = rotation(T[2])
        answers[name] = max(
            np.abs(points @ R.T + T[:2] - points_moved).max(),
            np.abs(R @ r[:2] + T[:2] - r_moved[:2]).max(),
            abs(wrapped(r[2] + T[2] - r_moved[2])),
            np.abs(R @ covs @ R.T - covs_moved).max(),
            np.abs(R @ P[:2, :2] @ R.T - P_moved[:2, :2]).max(),
        )
    assert answers["ri"] < 1e-9


@pytest.mark.parametrize("a", [0.0, 1e-9, 1e-3, 1.0, -3.0])
def test_exp_of_the_group(a):
    """exp of the algebra's matrix is [R, V xi; 0, 1]."""
    xi = np.array([0.3, -0.8])
    algebra = np.zeros((3, 3))
    algebra[:2, :2], algebra[:2, 2] = a * J, xi
    expected = expm(algebra)
    np.testing.assert_allclose(expected[:2, 2], left_jacobian(a) @ xi, atol=1e-12)
    np.testing.assert_allclose(expected[:2, :2], rotation(a), atol=1e-12)


def test_log_of_the_group_error_undoes_exp():
    m = Map("ri")
    robot = m.add_robot(START, P0)
    step = np.zeros(len(m.x))
    step[robot.rows] = [0.2, -0.3, 0.9]
    m.filter.inject(m, step)
    np.testing.assert_allclose(m.filter.pose_error(START, m.x[robot.rows]), step[robot.rows], atol=1e-12)


def test_ris_jacobian_is_that_of_its_own_error():
    """H, L_r and the noise of the motion by differences through exp."""
    m = Map("ri")
    robot = m.add_robot(START, P0)
    landmark = m.initialise(robot, MOUNTED, np.array([3.0, 0.4]), "a")
    o = m.observe(robot, MOUNTED, landmark, np.array([3.0, 0.4]))
    x = m.x.copy()

    def expected_after(xi):
        m.joint.x[:] = x
        step = np.zeros(len(x))
        step[o.rows] = xi
        m.filter.inject(m, step)
        return measured(m.x[robot.rows], m.x[landmark.rows], mount=MOUNTED.mount)

    np.testing.assert_allclose(o.H, difference(expected_after, np.zeros(5), [1]), atol=1e-6)
    assert not o.H[:, 2].any()


def test_ordinary_coordinates_of_ri():
    """To first order the ordinary covariance is that of points drawn by exp in ri's error."""
    m = Map("ri")
    robot = m.add_robot(START, 1e-6 * P0)
    landmark = m.initialise(robot, SENSOR, np.array([3.0, 0.4]), "a", R=1e-6 * SENSOR.R)
    m.move(robot, U, 1e-6 * Q)
    rows = np.concatenate([robot.rows, landmark.rows])
    x, P = m.x.copy(), m.joint.block(rows)

    def ordinary(xi):
        m.joint.x[:] = x
        step = np.zeros(len(x))
        step[rows] = xi
        m.filter.inject(m, step)
        return m.x[rows].copy()

    T = difference(ordinary, np.zeros(5))
    m.joint.x[:] = x
    np.testing.assert_allclose(m.pose(robot)[1], (T @ P @ T.T)[:3, :3], rtol=1e-6, atol=1e-14)
    np.testing.assert_allclose(m.point(landmark)[1], (T @ P @ T.T)[3:, 3:], rtol=1e-6, atol=1e-14)


def test_all_filters_agree_while_little_has_happened():
    """With tiny noise all three are the same Gaussian, in ordinary coordinates."""
    answers = []
    for name in FILTERS:
        m = Map(name)
        robot = m.add_robot(START, 1e-8 * P0)
        sensor = Sensor(noise=(1e-5, 3e-6))
        rng = np.random.default_rng(0)
        truth = START.copy()
        for _ in range(5):
            truth = se2(truth) @ se2([U[0], 0, U[1]])
            truth = np.array([*truth[:2, 2], np.arctan2(truth[1, 0], truth[0, 0])])
            m.move(robot, U, 1e-8 * Q)
            for i, point in enumerate(POINTS):
                y = measured(truth, point) + sensor.noise * rng.standard_normal(2)
                if i in m.landmarks:
                    m.correct(m.observe(robot, sensor, m.landmarks[i], y))
                else:
                    m.initialise(robot, sensor, y, i)
        answers.append((m.pose(robot), m.points()))
    for (r, P), (points, covs) in answers[1:]:
        (r0, P_r0), (points0, covs0) = answers[0]
        np.testing.assert_allclose(r, r0, atol=1e-8)
        np.testing.assert_allclose(points, points0, atol=1e-8)
        np.testing.assert_allclose(P, P_r0, atol=1e-3 * np.abs(P_r0).max())
        np.testing.assert_allclose(covs, covs0, atol=1e-3 * np.abs(covs0).max())


def test_headings_are_wrapped_after_correction():
    for name in FILTERS:
        m = Map(name)
        robot = m.add_robot(np.array([0.0, 0.0, np.pi - 0.01]), np.diag([1e-6, 1e-6, 0.1]))
        landmark = m.initialise(robot, SENSOR, np.array([2.0, 0.0]), "a", R=1e-6 * np.eye(2))
        m.move(robot, np.zeros(2), np.diag([1e-9, 0.1]))
        m.correct(m.observe(robot, SENSOR, landmark, np.array([2.0, -0.3])))
        assert -np.pi <= m.x[robot.rows[2]] < -np.pi + 0.5, name


@pytest.mark.parametrize(
    ("filter", "what"),
    [("fej", "landmarks by inverse depth"), ("ri", "landmarks by inverse depth"), ("ri", "several robots")],
)
def test_combinations_that_are_refused(filter, what):
    m = Map(filter)
    robot = m.add_robot(START, P0)
    act = {
        "several robots": lambda: m.add_robot(START, P0),
        "landmarks by inverse depth": lambda: m.initialise(robot, Sensor("bearing", (0.02,)), np.array([0.3]), "a"),
    }
    with pytest.raises(InputError, match=rf"The filter {filter} is not implemented for {what}; use ekf\."):
        act[what]()


def test_the_switch_is_complete():
    assert [*FILTERS] == ["ekf", "fej", "ri"]
    assert all(kind.name == name for name, kind in FILTERS.items())
    assert isinstance(Map("ri").filter, RightInvariant)
