"""Models of the EKF-SLAM wing: every Jacobian against central differences, every value against another formula."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slam_worlds import difference, measured, se2, wrapped

from lab.ekfslam import PRESETS, Sensor, inverse_depth
from lab.ekfslam.frames import from_frame, polar, rectangular, rotation, to_frame, wrap
from lab.ekfslam.motion import move
from lab.ekfslam.sensor import inv_observe, inv_scan, observe, scan
from lab.validation import InputError

RNG = np.random.default_rng(0)
FRAMES = [*RNG.normal(0, 3, (6, 3)), np.array([1.0, -2.0, np.pi]), np.array([0.0, 0.0, -np.pi]), np.zeros(3)]
# behind (bearing +-pi), abeam (p_x = 0), near and far
POINTS = [
    *RNG.normal(0, 3, (6, 2)),
    *map(np.array, [(-2.0, 1e-9), (-2.0, -1e-9), (0.0, 3.0), (0.0, -1.0), (1e-3, 0.0)]),
]
MOUNT = (0.3, -0.2, 2.5)
KINDS = {"range-bearing": (0.1, 0.02), "bearing": (0.02,), "range": (0.1,)}
TOLERANCE = {"rtol": 1e-6, "atol": 1e-7}


def angles_of(kind):
    return {"range-bearing": [1], "bearing": [0], "range": []}[kind]


@given(st.floats(-1e4, 1e4))
def test_wrap(a):
    w = wrap(a)
    assert -np.pi <= w <= np.pi
    assert wrapped(w - a) == pytest.approx(0, abs=1e-10)
    assert wrap(np.array([a, a]))[1] == w


@pytest.mark.parametrize("turns", [-7, -2, -1, 0, 1, 2, 9])
def test_wrap_takes_any_number_of_turns(turns):
    assert wrap(0.5 + turns * 2 * np.pi) == pytest.approx(0.5)
    assert wrap(np.pi + turns * 2 * np.pi) == pytest.approx(-np.pi, abs=1e-12) or wrap(
        np.pi + turns * 2 * np.pi
    ) == pytest.approx(np.pi, abs=1e-12)


@pytest.mark.parametrize("F", FRAMES)
@pytest.mark.parametrize("p", POINTS)
def test_frames(F, p):
    q, Q_F, Q_p = to_frame(F, p)
    np.testing.assert_allclose(q, (np.linalg.inv(se2(F)) @ [*p, 1])[:2], atol=1e-12)
    np.testing.assert_allclose(Q_F, difference(lambda v: to_frame(v, p)[0], F), **TOLERANCE)
    np.testing.assert_allclose(Q_p, difference(lambda v: to_frame(F, v)[0], p), **TOLERANCE)
    back, P_F, P_q = from_frame(F, q)
    np.testing.assert_allclose(back, p, atol=1e-12)
    np.testing.assert_allclose(P_F, difference(lambda v: from_frame(v, q)[0], F), **TOLERANCE)
    np.testing.assert_allclose(P_q, difference(lambda v: from_frame(F, v)[0], q), **TOLERANCE)


@pytest.mark.parametrize("p", POINTS)
def test_polar_by_complex_step(p):
    """Distance and bearing as the logarithm of p_x + i p_y, whose derivative is 1 / p."""
    y, Y_p = polar(p)
    z = complex(*p)
    np.testing.assert_allclose(y, [abs(z), np.angle(z)])
    np.testing.assert_allclose(Y_p[0], [np.exp(0) * z.real / abs(z), z.imag / abs(z)], atol=1e-15)
    np.testing.assert_allclose(Y_p[1], [(1 / z).imag, (1j / z).imag], rtol=1e-12, atol=1e-15)
    step = 1e-6 * abs(z)
    np.testing.assert_allclose(Y_p, difference(lambda v: polar(v)[0], p, [1], step), rtol=1e-6, atol=1e-6)
    back, P_y = rectangular(y)
    np.testing.assert_allclose(back, p, atol=1e-12)
    np.testing.assert_allclose(P_y, difference(lambda v: rectangular(v)[0], y), **TOLERANCE)
    np.testing.assert_allclose(Y_p @ P_y, np.eye(2), atol=1e-9)


def test_the_printed_jacobian_fails_abeam_and_this_does_not():
    _, Y_p = scan(np.array([0.0, 2.0]))
    np.testing.assert_allclose(Y_p, [[0, 1], [-0.5, 0]])


@pytest.mark.parametrize("kind", KINDS)
def test_a_point_in_the_sensor_is_refused(kind):
    with pytest.raises(InputError, match="distance 0"):
        scan(np.array([[1.0, 0.0], [0.0, 0.0]]), kind)


@pytest.mark.parametrize("r", FRAMES)
@pytest.mark.parametrize("u", [np.array([0.3, 0.2]), np.array([-1.0, 4.0]), np.array([0.3, -0.5, 3.0]), np.zeros(2)])
def test_move(r, u):
    after, R_r, R_n = move(r, u)
    step = u if len(u) == 3 else [u[0], 0, u[1]]
    T = se2(r) @ se2(step)
    np.testing.assert_allclose(se2(after), T, atol=1e-12)
    assert -np.pi <= after[2] <= np.pi
    np.testing.assert_allclose(R_r, difference(lambda v: move(v, u)[0], r, [2]), **TOLERANCE)
    np.testing.assert_allclose(R_n, difference(lambda n: move(r, u, n)[0], np.zeros(len(u)), [2]), **TOLERANCE)
    np.testing.assert_array_equal(move(r, u, np.ones(len(u)))[0], move(r, u + 1)[0])


def test_a_control_of_four_components_is_refused():
    with pytest.raises(InputError, match="2 components"):
        move(np.zeros(3), np.zeros(4))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mount", [(0, 0, 0), MOUNT])
@pytest.mark.parametrize("r", FRAMES)
def test_observe(kind, mount, r):
    sensor = Sensor(kind, KINDS[kind], mount)
    W = np.array(POINTS) + np.array([0.01, 0.02])
    y, Y_r, Y_l = observe(r, W, sensor)
    for i, point in enumerate(W):
        z = y[i] - measured(r, point, kind, mount)
        z[angles_of(kind)] = wrapped(z[angles_of(kind)])
        np.testing.assert_allclose(z, 0, atol=1e-10)
        angles = angles_of(kind)
        numeric = difference(lambda v, p=point: observe(v, p, sensor)[0], r, angles)
        np.testing.assert_allclose(Y_r[i], numeric, rtol=1e-5, atol=1e-6)
        numeric = difference(lambda v: observe(r, v, sensor)[0], point, angles)
        np.testing.assert_allclose(Y_l[i], numeric, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("mount", [(0, 0, 0), MOUNT])
@pytest.mark.parametrize("r", FRAMES)
def test_inv_observe(mount, r):
    sensor = Sensor(mount=mount)
    ys = np.array([(2.0, 0.3), (0.5, np.pi), (3.0, -np.pi), (1.0, np.pi / 2)])
    l, L_r, L_y = inv_observe(r, ys, sensor)  # noqa: E741
    back, _, _ = observe(r, l, sensor)
    np.testing.assert_allclose(wrapped(back - ys)[:, 1], 0, atol=1e-12)
    np.testing.assert_allclose(back[:, 0], ys[:, 0])
    for i, y in enumerate(ys):
        np.testing.assert_allclose(L_r[i], difference(lambda v, y=y: inv_observe(v, y, sensor)[0], r), **TOLERANCE)
        np.testing.assert_allclose(L_y[i], difference(lambda v: inv_observe(r, v, sensor)[0], y), **TOLERANCE)


def test_inv_scan_inverts_scan():
    y = np.array([1.5, -2.0])
    np.testing.assert_allclose(scan(inv_scan(y)[0])[0], y)


def test_rotations_of_many_angles():
    a = np.array([[0.1, 2.0, -4.0]])
    assert rotation(a).shape == (1, 3, 2, 2)
    np.testing.assert_allclose(rotation(a)[0, 2], se2([0, 0, -4.0])[:2, :2])


@pytest.mark.parametrize("rho", [0.5, 0.02, 1e-3, 1e-9, 0.0])
@pytest.mark.parametrize("alpha", [0.3, np.pi, -np.pi, np.pi / 2])
@pytest.mark.parametrize("F", FRAMES)
def test_bearing_of_inverse_depth(F, alpha, rho):
    L = np.array([0.7, -0.4, alpha, rho])
    y, Y_F, Y_L = inverse_depth.bearing(F, L)
    if rho > 0:
        p, _ = inverse_depth.point(L)
        assert wrapped(y[0] - measured(F, p, "bearing")[0]) == pytest.approx(0, abs=1e-6)
    else:
        assert wrapped(y[0] - alpha + F[2]) == pytest.approx(0, abs=1e-12)  # at infinity only the direction counts
    np.testing.assert_allclose(Y_F, difference(lambda v: inverse_depth.bearing(v, L)[0], F, [0]), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(Y_L, difference(lambda v: inverse_depth.bearing(F, v)[0], L, [0]), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mount", [(0, 0, 0), MOUNT])
@pytest.mark.parametrize("r", FRAMES)
def test_observe_by_inverse_depth(kind, mount, r):
    sensor = Sensor(kind, KINDS[kind], mount)
    L = np.array([0.7, -0.4, 2.8, 0.3])
    y, Y_r, Y_L = inverse_depth.observe(r, L, sensor)
    expected, _, _ = observe(r, inverse_depth.point(L)[0], sensor)
    np.testing.assert_allclose(y, expected, atol=1e-12)
    angles = angles_of(kind)
    np.testing.assert_allclose(
        Y_r, difference(lambda v: inverse_depth.observe(v, L, sensor)[0], r, angles), **TOLERANCE
    )
    np.testing.assert_allclose(
        Y_L, difference(lambda v: inverse_depth.observe(r, v, sensor)[0], L, angles), **TOLERANCE
    )


@pytest.mark.parametrize("r", FRAMES)
def test_inverse_observation_of_a_bearing(r):
    camera = Sensor("bearing", (0.02,), MOUNT)
    y = np.array([2.9])
    L, L_r, L_y, L_s = inverse_depth.inv_observe(r, y, 0.4, camera)
    np.testing.assert_allclose(inverse_depth.observe(r, L, camera)[0], y, atol=1e-12)
    invert = inverse_depth.inv_observe
    np.testing.assert_allclose(L_r, difference(lambda v: invert(v, y, 0.4, camera)[0], r, [2]), **TOLERANCE)
    np.testing.assert_allclose(L_y, difference(lambda v: invert(r, v, 0.4, camera)[0], y, [2]), **TOLERANCE)
    np.testing.assert_allclose(L_s, difference(lambda s: invert(r, y, s[0], camera)[0], [0.4], [2]), **TOLERANCE)


def test_point_of_inverse_depth():
    L = np.array([1.0, 2.0, -2.0, 0.25])
    p, P_L = inverse_depth.point(L)
    np.testing.assert_allclose(p, [1 + 4 * np.cos(-2), 2 + 4 * np.sin(-2)])
    np.testing.assert_allclose(P_L, difference(lambda v: inverse_depth.point(v)[0], L), **TOLERANCE)
    with pytest.raises(InputError, match="infinity"):
        inverse_depth.point(np.array([0, 0, 0, 0.0]))


def test_the_prior_on_rho_reaches_from_dmin_to_infinity():
    mean, std = inverse_depth.rho_prior(2.0)
    assert mean - 2 * std == 0
    assert mean + 2 * std == 1 / 2.0
    with pytest.raises(InputError, match="dmin"):
        inverse_depth.rho_prior(0)


def test_linearity_index_by_hand():
    """From abeam the cosine is 0; from the anchor it is 1 and d = 1 / rho: 4 sigma_rho / rho."""
    L = np.array([0.0, 0.0, 0.0, 0.5])
    assert inverse_depth.linearity_index(np.array([2.0, 3.0]), L, 0.01) == pytest.approx(0)
    assert inverse_depth.linearity_index(np.zeros(2), L, 0.01) == pytest.approx(4 * 0.1 / 0.5)
    assert inverse_depth.linearity_index(np.array([2.0, 0.0]), L, 0.01) == np.inf


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "radar"}, "one of range-bearing, range, bearing"),
        ({"noise": (0.1,)}, r"noise must have shape \(2,\)"),
        ({"noise": (0.1, 0.0)}, "must be positive"),
        ({"mount": (0, 0)}, "mount must have shape"),
    ],
)
def test_bad_sensors(arguments, message):
    with pytest.raises(InputError, match=message):
        Sensor(**arguments)


def test_partial_measurements_do_not_determine_a_point():
    for kind in ("bearing", "range"):
        with pytest.raises(InputError, match=f"{kind} alone"):
            Sensor(kind, KINDS[kind]).retroject(np.ones(1))


def test_the_guides_sensors():
    assert PRESETS["camera"].kind == "bearing"
    assert PRESETS["sonar"].noise[1] > 5 * PRESETS["laser"].noise[1]
    assert all(len(sensor.R) == sensor.size for sensor in PRESETS.values())
