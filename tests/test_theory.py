"""The theory: against itself, against the figures checked before it was written, and against simulation."""

import numpy as np
import pytest
from test_proposals import coupled, cut
from worlds import WORLDS, full_scenario, problem, reference

from lab import theory
from lab.solvers import kalman, particle_steps, sir
from lab.validation import InputError

FIGURES = {  # log10 ESS / N on the original's first experiment at k = 1, 2, 5, 49
    "prior": (-1.4, -4.5, -7.8, -39.3),
    "delayed": (0.0, -1.1, -1.4, -13.9),
    "rbpf-prior": (-0.2, -1.5, -2.4, -29.3),
    "rbpf-optimal": (0.0, -0.7, -0.9, -11.2),
}


@pytest.mark.parametrize("proposal", FIGURES)
def test_forecast_has_the_figures_of_an_independent_probe(proposal):
    forecast = theory.forecast(reference(1).problem, proposal)
    assert forecast[0] == 0
    np.testing.assert_allclose(forecast[[1, 2, 5, 49]], FIGURES[proposal], atol=0.1)


@pytest.mark.parametrize("world", [*WORLDS, "coupled"])
@pytest.mark.parametrize("proposal", theory.PROPOSALS)
def test_the_first_moment_is_the_evidence(world, proposal):
    """Every proposal is properly weighted: E[W] is the exact filter's p(z_1..z_k), at every k, whatever couples."""
    problem = coupled() if world == "coupled" else WORLDS[world]()
    moment = theory.log_weight_moment(problem, proposal, 1)
    np.testing.assert_allclose(moment, kalman(problem).log_evidence, rtol=1e-9, atol=1e-8)


def by_simulation(world, proposal, n_particles, runs, ess_threshold=0.0):
    """Return (sum W)^2 / (N sum W^2) of clouds: mean over runs and its standard error, (N,) each."""
    options = {"n_particles": n_particles, "ess_threshold": ess_threshold, "resample": "systematic"}
    law = theory.PROPOSALS[proposal]
    ratios = np.array(
        [
            [
                step.ess / n_particles
                for step in particle_steps(world, np.random.default_rng([s, 9]), proposal=law, **options)
            ]
            for s in range(runs)
        ]
    )
    return ratios.mean(axis=0), ratios.std(axis=0, ddof=1) / np.sqrt(runs)


@pytest.mark.parametrize("proposal", theory.PROPOSALS)
@pytest.mark.parametrize("name", ["handout", "coupled"])
def test_forecast_is_what_clouds_do(name, proposal):
    """At every k with N >= 100 E[W^4] / E[W^2]^2: within five standard errors, and a bias of 1 %, of the limit."""
    world = cut(reference(1).problem if name == "handout" else coupled(), 6)
    n_particles, runs = 20_000, 20
    second, fourth = (theory.log_weight_moment(world, proposal, power) for power in (2, 4))
    checked = np.exp(fourth - 2 * second) * 100 <= n_particles
    mean, error = by_simulation(world, proposal, n_particles, runs)
    limit = 10 ** theory.forecast(world, proposal)
    assert checked[1]
    assert (np.abs(mean - limit) <= 5 * error + 0.01 * limit + 1e-9)[checked].all()
    assert limit[checked].min() < 0.75  # else the line above proves little


@pytest.mark.parametrize("proposal", ["delayed", "rbpf-prior", "rbpf-optimal"])
def test_forecast_goes_on_after_resampling(proposal):
    """Within five standard errors, and a bias of 2 %; no forecast ratio is so near the threshold that runs disagree."""
    world = cut(reference(1).problem, 7)
    limit = 10 ** theory.forecast(world, proposal, ess_threshold=0.3)
    assert (np.abs(limit - 0.3) > 0.03).all()
    mean, error = by_simulation(world, proposal, 20_000, 12, ess_threshold=0.3)
    assert (np.abs(mean - limit) <= 5 * error + 0.02 * limit).all()
    once = 10 ** theory.forecast(world, proposal)
    after = int(np.argmax(limit <= 0.3))
    np.testing.assert_array_equal(limit[: after + 1], once[: after + 1])
    assert (limit[after + 1 :] > 2 * once[after + 1 :]).all()
    assert (theory.forecast(world, proposal, ess_threshold=1.0) >= theory.forecast(world, proposal)).all()
    with pytest.raises(InputError, match="ess_threshold must be between 0 and 1, not 2"):
        theory.forecast(world, proposal, ess_threshold=2)


def test_particles_needed_and_reach():
    world = reference(1).problem
    forecast = theory.forecast(world, "rbpf-optimal")
    needed = theory.particles_needed(world, "rbpf-optimal", ess=10)
    np.testing.assert_allclose(needed, 1 - forecast)
    size = int(10 ** needed[5] * 1.01)
    last = theory.reach(world, "rbpf-optimal", size)
    assert last >= 5
    assert (needed[: last + 1] <= np.log10(size)).all()
    assert needed[last + 1] > np.log10(size)
    assert theory.reach(world, "prior", 5) == -1  # not even 10 at the start
    assert theory.reach(WORLDS["nothing-seen"](), "prior", 10) == 29


def test_predicted_error_is_what_the_bootstrap_filter_does():
    """Multinomial resampling at every step: the spread of its mean over runs, within five standard errors."""
    world = cut(problem(full_scenario(1, 8), 8), 5)
    n_particles, runs = 2000, 800
    stds, needed = theory.predicted_error(world, n_particles)
    answers = [
        sir(
            world, np.random.default_rng([s, 4]), n_particles=n_particles, ess_threshold=1, resample="multinomial"
        ).means
        for s in range(runs)
    ]
    observed = np.std(answers, axis=0, ddof=1)
    checked = ~np.isnan(stds) & (needed <= n_particles / 10)[:, None] & (stds > 0)
    assert checked[1:].all()
    ratio = observed[checked] / stds[checked]
    # 5 standard errors of a deviation over 800 runs are 12.5 %; terms of higher order in 1 / N get 4 % more
    assert (np.abs(ratio - 1) <= 5 / np.sqrt(2 * runs) + 0.04).all()


def test_predicted_error_at_time_0_is_that_of_independent_draws():
    world = WORLDS["full-3-all-seen"]()
    stds, _ = theory.predicted_error(world, 10_000)
    np.testing.assert_allclose(stds[0], np.sqrt(np.diag(world.model.P0) / 10_000))


def test_the_handout_needs_very_many_particles():
    """10^5 for 0.3 deviations at k = 2, 10^10 at k = 49; where fewer are asked for, no number is given."""
    world = reference(1).problem
    stds, needed = theory.predicted_error(world, 100_000)
    assert np.log10(needed[[2, 49]]) == pytest.approx([5, 10], abs=0.6)
    assert np.isfinite(stds[:3]).all()
    assert np.isnan(stds[49]).all()
    assert not stds[0, :2].any()  # the robot is known at the start
    exact = kalman(world)
    ratios = stds[1:3] / exact.stds[1:3]
    assert (ratios <= 0.3).all()
    halved, _ = theory.predicted_error(world, 400_000)
    np.testing.assert_allclose(halved[:3], stds[:3] / 2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda world: theory.forecast(world, "best"), "Unknown proposal 'best'; known are prior, optimal, delayed"),
        (lambda world: theory.particles_needed(world, "prior", ess=0.5), "ess must be at least 1"),
        (lambda world: theory.particles_needed(world, "prior", ess=float("nan")), "ess must be at least 1"),
        (lambda world: theory.reach(world, "prior", 0), "n_particles must be at least 1"),
        (lambda world: theory.predicted_error(world, 0), "n_particles must be at least 1"),
    ],
)
def test_bad_arguments(call, message):
    with pytest.raises(InputError, match=message):
        call(WORLDS["full-1"]())
