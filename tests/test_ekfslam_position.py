"""A sensor that gives places in rectangular coordinates, and the joint innovation of several measurements at once."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from slam_worlds import difference, se2

from lab.ekfslam import Map, Sensor
from lab.ekfslam.map import stacked
from lab.ekfslam.sensor import inv_observe, observe, scan

FRAMES = [*np.random.default_rng(0).normal(0, 3, (5, 3)), np.array([1.0, -2.0, np.pi])]
POINT = np.array([0.7, -1.9])
TOLERANCE = {"rtol": 1e-6, "atol": 1e-7}


@pytest.mark.parametrize("mount", [(0, 0, 0), (0.3, -0.2, 2.5)])
@pytest.mark.parametrize("r", FRAMES)
def test_the_place_in_the_sensors_frame(r, mount):
    sensor = Sensor("position", (0.1, 0.2), mount)
    np.testing.assert_allclose(sensor.R, np.diag([0.01, 0.04]))
    (y,), (Y_r,), (Y_l,) = observe(r, POINT[np.newaxis], sensor)
    np.testing.assert_allclose(y, (np.linalg.inv(se2(r) @ se2(mount)) @ [*POINT, 1])[:2], atol=1e-12)
    np.testing.assert_allclose(Y_r, difference(lambda v: observe(v, POINT, sensor)[0], r), **TOLERANCE)
    np.testing.assert_allclose(Y_l, difference(lambda v: observe(r, v, sensor)[0], POINT), **TOLERANCE)
    back, L_r, L_y = inv_observe(r, y, sensor)
    np.testing.assert_allclose(back, POINT, atol=1e-12)
    np.testing.assert_allclose(L_r, difference(lambda v: inv_observe(v, y, sensor)[0], r), **TOLERANCE)
    np.testing.assert_allclose(L_y, difference(lambda v: inv_observe(r, v, sensor)[0], y), **TOLERANCE)


def test_no_component_of_a_place_is_an_angle():
    sensor = Sensor("position", (0.1, 0.1))
    np.testing.assert_array_equal(sensor.difference(np.array([9.0, 7.0]), np.array([1.0, -2.0])), [8.0, 9.0])


def test_a_place_at_the_sensor_is_no_trouble():
    y, Y_p = scan(np.zeros(2), "position")
    np.testing.assert_array_equal(y, [0, 0])
    np.testing.assert_array_equal(Y_p, np.eye(2))


def test_a_place_is_a_copy():
    p = np.ones(2)
    scan(p, "position")[0][:] = 5
    assert p.tolist() == [1, 1]


@pytest.fixture
def seen():
    """Three landmarks measured at once, each with its own noise."""
    rng = np.random.default_rng(1)
    m, sensor = Map("ekf"), Sensor("position", (0.1, 0.2))
    robot = m.add_robot(np.array([1.0, 2.0, 0.5]), 0.01 * np.eye(3))
    targets = [m.initialise(robot, sensor, rng.normal(size=2), i) for i in range(3)]
    m.move(robot, np.array([0.4, 0.1, 0.2]), 0.01 * np.eye(3))
    Rs = np.array([np.diag(rng.uniform(0.01, 0.1, 2)) for _ in targets])
    return m, m.observe_all(robot, sensor, targets, rng.normal(size=(3, 2)), Rs), Rs


def test_every_measurement_may_have_its_own_noise(seen):
    _, observations, Rs = seen
    for observation, R in zip(observations, Rs, strict=True):
        np.testing.assert_array_equal(observation.R, R)


def test_correct_returns_the_joint_innovation(seen):
    m, observations, Rs = seen
    rows, H = stacked(observations)
    Z = H @ m.P[np.ix_(rows, rows)] @ H.T + block_diag(*Rs)
    z = np.concatenate([o.z for o in observations])
    expected = z @ np.linalg.inv(Z) @ z
    assert expected != pytest.approx(sum(o.nis for o in observations), rel=0.01)  # they are correlated
    assert m.correct(*observations) == pytest.approx(expected)
    assert m.correct() == 0


def test_correct_returns_the_innovation_of_one(seen):
    m, observations, _ = seen
    nis = observations[0].nis
    assert m.correct(observations[0]) == pytest.approx(nis)
