"""The random experiment of the lab: a robot turns around a known centre and sees some of M landmarks.

Which data does a student of the lab receive? State x = (r, m_1 .. m_M), robot r and landmarks m_i, in metres:

    x_k = F x_{k-1} + B + w_k,   z_k = H_k x_k + v_k,   w ~ N(0, Qw),   v ~ N(0, Rv),   x_0 ~ N(mX0, PX0)

F turns r by omega dt around the centre CC (B = (I - F)(CC, 0)) and keeps the landmarks; z holds m_i - r of each
landmark in the field of view, H_k the rows of Hfull = [kron(1, -I_2), I_2M] for those; n = 2 + 2M. This is the MATLAB
function dataSimulation of the handout, with its output names and shapes. The file needs numpy, and matplotlib for the
animation only, and runs when copied alone; `python data_simulation.py [FILE.gif] [--seed S]` shows or saves it.
"""

from __future__ import annotations

import dataclasses
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Seed = int | np.random.Generator | None
Rule = Callable[[Array, Array], NDArray[np.bool_]]


def _outward_ahead(z: Array, o: Array) -> NDArray[np.bool_]:
    return np.asarray((z @ o >= 0) & (z @ np.array((-o[1], o[0])) >= 0))


def _north_east(z: Array, o: Array) -> NDArray[np.bool_]:
    return np.asarray((z > 0).all(axis=1))


_NO_WINDOW = "no window can be shown here"
# "exogenous" is the rule of "outward-ahead", applied to another robot than the one that measures.
RULES: dict[str, Rule] = {"outward-ahead": _outward_ahead, "north-east": _north_east, "exogenous": _outward_ahead}


def _check_field_of_view(value: object) -> None:
    if not callable(value) and not (isinstance(value, str) and value in RULES):
        known = ", ".join(f'"{name}"' for name in RULES)
        known += " or a function (z (M, 2), o (2,)) -> bool (M,)"
        raise ValueError(f"field_of_view must be one of {known}, not {value!r}")


def _reals(name: str, value: ArrayLike, what: str) -> Array:
    """Copy `value` into a float array, refusing text, booleans, complex numbers and what is not finite."""
    try:
        given = np.asarray(value)
        # In a list numpy turns True into 1.0 silently.
        flags = not isinstance(value, np.ndarray) and bool in map(type, np.asarray(value, dtype=object).flat)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{name} must be {what}, not nested lists of unequal lengths") from None
    if given.dtype.kind not in "iuf" or flags or np.ma.isMaskedArray(value):
        raise ValueError(f"{name} must be {what} of real numbers, not {type(value).__name__} (dtype {given.dtype})")
    if not np.isfinite(given).all():
        raise ValueError(f"{name} must be finite, but holds NaN or infinity")
    return np.array(given, dtype=np.float64)


def _scalar(name: str, value: ArrayLike) -> float:
    number = _reals(name, value, "a scalar")
    if number.ndim:
        raise ValueError(f"{name} must be a scalar; its shape is {number.shape}")
    return float(number)


def _covariance(name: str, value: ArrayLike, side: int) -> Array:
    """Check a covariance given as a scalar, a vector (side,) or a matrix (side, side), and return it in that form."""
    what = f"a scalar, a vector ({side},) or a matrix ({side}, {side})"
    cov = _reals(name, value, what)
    if cov.shape not in ((), (side,), (side, side)):
        raise ValueError(f"{name} must be {what}; its shape is {cov.shape}")
    # Both tests are relative to the deviations, so that they mean the same for 0.04 and for 1e-20.
    eigenvalues: NDArray[np.floating[Any]] = cov
    relative = eigenvalues
    if cov.ndim == 2:
        deviation = np.sqrt(np.maximum(np.diag(cov), 0))
        deviation[deviation == 0] = deviation.max() or 1
        scale = np.outer(deviation, deviation)
        i, j = np.unravel_index(np.argmax(abs(cov - cov.T) / scale), cov.shape)
        if abs(cov[i, j] - cov[j, i]) > 1e-9 * scale[i, j]:
            entries = f"entries ({i}, {j}) and ({j}, {i}) are {cov[i, j]} and {cov[j, i]}"
            raise ValueError(f"{name} must be symmetric: its {entries}")
        cov = cov / 2 + cov.T / 2  # the sum of the largest numbers would overflow
        eigenvalues, relative = np.linalg.eigvalsh(cov), np.linalg.eigvalsh(cov / scale)
    if relative.min() < (-1e-12 if cov.ndim == 2 else 0):
        smallest = f"its smallest eigenvalue is {eigenvalues.min():.3g}"
        raise ValueError(f"{name} must be positive semidefinite ({side}, {side}): {smallest}")
    return cov


def _full(cov: ArrayLike, side: int) -> Array:
    value = np.asarray(cov, dtype=np.float64)
    return value.copy() if value.ndim == 2 else value * np.eye(side)


def _join(first: Array, second: Array) -> Array:
    """Return the block-diagonal matrix of two square matrices."""
    corner = np.zeros((len(first), len(second)))
    return np.block([[first, corner], [corner.T, second]])


def _cholesky(cov: Array) -> Array:
    """Return the lower L with L L' = cov, zero columns where a semidefinite cov has no more to give."""
    factor = np.zeros_like(cov)
    for j in range(len(cov)):
        column = cov[j:, j] - factor[j:, :j] @ factor[j, :j]
        # A pivot is nought beside its OWN entry only: in Qw 1e-20 stands next to 0.04 and is not nought.
        if column[0] > 4 * len(cov) * np.finfo(np.float64).eps * cov[j, j]:
            factor[j:, j] = column / math.sqrt(column[0])
    return factor


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """What is fixed in the experiment before any draw; the defaults are those of the handout.

    A covariance is a scalar (times the identity), a vector (the diagonal) or a full matrix. A scalar stays one, so
    `dataclasses.replace(HANDOUT, landmark_means=others)` works for another M. Arrays are copied and read-only.

    Parameters
    ----------
    n_steps : int
        Number N of instants k = 0 .. N-1.
    dt, omega : float
        Time step [s], positive, and angular speed [rad/s], anticlockwise.
    centre, robot_mean : (2,)
        Centre of the circle and prior mean of the robot [m].
    landmark_means : (M, 2)
        Prior means of the landmarks [m].
    robot_cov, landmark_cov : scalar, (d,) or (d, d), d = 2 and 2M
        Prior covariances of the robot and of the landmarks [m^2].
    robot_noise_cov : scalar, (2,) or (2, 2)
        Covariance of the slippage of one step [m^2].
    landmark_noise_std : float
        Standard deviation of the motion of each landmark coordinate in one step [m].
    measurement_cov : scalar, (2M,) or (2M, 2M)
        Covariance Rv of the measurement noise [m^2].
    field_of_view : str or function
        "outward-ahead": landmark m is seen when z . o >= 0 and z . o' >= 0, with z = m - r, o = r - centre and
        o' = (-o_y, o_x). "north-east": when both components of z are > 0. "exogenous": what another robot, drawn
        independently from the same model, would see "outward-ahead" on the map of the prior means: being seen tells
        nothing about the state. A function (z (M, 2) [m], o (2,) [m]) -> bool (M,) gets the noise-free z.

    Raises
    ------
    ValueError
        When a field has the wrong type, shape or sign, is not finite, not symmetric or not positive semidefinite.

    Source: handout, section 1 and figure 2 (`dataSimulation`).
    """

    n_steps: int = 50
    dt: float = 1.0
    omega: float = math.pi / 4
    centre: ArrayLike = (-1.5, 0.0)
    robot_mean: ArrayLike = (0.0, 0.0)
    robot_cov: ArrayLike = 0.0
    landmark_means: ArrayLike = ((-2.0, 4.0), (-4.0, 2.0), (-4.0, -2.0), (-2.0, -4.0), (4.0, -2.0))
    landmark_cov: ArrayLike = 0.2
    robot_noise_cov: ArrayLike = 0.2**2
    landmark_noise_std: float = 1e-10
    measurement_cov: ArrayLike = 0.15**2
    field_of_view: str | Rule = "outward-ahead"

    def __post_init__(self) -> None:
        """Check every field and freeze the arrays."""
        if isinstance(self.n_steps, bool) or not isinstance(self.n_steps, (int, np.integer)) or self.n_steps < 1:
            raise ValueError(f"n_steps must be an integer >= 1, not {self.n_steps!r}")
        checked: dict[str, Any] = {"n_steps": int(self.n_steps)}
        for name in ("dt", "omega", "landmark_noise_std"):
            checked[name] = _scalar(name, getattr(self, name))
        if checked["dt"] <= 0:
            raise ValueError(f"dt must be positive, not {checked['dt']}")
        if checked["landmark_noise_std"] < 0:
            raise ValueError(f"landmark_noise_std must be >= 0, not {checked['landmark_noise_std']}")
        for name in ("centre", "robot_mean"):
            checked[name] = _reals(name, getattr(self, name), "a vector (2,)")
            if checked[name].shape != (2,):
                raise ValueError(f"{name} must be a vector (2,); its shape is {checked[name].shape}")
        means = checked["landmark_means"] = _reals("landmark_means", self.landmark_means, "an array (M, 2)")
        if means.ndim != 2 or means.shape[1] != 2 or len(means) < 1:
            raise ValueError(f"landmark_means must be an array (M, 2) with M >= 1; its shape is {means.shape}")
        sides = {"robot_cov": 2, "landmark_cov": means.size, "robot_noise_cov": 2, "measurement_cov": means.size}
        for name, side in sides.items():
            checked[name] = _covariance(name, getattr(self, name), side)
        _check_field_of_view(self.field_of_view)
        for name, value in checked.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value if np.ndim(value) or name == "n_steps" else float(value))

    @property
    def n_landmarks(self) -> int:
        """Number M of landmarks."""
        return len(np.asarray(self.landmark_means))

    @property
    def P0(self) -> Array:
        """Prior covariance of the state, (n, n) [m^2]."""
        return _join(_full(self.robot_cov, 2), _full(self.landmark_cov, 2 * self.n_landmarks))

    @property
    def Qw(self) -> Array:
        """Covariance of the dynamics noise, (n, n) [m^2]."""
        return _join(_full(self.robot_noise_cov, 2), self.landmark_noise_std**2 * np.eye(2 * self.n_landmarks))

    @property
    def Rv(self) -> Array:
        """Covariance of the measurement noise, all landmarks seen, (2M, 2M) [m^2]."""
        return _full(self.measurement_cov, 2 * self.n_landmarks)


HANDOUT = Scenario()
TWO_LANDMARKS = dataclasses.replace(  # the older edition of the handout
    HANDOUT,
    centre=(0.0, 0.0),
    robot_mean=(2.0, 0.0),
    robot_cov=(0.1, 0.2),
    landmark_means=((-1.0, 4.0), (4.0, -1.0)),
    robot_noise_cov=0.05**2,
    measurement_cov=0.1**2,
    field_of_view="north-east",
)


class Draws(NamedTuple):
    """Standard normal numbers to use instead of new ones: w (n, N), v (2M, N), x0 (n,)."""

    w: Array
    v: Array
    x0: Array


class Simulation(NamedTuple):
    """The 16 outputs, in the handout's order (figure 2); NaN marks what is not seen, and everything at k = 0.

    N instants at times T (N,) [s], M landmarks; measurements Z (2M, N) [m], their matrices arrayH (2M, n, N) (whole
    rows NaN) and noise covariances arrayR (2M, 2M, N) [m^2] (rows and columns NaN), in_fov (2M, N) 1 or NaN; dynamics
    F (n, n), B (n,) [m] around the centre CC (2,) [m]; Hfull (2M, n), the matrix when all is seen; prior mX0 (n,) [m],
    PX0 (n, n) [m^2]; noise covariances Qw (n, n), Rv (2M, 2M) [m^2]; hidden states X (n, N) [m].
    """

    N: int
    T: Array
    M: int
    Z: Array
    arrayH: Array
    arrayR: Array
    in_fov: Array
    F: Array
    B: Array
    CC: Array
    Hfull: Array
    mX0: Array
    PX0: Array
    Qw: Array
    Rv: Array
    X: Array


def _generator(rng: Seed) -> np.random.Generator:
    if isinstance(rng, np.random.Generator):
        return rng
    if rng is not None and (isinstance(rng, bool) or not isinstance(rng, (int, np.integer))):
        raise TypeError(f"rng must be None, an integer seed or a numpy.random.Generator, not {rng!r}")
    if rng is not None and rng < 0:
        raise ValueError(f"rng must be a seed >= 0, not {rng}")
    return np.random.default_rng(rng)


def _given(draws: Draws, model: Draws) -> Draws:
    """Check the draws of the caller against those that they replace."""
    if not isinstance(draws, tuple) or len(draws) != 3:
        raise TypeError(f"draws must be Draws(w, v, x0), not {type(draws).__name__}")
    checked = []
    for name, value, expected in zip(Draws._fields, draws, model, strict=True):
        array = _reals(f"draws.{name}", value, f"an array {expected.shape}")
        array = array.ravel() if name == "x0" and array.shape == (*expected.shape, 1) else array  # MATLAB's column
        if array.shape != expected.shape:
            raise ValueError(f"draws.{name} must have shape {expected.shape}; its shape is {array.shape}")
        checked.append(array)
    return Draws(*checked)


def _walk(F: Array, B: Array, start: Array, noise: Array) -> Array:
    """Return the states (d, N) from `start` (d,); the last column of `noise` (d, N) has no step left to disturb."""
    path = np.empty_like(noise)
    path[:, 0] = start
    for k in range(1, noise.shape[1]):
        path[:, k] = F @ path[:, k - 1] + B + noise[:, k - 1]
    return path


def _visibility(field_of_view: str | Rule, z: Array, o: Array) -> NDArray[np.bool_]:
    """Return which landmarks are seen, (M, N), from noise-free z (M, 2, N) and o (2, N); none is at k = 0."""
    rule = RULES[field_of_view] if isinstance(field_of_view, str) else field_of_view
    seen = np.zeros(z.shape[::2], dtype=bool)
    for k in range(1, z.shape[2]):
        answer = np.asarray(rule(z[..., k].copy(), o[:, k].copy()))
        if answer.shape != (len(z),) or answer.dtype != bool:
            problem = f"returned {answer.dtype} {answer.shape} at k = {k}"
            raise ValueError(f"the field_of_view function must return bool ({len(z)},), but {problem}")
        seen[:, k] = answer
    return seen


def data_simulation(
    plot: bool = False, scenario: Scenario = HANDOUT, *, rng: Seed = None, draws: Draws | None = None
) -> Simulation:
    """Draw one experiment.

    Parameters
    ----------
    plot : bool
        Also show the animation: in the cell of a notebook, otherwise in a window.
    scenario : Scenario
        What is fixed: HANDOUT, TWO_LANDMARKS or your own.
    rng : None, int or numpy.random.Generator
        Seed or generator. In the order of drawing: w (n, N), v (2M, N), x0 (n,), then what "exogenous" needs: one seed
        gives one truth whatever the field of view.
    draws : Draws, optional
        Standard normals to use for w, v and x0; `rng` then serves the exogenous trajectory only.

    Returns
    -------
    Simulation
        The 16 outputs, shapes and units there.

    Raises
    ------
    TypeError, ValueError
        When an argument has the wrong type, shape or value, or a field-of-view function does not return bool (M,).

    Source: handout, question 1b and figure 2.
    """
    if not isinstance(plot, (bool, np.bool_)) and not (isinstance(plot, int) and plot in (0, 1)):
        raise TypeError(f"plot must be True or False, not {type(plot).__name__} (the scenario comes second)")
    if not isinstance(scenario, Scenario):
        raise TypeError(f"scenario must be a Scenario, not {type(scenario).__name__}")
    N, M, n = scenario.n_steps, scenario.n_landmarks, 2 + 2 * scenario.n_landmarks
    turn = scenario.omega * scenario.dt
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    F, CC = _join(rotation, np.eye(2 * M)), np.array(scenario.centre)
    B = np.concatenate([(np.eye(2) - rotation) @ CC, np.zeros(2 * M)])
    Hfull = np.hstack([np.kron(np.ones((M, 1)), -np.eye(2)), np.eye(2 * M)])
    means = np.asarray(scenario.landmark_means)
    mX0, PX0, Qw, Rv = np.append(scenario.robot_mean, means), scenario.P0, scenario.Qw, scenario.Rv

    generator = _generator(rng)
    # Drawn even when `draws` replaces them: the exogenous numbers of a seed stay the same and are never those of w.
    shapes = ((n, N), (2 * M, N), (n,))
    normals = Draws(*(generator.standard_normal(shape) for shape in shapes))
    if draws is not None:
        normals = _given(draws, normals)
    root_Q, root_P0 = _cholesky(Qw), _cholesky(PX0)
    X = _walk(F, B, mX0 + root_P0 @ normals.x0, root_Q @ normals.w)
    z = Hfull @ X

    robot, offsets = X[:2], z.reshape(M, 2, N)
    if scenario.field_of_view == "exogenous":
        noise, first = generator.standard_normal((2, N)), generator.standard_normal(2)
        robot = _walk(rotation, B[:2], mX0[:2] + root_P0[:2, :2] @ first, root_Q[:2, :2] @ noise)
        offsets = means[:, :, None] - robot
    unseen = ~np.repeat(_visibility(scenario.field_of_view, offsets, robot - CC[:, None]), 2, axis=0)

    T, in_fov = scenario.dt * np.arange(N, dtype=np.float64), np.where(unseen, np.nan, 1.0)
    Z = np.where(unseen, np.nan, z + _cholesky(Rv) @ normals.v)
    arrayH = np.where(unseen[:, None], np.nan, Hfull[:, :, None])
    arrayR = np.where(unseen[:, None] | unseen, np.nan, Rv[:, :, None])
    simulation = Simulation(N, T, M, Z, arrayH, arrayR, in_fov, F, B, CC, Hfull, mX0, PX0, Qw, Rv, X)
    if plot and not _show(simulation, scenario.field_of_view):
        warnings.warn(f"{_NO_WINDOW}: save the animation with animate(simulation, 'FILE.gif')", stacklevel=2)
    return simulation


def _wedge_angles(field_of_view: str | Rule, o: Array) -> tuple[float, float] | None:
    """Return where the field of view begins and ends, anticlockwise [degrees], or None where it is no wedge."""
    if field_of_view == "north-east":
        return 0.0, 90.0
    if field_of_view != "outward-ahead":
        return None
    start = math.degrees(math.atan2(o[1], o[0]))
    return (start, start + 90.0) if o.any() else (0.0, 360.0)  # at the centre itself everything is seen


def _place(spots: list[tuple[float, float]], half: tuple[float, float], boxes: list[tuple[float, ...]]) -> Any:
    """Return the first of the `spots` where a label, half (width, height), meets fewest `boxes`, and add it to them."""

    def clashes(spot: tuple[float, float]) -> int:
        return sum(abs(spot[0] - x) < half[0] + dx and abs(spot[1] - y) < half[1] + dy for x, y, dx, dy in boxes)

    best = min(spots, key=clashes)
    boxes += 4 * [(*best, *half)]  # another label there would be worse than a line through this one
    return best


def _stage(sim: Simulation, field_of_view: str | Rule) -> tuple[Figure, Callable[[int], list[Artist]]]:
    """Build the figure with its artists; return it and the function that moves them to instant k."""
    from matplotlib import patheffects
    from matplotlib import pyplot as plt
    from matplotlib.patches import Wedge

    robot, landmarks = sim.X[:2], sim.X[2:].reshape(sim.M, 2, sim.N)
    seen = sim.in_fov[::2] == 1
    measured = robot + sim.Z.reshape(sim.M, 2, sim.N)
    drawn = np.vstack([robot.T, sim.CC, *landmarks.swapaxes(1, 2), *measured.swapaxes(1, 2)])
    low, high = np.nanmin(drawn, axis=0), np.nanmax(drawn, axis=0)
    reach = 0.6 * max(*(high - low), 1.0)
    fig, ax = plt.subplots(figsize=(7, 8.4), layout="constrained")
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.set(xlim=np.array([-reach, reach]) + (low + high)[0] / 2, ylim=np.array([-reach, reach]) + (low + high)[1] / 2)

    wedge = Wedge((0, 0), 4 * reach, 0, 90, color="tab:olive", alpha=0.2, lw=0, label="field of view")
    if _wedge_angles(field_of_view, robot[:, 0]):
        ax.add_patch(wedge)
    ax.plot(*sim.CC, "k+", ms=11, mew=2, label="centre")
    (legs,) = ax.plot([], [], ".-", color="tab:blue", lw=1.2, ms=5, label="measured $(l_m, m_m)$ of landmark $m$")
    (trail,) = ax.plot([], [], ".-", color="0.45", lw=1, ms=4, label="its last 15 steps")
    (green,) = ax.plot([], [], "o", color="darkgreen", ms=14, label="landmark seen")
    (red,) = ax.plot([], [], "s", mec="tab:red", mfc="white", mew=1.5, ms=12, label="landmark not seen")
    (body,) = ax.plot([], [], "D", color="black", ms=8, label="robot")
    halo = [patheffects.withStroke(linewidth=2.5, foreground="white")]
    style: dict[str, Any] = {"ha": "center", "va": "center"}
    numbers = [ax.text(0, 0, f"{m + 1}", size=8, weight="bold", **style) for m in range(sim.M)]
    names = [f"${letter}_{{{m + 1}}}$" for m in range(sim.M) for letter in "lm"]
    labels = [ax.text(0, 0, name, color="tab:blue", size=12, path_effects=halo, **style) for name in names]
    order = [body, trail, legs, green, red, *ax.lines[:1], *ax.patches]
    fig.legend(handles=order, loc="outside lower center", ncols=2, markerscale=0.7, frameon=False)
    ax.set_title("k, t")
    for _ in range(2):  # the title finds its place after the axes found theirs
        fig.draw_without_rendering()
    fig.set_layout_engine("none")  # the frames must not shift against each other
    point = 2 * reach / (ax.get_window_extent().width * 72 / fig.dpi)  # metres per typographic point

    def update(k: int) -> list[Artist]:
        r, (x, y) = robot[:, max(0, k - 15) : k + 1], robot[:, k]
        title = f"k = {k},  t = {sim.T[k]:g} s"
        ax.set_title(title if k else f"{title}:  the prior, nothing is measured")
        body.set_data([x], [y])
        trail.set_data(*r)
        green.set_data(*landmarks[seen[:, k], :, k].T)
        red.set_data(*landmarks[~seen[:, k], :, k].T)
        angles = _wedge_angles(field_of_view, robot[:, k] - sim.CC)
        wedge.set_visible(k > 0 and angles is not None)  # there is no z_0
        if angles:
            wedge.set(center=(x, y), theta1=angles[0], theta2=angles[1])
        ends = measured[:, :, k]
        paths = [[(x, y), (end[0], y), end, (np.nan, np.nan)] for end in ends[seen[:, k]]]
        legs.set_data(*np.reshape(paths, (-1, 2)).T)
        boxes = [(*spot, 8 * point, 8 * point) for spot in (*landmarks[:, :, k], (x, y), sim.CC)]
        for end in ends[seen[:, k]]:
            boxes += [((x + end[0]) / 2, y, abs(end[0] - x) / 2, 0), (end[0], (y + end[1]) / 2, 0, abs(end[1] - y) / 2)]
        half = (point * (7 + 2.5 * len(f"{sim.M}")), 7 * point)
        for m, (end_x, end_y) in enumerate(ends):
            numbers[m].set(position=landmarks[m, :, k], color="white" if seen[m, k] else "tab:red")
            for label in labels[2 * m : 2 * m + 2]:
                label.set_visible(bool(seen[m, k]))
            if seen[m, k]:
                # Beside its own leg, first on the side where the other leg is not; horizontal legs coincide, so
                # l goes where the last shorter one has ended, if there is room.
                parts = (0.5, 0.6, 0.4, 0.7, 0.3, 0.85, 0.15, 1)
                aside = [(side, part) for side in (1, -1, 2.2, -2.2, 3.4, -3.4) for part in parts]
                side_x = math.copysign(1, end_x - x)
                shorter = [e for e in ends[seen[:, k], 0] if 0 < side_x * (e - x) < abs(end_x - x)]
                start = max(shorter, key=lambda e: abs(e - x), default=x)
                below, right = math.copysign(half[1] + 2 * point, y - end_y), side_x * (half[0] + 2 * point)
                spots = [(b + part * (end_x - b), y + side * below) for b in (start, x) for side, part in aside]
                labels[2 * m].set_position(_place(spots, half, boxes))
                spots = [(end_x + side * right, y + part * (end_y - y)) for side, part in aside]
                labels[2 * m + 1].set_position(_place(spots, half, boxes))
        return [body, trail, green, red, legs, wedge, *numbers, *labels]

    return fig, update


def animate(
    simulation: Simulation,
    path: str | os.PathLike[str] | None = None,
    *,
    field_of_view: str | Rule = "outward-ahead",
    interval: float = 200,
) -> FuncAnimation:
    """Animate the truth: centre, robot and its last 15 steps, field of view, landmarks and their measurements.

    A landmark is a full green disc when seen and a hollow red square when not; the horizontal and the vertical leg from
    the robot are the two measured, noisy components l_m, m_m of landmark m. The last line of a notebook cell shows it.

    Parameters
    ----------
    simulation : Simulation
        What `data_simulation` returned.
    path : path, optional
        Where to save: .gif, or .mp4 where ffmpeg is installed. The figure is then closed.
    field_of_view : str or function
        That of the scenario. The wedge is left out where there is none ("exogenous", a function), and, with a warning,
        where it does not explain which landmarks are seen.
    interval : float
        Time between frames [ms].

    Returns
    -------
    FuncAnimation
        Keep a reference to it as long as its window is open.

    Raises
    ------
    TypeError, ValueError
        When an argument has the wrong type or value; before any work, as the next two.
    OSError
        When the folder of `path` does not exist or cannot be written.
    RuntimeError
        When an .mp4 is asked for and ffmpeg is missing.

    Source: handout, question 1a.
    """
    if not isinstance(simulation, Simulation):
        raise TypeError(f"simulation must be a Simulation, not {type(simulation).__name__}")
    _check_field_of_view(field_of_view)
    if _scalar("interval", interval) <= 0:
        raise ValueError(f"interval must be positive, not {interval}")
    target = None if path is None else Path(path)
    if target and target.suffix.lower() not in (".gif", ".mp4"):
        raise ValueError(f"the animation is saved as .gif or .mp4, not as {target.name!r}")
    if target and not target.parent.is_dir():
        raise FileNotFoundError(f"the folder {target.parent} does not exist")
    if target and target.is_dir():
        raise IsADirectoryError(f"{target} is a folder")
    if target and not os.access(target.parent, os.W_OK):
        raise PermissionError(f"the folder {target.parent} cannot be written")
    from matplotlib import pyplot as plt
    from matplotlib.animation import FFMpegWriter, FuncAnimation

    if target and target.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise RuntimeError("an .mp4 needs the program ffmpeg, which is missing here: save a .gif instead")

    if _wedge_angles(field_of_view, simulation.CC):
        z, o = simulation.Hfull @ simulation.X, simulation.X[:2] - simulation.CC[:, None]
        explained = _visibility(field_of_view, z.reshape(simulation.M, 2, simulation.N), o)
        if (explained != (simulation.in_fov[::2] == 1)).any():
            asked = f"field_of_view {field_of_view!r} does not explain which landmarks are seen"
            warnings.warn(f"{asked}: no wedge is drawn; give the one of the scenario", stacklevel=2)
            field_of_view = "exogenous"
    fig, update = _stage(simulation, field_of_view)

    class Animation(FuncAnimation):
        def _repr_html_(self) -> str:
            plt.close(fig)  # or the notebook shows the figure a second time, still
            return str(self.to_jshtml())

    animation = Animation(fig, update, frames=simulation.N, interval=interval)
    if target:
        writer = "pillow" if target.suffix.lower() == ".gif" else "ffmpeg"
        try:
            # Beside the target, so that one rename puts the finished file there.
            with tempfile.TemporaryDirectory(prefix=".animation-", dir=target.parent) as folder:
                part = Path(folder, target.name)
                animation.save(part, writer=writer)
                part.replace(target)
        finally:
            plt.close(fig)
    return animation


def _show(simulation: Simulation, field_of_view: str | Rule) -> bool:
    """Show the animation in the notebook or in a window; return False where neither is there."""
    from matplotlib import pyplot as plt

    ipython = sys.modules.get("IPython")
    if ipython and hasattr(ipython.get_ipython(), "kernel"):
        ipython.display.display(animate(simulation, field_of_view=field_of_view))
        return True
    if plt.get_backend().lower() in ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template"):
        return False
    try:
        animation = animate(simulation, field_of_view=field_of_view)
    except ImportError:  # a backend was asked for that finds no screen
        return False
    plt.show()
    del animation  # it had to live as long as its window
    return True


def main(arguments: list[str] | None = None) -> int:
    """Show the animation, or save it to a file; return the exit status."""
    import argparse

    class Parser(argparse.ArgumentParser):
        def error(self, message: str) -> NoReturn:
            self.exit(2, f"{self.prog}: {message}\n")

    parser = Parser(prog="data_simulation.py", description="Animate the random experiment of the handout.")
    parser.add_argument("file", nargs="?", metavar="FILE", help="save to FILE (.gif or .mp4) and show no window")
    parser.add_argument("--seed", type=int, help="the same seed gives the same experiment")
    options = parser.parse_args(arguments)
    try:
        simulation = data_simulation(scenario=HANDOUT, rng=options.seed)
        if options.file:
            animate(simulation, options.file)
        elif not _show(simulation, HANDOUT.field_of_view):
            raise RuntimeError(f"{_NO_WINDOW}: give the name of a file to save, such as experiment.gif")
    except (ValueError, OSError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except (ImportError, RuntimeError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
