"""The words for every named mistake.

Question answered: what is a person told whose answer equals that of a known mistake?  Each entry says what was done,
and gives a hint that leads to the place and leaves the mending to the reader.
"""

from dataclasses import dataclass

from lab.checks.mistakes.ekf_catalogue import EKF_TEXTS


@dataclass(frozen=True)
class Mistake:
    """A mistake that has a name: its key, what was done, and where to look."""

    key: str
    says: str
    hint: str


_TEXTS: dict[str, tuple[str, str]] = {
    # what is seen
    "nan-kept": (
        "rows of landmarks that are not seen stay in the computation, and their NaN spreads over everything",
        "Which entries of z are numbers at this instant? Only those rows may enter.",
    ),
    "r-rows-only": (
        "rows and columns of R do not match: you kept the rows of what is seen, but not its columns (or the reverse)",
        "R is a covariance of z with itself. Which shape must it have when p components are seen?",
    ),
    "mask-flattens": (
        "a boolean mask, or a pair of lists of indices, turned H (or R) into a vector",
        "What shape has the result of A[mask], or of A[rows, rows]? Print it. One selection an axis is wanted.",
    ),
    "hidden-as-zero": (
        "landmarks that are not seen enter as if a value, such as zero, had been measured",
        "No measurement is not a measurement of zero. What should an unseen landmark do to the result?",
    ),
    "wrong-block": (
        "a measurement is attributed to the wrong columns of the state, or to the wrong landmark",
        "Write down which two components of x hold landmark i, and which two rows of z belong to it.",
    ),
    "r-linear-index": (
        "the noise block is not that of the landmarks seen: R is indexed from its top left, or by a single index",
        "Try an instant at which the first landmark is hidden, and print what you took out of R.",
    ),
    "r-one-block": (
        "one and the same noise block serves all the landmarks",
        "Each landmark has its own block in R.",
    ),
    "r-diagonal": (
        "only the diagonal of R is used",
        "The noise of the two components of a landmark may be correlated.",
    ),
    "cases-by-hand": (
        "only some numbers of visible landmarks are treated; the other cases lose measurements",
        "How many landmarks can be seen at once? One rule should serve any number of them.",
    ),
    "robot-ignored": (
        "the measurement is compared with the position of the landmark, without that of the robot",
        "What does the sensor return: where the landmark is, or where it is as seen from the robot?",
    ),
    "relative-sign": (
        "the position of the robot enters the predicted measurement with the wrong sign",
        "Draw robot, landmark and the measured vector. Which is the difference of which?",
    ),
    # units and constants
    "deviation-as-variance": (
        "a standard deviation is used where a variance belongs (a square root too many)",
        "Q, R and P0 are covariances, in m^2. Which unit does each of your numbers have?",
    ),
    "variance-squared": (
        "a variance is used where a standard deviation belongs (a square too many)",
        "Q, R and P0 are covariances, in m^2. Which unit does each of your numbers have?",
    ),
    "retyped": (
        "constants of the handout are typed into the code, and differ from those of the problem that is given",
        "Take F, B, Q, R from the arguments: the check changes them.",
    ),
    "global-data": (
        "the function reads variables of the notebook instead of its arguments",
        "A function that is called with other data must answer for those.",
    ),
    "true-state": (
        "the function uses the true state, which a robot does not know",
        "What, of all you simulated, does the robot have? The predicted measurement comes from an estimate.",
    ),
    # prediction
    "b-omitted": (
        "the constant B is left out of the prediction: means are off while covariances are right",
        "The robot turns around c, which is not the origin. Which term of the dynamics says so?",
    ),
    "wrong-b": (
        "a constant enters the prediction, but it is not B",
        "Compare with x_k = F x_{k-1} + B + w_k, term by term.",
    ),
    "f-transposed": (
        "F is transposed, or not transposed, in the wrong place: the robot turns the wrong way round",
        "For a rotation the transpose is the inverse. Check each F of your prediction.",
    ),
    "f-omitted": ("the state is not multiplied by F", "What would the robot do without noise?"),
    "noise-omitted": (
        "the noise of the dynamics is missing from the prediction",
        "The robot slips. Where does that enter?",
    ),
    "covariance-not-predicted": (
        "the covariance is not predicted: it is that of the step before when the measurement comes in",
        "Both moments change when time passes.",
    ),
    "element-wise": (
        "a product is taken element by element where a matrix product belongs",
        "In numpy * is element-wise, unlike in MATLAB.",
    ),
    "update-before-prediction": (
        "the measurement of k updates the estimate of k - 1, which is predicted afterwards",
        "At which instant is the state when z_k is measured?",
    ),
    "no-prediction-when-blind": (
        "when nothing is seen nothing happens at all, although the robot moves",
        "Does the robot stand still while it sees no landmark?",
    ),
    # update
    "innovation-sign": (
        "the innovation, or the correction, has the wrong sign",
        "When the measurement is larger than predicted, which way should the estimate move?",
    ),
    "innovation-before-prediction": (
        "the innovation is computed from the estimate before the prediction",
        "Compare z_k with what was expected at instant k.",
    ),
    "open-loop": (
        "measurements have no effect: only the prediction is returned, because the update is missing, its result is not"
        " stored, or its test is inverted",
        "Print the estimate before and after the update at an instant when something is seen.",
    ),
    "mean-not-stored": ("the covariance is updated, but not the mean", "What becomes of your new mean?"),
    "covariance-not-stored": ("the mean is updated, but not the covariance", "What does a measurement do to P?"),
    "prediction-lost": (
        "what comes back is what went in",
        "Is the result stored under the name that you return?",
    ),
    "covariance-sign": (
        "the covariance grows with a measurement: a sign in the update of P",
        "Information reduces uncertainty. Look at I and K H.",
    ),
    "covariance-with-innovation": (
        "the covariance is updated with the innovation: it would depend on the measured value",
        "In a linear Gaussian model, does the covariance depend on what is measured, or only on what is seen?",
    ),
    "one-for-identity": (
        "the number 1 stands where the identity matrix belongs",
        "In numpy 1 - A subtracts from every entry.",
    ),
    "joseph-incomplete": (
        "the covariance has the first term of Joseph's form without the second",
        "That form has two terms, or use the short one.",
    ),
    "double-inverse": (
        "S is inverted twice, or not at all, in the gain or in the density",
        "Check the units: K turns metres of measurement into metres of state.",
    ),
    "s-without-noise": (
        "the measurement noise R is missing from the covariance of the innovation",
        "Why does a measurement differ from its prediction? There are two reasons.",
    ),
    "s-without-state": (
        "the uncertainty of the state is missing from the covariance of the innovation",
        "Why does a measurement differ from its prediction? There are two reasons.",
    ),
    "only-seen-corrected": (
        "only the robot and the landmarks that are seen are corrected; the others should move, too, where correlated",
        "Which rows of K are zero in your code, and which should be?",
    ),
    "robot-only": ("only the robot is corrected", "The whole state is estimated, the map included."),
    "cross-terms-dropped": (
        "the correlations between robot and landmarks are dropped",
        "Why does a landmark become better known when another one is seen again?",
    ),
    "gain-transposed": ("a matrix in the gain is transposed", "Check K = P H' S^-1 factor by factor."),
    "gain-before-prediction": (
        "the gain is computed from the covariance before the prediction",
        "Which covariance does the innovation at instant k have?",
    ),
    "noise-before-f": (
        "the noise is added before F is applied, which turns it",
        "Compare with x_k = F x_{k-1} + B + w_k: what does F multiply?",
    ),
    # whole filters
    "late": (
        "measurements are read one instant late: z_{k-1} where z_k belongs",
        "Print which z is used at k = 1. There is no z_0.",
    ),
    "early": ("measurements are read one instant early: z_{k+1} where z_k belongs", "Print which z is used at k = 1."),
    "time-0-missing": (
        "row 0, the prior, is missing: the result has one row too few",
        "The answer has N rows, and row 0 holds what is known before the first measurement.",
    ),
    "time-0-updated": (
        "row 0 is not the prior: a step was made before it was stored",
        "There is no z_0, and no motion before k = 0.",
    ),
    "covariance-not-carried": (
        "every step starts from the covariance of the prior again",
        "What does step k + 1 start from?",
    ),
    "mean-not-carried": ("every step starts from the mean of the prior again", "What does step k + 1 start from?"),
    "stored-before-update": (
        "the moments that are stored are the predicted ones; the update comes after",
        "Row k is what is known given z_1..z_k, z_k included.",
    ),
    "p0-transposed": (
        "the initial cloud has the wrong covariance: a Cholesky factor of P0 is transposed",
        "With x = m0 + A e, Cov[x] = A A'. What do you get from your A? numpy's factor is lower, scipy's upper.",
    ),
    "p0-omitted": (
        "all particles start at the prior mean",
        "How uncertain are the landmarks at k = 0? The cloud must show it.",
    ),
    # densities
    "half-missing": ("the factor 1/2 in the exponent is missing", "Write down the density of N(0, 1)."),
    "exponent-sign": ("the exponent has the wrong sign: far is likelier than near", "Where is a Gaussian largest?"),
    "linear-not-log": ("the density itself is returned, not its logarithm", "What does the question ask for?"),
    "plain-exp": (
        "a likelihood is computed with a plain exp, which is 0 in floating point below about -745",
        "Stay in logarithms, and take the exponential only of differences to the largest.",
    ),
    "not-centred": ("the mean is not subtracted", "A density is a function of the deviation from its mean."),
    "support-ignored": (
        "a state that the model excludes gets a finite density",
        "What is known exactly has no spread. What is the density of any other value?",
    ),
    "support-refused": (
        "a state that the model allows gets no density",
        "Compare with rounding in mind, and only what is known exactly.",
    ),
    "diagonal-only": ("only the diagonal of a covariance is used", "Components may be correlated."),
    "arguments-swapped": ("x_{k-1} and x_k are exchanged", "Which of the two is the condition?"),
    "landmark-noise-ignored": (
        "landmark noise that the model has is ignored",
        "Look at the whole of Q before you decide which landmarks stand still.",
    ),
    # weights
    "weights-overwritten": (
        "the weights of the step before are overwritten instead of multiplied",
        "What do the weights already know about z_1..z_{k-1}?",
    ),
    "not-normalised": ("the weights do not sum to 1", "What must the weights of a cloud sum to?"),
    "weights-added": ("likelihoods are added to the weights", "Independent pieces of information: sum or product?"),
    "log-as-weight": (
        "a logarithm is used as a weight",
        "A weight is positive. What is between a log-weight and a weight?",
    ),
    "weights-unchanged": (
        "the weights do not change: the measurement has no effect",
        "Which particles explain z_k best? The weights must say so.",
    ),
    "weights-reset-when-blind": (
        "the weights become even when nothing is seen",
        "Does seeing nothing make earlier measurements untrue?",
    ),
    "weighed-before-move": (
        "the likelihood is that of the particles before they moved",
        "z_k is measured at instant k.",
    ),
    "noise-shared": ("all particles get the same noise", "Each particle is a world of its own."),
    "noise-again": ("the noise that is given is scaled or drawn again", "The noise is drawn from N(0, Q) already."),
    "particles-averaged": (
        "one likelihood, that of the mean of the particles, serves them all",
        "Each particle is a hypothesis of its own, with a likelihood of its own.",
    ),
    "jitter-not-in-weights": (
        "the landmarks are jittered after the weights were computed: the weight belongs to another particle",
        "Which position of the landmark does the likelihood look at?",
    ),
    "jitter-undeclared": (
        "landmarks move, although the model has no noise for them",
        "Jitter changes the model. Declare it, as a keyword landmark_noise=STD of the filter, or leave it out.",
    ),
    "jitter-dropped": ("the jitter has no effect", "Landmarks move in this model."),
    "jitter-only-seen": ("only the landmarks that are seen are jittered", "Does a landmark know whether it is seen?"),
    # moments and pictures
    "weights-ignored": ("the weights are ignored", "Do all particles count the same?"),
    "covariance-normalisation": (
        "the covariance has the wrong normalisation",
        "The weights sum to 1, and the table asks for the covariance of the weighted points themselves.",
    ),
    "second-moment": ("the mean is not subtracted in the covariance", "E[x x'] is not a covariance yet."),
    "variances-only": ("the covariance has no terms off its diagonal", "How do two components vary together?"),
    "weights-squared": ("the weights enter twice", "Count how often w_i occurs in each term of your sum."),
    "weights-rooted": ("square roots of the weights are used", "Look at the definition of an expectation."),
    "variance-for-deviation": (
        "variances stand where deviations belong (a square root is missing)",
        "A corridor and the axes of an ellipse are lengths, in m.",
    ),
    "wrong-level": ("the factor belongs to another probability", "How many deviations hold 99.7 % in one dimension?"),
    "chi2-dimension": (
        "the radius comes from a chi-square of the wrong dimension",
        "How many components does the point have whose region you draw?",
    ),
    "three-sigma": (
        "the ellipse is the one of 3 deviations, which holds 98.9 % in the plane, not 99 %",
        "In two dimensions the probability within 3 deviations is not what it is in one.",
    ),
    "radius-squared": (
        "the quantile of the chi-square is used as the radius",
        "The quantile bounds a squared distance.",
    ),
    "axes-wrong": (
        "the ellipse has the right lengths in the wrong directions",
        "Try a covariance with a strong positive correlation: which way must the ellipse lean?",
    ),
    "correlation-ignored": ("the ellipse ignores the correlation", "The ellipse may lean."),
    "not-shifted": ("the mean is missing", "Where is the centre?"),
    "bounds-swapped": ("lower and upper are exchanged", "Look at the order in the table."),
    "width": ("a width is returned where the two bounds are asked for", "Look at what the table asks for."),
    # resampling
    "ess-inverse": ("this is the sum of the squared weights itself", "Even weights should give P."),
    "ess-ratio": ("this is a ratio of P", "Even weights should give P."),
    "ess-no-square": ("the weights are not squared", "The plain sum of the weights is always the same."),
    "ess-maximum": ("this is 1 / max w, another measure", "The question asks for the one with squared weights."),
    "ess-count": ("this counts the particles that have a weight", "A tiny weight is almost none."),
    "ess-rounded": ("the effective sample size is rounded to a whole number", "It need not be one."),
    "ess-perplexity": ("this is the exponential of the entropy", "The question asks for the one with squared weights."),
    "ancestor-shifted": ("the index is off by one", "Which particle owns the first share of [0, 1)?"),
    "not-cumulated": ("the points are compared with the weights themselves", "Whose share does a point fall into?"),
    "index-sorted": (
        "positions in a sorted array are returned, not indices of particles",
        "Sorting loses the indices.",
    ),
    "never-resampled": (
        "the cloud is never resampled: the test never holds",
        "Compare with what? The threshold is a ratio of P, the effective sample size a number of particles.",
    ),
    "always-resampled": (
        "the cloud is resampled at every step, whatever its effective sample size",
        "Resampling costs diversity. When is it worth it?",
    ),
    "fixed-instants": (
        "the cloud is resampled at fixed instants, whatever its effective sample size",
        "What should decide, the clock or the weights?",
    ),
    "test-inverted": ("the test is inverted: the cloud is resampled when it is healthy", "When are the weights bad?"),
    "weights-not-reset": (
        "the weights are not made even after resampling, so that their information counts twice",
        "What do the copies of a particle say already?",
    ),
    "weights-permuted": (
        "after resampling the copies keep the weights of their ancestors, so that these count twice",
        "What do the copies of a particle say already?",
    ),
    "robot-resampled-only": (
        "only the robots are resampled: each is married to the map of another particle",
        "A particle is a whole state.",
    ),
    "particles-not-resampled": ("the weights are made even, but the particles are not chosen", "Is the choice used?"),
    "resampled-last": (
        "the cloud is resampled after it was weighed, not before it moves",
        "Look at the order in the table: moments are to come from the weighted cloud.",
    ),
    "resampling-biased": (
        "particles do not get P w_i offspring on average",
        "Average the offspring of one particle over many calls, and compare with P w_i.",
    ),
    "uniform-choice": ("the ancestors do not depend on the weights", "What should a heavy particle have more of?"),
    # evidence
    "evidence-not-carried": (
        "the log-evidence ignores the weights that were carried over",
        "Which expectation is p(z_k given z_1..z_{k-1}), and under which weighted cloud?",
    ),
    "evidence-of-logs": ("the mean of the logarithms is taken, not the logarithm of the mean", "Which comes first?"),
    "evidence-summed": ("the sum over particles is taken where a mean belongs", "Even weights are 1 / P each."),
    "evidence-increments": (
        "log_evidence holds the increments, not their running sum",
        "Entry k is log p(z_1..z_k), cumulative.",
    ),
    # loop closure and study
    "first-sighting": ("a landmark that is seen for the first time counts as a loop closure", "Closing needs a start."),
    "every-sighting": (
        "every sighting of a known landmark counts, even without an interruption",
        "When has the loop been open?",
    ),
    "index-from-one": ("landmarks, or instants, are counted from the wrong number", "Look at the table."),
    "robot-offset": ("the blocks of the covariance are shifted: the robot comes first", "Which components are m_1?"),
    "gain-from-start": (
        "the gain is measured from k = 0 and not from the instant before",
        "What did THIS sighting do?",
    ),
    "gain-of-deviation": ("the gain is that of deviations, not of variances", "The table asks for traces."),
    "gain-flipped": ("what is left is returned, not what was gained", "A landmark that gains nothing has gain 0."),
    "k0-counted": ("k = 0 is counted, where the robot is known exactly", "Which instants does the question name?"),
    "gap-in-metres": ("the gap is not divided by the exact deviation", "Components of different scale must compare."),
    "gap-by-variance": ("the gap is divided by the variance", "A gap in deviations has no unit."),
    "gap-own-deviation": (
        "the gap is divided by the filter's own deviation",
        "A cloud that collapsed has none: measure in the exact one.",
    ),
    "gap-absolute": ("the mean of absolute gaps is taken", "Root mean square: which order?"),
    "gap-not-rooted": ("the square root is missing", "Mean square is not root mean square."),
    "gap-signed": ("gaps of opposite sign cancel", "Square before you average."),
    "same-numbers": (
        "every run gets the same random numbers: their spread says nothing",
        "What makes two runs differ?",
    ),
    "deviation-for-error": (
        "the standard deviation is returned where the standard error belongs",
        "More runs make the mean better known, not the runs less scattered.",
    ),
    "against-truth": (
        "the reference is not the exact filter",
        "Error against the truth has a floor; see the question.",
    ),
    # importance functions
    "z-ignored-in-draw": (
        "the draw does not depend on z_k: this is the prior dynamics again",
        "The new importance function is to look at the measurement before it draws.",
    ),
    "ratio-dropped": (
        "the weight is the likelihood alone: the transition density over the proposal density is dropped",
        "From where were the particles drawn, and from where should they have been?",
    ),
    "likelihood-dropped": ("the likelihood is missing from the weight", "Three densities make the weight."),
    "weight-ignores-z": (
        "all increments are equal: the weights ignore z_k",
        "Even an optimal draw leaves parents that explain z_k better or worse.",
    ),
    "transition-dropped": (
        "the transition density is missing from the weight",
        "Three densities make the weight.",
    ),
    "proposal-dropped": ("the proposal density is missing from the weight", "Three densities make the weight."),
    "ratio-inverted": ("the ratio of transition and proposal density is upside down", "Which is divided by which?"),
    "wrong-point": (
        "a density of the weight is evaluated at the wrong point",
        "Which densities are functions of the new particle, and which of its parent?",
    ),
    "parent-without-noise": (
        "the weight of the parent lacks the noise of the dynamics",
        "Given the parent, two noises separate it from z_k.",
    ),
    "parent-without-measurement": (
        "the weight of the parent lacks the noise of the measurement",
        "Given the parent, two noises separate it from z_k.",
    ),
    # Rao-Blackwell
    "rb-without-landmarks": (
        "the weight lacks the uncertainty of the landmarks: they are taken as known",
        "Given the robot's path, what is still uncertain about z_k?",
    ),
    "rb-without-noise": (
        "the weight lacks the measurement noise",
        "Given robot and landmarks, what is still uncertain about z_k?",
    ),
    "rb-weighed-late": (
        "the weight is computed after the landmarks were updated: z_k counts twice",
        "The weight is how well z_k was predicted.",
    ),
    "rb-mean-robot": (
        "the landmarks of all particles are updated with one robot",
        "Each map is conditional on the path of its own robot.",
    ),
    "rb-old-robot": ("the landmarks are updated with the robots before they moved", "Where was z_k measured?"),
    "rb-means-not-updated": ("the conditional means of the landmarks are not updated", "What does each map learn?"),
    "rb-cov-not-updated": ("the conditional covariance is not updated", "What does a measurement do to it?"),
    "rb-conditional-dropped": (
        "the conditional covariance of the landmarks is missing",
        "Law of total covariance: there are two terms.",
    ),
    "rb-spread-dropped": (
        "the spread of the conditional means is missing",
        "Law of total covariance: there are two terms.",
    ),
    "rb-cross-dropped": (
        "the cross terms of robot and landmarks are missing",
        "Robots and maps vary together from particle to particle.",
    ),
}
CATALOGUE = {key: Mistake(key, *texts) for key, texts in (_TEXTS | EKF_TEXTS).items()}
