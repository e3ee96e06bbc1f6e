"""Mistakes of one step of SIS, with jitter, and of SIR."""

from typing import Any

import numpy as np

from lab.checks import recipes
from lab.checks.mistakes.densities import likelihoods
from lab.checks.mistakes.kalman import Mutants, predicted_means
from lab.checks.recipes import (
    effective_sample_size,
    jittered_step_with,
    log_likelihood_with,
    normalised,
    select_ancestors,
    sir_step_with,
    sis_step_with,
)
from lab.validation import Array


def _plain(weights: Array, logs: Array) -> Array:
    with np.errstate(all="ignore"):
        new = weights * np.exp(logs)
        return np.asarray(new / new.sum())


def _plain_guarded(weights: Array, logs: Array) -> Array:
    """Add a small number against the division by zero."""
    new = weights * np.exp(logs) + 1e-300
    return np.asarray(new / new.sum())


def _even_when_lost(weights: Array, logs: Array) -> Array:
    """Make the weights even when all likelihoods underflow."""
    new = weights * np.exp(logs)
    return new / new.sum() if new.sum() > 0 else np.full(len(weights), 1 / len(weights))


def _unnormalised(weights: Array, logs: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(weights * np.exp(logs))


def _relative(weights: Array, logs: Array) -> Array:
    with np.errstate(divide="ignore"):
        new = np.log(weights) + logs
    return np.asarray(np.exp(new - new.max()))


def _scaled_likelihood(weights: Array, logs: Array) -> Array:
    """Normalise the likelihoods, and not their product with the weights."""
    return np.asarray(weights * normalised(np.ones(len(logs)), logs))


def _added(weights: Array, logs: Array) -> Array:
    new = weights + np.exp(logs)
    return np.asarray(new / new.sum())


def _added_scaled(weights: Array, logs: Array) -> Array:
    return np.asarray((weights + normalised(np.ones(len(logs)), logs)) / 2)


def _logs(weights: Array, logs: Array) -> Array:
    new = weights * logs
    return np.asarray(new / new.sum())


def _doubled(weights: Array, logs: Array) -> Array:
    return np.asarray(normalised(weights, 2 * logs))


# (weights (P,), log-likelihoods (P,)) -> weights (P,)
COMBINE: tuple[tuple[str, Any], ...] = (
    ("plain-exp", _plain),
    ("plain-exp", _plain_guarded),
    ("plain-exp", _even_when_lost),
    ("weights-overwritten", lambda w, logs: normalised(np.ones(len(w)), logs)),
    ("not-normalised", _unnormalised),
    ("not-normalised", _relative),
    ("not-normalised", _scaled_likelihood),
    ("weights-added", _added),
    ("weights-added", _added_scaled),
    ("log-as-weight", _logs),
    ("log-as-weight", lambda w, logs: logs / logs.sum()),
    ("log-as-weight", lambda w, logs: w * logs),
    ("log-as-weight", lambda w, logs: np.log(normalised(w, logs))),
    ("weights-unchanged", lambda w, logs: w),
    ("weights-unchanged", lambda w, logs: np.full(len(w), 1 / len(w))),
    ("exponent-sign", lambda w, logs: normalised(w, -logs)),
    ("half-missing", _doubled),
    ("weights-squared", lambda w, logs: normalised(w**2, logs)),
    ("not-normalised", lambda w, logs: normalised(w, logs) * len(w)),
)


def _half_likelihood() -> Any:
    return lambda *args: 0.5 * log_likelihood_with()(*args)


def steps() -> Mutants:
    """Return mistaken sis_steps."""
    build = sis_step_with
    found: Mutants = [(key, build(likelihood=wrong)) for key, wrong in likelihoods()]
    found += [(key, build(move=_moved_by(wrong))) for key, wrong in predicted_means() if key not in ("open-loop",)]
    found += [
        (key, build(move=wrong))
        for key, wrong in (
            ("noise-omitted", lambda x, noise, model: recipes.moved(x, 0 * noise, model)),
            ("noise-shared", lambda x, noise, model: recipes.moved(x, noise[:, :1], model)),
            ("noise-again", lambda x, noise, model: recipes.moved(x, np.linalg.cholesky(model.Q) @ noise, model)),
            ("noise-again", lambda x, noise, model: recipes.moved(x, model.Q @ noise, model)),
            ("noise-again", lambda x, noise, model: recipes.moved(x, np.sqrt(model.Q) @ noise, model)),
            ("noise-again", lambda x, noise, model: recipes.moved(x, 2 * noise, model)),
            ("noise-again", lambda x, noise, model: recipes.moved(x, -noise, model)),
            ("f-omitted", lambda x, noise, model: x + noise),
            ("prediction-lost", lambda x, noise, model: x),
            ("noise-before-f", lambda x, noise, model: recipes.moved(x + noise, 0 * noise, model)),
        )
    ]
    bare = log_likelihood_with(density=_bare)
    found += [(key, build(combine=combine)) for key, combine in COMBINE]
    found += [(key, _kept_when_blind(build(combine=combine))) for key, combine in COMBINE]
    found += [
        (key, build(combine=c, likelihood=bare)) for key, c in COMBINE if key in ("weights-added", "log-as-weight")
    ]
    found += [
        ("weighed-before-noise", _weighed_before_noise),
        ("transition-in-weight", _with_transition),
        ("old-particles", _old_returned),
        ("weighed-before-move", build(weighed=lambda old, new: old)),
        ("weights-reset-when-blind", build(even_when_blind=True)),
        ("no-prediction-when-blind", _frozen_when_blind),
        ("deviation-as-variance", build(likelihood=_half_likelihood())),
        ("weights-overwritten", build(combine=lambda w, logs: _plain(np.ones(len(w)), logs))),
    ]
    return found


def _bare(deviation: Array, cov: Array) -> Array:
    """Return the log-density without its constant."""
    return np.asarray(-0.5 * np.sum(deviation * np.linalg.solve(cov, deviation), axis=0))


def _weighed_before_noise(particles: Array, weights: Array, noise: Array, *rest: Any) -> Any:
    new, _ = sis_step_with()(particles, weights, noise, *rest)
    return new, sis_step_with()(particles, weights, 0 * noise, *rest)[1]


def _with_transition(particles: Array, weights: Array, noise: Array, *rest: Any) -> Any:
    new, right = sis_step_with()(particles, weights, noise, *rest)
    return new, normalised(right, _bare(noise[:2], rest[-1].Q[:2, :2]))


def _old_returned(particles: Array, *rest: Any) -> Any:
    return particles, sis_step_with()(particles, *rest)[1]


def _moved_by(wrong: Any) -> Any:
    return lambda particles, noise, model: wrong(particles, model) + noise


def _frozen_when_blind(*args: Any) -> tuple[Array, Array]:
    particles, weights, _, z = args[:4]
    return (particles, weights) if np.isnan(z).all() else sis_step_with()(*args)


def _kept_when_blind(step: Any) -> Any:
    """Leave the weights as they are when nothing is seen, whatever is wrong otherwise."""

    def sis_step(particles: Array, weights: Array, noise: Array, z: Array, H: Array, R: Array, model: Any) -> Any:
        new, weighed = step(particles, weights, noise, z, H, R, model)
        return new, weights if np.isnan(z).all() else weighed

    return sis_step


def jittered_steps() -> Mutants:
    """Return mistaken jittered_steps."""
    build = jittered_step_with
    found: Mutants = [
        ("jitter-not-in-weights", build(after=True)),
        ("jitter-dropped", build(shift=lambda jitter, z: 0 * jitter)),
        ("jitter-only-seen", build(shift=lambda jitter, z: np.where(np.isnan(z)[:, np.newaxis], 0, jitter))),
        ("noise-shared", build(shift=lambda jitter, z: np.repeat(jitter[:, :1], jitter.shape[1], axis=1))),
        ("noise-again", build(shift=lambda jitter, z: 2 * jitter)),
        ("noise-again", build(shift=lambda jitter, z: -jitter)),
        ("jitter-replaces", _jitter_for_landmarks),
        ("jitter-dropped", _jitter_in_weights_only),
        ("noise-omitted", _without_noise),
    ]
    return found + [(key, build(step)) for key, step in steps()]


def _jitter_in_weights_only(particles: Array, weights: Array, noise: Array, jitter: Array, *rest: Any) -> Any:
    new, weights = jittered_step_with()(particles, weights, noise, jitter, *rest)
    new[2:] -= jitter
    return new, weights


def _jitter_for_landmarks(particles: Array, weights: Array, noise: Array, jitter: Array, *rest: Any) -> Any:
    empty = np.vstack([particles[:2], 0 * particles[2:]])
    return jittered_step_with()(empty, weights, noise, jitter, *rest)


def _without_noise(particles: Array, weights: Array, noise: Array, *rest: Any) -> Any:
    return jittered_step_with()(particles, weights, 0 * noise, *rest)


def _ess(weights: Array) -> float:
    return effective_sample_size(weights)


def _robots_only(particles: Array, weights: Array, ancestors: Any) -> tuple[Array, Array]:
    new = particles.copy()
    new[:2] = particles[:2, ancestors]
    return new, np.full(len(weights), 1 / len(weights))


def _even(weights: Array) -> Array:
    return np.full(len(weights), 1 / len(weights))


def _shifted(by: int) -> Any:
    return lambda weights, points: np.clip(select_ancestors(weights, points) + by, 0, len(weights) - 1)


# (weights (P,), points (P,)) -> ancestors (P,)
CHOOSE: tuple[tuple[str, Any], ...] = (
    ("ancestor-shifted", _shifted(1)),
    ("ancestor-shifted", _shifted(-1)),
    ("ancestor-shifted", lambda w, u: select_ancestors(w, u) + 1),
    ("ancestor-shifted", lambda w, u: select_ancestors(w, u) - 1),
    ("not-cumulated", lambda w, u: np.minimum(np.searchsorted(w, u), len(w) - 1)),
    ("not-cumulated", lambda w, u: np.searchsorted(w, u)),
    ("not-cumulated", lambda w, u: np.argmax(w[np.newaxis, :] > u[:, np.newaxis], axis=1)),
    ("not-cumulated", lambda w, u: np.searchsorted(np.sort(w), u)),
    ("index-sorted", lambda w, u: select_ancestors(np.sort(w), u)),
    ("index-sorted", lambda w, u: select_ancestors(np.sort(w)[::-1], u)),
    ("uniform-choice", lambda w, u: np.arange(len(w))),
    ("uniform-choice", lambda w, u: np.floor(len(w) * u).astype(int)),
    ("uniform-choice", lambda w, u: np.full(len(w), np.argmax(w))),
    ("uniform-choice", lambda w, u: np.argsort(w)[::-1]),
    ("uniform-choice", lambda w, u: np.argsort(w)),
    ("weights-squared", lambda w, u: select_ancestors(w**2, u)),
    ("ancestor-shifted", lambda w, u: (select_ancestors(w, u) + 1) % len(w)),
    ("ancestor-shifted", lambda w, u: (select_ancestors(w, u) - 1) % len(w)),
    ("not-cumulated", lambda w, u: np.searchsorted(w, u, side="right")),
    ("points-ignored", lambda w, u: select_ancestors(w, (np.arange(len(w)) + 0.5) / len(w))),
    ("points-ignored", lambda w, u: select_ancestors(w, np.arange(len(w)) / len(w))),
    ("points-ignored", lambda w, u: select_ancestors(w, np.linspace(0, 1, len(w), endpoint=False))),
    ("search-exchanged", lambda w, u: np.searchsorted(u, np.cumsum(w))),
    ("search-exchanged", lambda w, u: np.searchsorted(u, np.cumsum(w), side="right")),
    ("counts-returned", lambda w, u: np.bincount(select_ancestors(w, u), minlength=len(w))),
    ("one-step-search", lambda w, u: _one_step(w, u)),
    ("search-inverted", lambda w, u: np.argmin(np.cumsum(w)[np.newaxis, :-1] > u[:, np.newaxis], axis=1)),
    ("search-inverted", lambda w, u: _until_below(w, u)),
    ("nearest-edge", lambda w, u: np.argmin(np.abs(np.cumsum(w)[np.newaxis, :] - u[:, np.newaxis]), axis=1)),
    ("ancestor-shifted", lambda w, u: np.searchsorted(np.cumsum(w) - w, u)),
    ("ancestor-shifted", lambda w, u: np.minimum(np.searchsorted(np.cumsum(w) - w, u), len(w) - 1)),
)


def _one_step(weights: Array, points: Array) -> Any:
    cumulative, found, j = np.cumsum(weights), [], 0
    for point in points:
        j += int(point > cumulative[j] and j < len(weights) - 1)
        found.append(j)
    return np.array(found)


def _until_below(weights: Array, points: Array) -> Any:
    cumulative, found = np.cumsum(weights), []
    for point in points:
        j = 0
        while j < len(weights) - 1 and cumulative[j] > point:
            j += 1
        found.append(j)
    return np.array(found)


def _landmarks_only(particles: Array, weights: Array, ancestors: Any) -> tuple[Array, Array]:
    new = particles[:, ancestors]
    new[:2] = particles[:2]
    return new, _even(weights)


def _in_place(particles: Array, weights: Array, ancestors: Any) -> tuple[Array, Array]:
    new = particles.copy()
    for i, ancestor in enumerate(ancestors):
        new[:, i] = new[:, ancestor]
    return new, _even(weights)


def _moved_first(*args: Any) -> Any:
    """Move, then choose, then weigh."""
    particles, weights, noise, points, z, H, R, model, threshold = args
    particles = recipes.moved(particles, noise, model)
    if _ess(weights) <= threshold * len(weights):
        particles, weights = recipes.resampled(particles, weights, select_ancestors(weights, points))
    return particles, normalised(weights, log_likelihood_with()(z, particles, H, R))


def _if_blind(due: bool) -> Any:
    """Resample always, or never, when nothing is seen."""

    def sir_step(*args: Any) -> Any:
        blind = bool(np.isnan(args[4]).all())
        step = sir_step_with(due=lambda w, t: due) if blind else sir_step_with()
        return step(*args)

    return sir_step


def sir_steps() -> Mutants:
    """Return mistaken sir_steps."""
    build = sir_step_with
    found: Mutants = [
        (key, build(due=due))
        for key, due in (
            ("never-resampled", lambda w, t: False),
            ("never-resampled", lambda w, t: _ess(w) <= t),
            ("always-resampled", lambda w, t: True),
            ("always-resampled", lambda w, t: len(w) > t),
            ("always-resampled", lambda w, t: _ess(w) / len(w) <= 1),
            ("test-inverted", lambda w, t: _ess(w) > t * len(w)),
            ("always-resampled", lambda w, t: _ess(w) / len(w) <= t * len(w)),
            ("ess-maximum", lambda w, t: 1 / w.max() <= t * len(w)),
            ("threshold-typed", lambda w, t: _ess(w) <= 0.5 * len(w)),
        )
    ]
    found += [
        (key, build(replace=wrong))
        for key, wrong in (
            ("weights-not-reset", lambda x, w, a: (x[:, a], w)),
            ("weights-permuted", lambda x, w, a: (x[:, a], w[a] / w[a].sum())),
            ("weights-permuted", lambda x, w, a: (x[:, a], w[a])),
            ("robot-resampled-only", _robots_only),
            ("landmarks-resampled-only", _landmarks_only),
            ("overwritten-in-place", _in_place),
            ("particles-not-resampled", lambda x, w, a: (x, _even(w))),
        )
    ]
    found += [(key, build(choose=choose)) for key, choose in CHOOSE]
    found += [
        ("noise-resampled", _moved_first),
        ("resampled-when-seen", _if_blind(True)),
        ("resampled-when-seen", _if_blind(False)),
        ("resampled-last", build(last=True)),
        ("resampled-last", build(last=True, due=lambda w, t: True)),
        ("weights-not-reset", build(last=True, replace=lambda x, w, a: (x[:, a], w))),
    ]
    return found + [(key, build(step)) for key, step in steps()]
