"""The table of questions: what each one asks for, as data.

Question answered: under which name, with which arguments, shapes and units is an answer looked for?  The notebooks, the
checks, the grader and the table at the head of ``solutions/README.md`` all read it here.  The symbols of the shapes:

    N   instants k = 0..N-1, time always first       M   landmarks
    n   2 + 2M components of the state               P   particles, dimension first: (n, P)

Unseen entries of z, H and R are NaN, as in `lab.problem.Problem`; ``model`` is a `lab.problem.LinearGaussianModel` with
F, B, Q, m0, P0.  Lengths are in metres, variances in m^2, densities per m^d.  Source: the questions of the handout.
Those of EKF-SLAM, whose symbols are other ones, come from `lab.checks.ekf_questions`.
"""

from lab.checks.ekf_questions import EKF_QUESTIONS
from lab.checks.question import CODE, TEXT, Question, Value
from lab.validation import InputError

__all__ = ["BY_KEY", "CODE", "NOTEBOOKS", "QUESTIONS", "TEXT", "Question", "Value", "as_markdown", "question_named"]

NOTEBOOKS = (
    "01_simulation_and_modeling",
    "02_sis",
    "03_sir",
    "04_importance_function",
    "05_rao_blackwellized",
    "06_ekf_slam",
)

MODEL = Value("model", "LinearGaussianModel", "F, B, Q, m0, P0")
PROBLEM = Value("problem", "Problem", "model, z (N, 2M), H (N, 2M, n), R (N, 2M, 2M)")
RNG = Value("rng", "numpy Generator", "all randomness")
Z = Value("z", "(2M,)", "measurement [m], NaN where unseen")
H = Value("H", "(2M, n)", "its matrix, NaN rows where unseen")
R = Value("R", "(2M, 2M)", "its noise covariance [m^2], NaN rows and columns where unseen; a (2, 2) block a landmark")
MEAN = Value("mean", "(n,)", "[m]")
COV = Value("cov", "(n, n)", "[m^2]")
PARTICLES = Value("particles", "(n, P)", "one a column [m]")
WEIGHTS = Value("weights", "(P,)", "sum to 1")
NOISE = Value("noise", "(n, P)", "w_k of each particle, already drawn from N(0, Q) [m]; 0 for landmarks")
JITTER = Value("jitter", "(2M, P)", "motion of the landmarks, already drawn [m]")
POINTS = Value("points", "(P,)", "in [0, 1), ascending")
ROBOTS = Value("robots", "(2, P)", "robot of each particle [m]")
MAPS = Value("means", "(2M, P)", "conditional means of the landmarks [m]")
MAP_COV = Value("cov", "(2M, 2M)", "their conditional covariance [m^2], the same for all particles")
N_PARTICLES = Value("n_particles", "int", "P")
FILTERED = Value("filtered", "lab.result.Filtered", "means (N, n), covs (N, n, n), log_evidence (N,), ess (N,) or None")
ROWS = "for the check particles one a row, (P, n), in and out; the other cells want columns"
SOLVER = ", rng, *, n_particles)"
OWN_CHOICE = "any order of the draws; a keyword landmark_noise=STD declares jitter as part of the model"

QUESTIONS: tuple[Question, ...] = (
    Question("q1a", TEXT, 2, NOTEBOOKS[0], "Explain the animation"),
    Question("q1b", TEXT, 2, NOTEBOOKS[0], "The meaning of the sixteen outputs"),
    Question("q1c", TEXT, 4, NOTEBOOKS[0], "Why the Kalman filter is the exact Bayes solution"),
    Question(
        "q1d-step",
        CODE,
        4,
        NOTEBOOKS[0],
        "One Kalman step: predict to k, then update with what is seen at k",
        "kalman_step",
        "kalman_step(mean, cov, z, H, R, model)",
        (MEAN, COV, Z, H, R, MODEL),
        (MEAN, COV),
        "any form of the update",
    ),
    Question(
        "q1d-filter",
        CODE,
        3,
        NOTEBOOKS[0],
        "The whole filter; row 0 is the prior",
        "kalman_filter",
        "kalman_filter(problem)",
        (PROBLEM,),
        (Value("means", "(N, n)", "[m]"), Value("covs", "(N, n, n)", "[m^2]")),
        "for the check a Filtered, too; the other cells want two arrays",
    ),
    Question("q2", TEXT, 5, NOTEBOOKS[0], "Closed forms of prior, transition (landmarks moving or not) and likelihood"),
    Question(
        "q2a",
        CODE,
        2,
        NOTEBOOKS[0],
        "log p(x_0); components without variance are known exactly",
        "log_prior",
        "log_prior(x, model)",
        (Value("x", "(n,)", "state at k = 0 [m]"), MODEL),
        (Value("log density", "()", "of the components that have a variance; -inf where a known one differs"),),
        "a constant",
    ),
    Question(
        "q2b",
        CODE,
        2,
        NOTEBOOKS[0],
        "log p(x_k given x_{k-1}); noise below 1e-8 m is none, other landmark noise counts",
        "log_transition",
        "log_transition(x_next, x, model)",
        (Value("x_next", "(n,)", "x_k [m]"), Value("x", "(n,)", "x_{k-1} [m]"), MODEL),
        (Value("log density", "()", "of the components that have noise; -inf where one without noise moves"),),
        "a constant",
    ),
    Question(
        "q2c",
        CODE,
        3,
        NOTEBOOKS[0],
        "log p(z_k given x_k) for every particle, from what is seen",
        "log_likelihood",
        "log_likelihood(z, particles, H, R)",
        (Z, PARTICLES, H, R),
        (Value("log density", "(P,)", "0 when nothing is seen"),),
        f"a constant; {ROWS}",
    ),
    Question("q3", TEXT, 4, NOTEBOOKS[1], "The SIS algorithm with the prior dynamics as importance function"),
    Question(
        "q3-jitter",
        CODE,
        2,
        NOTEBOOKS[1],
        "A step of SIS in a model whose landmarks move a little",
        "jittered_step",
        "jittered_step(particles, weights, noise, jitter, z, H, R, model)",
        (PARTICLES, WEIGHTS, NOISE, JITTER, Z, H, R, MODEL),
        (PARTICLES, WEIGHTS),
        ROWS,
    ),
    Question(
        "q4-step",
        CODE,
        4,
        NOTEBOOKS[1],
        "A step of SIS: move with the given noise, then weight",
        "sis_step",
        "sis_step(particles, weights, noise, z, H, R, model)",
        (PARTICLES, WEIGHTS, NOISE, Z, H, R, MODEL),
        (PARTICLES, WEIGHTS),
        ROWS,
    ),
    Question(
        "q4-evidence",
        CODE,
        2,
        NOTEBOOKS[1],
        "What step k adds to the log-evidence",
        "evidence_increment",
        "evidence_increment(weights, log_likelihoods)",
        (
            Value("weights", "(P,)", "carried over from k - 1, sum to 1"),
            Value("log_likelihoods", "(P,)", "log p(z_k given x_k) of each particle, often near -800"),
        ),
        (Value("increment", "()", "log p(z_k given z_1..z_{k-1}), estimated; in terms of these two alone"),),
    ),
    Question(
        "q4-filter",
        CODE,
        3,
        NOTEBOOKS[1],
        "The SIS filter, started as the simulator says",
        "sis",
        f"sis(problem{SOLVER}",
        (PROBLEM, RNG, N_PARTICLES),
        (FILTERED,),
        OWN_CHOICE,
    ),
    Question(
        "q4a",
        CODE,
        2,
        NOTEBOOKS[1],
        "Mean and covariance of a weighted cloud",
        "moments",
        "moments(particles, weights)",
        (PARTICLES, WEIGHTS),
        (MEAN, Value("cov", "(n, n)", "of the weighted points themselves [m^2]: no correction for P")),
        ROWS,
    ),
    Question(
        "q4b-corridor",
        CODE,
        1,
        NOTEBOOKS[1],
        "99.7 % corridor of every component",
        "corridor",
        "corridor(means, covs)",
        (Value("means", "(N, n)", "[m]"), Value("covs", "(N, n, n)", "[m^2]")),
        (Value("lower", "(N, n)", "[m]"), Value("upper", "(N, n)", "[m]")),
        "3 deviations, or the exact quantile",
    ),
    Question(
        "q4b-ellipse",
        CODE,
        2,
        NOTEBOOKS[1],
        "Boundary of the 99 % ellipse of a point of the plane",
        "confidence_ellipse",
        "confidence_ellipse(mean, cov, n_points=100)",
        (Value("mean", "(2,)", "[m]"), Value("cov", "(2, 2)", "[m^2]"), Value("n_points", "int", "how many points")),
        (Value("points", "(2, n_points)", "on the boundary, once around, one after the other [m]"),),
        "first point, sense of rotation; (n_points, 2)",
    ),
    Question(
        "q5",
        CODE,
        1,
        NOTEBOOKS[1],
        "Effective sample size",
        "effective_sample_size",
        "effective_sample_size(weights)",
        (WEIGHTS,),
        (Value("ess", "()", "between 1 and P"),),
    ),
    Question("q5-text", TEXT, 4, NOTEBOOKS[1], "Several N: which difficulties, and why"),
    Question(
        "q6-ancestors",
        CODE,
        2,
        NOTEBOOKS[2],
        "From points of [0, 1) to ancestors, by the cumulative weights",
        "select_ancestors",
        "select_ancestors(weights, points)",
        (WEIGHTS, POINTS),
        (Value("ancestors", "(P,) int", "index of the particle in whose share of [0, 1) each point falls"),),
        "the order of the ancestors",
    ),
    Question(
        "q6-resample",
        CODE,
        2,
        NOTEBOOKS[2],
        "Resample: any scheme that gives particle i on average P w_i offspring",
        "resample",
        "resample(weights, rng)",
        (WEIGHTS, RNG),
        (Value("ancestors", "(P,) int", "indices of particles"),),
        "the scheme; the order of the ancestors",
    ),
    Question(
        "q6-step",
        CODE,
        3,
        NOTEBOOKS[2],
        "A step of SIR: resample at the given points when ESS <= threshold P, then move, then weight",
        "sir_step",
        "sir_step(particles, weights, noise, points, z, H, R, model, threshold)",
        (PARTICLES, WEIGHTS, NOISE, POINTS, Z, H, R, MODEL, Value("threshold", "float", "in [0, 1], a ratio of P")),
        (PARTICLES, WEIGHTS),
        f"{ROWS}; after resampling particle j is the one of point j",
    ),
    Question(
        "q6-filter",
        CODE,
        3,
        NOTEBOOKS[2],
        "The SIR filter",
        "sir",
        "sir(problem, rng, *, n_particles, ess_threshold=0.5)",
        (PROBLEM, RNG, N_PARTICLES, Value("ess_threshold", "float", "resample when ESS <= ess_threshold P")),
        (FILTERED,),
        f"the scheme; {OWN_CHOICE}; ess_threshold may be left out",
    ),
    Question("q6-text", TEXT, 3, NOTEBOOKS[2], "Which threshold, and why"),
    Question(
        "q7",
        CODE,
        3,
        NOTEBOOKS[2],
        "Loop closures, and what each does to every landmark",
        "loop_closures",
        "loop_closures(z, covs)",
        (
            Value("z", "(N, 2M)", "measurements [m], NaN where unseen"),
            Value("covs", "(N, n, n)", "of a filter [m^2]"),
        ),
        (
            Value("closures", "(C, 2) int", "k and landmark 0..M-1: seen at k, not at k - 1, but before; by k, then m"),
            Value("gains", "(C, M)", "1 - trace(P_m at k) / trace(P_m at k - 1) for every landmark m"),
        ),
    ),
    Question("q7-text", TEXT, 4, NOTEBOOKS[2], "Loop closure: how one landmark sharpens the others"),
    Question(
        "q8-gap",
        CODE,
        2,
        NOTEBOOKS[2],
        "Root mean square, over k >= 1 and components, of (mean - exact mean) / exact deviation",
        "mean_gap",
        "mean_gap(filtered, exact)",
        (
            Value("filtered", "Filtered", "of a particle filter"),
            Value("exact", "Filtered", "of the Kalman filter, on the same data"),
        ),
        (Value("gap", "()", "in exact deviations"),),
    ),
    Question(
        "q8-study",
        CODE,
        2,
        NOTEBOOKS[2],
        "Mean gap for several P, over several runs, by lab.compare or by hand",
        "study",
        "study(problem, solver, sizes, runs, seed)",
        (
            PROBLEM,
            Value("solver", "function", "solver(problem, rng, *, n_particles) -> Filtered"),
            Value("sizes", "list of int", "the P to try"),
            Value("runs", "int", "runs of each, at least 2"),
            Value("seed", "int", "of the study"),
        ),
        (Value("table", "(len(sizes), 3)", "a row per size: P, mean gap, its standard error sd / sqrt(runs)"),),
        "how the runs are seeded, if each has its own numbers",
    ),
    Question("q8-text", TEXT, 3, NOTEBOOKS[2], "Exact against estimated moments: what the study says"),
    Question(
        "q9",
        CODE,
        4,
        NOTEBOOKS[3],
        "Another importance function, which uses the dynamics and the measurement",
        "propose",
        "propose(particles, k, problem, rng)",
        (Value("particles", "(n, P)", "at k - 1, one a column [m]"), Value("k", "int", "instant"), PROBLEM, RNG),
        (
            Value("particles", "(n, P)", "at k [m]"),
            Value("log_increments", "(P,)", "log [p(z_k given x_k) p(x_k given x_{k-1}) / q(x_k given x_{k-1}, z_k)]"),
        ),
        f"any properly weighted importance function; a constant; {ROWS}",
    ),
    Question(
        "q9-filter",
        CODE,
        2,
        NOTEBOOKS[3],
        "The filter that uses it",
        "guided",
        f"guided(problem{SOLVER}",
        (PROBLEM, RNG, N_PARTICLES),
        (FILTERED,),
        OWN_CHOICE,
    ),
    Question("q9-text", TEXT, 4, NOTEBOOKS[3], "Its weight, derived"),
    Question("q10-text", TEXT, 3, NOTEBOOKS[4], "Why the landmarks are independent Gaussians given the robot's path"),
    Question(
        "q10-step",
        CODE,
        4,
        NOTEBOOKS[4],
        "A step of the Rao-Blackwellized filter: move the robots with the given noise, weight, update the landmarks",
        "rbpf_step",
        "rbpf_step(robots, means, cov, weights, noise, z, H, R, model)",
        (
            ROBOTS,
            MAPS,
            MAP_COV,
            WEIGHTS,
            Value("noise", "(2, P)", "already drawn from N(0, Q_R), R the robot [m]"),
            Z,
            H,
            R,
            MODEL,
        ),
        (ROBOTS, MAPS, MAP_COV, WEIGHTS),
        "any form of the update",
    ),
    Question(
        "q10-moments",
        CODE,
        2,
        NOTEBOOKS[4],
        "Mean and covariance of the state, cross terms of robot and landmarks included",
        "rbpf_moments",
        "rbpf_moments(robots, means, cov, weights)",
        (ROBOTS, MAPS, MAP_COV, WEIGHTS),
        (MEAN, COV),
    ),
    Question(
        "q10-filter",
        CODE,
        2,
        NOTEBOOKS[4],
        "The Rao-Blackwellized filter",
        "rbpf",
        f"rbpf(problem{SOLVER}",
        (PROBLEM, RNG, N_PARTICLES),
        (FILTERED,),
        f"the robot's importance function; {OWN_CHOICE}",
    ),
    *EKF_QUESTIONS,
)
BY_KEY = {question.key: question for question in QUESTIONS}


def question_named(key: str) -> Question:
    """Return the question with this key.

    Raises
    ------
    InputError
        There is none.
    """
    if not isinstance(key, str) or key not in BY_KEY:
        codes = ", ".join(question.key for question in QUESTIONS if question.kind == CODE)
        raise InputError(f"There is no question {key!r}; those with a check are {codes}.")
    return BY_KEY[key]


def as_markdown() -> str:
    """Return the table of `solutions/README.md`, a row per question, then arguments and results per function."""
    lines = [
        "| key | kind | points | notebook | what is asked | function |",
        "|---|---|---|---|---|---|",
    ]
    for question in QUESTIONS:
        call = f"`{question.call}`" if question.call else ""
        cells = (f"`{question.key}`", question.kind, str(question.points), question.notebook[:2], question.title, call)
        lines.append("| " + " | ".join(cells) + " |")
    total = sum(question.points for question in QUESTIONS)
    handout = total - sum(question.points for question in EKF_QUESTIONS)
    lines += [
        "",
        f"{handout} points for the questions of the handout, {total - handout} for EKF-SLAM: {total} in all.",
        "",
        "| function | arguments | returns | left to you |",
        "|---|---|---|---|",
    ]
    for question in QUESTIONS:
        if question.kind == CODE:
            entry = (f"`{question.function}`", _listed(question.arguments), _listed(question.returns), question.freedom)
            lines.append("| " + " | ".join(entry) + " |")
    return "\n".join(lines) + "\n"


def _listed(values: tuple[Value, ...]) -> str:
    return "<br>".join(f"`{value.name}` {value.shape}: {value.meaning}" for value in values)
