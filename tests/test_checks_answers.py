"""The checks as a student meets them: right answers pass, wrong ones are named, whatever else a function does."""

import functools
import time

import numpy as np
import pytest
from bank import CODES, HERE, RANDOM, chaff, chaffs, load, verdict_on_chaff, verdict_on_wheat, wheats

from lab import given
from lab import weights as lab_weights
from lab.checks import QUESTIONS, Verdict, check, exact, forms, naming, reference, trials, worlds
from lab.checks.inputs import cases
from lab.checks.mistakes import CATALOGUE, mutants
from lab.result import Filtered
from lab.solvers import kalman
from lab.validation import InputError

EXACT = [key for key in CODES if key in forms.forms()]
QUICK = [wheat for wheat in wheats() if wheat[1] not in RANDOM]
# of the random ones, the rest is run by the bank
SLOW = [wheat for wheat in wheats() if wheat[1] in RANDOM and wheat[0] in ("plain.py", "rows.py", "resamples_last.py")]
WRONG = [entry for entry in chaffs() if entry[1] not in RANDOM]
WRONG_RANDOM = [entry for entry in chaffs() if entry[1] in RANDOM]


@pytest.mark.parametrize(("name", "key"), [*QUICK, *SLOW])
def test_right_answers_pass(name, key):
    verdict = verdict_on_wheat(name, key)
    assert verdict.passed, verdict
    assert verdict.reason.startswith("public checks passed (")
    assert "correct" not in str(verdict)


def test_the_bank_is_large_enough():
    assert len({name for name, _ in wheats()}) >= 15
    assert len(CATALOGUE) >= 45
    assert {key for _, key in wheats()} == set(CODES)
    named = {mistake for *_, mistake in chaffs() if mistake}
    assert len(named) >= 45


@pytest.mark.parametrize("key", sorted({key for _, key, _ in WRONG}))
def test_wrong_answers_are_refused_and_named(key):
    unnamed = []
    for number, question, mistake in WRONG:
        if question == key:
            verdict = verdict_on_chaff(number, key)
            assert not verdict.passed, (number, mistake)
            assert verdict.answered
            if mistake and mistake not in verdict.mistake.split():
                unnamed.append((number, mistake, verdict.mistake))
            if verdict.mistake:
                assert verdict.hint
    assert not unnamed


@pytest.mark.parametrize(("number", "key", "mistake"), WRONG_RANDOM[::12])
def test_wrong_random_answers_are_refused(number, key, mistake):
    verdict = verdict_on_chaff(number, key)
    assert not verdict.passed
    assert mistake in (*verdict.mistake.split(), "")


@pytest.mark.parametrize("key", EXACT)
def test_every_mutant_differs_from_the_right_answer(key):
    """Else its mistake could not be found, or a right answer would be called by its name."""
    right = naming.right_results(key)
    tolerant = [
        mistake
        for number, (mistake, _) in enumerate(mutants(key))
        if all(naming.same(naming.of_mutant(key, number, i), right[i], naming.ACCEPTED) for i in range(len(right)))
    ]
    assert not tolerant
    assert {mistake for mistake, _ in mutants(key)} <= set(CATALOGUE)


def test_the_reference_steps_against_the_laboratory():
    """The one Kalman step and the particle steps are held against filters that share no line with them."""
    for problem in worlds.problems().values():
        means, covs = reference.kalman_filter(problem)
        expected = kalman(problem)
        np.testing.assert_allclose(means, expected.means, atol=1e-9)
        np.testing.assert_allclose(covs, expected.covs, atol=1e-9)


def test_the_reference_densities_against_scipy():
    from scipy.stats import multivariate_normal as normal

    for case in cases("q2c"):
        z, particles, H, R = case.calls[0]
        seen = ~np.isnan(z)
        if seen.any():
            expected = normal.logpdf((z[seen, None] - H[seen] @ particles).T, cov=R[seen][:, seen])
            np.testing.assert_allclose(reference.log_likelihood(z, particles, H, R), expected, rtol=1e-10)
    for case in cases("q2a"):
        for x, model in case.calls:
            expected = normal.logpdf(x, model.m0, model.P0, allow_singular=True)
            assert reference.log_prior(x, model) == pytest.approx(expected, rel=1e-9)


def test_the_reference_moments_against_numpy():
    for case in cases("q4a"):
        particles, w = case.calls[0]
        mean, cov = reference.moments(particles, w)
        np.testing.assert_allclose(mean, lab_weights.moments(particles, w)[0])
        np.testing.assert_allclose(cov, np.cov(particles, aweights=w, ddof=0), atol=1e-12)


def test_an_rbpf_step_against_a_kalman_filter_of_a_single_particle():
    """A particle's landmarks are those of a Kalman filter whose robot is known."""
    robots, means, cov, w, noise, z, H, R, model = cases("q10-step")[1].calls[0]
    moved, maps, left, weights = reference.rbpf_step(robots, means, cov, w, noise, z, H, R, model)
    seen = ~np.isnan(z)
    for i in range(3):
        P = np.zeros((len(model.m0), len(model.m0)))
        P[2:, 2:] = cov
        x = np.append(moved[:, i], means[:, i])
        S = H[seen] @ P @ H[seen].T + R[seen][:, seen]
        K = P @ H[seen].T @ np.linalg.inv(S)
        np.testing.assert_allclose((x + K @ (z[seen] - H[seen] @ x))[2:], maps[:, i])
        np.testing.assert_allclose((P - K @ S @ K.T)[2:, 2:], left, atol=1e-12)
    assert weights.sum() == pytest.approx(1)


# what a function may do beside answering


def ess(weights):
    return 1 / np.sum(weights**2)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda w: None, "nothing comes back (None): is there a return at the end?"),
        (lambda w: "7", "ess holds text, not real numbers"),
        (lambda w: 1j, "ess holds complex numbers, not real numbers"),
        (lambda w: w > 0, "ess holds truth values, not real numbers"),
        (lambda w: [[1, 2], [3]], "no rectangular array of numbers"),
        (lambda w: {"ess": 3}, "ess is a dict, not an array of numbers"),
        (lambda w: np.ma.masked_array([1.0]), "ess is a masked array: return a plain one"),
        (lambda w: np.float32(1 / np.sum(w**2)), "ess is computed in float32"),
        (lambda w: w, "ess has shape (17,) where () = () is asked for"),
        (lambda w: np.nan, "ess holds NaN"),
        (lambda w: 1 / 0, "raises ZeroDivisionError: division by zero"),
        (lambda w: absent, "name 'absent' is not defined"),  # noqa: F821
        (lambda w: sys_exit(), "it leaves Python (SystemExit) instead of returning"),
        (lambda w: forever(), "it calls itself without end (RecursionError)"),
        (lambda w: lab_weights.ess(w), "the answer calls lab.weights.ess: that is the laboratory's own"),
        (lab_weights.ess, "the answer calls lab.weights.ess"),
        (3, "the answer is an int, not a function"),
        (ess(np.ones(3) / 3), "the answer is a float64, not a function"),
        (lambda: 3, "is called as effective_sample_size(weights): too many positional arguments"),
        (lambda w, threshold: 3, "missing a required argument: 'threshold'"),
    ],
)
def test_each_way_to_fail_has_its_sentence(answer, words):
    verdict = check("q5", answer)
    assert not verdict.passed
    assert verdict.answered
    assert words.lower() in verdict.reason.lower()


def sys_exit():
    raise SystemExit


def forever():
    return forever()


@pytest.mark.parametrize("answer", [None, ...])
def test_no_answer_is_not_a_wrong_one(answer):
    verdict = check("q5", answer)
    assert (verdict.passed, verdict.answered, verdict.status) == (False, False, "not answered yet")


@pytest.mark.parametrize("key", CODES)
def test_a_stub_is_not_answered_yet(key):
    scope = {}
    exec(f"def {CODES[key].call}:\n    raise NotImplementedError", scope)
    verdict = check(key, scope[CODES[key].function])
    assert verdict.status == "not answered yet"
    assert "NotImplementedError" in verdict.reason


def test_a_function_that_hangs_is_stopped(monkeypatch):
    monkeypatch.setattr(trials, "SECONDS", 0.3)
    monkeypatch.setattr(forms, "SECONDS", 0.3)

    def hangs(weights):
        while True:
            try:  # noqa: SIM105
                time.sleep(0.01)
            except Exception:
                pass

    start = time.monotonic()
    verdict = check("q5", hangs)
    assert "did not come back within 0.3 s" in verdict.reason
    assert time.monotonic() - start < 5


def test_a_platform_without_a_timer_is_named(monkeypatch):
    from lab.checks import guard

    monkeypatch.setattr(guard, "_has_timer", lambda: False)
    verdict = check("q5", ess)
    assert verdict.passed
    assert "time limit of 20 s is inactive here" in verdict.notes[0]
    assert "Note: the time limit" in str(verdict)


def test_edited_arguments_are_named():
    def step(particles, weights, noise, z, H, R, model):
        particles += noise
        return reference.sis_step(particles - noise, weights, noise, z, H, R, model)

    with_lab_calls_allowed = exact.examine(CODES["q4-step"], step, lambda module, name: False)
    assert "edits its argument particles in place" in with_lab_calls_allowed.reason


def test_nothing_that_a_function_does_to_a_problem_stays():
    """The checks share their worlds: an answer that breaks into one must not spoil it for the next."""

    def breaks_in(problem):
        for array in (problem.z, problem.H, problem.R, problem.model.m0):
            array.flags.writeable = True
            array[:] = 7
        object.__setattr__(problem, "z", problem.z[:3])
        return reference.kalman_filter(problem)

    assert not exact.examine(CODES["q1d-filter"], breaks_in, lambda module, name: False).passed
    assert exact.examine(CODES["q1d-filter"], reference.kalman_filter, lambda module, name: False).passed

    def edits(filtered, exact_answer):
        filtered.means[1:] -= exact_answer.means[1:]
        return np.sqrt(np.mean((filtered.means[1:] / exact_answer.stds[1:]) ** 2))

    assert "edits its argument filtered in place" in check("q8-gap", edits).reason


def test_prints_and_global_draws_leave_no_trace(capsys):
    def noisy(weights):
        print("debugging")
        np.random.seed(3)  # noqa: NPY002
        return 1 / np.sum(weights**2)

    before = np.random.get_state()[1].copy()  # noqa: NPY002
    verdict = check("q5", noisy)
    assert verdict.passed
    assert "prints" in verdict.hint
    assert "global random generator" in verdict.hint
    assert capsys.readouterr().out == ""
    assert np.array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_the_notebooks_data_are_named():
    scope = {"np": np, "X": np.sqrt(np.arange(600.0)).reshape(12, 50), "__name__": "notebook"}
    source = chaff_source_with_truth()
    exec(source, scope)
    verdict = check("q1d-step", scope["kalman_step"])
    assert verdict.mistake == "true-state"


def chaff_source_with_truth():
    return """
def kalman_step(mean, cov, z, H, R, model):
    mean = model.F @ mean + model.B
    cov = model.F @ cov @ model.F.T + model.Q
    ok = ~np.isnan(z)
    if ok.any():
        n = min(len(mean), len(X))
        S = H[ok] @ cov @ H[ok].T + R[ok][:, ok]
        K = cov @ H[ok].T @ np.linalg.inv(S)
        mean = mean + K @ (z[ok] - H[ok][:, :n] @ X[:n, 3])
        cov = cov - K @ S @ K.T
    return mean, cov
"""


def test_a_replaced_numpy_is_noticed_and_put_back(monkeypatch):
    """The checks compute with numpy, so that a student's abs, shadowing np.abs, would make everything right."""

    def effective_sample_size(weights):
        np.abs = lambda a: 0 * np.asarray(a)
        return 3.0

    before = np.abs
    monkeypatch.setattr(np, "abs", before)
    verdict = check("q5", effective_sample_size)
    assert not verdict.passed
    assert "replaced (abs)" in verdict.reason
    assert np.abs is before


def test_errors_and_results_that_raise_when_looked_at():
    class Odd(Exception):
        def __str__(self):
            raise RuntimeError

    class Box:
        def __array__(self, *args, **kwargs):
            raise RuntimeError

    def raises(weights):
        raise Odd

    def chatters(weights):
        raise ValueError("x" * 10**6)

    assert "It raises Odd" in check("q5", raises).reason
    assert len(check("q5", chatters).reason) < 500
    assert "Ess is a Box, not an array of numbers" in check("q5", lambda weights: Box()).reason


def test_rounded_quantiles_are_right_and_neighbours_are_not():
    def corridor_of(factor):
        return lambda means, covs: (means - factor * _stds(covs), means + factor * _stds(covs))

    passed = [
        factor for factor in (2.9, 2.93, 2.9677, 2.97, 3.0, 3.02, 3.035, 3.1) if check_corridor(corridor_of(factor))
    ]
    assert passed == [2.93, 2.9677, 2.97, 3.0, 3.02]

    def ellipse_of(radius):
        angles = np.linspace(0, 2 * np.pi, 60)
        circle = np.array([np.cos(angles), np.sin(angles)])
        return lambda mean, cov, n_points: mean[:, None] + radius * np.linalg.cholesky(cov) @ circle

    passed = [r for r in (3.0, 3.03, 3.035, 9.21**0.5, 3.04, 3.06) if check("q4b-ellipse", ellipse_of(r)).passed]
    assert passed == [3.03, 3.035, 9.21**0.5, 3.04]


def _stds(covs):
    return np.sqrt(np.diagonal(covs, axis1=1, axis2=2))


def check_corridor(answer):
    return check("q4b-corridor", answer).passed


def test_advice_at_the_edges():
    """What happens once in 10^15 draws, or by convention, is advice and no failure."""

    def select_ancestors(weights, points):
        return np.searchsorted(np.cumsum(weights), points)

    verdict = check("q6-ancestors", select_ancestors)
    assert verdict.passed
    assert "through rounding" in verdict.hint

    def sir_step(particles, weights, noise, points, z, H, R, model, threshold):
        if 1 / np.sum(weights**2) < threshold * len(weights):
            particles, weights = particles[:, reference.select_ancestors(weights, points)], np.full(len(weights), 1.0)
        return reference.sis_step(particles, weights / weights.sum(), noise, z, H, R, model)

    verdict = exact.examine(next(q for q in QUESTIONS if q.key == "q6-step"), sir_step, lambda module, name: False)
    assert verdict.passed
    assert "The table says <=" in verdict.hint


@pytest.mark.parametrize(("shifted", "said"), [("likelihoods", "Beside a particle of weight 0"), ("sum", "")])
def test_advice_on_the_maximum_that_is_shifted_by(shifted, said):
    """Of the log-likelihoods alone it is right until a particle without weight is 745 ahead of all others."""

    def log_evidence_increment(weights, log_likelihoods):
        shift = log_likelihoods.max()
        if shifted == "sum":
            shift = np.max(np.log(weights) + log_likelihoods)
        return shift + np.log(np.sum(weights * np.exp(np.where(weights > 0, log_likelihoods - shift, 0))))

    verdict = check("q4-evidence", log_evidence_increment)
    assert verdict.passed, verdict
    assert verdict.hint.startswith(said)
    assert bool(verdict.hint) == bool(said)


def test_two_mistakes_that_agree_are_both_named():
    number = next(n for n, key, mistake in chaffs() if (key, mistake) == ("q6-step", "particles-not-resampled"))
    verdict = check("q6-step", chaff(number))
    assert set(verdict.mistake.split()) == {"particles-not-resampled", "uniform-choice"}
    assert verdict.reason.startswith("Either ")


def test_texts_are_not_checked():
    with pytest.raises(InputError, match="q1a asks for a text, which a person reads and marks"):
        check("q1a", "because")


# filters


@pytest.mark.parametrize("key", ["q4-filter", "q6-filter"])
def test_row_0_may_hold_the_prior_itself(key):
    """As that of the Kalman filter does: it is no sign of a cloud of another size, nor of landmarks that move."""
    plain = load((HERE / "wheats" / "plain.py").read_text(encoding="utf-8"))[CODES[key].function]

    @functools.wraps(plain)
    def answer(problem, rng, *, n_particles, **options):
        run = plain(problem, rng, n_particles=n_particles, **options)
        run.means[0], run.covs[0] = problem.model.m0, problem.model.P0
        return run

    verdict = check(key, answer)
    assert verdict.passed, verdict
    assert verdict.hint.startswith("Row 0 holds the moments of the prior itself")


def test_a_threshold_that_is_taken_and_not_used_is_named():
    """So that notebook 03 does not compare five times the same filter."""
    (number,) = [number for number, key, mistake in chaffs() if (key, mistake) == ("q6-filter", "threshold-typed")]
    verdict = verdict_on_chaff(number, "q6-filter")
    assert verdict.mistake == "threshold-typed", verdict


@pytest.mark.parametrize(("tolerance", "said"), [(1e-8, ""), (1e-12, "The landmarks of the simulator move by 1e-10 m")])
def test_a_transition_that_the_simulator_makes_is_possible(tolerance, said):
    def log_transition(x_next, x, model):
        d, free = x_next - model.F @ x - model.B, np.diag(model.Q) > 1e-16
        if np.any(np.abs(d[~free]) > tolerance):
            return -np.inf
        return -0.5 * d[free] @ np.linalg.solve(model.Q[free][:, free], d[free])

    verdict = check("q2b", log_transition)
    assert verdict.passed, verdict
    assert verdict.hint.startswith(said)
    assert bool(verdict.hint) == bool(said)


def test_a_hint_speaks_of_what_the_question_has():
    """Nobody who computes an effective sample size can start with one landmark."""
    assert check("q5", lambda weights: 3.14).hint.endswith("by hand, with two particles.")
    assert check("q8-gap", lambda filtered, exact: 3.14).hint.endswith("start with the simplest one, by hand.")
    assert check("q11-observe", lambda r, landmark: (r[:2], np.ones((2, 3)), np.eye(2))).hint.endswith("one landmark.")


def test_an_exact_filter_is_no_particle_filter():
    def sis(problem, rng, *, n_particles):
        means, covs = [problem.model.m0], [problem.model.P0]
        for _ in range(1, problem.n_instants):
            means.append(means[-1])
            covs.append(covs[-1])
        return Filtered(np.array(means), np.array(covs), np.zeros(len(means)))

    assert check("q4-filter", sis).mistake == "not-random"


def test_a_filter_of_the_laboratory_is_recognised():
    from lab import solvers

    def sir(problem, rng, *, n_particles):
        return solvers.sir(problem, rng, n_particles=n_particles)

    assert check("q6-filter", sir).mistake == "calls-the-lab"
    assert check("q6-filter", solvers.sir).mistake == "calls-the-lab"


@pytest.mark.parametrize("question", [q for q in QUESTIONS if q.function], ids=lambda question: question.key)
def test_a_given_answer_is_none_to_its_own_question(question):
    right = getattr(given, question.function)

    def answer(*args, **options):
        return right(*args, **options)

    for handed_in in (right, answer):
        verdict = check(question.key, handed_in)
        assert verdict.mistake == "calls-the-lab"
        assert f"calls lab.given.{question.function}:" in verdict.reason


def test_a_given_answer_helps_with_another_question():
    def jittered_step(particles, weights, noise, jitter, z, H, R, model):
        moved = noise + np.vstack([np.zeros((2, jitter.shape[1])), jitter])
        return given.sis_step(particles, weights, moved, z, H, R, model)

    assert check("q3-jitter", jittered_step).passed


def test_a_wrong_type_of_result_is_named():
    def sis(problem, rng, *, n_particles):
        return rng.random(3), 4

    assert "it returned tuple, not lab.result.Filtered" in check("q4-filter", sis).reason


# the verdict


def test_a_verdict_in_words_and_in_a_notebook():
    verdict = Verdict("q5", False, "1 < 2 & so on", "look", "ess-inverse", ("a note",))
    assert str(verdict) == "[x] q5 not passed: 1 < 2 & so on\n    Hint: look\n    Note: a note"
    shown = verdict._repr_html_()
    assert "1 &lt; 2 &amp; so on" in shown
    assert 'aria-label="Check of q5: not passed"' in shown
    assert "&#10007;" in shown
    assert repr(verdict) == str(verdict)
    passed = Verdict("q5", True, "public checks passed (3/3).", "faster")
    assert "Advice: faster" in str(passed)
    assert max(map(len, str(Verdict("q5", True, "word " * 100)).splitlines())) <= 100
    with pytest.raises(AttributeError):
        verdict.passed = True


def test_hints_do_not_contain_code():
    """A hint that can be pasted would be the answer."""
    for mistake in CATALOGUE.values():
        for call in ("np.", "inv(", "@ ", "return ", "[rows]"):
            assert call not in mistake.hint, mistake
