"""The inputs on which the answers of notebook 06 are tried, question by question.

Question answered: on which maps and measurements does a mistake in EKF-SLAM show?  Bearings and headings on both sides
of pi, landmarks abeam (where a division by p_x fails) and behind, headings that nobody has wrapped, maps of none to
four landmarks whose covariance is full, noise that is correlated.  `lab.checks.inputs` makes its cases of the pairs of
a label and calls; all scales are of order one, so that no entry hides behind a larger one.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.checks.ekf_recipes import ekf_observe, wrapped_heading
from lab.checks.worlds import covariance
from lab.validation import Array

ABEAM = np.pi / 2  # from a heading of 0: p_x is 0 to the digit
Made = tuple[str, tuple[tuple[Any, ...], ...]]
POSES = {  # what is special about them
    "a plain pose": (1.2, -0.7, 0.6),
    "a heading close to pi": (-2.1, 1.4, 3.05),
    "a heading close to -pi": (0.4, 2.3, -3.0),
    "a heading that nobody has wrapped": (-1.6, -0.9, 10.2),
}


def _moves() -> list[Made]:
    controls = {"a plain pose": (0.8, 0.3), "a heading close to pi": (0.5, 0.4), "a heading close to -pi": (1.1, -0.9)}
    found: list[Made] = [
        (label, ((np.array(pose), np.array(controls.get(label, (0.7, 0.2)))),)) for label, pose in POSES.items()
    ]
    found.append(("a step back and a long turn", ((np.array([0.3, 0.8, -1.1]), np.array([-0.6, 2.4])),)))
    return found


def _at(pose: Sequence[float], distance: float, bearing: float) -> Array:
    """Return the point at this distance and bearing from a pose."""
    angle = pose[2] + bearing
    return np.array(pose[:2]) + distance * np.array([np.cos(angle), np.sin(angle)])


def _sightings() -> list[Made]:
    found: list[Made] = [
        (f"{label}, a landmark ahead to the left", ((np.array(pose), _at(pose, 2.6, 0.8)),))
        for label, pose in POSES.items()
    ]
    plain = POSES["a plain pose"]
    for label, pose, bearing in (
        ("a landmark ahead to the right", plain, -0.5),
        ("a landmark behind to the left", plain, 2.2),
        ("a landmark behind, bearing close to pi", plain, 3.1),
        ("a landmark behind, bearing close to -pi", POSES["a heading close to pi"], -3.1),
    ):
        found.append((label, ((np.array(pose), _at(pose, 1.7, bearing)),)))
    found.append(("a landmark abeam, p_x = 0", ((np.array([1.0, 2.0, 0.0]), np.array([1.0, 3.5])),)))
    return found


def _inversions() -> list[Made]:
    measured = ((2.6, 0.8), (1.4, 2.9), (0.7, -1.9), (3.1, -0.4))
    return [
        (label, ((np.array(pose), np.array(y)),))
        for (label, pose), y in zip(POSES.items(), measured, strict=True)
    ]  # fmt: skip


def _map(pose: Sequence[float], n_landmarks: int, seed: int) -> tuple[Array, Array]:
    """Return a mean and a full covariance, as a filter might have them."""
    rng = np.random.default_rng(seed)
    bearings = rng.uniform(-2.5, 2.5, n_landmarks)
    distances = rng.uniform(1, 4, n_landmarks)
    points = [_at(pose, distance, bearing) for distance, bearing in zip(distances, bearings, strict=True)]
    n = 3 + 2 * n_landmarks
    return np.concatenate([pose, *points]), covariance(rng, n, 0.3)


def _noise(seed: int) -> Array:
    """Return a covariance (2, 2) that couples its components."""
    return covariance(np.random.default_rng(seed), 2, 0.35)


def _predictions() -> list[Made]:
    found: list[Made] = []
    controls = ((0.8, 0.3), (0.5, 0.4), (1.1, -0.9), (0.7, 0.2))
    for i, (label, pose) in enumerate(POSES.items()):
        n_landmarks = (2, 1, 3, 2)[i]
        x, P = _map(pose, n_landmarks, 100 + i)
        what = "1 landmark" if n_landmarks == 1 else f"{n_landmarks} landmarks"
        found.append((f"{label}, {what}", ((x, P, np.array(controls[i]), _noise(110 + i)),)))
    x, P = _map((0.3, 0.8, -1.1), 0, 120)
    found.append(("an empty map", ((x, P, np.array([0.4, 0.6]), _noise(121)),)))
    return found


def _correction(
    label: str,
    pose: Sequence[float],
    seed: int,
    size: int,
    i: int,
    shift: tuple[float, float],
    bearing: float | None = None,
) -> Made:
    """Return a case in which landmark i of a map is measured with this innovation."""
    x, P = _map(pose, size, seed)
    if bearing is not None:
        x[3 + 2 * i : 5 + 2 * i] = _at(pose, 2.1, bearing) if bearing != ABEAM else (pose[0], pose[1] + 2.1)
    e, _, _ = ekf_observe(x[:3], x[3 + 2 * i : 5 + 2 * i])
    y = wrapped_heading(np.array([0, 0, (e + shift)[1]]))[2]
    return label, ((x, P, np.array([e[0] + shift[0], y]), i, _noise(seed + 50)),)


def _corrections() -> list[Made]:
    plain, near = POSES["a plain pose"], POSES["a heading close to pi"]
    return [
        _correction("a plain pose, the only landmark", plain, 200, 1, 0, (0.3, 0.2)),
        _correction("a plain pose, the second of 3 landmarks", plain, 201, 3, 1, (-0.4, 0.25)),
        _correction("the last of 4 landmarks", (0.3, 0.8, -1.1), 202, 4, 3, (0.25, -0.3)),
        _correction("bearings on the two sides of pi, 2 landmarks", plain, 203, 2, 0, (0.2, 0.3), 3.0),
        _correction("bearings on the two sides of -pi, 3 landmarks", plain, 204, 3, 2, (-0.2, -0.35), -2.95),
        _correction("a heading that the correction takes beyond pi", near, 205, 2, 1, (0.2, -0.9), 0.7),
        _correction("a heading that nobody has wrapped", (-1.6, -0.9, 10.2), 206, 2, 0, (0.3, 0.3), -0.8),
        _correction("a landmark abeam, p_x = 0", (1.0, 2.0, 0.0), 207, 2, 1, (-0.3, 0.2), ABEAM),
    ]


def _initialisations() -> list[Made]:
    found: list[Made] = []
    poses = [*POSES.values()][:3]
    for i, (pose, size, y) in enumerate(zip(poses, (2, 1, 3), ((2.2, 0.7), (1.3, 2.8), (3.0, -1.2)), strict=True)):
        x, P = _map(pose, size, 300 + i)
        label = f"{[*POSES][i]}, {size} landmark{'s' * (size > 1)} so far"
        found.append((label, ((x, P, np.array(y), _noise(310 + i)),)))
    x, P = _map((0.3, 0.8, -1.1), 0, 320)
    found.append(("an empty map", ((x, P, np.array([1.8, -0.6]), _noise(321)),)))
    known = np.array([0.0, -2.0, 0.4])
    args = (known, np.zeros((3, 3)), np.array([2.5, 0.5]), _noise(322))
    found.append(("an empty map, the robot known exactly", (args,)))
    return found


def _errors() -> list[Made]:
    found: list[Made] = []
    for i, (label, truth, error) in enumerate(
        (
            ("a plain pose", (1.2, -0.7, 0.6), (0.2, -0.3, 0.25)),
            ("headings on the two sides of pi", (-2.1, 1.4, -3.1), (-0.25, 0.2, -0.3)),
            ("headings on the two sides of -pi", (0.4, 2.3, 3.12), (0.3, 0.15, 0.2)),
            ("a heading two turns away", (0.5, -0.5, 0.3), (0.2, 0.2, 0.1 + 4 * np.pi)),
        )
    ):
        r = np.add(truth, error)
        given = r if label.endswith("away") else wrapped_heading(r)
        found.append((label, ((given, covariance(np.random.default_rng(400 + i), 3, 0.3), np.array(truth)),)))
    return found


def _frames() -> list[Made]:
    return [
        (f"{size} landmark{'s' * (size != 1)}", ((_map(pose, size, 500 + size)[0],),))
        for size, pose in ((1, (1.2, -0.7, 0.6)), (3, (-2.1, 1.4, 3.05)), (2, (0.4, 2.3, -3.0)))
    ]


def _rays() -> list[Made]:
    rays = {
        "a ray ahead to the left": (0.4, -0.3, 0.7, 0.5),
        "a ray to the left and behind": (-1.1, 0.8, 2.6, 0.8),
        "a ray to the right and behind": (0.6, 1.3, -2.2, 0.4),
    }
    return [
        (label, ((np.array(L), covariance(np.random.default_rng(600 + i), 4, 0.2)),))
        for i, (label, L) in enumerate(rays.items())
    ]


MAKERS: dict[str, Callable[[], Sequence[Made]]] = {
    "q11-move": _moves,
    "q11-observe": _sightings,
    "q11-invert": _inversions,
    "q12-predict": _predictions,
    "q12-update": _corrections,
    "q12-initialise": _initialisations,
    "q13-nees": _errors,
    "q14-directions": _frames,
    "q16-ray": _rays,
}
