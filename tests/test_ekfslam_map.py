"""The map: sparse arithmetic against a dense filter, deletion against marginalising, slots, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slam_worlds import DenseEkf, difference, measured

from lab.ekfslam import Map, Sensor
from lab.ekfslam.joint import Joint, whitening
from lab.ekfslam.map import stacked
from lab.ekfslam.mapspace import BLOCK, MapSpace
from lab.validation import InputError

Q = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
Q3 = np.array([[4e-4, 1e-4, 0], [1e-4, 2e-4, -1e-4], [0, -1e-4, 9e-4]])
R = np.array([[0.01, 0.0004], [0.0004, 0.0009]])
POINTS = np.array([[3.0, 1.0], [-2.0, 2.0], [1.0, -4.0], [0.5, 3.0]])
START = np.array([0.2, -0.1, 3.0])  # near the wrap
P0 = np.diag([0.01, 0.02, 0.001]) + 0.001
SENSOR = Sensor()


def place(joint, n):
    """Put a random Gaussian into a joint; return its rows."""
    rng = np.random.default_rng(n)
    A = rng.standard_normal((n, n))
    rows = joint.take(n)
    joint.settle(rows, A @ A.T)
    joint.x[rows] = rng.standard_normal(n)
    return rows


def noisy(rng, r, i):
    y = measured(r, POINTS[i]) + [0.1, 0.03] * rng.standard_normal(2)
    return np.array([y[0], (y[1] + np.pi) % (2 * np.pi) - np.pi])


@pytest.mark.parametrize("u", [np.array([0.5, 0.6]), np.array([0.5, -0.2, 0.6])])
def test_the_sparse_filter_is_the_dense_one(u):
    """To 1e-12 in one prediction, initialisation and correction; numerical Jacobians cost the rest over many."""
    rng = np.random.default_rng(0)
    m, dense = Map("ekf"), DenseEkf(START, P0)
    robot = m.add_robot(START, P0, sensors=[SENSOR])
    noise = Q if len(u) == 2 else Q3
    truth = START.copy()
    for _ in range(30):
        m.move(robot, u, noise)
        dense.move(u, noise)
        truth = dense.x[:3].copy()  # a drive along the estimate: any measurements will do
        for i in range(len(POINTS)):
            y = noisy(rng, truth, i)
            if i in m.landmarks:
                m.correct(m.observe(robot, SENSOR, m.landmarks[i], y, R))
                dense.correct(list(m.landmarks).index(i), y, R)
            elif rng.uniform() < 0.3 or i == len(m.landmarks) == 0:
                m.initialise(robot, SENSOR, y, i, R=R)
                dense.initialise(y, R)
    rows = np.concatenate([robot.rows, *(landmark.rows for landmark in m.landmarks.values())])
    assert len(rows) == 11
    np.testing.assert_allclose(m.x[rows], dense.x, atol=1e-8)
    np.testing.assert_allclose(m.P[np.ix_(rows, rows)], dense.P, atol=1e-9)


def test_joint_arithmetic_is_the_dense_one_to_rounding():
    joint = Joint()
    place(joint, 3)
    hole = place(joint, 4)
    rows = place(joint, 7)
    joint.release(hole)
    rng = np.random.default_rng(1)
    touched = rows[[5, 0, 3]]  # not in order
    F, noise = rng.standard_normal((3, 3)), np.eye(3)
    before = joint.covariance()
    whole = np.eye(len(before))
    whole[np.ix_(touched, touched)] = F
    added = np.zeros_like(before)
    added[np.ix_(touched, touched)] = noise
    joint.predict(touched, F, noise)
    expected = whole @ before @ whole.T + added
    np.testing.assert_allclose(joint.covariance(), expected, rtol=1e-12, atol=1e-12)

    H, z = rng.standard_normal((2, 3)), rng.standard_normal(2)
    wide = np.zeros((2, len(before)))
    wide[:, touched] = H
    Z = wide @ expected @ wide.T + np.eye(2)
    K = expected @ wide.T @ np.linalg.inv(Z)
    np.testing.assert_allclose(joint.correct(touched, H, z, Z), K @ z, rtol=1e-10, atol=1e-12)
    expected = expected - K @ Z @ K.T
    np.testing.assert_allclose(joint.covariance(), expected, rtol=1e-11, atol=1e-12)

    G = rng.standard_normal((2, 3))
    rows = joint.augment(touched, G, 0.5 * np.eye(2))
    lift = np.eye(len(expected))
    lift[rows] = 0
    lift[np.ix_(rows, touched)] = G
    expected = lift @ expected @ lift.T
    expected[rows, rows] += 0.5
    np.testing.assert_allclose(joint.covariance(), expected, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(joint.block(rows, touched), expected[np.ix_(rows, touched)], rtol=1e-11, atol=1e-12)

    W = rng.standard_normal((len(expected), 2))
    joint.spread(W, R)
    np.testing.assert_allclose(joint.covariance(), expected + W @ R @ W.T, rtol=1e-11, atol=1e-11)


def test_refine_is_the_consider_filter():
    """Joseph's form with a gain whose other rows are zero."""
    joint = Joint()
    rows = place(joint, 7)
    rng = np.random.default_rng(2)
    own, touched = rows[[4, 5]], rows[[0, 1, 4, 5]]
    H, z = rng.standard_normal((1, 4)), rng.standard_normal(1)
    before = joint.covariance()
    wide = np.zeros((1, len(before)))
    wide[:, touched] = H
    Z = wide @ before @ wide.T + 0.3
    K = np.zeros((len(before), 1))
    K[own] = (before @ wide.T @ np.linalg.inv(Z))[own]
    left = np.eye(len(before)) - K @ wide
    expected = left @ before @ left.T + 0.3 * K @ K.T
    np.testing.assert_allclose(joint.refine(own, touched, H, z, Z), K[own] @ z, rtol=1e-12)
    np.testing.assert_allclose(joint.covariance(), expected, rtol=1e-11, atol=1e-12)


def test_blas_works_in_place():
    joint = Joint()
    rows = place(joint, 5)
    memory = joint._P.ctypes.data
    joint.correct(rows, np.eye(1, 5), np.ones(1), joint.block(rows[:1]) + 1)
    joint.spread(np.ones((BLOCK, 1)), np.eye(1))
    assert joint._P.ctypes.data == memory


def mapped(filter="ekf", n=4):
    """Return a map with n landmarks, all seen twice."""
    rng = np.random.default_rng(5)
    m = Map(filter)
    robot = m.add_robot(START, P0, sensors=[SENSOR], Q=Q)
    for i in range(n):
        m.initialise(robot, SENSOR, noisy(rng, START, i), i)
        m.move(robot, np.array([0.1, 0.1]))
    for i in range(n):
        m.correct(m.observe(robot, SENSOR, m.landmarks[i], noisy(rng, m.x[robot.rows], i)))
    return m, robot


@pytest.mark.parametrize("filter", ["ekf", "fej", "ri"])
def test_deletion_is_marginalising(filter):
    m, robot = mapped(filter)
    keep = np.setdiff1d(m.joint.space.taken, m.landmarks[1].rows)
    x, P = m.x.copy(), m.P
    m.delete(m.landmarks[1])
    np.testing.assert_array_equal(m.x[keep], x[keep])
    np.testing.assert_array_equal(m.P[np.ix_(keep, keep)], P[np.ix_(keep, keep)])
    assert not m.P[np.setdiff1d(np.arange(len(x)), keep)].any()
    # and the smaller map goes on as if the landmark had never been there
    m.correct(m.observe(robot, SENSOR, m.landmarks[3], measured(m.x[robot.rows], POINTS[3])))
    assert not m.x[np.setdiff1d(np.arange(len(x)), keep)].any()
    assert not m.P[np.setdiff1d(np.arange(len(x)), keep)].any()


def test_freed_slots_are_taken_again():
    m, robot = mapped()
    rows = m.landmarks[1].rows
    m.delete(m.landmarks[1])
    fresh = m.initialise(robot, SENSOR, np.array([2.0, 0.5]), "new")
    np.testing.assert_array_equal(fresh.rows, rows)
    assert [*m.landmarks] == [0, 2, 3, "new"]
    assert np.linalg.eigvalsh(m.P).min() > -1e-12


def test_a_landmark_is_deleted_once():
    m, _ = mapped()
    landmark = m.landmarks[2]
    m.delete(landmark)
    with pytest.raises(InputError, match="not in the map"):
        m.delete(landmark)
    with pytest.raises(InputError, match="deleted twice"):
        m.joint.release(landmark.rows)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.sampled_from([2, 3, 4])), max_size=120), st.booleans())
def test_slots(acts, bounded):
    """No slot is ever given twice, none is lost, and a full space says so."""
    space = MapSpace(limit=41 if bounded else None)
    held = []
    for take, n in acts:
        if take or not held:
            free = space.capacity - len(space.taken)
            room = 41 - len(space.taken) if bounded else np.inf
            if n > room:
                with pytest.raises(InputError, match="The map is full"):
                    space.take(n)
                continue
            held.append(space.take(n))
            assert free >= n or space.capacity % BLOCK == 0 or bounded
        else:
            space.release(held.pop(len(held) // 2))
        every = np.concatenate([*held, np.empty(0, dtype=int)])
        assert len(set(every)) == len(every)
        np.testing.assert_array_equal(np.sort(every), space.taken)


def test_one_free_slot_is_not_enough_for_a_landmark():
    m = Map("ekf", limit=6)
    robot = m.add_robot(START, P0)
    m.initialise(robot, SENSOR, np.array([1.0, 0.0]), "a")
    with pytest.raises(InputError, match="2 slots are wanted and 6 is its limit"):
        m.initialise(robot, SENSOR, np.array([1.0, 0.0]), "b")


@pytest.mark.parametrize("p", [1, 2, 3])
def test_whitening(p):
    A = np.random.default_rng(p).standard_normal((p, p))
    np.testing.assert_allclose(whitening(A @ A.T), np.linalg.inv(np.linalg.cholesky(A @ A.T)), rtol=1e-9, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        whitening(-A @ A.T)
    if p == 2:
        with pytest.raises(np.linalg.LinAlgError):
            whitening(np.array([[1.0, 2.0], [2.0, 1.0]]))


@pytest.mark.parametrize("n", [1, 100])
def test_growth_keeps_the_map(n):
    joint = Joint()
    rows = place(joint, 60)
    x, P = joint.x.copy(), joint.covariance()
    joint.take(n)
    k = len(x)
    np.testing.assert_array_equal(joint.x[:k], x)
    np.testing.assert_array_equal(joint.covariance()[:k, :k], P)
    assert not joint.covariance()[k:].any()
    assert len(rows) == 60


def test_several_observations_at_once_are_one_update():
    """A stacked measurement in one dense update."""
    m, robot = mapped()
    ys = [measured(m.x[robot.rows], POINTS[i]) + 0.05 for i in range(3)]
    many = m.observe_all(robot, SENSOR, list(m.landmarks.values())[:3], ys)
    rows, H = stacked(many)
    taken = m.joint.space.taken
    wide = np.zeros((6, len(m.x)))
    wide[:, rows] = H
    x, P = m.x.copy(), m.P
    Z = wide @ P @ wide.T + np.kron(np.eye(3), SENSOR.R)
    K = P @ wide.T @ np.linalg.inv(Z)
    m.correct(*many)
    expected = x + K @ np.concatenate([o.z for o in many])
    np.testing.assert_allclose(m.x[taken], expected[taken], atol=1e-12)
    np.testing.assert_allclose(m.P, P - K @ Z @ K.T, atol=1e-12)


def test_an_observation_of_an_older_map_is_refused():
    m, robot = mapped()
    one, other = (m.observe(robot, SENSOR, m.landmarks[i], np.array([3.0, 1.0])) for i in (0, 1))
    m.correct(one)
    with pytest.raises(InputError, match="older map"):
        m.correct(other)


@pytest.mark.parametrize("filter", ["ekf", "fej"])
def test_robots_that_see_each_other(filter):
    """A sighting correlates two robots, and its Jacobian is that of the measurement."""
    m = Map(filter)
    a = m.add_robot(START, P0, name="a", Q=Q)
    b = m.add_robot(np.array([2.0, 1.0, 0.5]), P0, name="b", Q=Q)
    y = measured(START, [2.0, 1.0]) + np.array([0.1, 0.02])
    o = m.observe(a, SENSOR, b, y)
    both = np.concatenate([START, [2.0, 1.0]])
    np.testing.assert_allclose(o.H, difference(lambda v: measured(v[:3], v[3:]), both, [1]), atol=1e-6)
    np.testing.assert_array_equal(o.rows, [*a.rows, *b.rows[:2]])
    m.correct(o)
    assert np.abs(m.joint.block(a.rows, b.rows)).max() > 1e-4
    with pytest.raises(InputError, match="cannot see itself"):
        m.observe(a, SENSOR, a, y)


def test_a_map_of_several_robots_is_the_map_of_one_when_they_never_meet():
    m, robot = mapped()
    two, first = Map("ekf"), None
    rng = np.random.default_rng(5)
    first = two.add_robot(START, P0, Q=Q)
    second = two.add_robot(np.array([5.0, 5.0, 1.0]), P0, Q=Q)
    for i in range(4):
        two.initialise(first, SENSOR, noisy(rng, START, i), i)
        two.move(first, np.array([0.1, 0.1]))
        two.move(second, np.array([0.3, 0.0]))
    for i in range(4):
        two.correct(two.observe(first, SENSOR, two.landmarks[i], noisy(rng, two.x[first.rows], i)))
    np.testing.assert_allclose(two.x[first.rows], m.x[robot.rows], atol=1e-12)
    np.testing.assert_allclose(two.points()[1], m.points()[1], atol=1e-12)
    assert not two.joint.block(first.rows, second.rows).any()


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda m, r: m.move(r, np.zeros(3)), "of the control's size"),
        (lambda m, r: m.initialise(r, SENSOR, np.array([1.0, 0.0]), 0), "in the map already"),
        (lambda m, r: m.initialise(r, Sensor("range", (0.1,)), np.array([1.0]), "x"), "does not determine a point"),
        (lambda m, r: m.add_robot(np.zeros(2)), "pose must have shape"),
        (lambda m, r: m.add_robot(np.zeros(3), -np.eye(3)), "P is not positive semidefinite"),
        (lambda m, r: Map("ukf"), "Unknown filter 'ukf'; known are ekf, fej, ri"),
    ],
)
def test_what_is_refused(act, message):
    m, robot = mapped()
    with pytest.raises(InputError, match=message):
        act(m, robot)
