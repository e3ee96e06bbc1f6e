# ruff: noqa: E741 - the guide's letter for a landmark
"""The checks of notebook 06: the reference against the wing itself, Jacobians against the complex step, and manners."""

import numpy as np
import pytest
from bank import CODES, load

from lab.checks import check, exact, reference
from lab.checks.inputs import cases
from lab.checks.mistakes import mutants
from lab.ekfslam import Map, Sensor
from lab.ekfslam.consistency import nis
from lab.ekfslam.frames import wrap
from lab.validation import InputError

KEYS = [key for key in CODES if CODES[key].notebook.startswith("06")]


def jacobian(f, at):
    """Return the derivative by the complex step."""
    at = np.asarray(at, dtype=float)
    return np.column_stack([np.imag(f(at + 1e-30j * e)) / 1e-30 for e in np.eye(len(at))])


def moved(r, u):
    return np.array([r[0] + u[0] * np.cos(r[2]), r[1] + u[0] * np.sin(r[2]), r[2] + u[1]])


def seen(r, l):
    """Distance and bearing; the imaginary part of arctan2 by its derivative, which numpy does not give."""
    x, y = l[0] - r[0], l[1] - r[1]
    slope = (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / np.real(x * np.conj(x) + y * np.conj(y))
    return np.array([np.sqrt(x * x + y * y), np.arctan2(np.real(y), np.real(x)) + 1j * slope - r[2]])


def found(r, y):
    return np.array([r[0] + y[0] * np.cos(r[2] + y[1]), r[1] + y[0] * np.sin(r[2] + y[1])])


@pytest.mark.parametrize(
    ("key", "model", "angle"), [("q11-move", moved, 2), ("q11-observe", seen, 1), ("q11-invert", found, None)]
)
def test_the_models_against_plain_formulas_and_the_complex_step(key, model, angle):
    for case in cases(key):
        first, second = case.calls[0]
        value, by_first, by_second = getattr(reference, CODES[key].function)(first, second)
        expected = np.real(model(first, second))
        if angle is not None:
            expected[angle] = wrap(expected[angle])
            assert -np.pi <= value[angle] < np.pi
        np.testing.assert_allclose(value, expected, atol=1e-12)
        np.testing.assert_allclose(by_first, jacobian(lambda a: model(a, second), first), atol=1e-12)  # noqa: B023
        np.testing.assert_allclose(by_second, jacobian(lambda a: model(first, a), second), atol=1e-12)  # noqa: B023


def test_the_events_against_the_map_of_the_wing():
    """The map keeps one triangle of P in slots of its own; the answers are whole matrices: no line is shared."""
    rng = np.random.default_rng(3)
    Q, R = np.diag([0.02, 0.03]) ** 2, Sensor("range-bearing", (0.1, 0.05)).R
    m = Map("ekf")
    sensor = Sensor("range-bearing", (0.1, 0.05))
    robot = m.add_robot(np.array([0.4, -0.3, 2.9]), np.diag([0.02, 0.01, 0.03]), sensors=[sensor], Q=Q)
    x, P = np.array([0.4, -0.3, 2.9]), np.diag([0.02, 0.01, 0.03])
    landmarks = []
    for name in range(4):
        u = np.array([0.3, 0.4])
        m.move(robot, u)
        x, P = reference.ekf_predict(x, P, u, Q)
        for i, landmark in enumerate(landmarks):
            e, _, _ = reference.ekf_observe(x[:3], x[3 + 2 * i : 5 + 2 * i])
            y = e + [0.1, 0.06] * rng.standard_normal(2)
            m.correct(m.observe(robot, sensor, landmark, y))
            x, P = reference.ekf_correct(x, P, y, i, R)
        y = np.array([2 + rng.random(), rng.uniform(-3, 3)])
        landmarks.append(m.initialise(robot, sensor, y, name))
        x, P = reference.ekf_initialise(x, P, y, R)
    rows = np.concatenate([robot.rows, *(landmark.rows for landmark in landmarks)])
    np.testing.assert_allclose(x, m.x[rows], atol=1e-10)
    np.testing.assert_allclose(P, m.joint.block(rows), atol=1e-12)


def test_the_nis_of_a_plain_mean_and_covariance_is_that_of_the_map():
    m, sensor = Map("ekf"), Sensor("range-bearing", (0.1, 0.05))
    robot = m.add_robot(np.array([0.4, -0.3, 3.1]), np.diag([0.02, 0.01, 0.03]), sensors=[sensor])
    landmarks = [m.initialise(robot, sensor, np.array([2.0, b]), b) for b in (0.5, 3.0)]
    rows = np.concatenate([robot.rows, *(landmark.rows for landmark in landmarks)])
    y = np.array([2.1, -3.1])
    expected = m.observe(robot, sensor, landmarks[1], y).nis
    assert nis(m.x[rows], m.joint.block(rows), y, 1, sensor) == pytest.approx(expected, rel=1e-10)


def test_the_directions_are_those_of_a_rigid_motion():
    for case in cases("q14-directions"):
        (x,) = case.calls[0]
        points = np.vstack([x[:2], x[3:].reshape(-1, 2)])

        def rigid(t, x=x, points=points):
            turned = points @ np.array([[np.cos(t[2]), np.sin(t[2])], [-np.sin(t[2]), np.cos(t[2])]]) + t[:2]
            return np.concatenate([turned[0], [x[2] + t[2]], turned[1:].ravel()])

        expected = jacobian(rigid, np.zeros(3))
        N = reference.frame_directions(x)
        np.testing.assert_allclose(N @ np.linalg.lstsq(N, expected)[0], expected, atol=1e-12)


def test_the_point_of_a_ray_against_the_complex_step():
    for case in cases("q16-ray"):
        L, P = case.calls[0]
        p, cov = reference.ray_to_point(L, P)
        slope = jacobian(lambda L: L[:2] + np.array([np.cos(L[2]), np.sin(L[2])]) / L[3], L)
        np.testing.assert_allclose(p, L[:2] + np.array([np.cos(L[2]), np.sin(L[2])]) / L[3])
        np.testing.assert_allclose(cov, slope @ P @ slope.T, atol=1e-12)


def test_the_traps_are_set():
    """What the mistakes need to show: both sides of pi, p_x = 0, headings beyond pi, full covariances."""
    turns, abeam, sizes = [], 0, set()
    for case in cases("q12-update"):
        x, P, y, i, R = case.calls[0]
        l = x[3 + 2 * i : 5 + 2 * i]
        e, _, _ = reference.ekf_observe(x[:3], l)
        turns.append(abs(y[1] - e[1]) > np.pi)
        abeam += x[2] == 0 and l[0] == x[0]
        sizes.add(len(x))
        assert np.abs(P).min() > 1e-4
        assert abs(R[0, 1]) > 0.01
        assert np.linalg.eigvalsh(P).min() > 0
    assert sum(turns) >= 2
    assert abeam == 1
    assert len(sizes) >= 4
    assert any(abs(case.calls[0][0][2]) > np.pi for case in cases("q12-update"))
    assert any(len(case.calls[0][0]) == 3 and not case.calls[0][1].any() for case in cases("q12-initialise"))


def test_the_notebook_has_mistakes_enough_of_its_own():
    names = {mistake for key in KEYS for mistake, _ in mutants(key)}
    assert len(names) >= 50
    assert {
        *("innovation-not-wrapped", "heading-not-wrapped", "scan-jacobian-px", "rotation-sign", "noise-unmapped"),
        *("cross-left-out", "cross-wrong-jacobian", "landmark-without-robot", "deviation-as-variance"),
        *("turn-before-step", "jacobians-late", "degrees", "covariance-order", "landmark-only"),
    } <= names


def test_an_answer_that_calls_the_wing_is_recognised():
    scope = load(
        """
from lab.ekfslam import Map, Sensor
from lab.ekfslam.motion import move
import numpy as np

def ekf_move(r, u):
    return move(r, u)

def ekf_predict(x, P, u, Q):
    m = Map()
    robot = m.add_robot(x[:3], P[:3, :3], Q=Q)
    m.move(robot, u)
    return np.append(m.x[robot.rows], x[3:]), P
"""
    )
    for key in ("q11-move", "q12-predict"):
        verdict = check(key, scope[CODES[key].function])
        assert verdict.mistake == "calls-the-lab"
        assert "lab.ekfslam" in verdict.reason


def plain(key, source):
    return check(key, load("import numpy as np\n" + source)[CODES[key].function])


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("def frame_directions(x):\n    return np.zeros((len(x), 3))", "he three columns of N are not independent"),
        ("def frame_directions(x):\n    return np.eye(len(x))[:, :2]", "N has shape (5, 2) where (n, 3) = (5, 3)"),
        ("def frame_directions(x):\n    return np.full((len(x), 3), np.nan)", "holds NaN"),
        ("def frame_directions(x):\n    return np.eye(len(x))[:, :3]", "he space of the three columns is off"),
    ],
)
def test_directions_are_read_with_care(source, words):
    verdict = plain("q14-directions", source)
    assert not verdict.passed
    assert words in verdict.reason


def test_a_map_that_is_edited_in_place_is_named():
    def ekf_predict(x, P, u, Q):
        new, later = reference.ekf_predict(x, P, u, Q)
        x[:3] = new[:3]
        return new, later

    verdict = exact.examine(CODES["q12-predict"], ekf_predict, lambda module, name: False)
    assert "edits its argument x in place" in verdict.reason


def test_the_texts_have_no_check():
    for key in ("q12-text", "q13-text", "q14-text", "q15-text", "q16-text"):
        with pytest.raises(InputError, match="asks for a text"):
            check(key, "because")
