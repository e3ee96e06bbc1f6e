"""Mistakes of the Rao-Blackwellized step and of its moments."""

from typing import Any

import numpy as np

from lab.checks import recipes, reference
from lab.checks.mistakes.clouds import COMBINE
from lab.checks.mistakes.densities import DENSITIES
from lab.checks.mistakes.kalman import Mutants
from lab.checks.mistakes.seeing import SELECT
from lab.checks.recipes import rbpf_step_with
from lab.validation import Array


def _late(move: Any) -> Any:
    def wrong(robots: Array, noise: Array, model: Any) -> Array:
        F, B = model.F[:2, :2], model.B[:2, np.newaxis]
        return np.asarray(move(robots, noise, F, B))

    return wrong


def _mean_robot(z: Array, H: Array, robots: Array, means: Array) -> Array:
    robot = robots.mean(axis=1, keepdims=True)
    return np.asarray(z[:, np.newaxis] - H[:, :2] @ robot - H[:, 2:] @ means)


def _only_seen(cov: Array, H: Array, S: Array) -> Array:
    K = np.linalg.solve(S, H[:, 2:] @ cov).T
    K[~(H[:, 2:] != 0).any(axis=0)] = 0
    return np.asarray(K)


def steps() -> Mutants:
    """Return mistaken rbpf_steps."""
    build = rbpf_step_with
    found: Mutants = [(key, build(select=select)) for key, select in SELECT]
    found += [(key, build(combine=combine)) for key, combine in COMBINE]
    found += [(key, _kept_when_blind(build(combine=combine))) for key, combine in COMBINE]
    found += [(key, build(density=density)) for key, density in DENSITIES]
    found += [
        (key, build(move=_late(move)))
        for key, move in (
            ("b-omitted", lambda r, noise, F, B: F @ r + noise),
            ("f-omitted", lambda r, noise, F, B: r + B + noise),
            ("f-omitted", lambda r, noise, F, B: r + noise),
            ("f-transposed", lambda r, noise, F, B: F.T @ r + B + noise),
            ("noise-omitted", lambda r, noise, F, B: F @ r + B),
            ("noise-shared", lambda r, noise, F, B: F @ r + B + noise[:, :1]),
            ("noise-again", lambda r, noise, F, B: F @ r + B + 2 * noise),
            ("wrong-b", lambda r, noise, F, B: F @ r - B + noise),
            ("prediction-lost", lambda r, noise, F, B: r),
        )
    ]
    found += [
        ("noise-again", build(move=_factor_again)),
        ("rb-without-landmarks", build(weight_spread=lambda cov, H, R: R)),
        ("rb-without-noise", build(weight_spread=lambda cov, H, R: H[:, 2:] @ cov @ H[:, 2:].T)),
        ("rb-without-landmarks", build(spread=lambda cov, H, R: R)),
        ("rb-without-noise", build(spread=lambda cov, H, R: H[:, 2:] @ cov @ H[:, 2:].T)),
        ("rb-weighed-late", build(weigh_late=True)),
        ("rb-weighed-late", build(weigh_late=True, weight_spread=lambda cov, H, R: R)),
        ("rb-weighed-late", build(weigh_late=True, weight_spread=_after)),
        ("rb-weighed-late", build(weight_spread=_after)),
        ("rb-mean-robot", build(innovation=_mean_robot)),
        ("rb-old-robot", build(old_robots=True)),
        ("rb-means-not-updated", build(new_means=lambda means, K, nu, w: means)),
        ("innovation-sign", build(new_means=lambda means, K, nu, w: means - K @ nu)),
        ("rb-mean-robot", build(new_means=lambda means, K, nu, w: means + (K @ nu).mean(axis=1, keepdims=True))),
        ("rb-mean-robot", build(new_means=lambda means, K, nu, w: means + (K @ nu @ w)[:, np.newaxis])),
        ("rb-cov-not-updated", build(new_cov=lambda cov, K, H: cov)),
        ("covariance-sign", build(new_cov=lambda cov, K, H: cov + K @ H[:, 2:] @ cov)),
        ("one-for-identity", build(new_cov=lambda cov, K, H: (1 - K @ H[:, 2:]) @ cov)),
        ("joseph-incomplete", build(new_cov=_half_joseph)),
        ("double-inverse", build(gain=lambda cov, H, S: cov @ H[:, 2:].T @ S)),
        ("double-inverse", build(gain=lambda cov, H, S: cov @ H[:, 2:].T)),
        ("element-wise", build(gain=lambda cov, H, S: cov @ H[:, 2:].T / np.diag(S))),
        ("relative-sign", build(innovation=lambda z, H, r, m: z[:, np.newaxis] + H[:, :2] @ r - H[:, 2:] @ m)),
        ("robot-ignored", build(innovation=lambda z, H, r, m: z[:, np.newaxis] - H[:, 2:] @ m)),
        ("weights-reset-when-blind", _even_when_blind),
        ("no-prediction-when-blind", _frozen_when_blind),
        ("rb-means-not-updated", build(new_means=lambda m, K, nu, w: m, new_cov=lambda cov, K, H: cov)),
        ("cross-terms-dropped", build(new_cov=lambda cov, K, H: np.diag(np.diag(cov - K @ H[:, 2:] @ cov)))),
        ("rb-without-landmarks", build(spread=lambda cov, H, R: np.diag(np.diag(H[:, 2:] @ cov @ H[:, 2:].T)) + R)),
    ]
    return found


def _kept_when_blind(step: Any) -> Any:
    """Leave the weights as they are when nothing is seen, whatever is wrong otherwise."""

    def rbpf_step(*args: Any) -> Any:
        answer = step(*args)
        return (*answer[:3], args[3]) if np.isnan(args[5]).all() else answer

    return rbpf_step


def _factor_again(robots: Array, noise: Array, model: Any) -> Array:
    moved = recipes.moved(robots, 0 * noise, _Robot(model))
    return np.asarray(moved + np.linalg.cholesky(model.Q[:2, :2]) @ noise)


class _Robot:
    def __init__(self, model: Any) -> None:
        self.F, self.B = model.F[:2, :2], model.B[:2]


def _after(cov: Array, H: Array, R: Array) -> Array:
    """Return the spread of z with the landmarks' covariance after the update."""
    L = H[:, 2:]
    K = np.linalg.solve(L @ cov @ L.T + R, L @ cov).T
    return np.asarray(L @ (cov - K @ L @ cov) @ L.T + R)


def _half_joseph(cov: Array, K: Array, H: Array) -> Array:
    left = np.eye(len(cov)) - K @ H[:, 2:]
    return np.asarray(left @ cov @ left.T)


def _even_when_blind(*args: Any) -> Any:
    answer = reference.rbpf_step(*args)
    return (*answer[:3], np.full(len(answer[3]), 1 / len(answer[3]))) if np.isnan(args[5]).all() else answer


def _frozen_when_blind(*args: Any) -> Any:
    return args[:4] if np.isnan(args[5]).all() else reference.rbpf_step(*args)


def _mixture(change: Any) -> Any:
    def rbpf_moments(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
        mean, spread = reference.moments(np.vstack([robots, means]), weights)
        return mean, change(spread, cov, weights)

    return rbpf_moments


def _within(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[2:, 2:] += cov
    return spread


def _uncrossed(spread: Array) -> Array:
    spread = spread.copy()
    spread[:2, 2:] = spread[2:, :2] = 0
    return spread


def _only_within(spread: Array, cov: Array) -> Array:
    spread = spread.copy()
    spread[2:, 2:] = cov
    return spread


moments: Mutants = [
    ("rb-conditional-dropped", _mixture(lambda spread, cov, w: spread)),
    ("rb-cross-dropped", _mixture(lambda spread, cov, w: _within(_uncrossed(spread), cov))),
    ("rb-cross-dropped", _mixture(lambda spread, cov, w: _uncrossed(spread))),
    ("rb-spread-dropped", _mixture(lambda spread, cov, w: _only_within(spread, cov))),
    ("rb-spread-dropped", _mixture(lambda spread, cov, w: _only_within(_uncrossed(spread), cov))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread / (1 - np.sum(w**2)), cov))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov * np.sum(w**2)))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov / len(w)))),
    ("covariance-normalisation", _mixture(lambda spread, cov, w: _within(spread, cov * len(w)))),
    ("weights-ignored", lambda r, m, cov, w: reference.rbpf_moments(r, m, cov, np.full(len(w), 1 / len(w)))),
    ("variances-only", _mixture(lambda spread, cov, w: np.diag(np.diag(_within(spread, cov))))),
    ("cross-terms-dropped", _mixture(lambda spread, cov, w: _within(spread, np.diag(np.diag(cov))))),
    ("weights-ignored", lambda r, m, cov, w: _plain(r, m, cov, w)),
]


def _plain(robots: Array, means: Array, cov: Array, weights: Array) -> tuple[Array, Array]:
    """Weigh the mean, but not the spread."""
    x = np.vstack([robots, means])
    return x @ weights, _within(np.cov(x, ddof=0), cov)
