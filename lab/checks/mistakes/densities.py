"""Mistakes of the three log-densities."""

from typing import Any

import numpy as np

from lab.checks.mistakes.kalman import Mutants
from lab.checks.mistakes.seeing import SELECT
from lab.checks.recipes import Function, log_gaussian, log_likelihood_with
from lab.checks.reference import MARGIN
from lab.checks.worlds import handout_model
from lab.validation import Array


def _quadratic(deviation: Array, cov: Array) -> Array:
    return np.asarray(np.sum(deviation * np.linalg.solve(cov, deviation), axis=0))


def _constant(cov: Array) -> float:
    return float(-0.5 * (np.linalg.slogdet(cov)[1] + len(cov) * np.log(2 * np.pi)))


def _underflowing(deviation: Array, cov: Array) -> Array:
    with np.errstate(all="ignore"):
        return np.asarray(np.log(np.exp(-0.5 * _quadratic(deviation, cov)) * np.exp(_constant(cov))))


# (deviation (p, P), cov (p, p)) -> (P,)
DENSITIES: tuple[tuple[str, Function], ...] = (
    ("half-missing", lambda d, cov: -_quadratic(d, cov) + _constant(cov)),
    ("exponent-sign", lambda d, cov: 0.5 * _quadratic(d, cov) + _constant(cov)),
    ("exponent-sign", lambda d, cov: 0.5 * _quadratic(d, cov) - _constant(cov)),
    ("double-inverse", lambda d, cov: -0.5 * np.sum(d * (cov @ d), axis=0) + _constant(cov)),
    ("r-diagonal", lambda d, cov: log_gaussian(d, np.diag(np.diag(cov)))),
    ("plain-exp", _underflowing),
    ("half-missing", lambda d, cov: -2 * _quadratic(d, cov) + _constant(cov)),
    ("variance-squared", lambda d, cov: log_gaussian(d, cov @ cov)),
    ("element-wise", lambda d, cov: -0.5 * np.sum(d * d, axis=0) / np.trace(cov)),
    ("s-without-noise", lambda d, cov: -0.5 * np.sum(d * d, axis=0)),
    ("deviation-as-variance", lambda d, cov: -0.5 * np.sum((d.T / np.diag(cov)) ** 2, axis=1)),
    ("cases-by-hand", lambda d, cov: log_gaussian(d[:2], cov[:2, :2])),
    ("cases-by-hand", lambda d, cov: log_gaussian(d[:1], cov[:1, :1])),
    ("deviation-as-variance", lambda d, cov: -0.5 * np.sqrt(_quadratic(d, cov))),
    ("deviation-as-variance", lambda d, cov: -0.5 * np.sum(d * d / np.sqrt(np.diag(cov))[:, np.newaxis], axis=0)),
    ("log-base", lambda d, cov: log_gaussian(d, cov) / np.log(10)),
    ("plain-exp", lambda d, cov: np.log(np.exp(-0.5 * _quadratic(d, cov)) + 1e-300)),
    ("plain-exp", lambda d, cov: np.log(np.exp(log_gaussian(d, cov)) + 1e-300)),
)
LINEAR = lambda d, cov: np.exp(log_gaussian(d, cov))  # noqa: E731
UNSCALED = lambda d, cov: np.exp(-0.5 * _quadratic(d, cov))  # noqa: E731


def _mean_innovation(z: Array, H: Array, particles: Array) -> Array:
    return np.repeat((z - H @ particles.mean(axis=1))[:, np.newaxis], particles.shape[1], axis=1)


def likelihoods() -> Mutants:
    """Return mistaken log_likelihoods that also go into the steps of particles."""
    build = log_likelihood_with
    found: Mutants = [(key, build(select=select)) for key, select in SELECT if key != "relative-sign"]
    found += [(key, build(density=density)) for key, density in DENSITIES]
    found += [
        ("relative-sign", build(innovation=lambda z, H, x: z[:, np.newaxis] - np.abs(H) @ x)),
        ("relative-sign", build(innovation=lambda z, H, x: z[:, np.newaxis] + H @ x)),
        ("not-centred", build(innovation=lambda z, H, x: H @ x)),
        ("particles-averaged", build(innovation=_mean_innovation)),
    ]
    return found


def log_likelihoods() -> Mutants:
    """Return mistaken answers to q2c."""
    found = [*likelihoods(), ("linear-not-log", log_likelihood_with(density=LINEAR))]
    found.append(("linear-not-log", lambda *args: np.exp(log_likelihood_with()(*args))))
    found.append(("exponent-sign", lambda *args: -log_likelihood_with()(*args)))
    found += [
        ("linear-not-log", log_likelihood_with(density=UNSCALED)),
        ("linear-not-log", lambda *args: _shares(log_likelihood_with()(*args))),
        ("last-particle-missed", lambda *args: np.r_[log_likelihood_with()(*args)[:-1], 0.0]),
        ("last-particle-missed", lambda *args: np.r_[log_likelihood_with(density=_bare)(*args)[:-1], 0.0]),
        ("loop-accumulates", lambda *args: np.cumsum(log_likelihood_with()(*args))),
        ("loop-accumulates", lambda *args: np.cumsum(log_likelihood_with(density=_bare)(*args))),
        ("blind-density", _when_blind(-np.inf)),
        ("blind-density", _when_blind(np.nan)),
    ]
    return found


def _bare(deviation: Array, cov: Array) -> Array:
    return -0.5 * _quadratic(deviation, cov)


def _shares(logs: Array) -> Array:
    scaled = np.exp(logs - logs.max())
    return np.asarray(scaled / scaled.sum())


def _when_blind(value: float) -> Function:
    def log_likelihood(z: Array, particles: Array, H: Array, R: Array) -> Array:
        blind = np.isnan(z).all()
        return np.full(particles.shape[1], value) if blind else log_likelihood_with()(z, particles, H, R)

    return log_likelihood


def _singular_with(density: Function, *, support: bool = True, free: Function | None = None) -> Function:
    def log_density(deviation: Array, cov: Array) -> Any:
        kept = np.diag(cov) > 0 if free is None else free(cov)
        if support and np.abs(deviation[~kept]).max(initial=0) > MARGIN:
            return -np.inf
        return float(density(deviation[kept, np.newaxis], cov[np.ix_(kept, kept)])[0])

    return log_density


def _singular() -> Mutants:
    """Return mistaken (deviation, cov) -> log-density for a singular covariance."""
    found: Mutants = [("diagonal-only" if key == "r-diagonal" else key, _singular_with(d)) for key, d in DENSITIES]
    found += [
        ("support-ignored", _singular_with(log_gaussian, support=False)),
        ("linear-not-log", lambda deviation, cov: np.exp(_singular_with(log_gaussian)(deviation, cov))),
        ("linear-not-log", _singular_with(LINEAR)),
        ("support-refused", lambda deviation, cov: log_gaussian(deviation[:, np.newaxis], cov)[0]),
        *[("support-ignored", _regularised(10.0**-power)) for power in (3, 4, 5, 6, 7, 8, 9, 10)],
        ("support-inverted", _inverted),
        ("support-as-zero", lambda d, cov: _instead(_singular_with(log_gaussian)(d, cov), 0.0)),
        ("support-as-zero", lambda d, cov: _instead(_singular_with(log_gaussian)(d, cov), np.inf)),
        ("linear-not-log", _singular_with(UNSCALED)),
        ("linear-not-log", lambda d, cov: np.exp(_singular_with(_bare)(d, cov))),
        ("support-ignored", lambda d, cov: log_gaussian(d[:, np.newaxis], np.diag(np.diag(cov)) + np.eye(len(cov)))[0]),
        ("support-ignored", lambda d, cov: -0.5 * d @ np.linalg.pinv(cov) @ d),
        ("support-ignored", lambda d, cov: -0.5 * d @ np.linalg.pinv(cov, rcond=1e-12) @ d),
        ("diagonal-only", _singular_with(lambda d, cov: log_gaussian(d, np.diag(np.diag(cov))), support=False)),
    ]
    return found


def _regularised(small: float) -> Function:
    return lambda d, cov: log_gaussian(d[:, np.newaxis], cov + small * np.eye(len(cov)))[0]


def _inverted(deviation: Array, cov: Array) -> float:
    possible = np.isfinite(_singular_with(log_gaussian)(deviation, cov))
    return -np.inf if possible else float(_singular_with(log_gaussian, support=False)(deviation, cov))


def _instead(value: float, other: float) -> float:
    return value if np.isfinite(value) else other


def _where_allowed(deviation: Array, other: Array, cov: Array) -> Any:
    """Return the log-density of `other` where `deviation` is possible."""
    possible = np.isfinite(_singular_with(log_gaussian)(deviation, cov))
    return _singular_with(log_gaussian, support=False)(other, cov) if possible else -np.inf


def _first_two(cov: Array) -> Any:
    return np.arange(len(cov)) < 2


def log_priors() -> Mutants:
    """Return mistaken log_priors."""
    found: Mutants = [(key, _prior(density)) for key, density in _singular()]
    found += [
        ("not-centred", lambda x, model: _singular_with(log_gaussian, support=False)(np.asarray(x), model.P0)),
        ("not-centred", lambda x, model: _singular_with(log_gaussian)(np.asarray(x), model.P0)),
        ("not-centred", lambda x, model: _where_allowed(x - model.m0, np.asarray(x), model.P0)),
        ("f-omitted", lambda x, model: _singular_with(log_gaussian)(x - model.F @ model.m0 - model.B, model.P0)),
        ("retyped", lambda x, model: _singular_with(log_gaussian)(x - _handout(x).m0, _handout(x).P0)),
        ("retyped", lambda x, model: _singular_with(log_gaussian)(x - model.m0, _handout(x).P0)),
        ("retyped", lambda x, model: _where_allowed(x - model.m0, x - _handout(x).m0, model.P0)),
        ("retyped", lambda x, model: log_gaussian((x - model.m0)[2:, np.newaxis], 0.2 * np.eye(len(x) - 2))[0]),
    ]
    return found


def _prior(density: Function) -> Function:
    return lambda x, model: density(np.asarray(x) - model.m0, model.P0)


def with_motion_noise(x: Array, model: Any) -> float:
    """Return the prior's log-density with Q added to P0, which only an uncertain robot shows."""
    free = np.diag(model.P0) > 0
    if np.any(x[~free] != model.m0[~free]):
        return -np.inf
    cov = (model.P0 + model.Q)[np.ix_(free, free)]
    return float(log_gaussian((x - model.m0)[free, np.newaxis], cov)[0])


def _handout(x: Array) -> Any:
    return handout_model(len(x) // 2 - 1)


def log_transitions() -> Mutants:
    """Return mistaken log_transitions."""
    right = _singular_with(log_gaussian)
    loose = _singular_with(log_gaussian, support=False)
    found: Mutants = [(key, _transition(density)) for key, density in _singular()]
    for density in (right, loose):
        found += [
            ("b-omitted", lambda new, x, model, d=density: d(new - model.F @ x, model.noise_cov)),
            ("wrong-b", lambda new, x, model, d=density: d(new - model.F @ x + model.B, model.noise_cov)),
            (
                "wrong-b",
                lambda new, x, model, d=density: d(new - model.F @ (x - model.B) - model.B, model.noise_cov),
            ),
            ("f-omitted", lambda new, x, model, d=density: d(new - x - model.B, model.noise_cov)),
            ("f-omitted", lambda new, x, model, d=density: d(new - x, model.noise_cov)),
            ("f-transposed", lambda new, x, model, d=density: d(new - model.F.T @ x - model.B, model.noise_cov)),
            ("arguments-swapped", lambda new, x, model, d=density: d(x - model.F @ new - model.B, model.noise_cov)),
            ("not-centred", lambda new, x, model, d=density: d(np.asarray(new), model.noise_cov)),
            ("retyped", lambda new, x, model, d=density: d(new - model.F @ x - model.B, _handout(x).noise_cov)),
            (
                "retyped",
                lambda new, x, model, d=density: d(new - _handout(x).F @ x - _handout(x).B, _handout(x).noise_cov),
            ),
        ]
    robot_only = _singular_with(log_gaussian, support=False, free=_first_two)
    landmarks_still = _singular_with(log_gaussian, free=_first_two)
    found += [
        ("support-ignored", _transition(robot_only)),
        ("landmark-noise-ignored", _transition(landmarks_still)),
        ("wrong-block", lambda new, x, model: right(new - model.F @ x - model.B, model.P0)),
    ]
    return found


def _transition(density: Function) -> Function:
    return lambda new, x, model: density(np.asarray(new) - model.F @ x - model.B, model.noise_cov)
