"""The known mistakes: what each is called, and what an answer that makes it returns.

Question answered: which mistakes explain a wrong answer?  `mutants` gives, for a question whose answers are compared
exactly, the mistaken answers with the keys of their words in `CATALOGUE`; the same mistake may come in several forms.
"""

from functools import cache

from lab.checks.mistakes import clouds, densities, ekf_events, ekf_models, kalman, rao_blackwell, small
from lab.checks.mistakes.catalogue import CATALOGUE, Mistake
from lab.checks.recipes import Function

__all__ = ["CATALOGUE", "Mistake", "mutants"]


@cache
def mutants(question: str) -> tuple[tuple[str, Function], ...]:
    """Return the known mistaken answers to a question, each with the key of its mistake."""
    makers = {
        "q1d-step": kalman.steps,
        "q1d-filter": kalman.filters,
        "q2a": densities.log_priors,
        "q2b": densities.log_transitions,
        "q2c": densities.log_likelihoods,
        "q3-jitter": clouds.jittered_steps,
        "q4-step": clouds.steps,
        "q6-step": clouds.sir_steps,
        "q10-step": rao_blackwell.steps,
        "q11-move": ekf_models.moves,
        "q11-observe": ekf_models.observes,
        "q11-invert": ekf_models.inverts,
        "q12-predict": ekf_events.predictions,
        "q12-update": ekf_events.corrections,
        "q12-initialise": ekf_events.initialisations,
        "q13-nees": ekf_models.neeses,
        "q14-directions": ekf_models.directions,
        "q16-ray": ekf_models.rays,
    }
    ready = {
        "q4-evidence": small.evidences,
        "q4a": small.moments,
        "q4b-corridor": small.corridors,
        "q4b-ellipse": small.ellipses,
        "q5": small.ess,
        "q6-ancestors": small.ancestors,
        "q7": small.closures,
        "q8-gap": small.gaps,
        "q10-moments": rao_blackwell.moments,
    }
    return tuple(makers[question]() if question in makers else ready.get(question, []))
