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
    "landmark-missed": (
        "one landmark is never used: a loop over the landmarks ends too early, or starts too late",
        "Which values does your index take? Print them.",
    ),
    "return-in-loop": (
        "only the first landmark is ever looked at",
        "Where is the return: in the loop over the landmarks, or after it?",
    ),
    "seen-by-sign": (
        "a landmark counts as seen when its measurement is positive",
        "What do the arrays hold where nothing is seen? A measured component may well be negative.",
    ),
    "blind-density": (
        "when nothing is seen the log-density is not 0",
        "No measurement tells nothing: which factor changes no weight, and what is its logarithm?",
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
    "log-base": (
        "the logarithm has another base",
        "Which base has the logarithm of a density here? All are to be compared and added.",
    ),
    "degrees": (
        "an angle in degrees is used where radians belong, or the reverse",
        "What do cos and sin of numpy expect?",
    ),
    "last-particle-missed": (
        "the last particle is never treated",
        "Which values does the index of your loop take? Print them.",
    ),
    "loop-accumulates": (
        "a sum runs on from one particle to the next",
        "Which of your variables should start afresh for every particle?",
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
    "prediction-missing": (
        "there is an update, but no prediction: time does not pass",
        "The robot has moved since k - 1. Where does the step say so?",
    ),
    "predicted-twice": ("the prediction is made twice", "How often does the robot move between k - 1 and k?"),
    "prediction-late": (
        "B, or the noise of the dynamics, is added after the update instead of before",
        "With what is z_k compared? Everything that moves the robot must have happened by then.",
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
    "s-sign": (
        "the measurement noise R is subtracted in the covariance of the innovation",
        "Does noise make the innovation more or less certain?",
    ),
    "innovation-missing": (
        "the measurement itself stands where the innovation belongs",
        "What of z_k is news? Compare it with what was expected.",
    ),
    "correction-on-old": (
        "the correction is added to the estimate before the prediction",
        "Which estimate was the innovation computed from?",
    ),
    "joseph-sign": (
        "the second term of Joseph's form has the wrong sign",
        "A covariance is a sum of two covariances there.",
    ),
    "p-missing": ("P itself is missing from its update", "Check the units: I - K H has none, a covariance is in m^2."),
    "product-order": (
        "the factors of the covariance update are in the wrong order",
        "A product of matrices is not commutative. Is your result symmetric?",
    ),
    "not-halved": (
        "the covariance and its transpose are added, but not halved",
        "What should symmetrising do to a matrix that is symmetric already?",
    ),
    "updates-side-by-side": (
        "every landmark corrects the same prediction, and the corrections are added",
        "After the first landmark the estimate is another one. From what should the second start?",
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
    "q-in-prior": (
        "the motion noise Q is added to the covariance of the prior",
        "How often has the robot moved at k = 0?",
    ),
    "p0-omitted": (
        "the start is taken as known exactly: P0 is left out",
        "How uncertain are the landmarks at k = 0? Row 0 must show it.",
    ),
    "update-not-carried": (
        "the updated estimate is stored, but the next step starts from the prediction",
        "What does step k + 1 start from? Follow your variables through two steps.",
    ),
    "rows-not-filled": (
        "some rows hold zeros: nothing is ever stored there",
        "Which instants does your loop reach, and what does it store when nothing is seen?",
    ),
    "rows-alias": (
        "all rows are the same: they are one array that is edited in place",
        "Every row needs an array of its own. What does append store, the numbers or the array?",
    ),
    "smoothed": (
        "these are the moments given all measurements, future ones included: a smoother",
        "Row k is what is known given z_1..z_k.",
    ),
    "wrong-start": (
        "row 0, or what the filter starts from, is not m0 and P0",
        "What is known before the first measurement? The model says it.",
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
    "support-inverted": (
        "the test for what is known exactly is inverted",
        "Which states are excluded: those that agree with what is known, or those that differ?",
    ),
    "support-as-zero": (
        "an impossible state gets the log-density 0",
        "What is the logarithm of the density 0? Which density has the logarithm 0?",
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
    "jitter-replaces": ("the landmarks are replaced by their jitter", "Jitter is a small motion: from where?"),
    "weighed-before-noise": (
        "the likelihood is that of the particles before their noise was added",
        "Which particle is returned, and which was weighed?",
    ),
    "transition-in-weight": (
        "the transition density enters the weight, although the particles were drawn from it",
        "Target over proposal: which factor cancels when the prior dynamics draws?",
    ),
    "old-particles": (
        "the particles that come back are those of k - 1",
        "Is the result stored under the name that you return?",
    ),
    "size-ignored": ("the number of particles is not the one that is asked for", "Where does n_particles enter?"),
    "ess-of-filter": (
        "the effective sample size of the filter is not one of P particles: between 1 and P",
        "Is it a ratio? Of which weights, and do those sum to 1?",
    ),
    "q-transposed": (
        "the noise of the robot has the wrong covariance: a Cholesky factor of Q is transposed",
        "With w = A e, Cov[w] = A A'. What do you get from your A?",
    ),
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
    "wrong-level": (
        "the factor belongs to another probability",
        "Which probability is asked for, and in how many dimensions? How many deviations hold it there?",
    ),
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
    "centred-elsewhere": (
        "the covariance is not centred on the weighted mean",
        "The deviation from which point counts?",
    ),
    "likeliest-particle": (
        "the particle of largest weight is returned as the mean",
        "An expectation is a sum over all particles.",
    ),
    "mean-over-all": ("one mean is taken over all components at once", "Which axis holds the particles?"),
    "mean-divided": ("the weighted sum is divided by P once more", "What do the weights sum to?"),
    "one-instant": ("the spread of one instant serves them all", "Does the uncertainty change with time?"),
    "spread-over-time": (
        "the spread of the means over time is taken for the uncertainty",
        "What holds how well the state is known at instant k?",
    ),
    "one-sided": ("one of the two bounds is the mean", "A corridor reaches as far down as up."),
    "axes-of-time": (
        "the diagonal is taken over the wrong axes",
        "Time comes first. Which two axes hold the covariance of one instant?",
    ),
    "diameter": ("the axes of the ellipse are twice, or half, as long as they should be", "A radius, or a diameter?"),
    "inverse-covariance": (
        "the inverse of the covariance gives the axes",
        "Which direction should be long: the well known, or the badly known?",
    ),
    # resampling
    "ess-inverse": ("this is the sum of the squared weights itself", "Even weights should give P."),
    "ess-ratio": ("this is a ratio of P", "Even weights should give P."),
    "ess-no-square": ("the weights are not squared", "The plain sum of the weights is always the same."),
    "ess-maximum": ("this is 1 / max w, another measure", "The question asks for the one with squared weights."),
    "ess-count": ("this counts the particles that have a weight", "A tiny weight is almost none."),
    "ess-rounded": ("the effective sample size is rounded to a whole number", "It need not be one."),
    "ess-perplexity": ("this is the exponential of the entropy", "The question asks for the one with squared weights."),
    "ess-rooted": (
        "this is the square root of the effective sample size, or of its inverse",
        "Even weights should give P.",
    ),
    "ess-times-p": ("this is P times the effective sample size", "Even weights should give P."),
    "ess-variance": (
        "the spread of the weights is not the right one: relative to their mean, squared, and divided by P",
        "Even weights should give P, a single weight 1.",
    ),
    "ess-complement": ("this is 1 minus the sum of the squared weights", "Even weights should give P."),
    "ess-entropy": ("this is the entropy of the weights", "The question asks for the one with squared weights."),
    "ess-logarithm": ("a logarithm is returned", "Even weights should give P."),
    "ess-term-by-term": ("the inverse is taken of each term, not of the sum", "Sum first, or divide first?"),
    "weights-cubed": ("the weights enter with the third power", "Which power has the definition?"),
    "ancestor-shifted": ("the index is off by one", "Which particle owns the first share of [0, 1)?"),
    "not-cumulated": ("the points are compared with the weights themselves", "Whose share does a point fall into?"),
    "index-sorted": (
        "positions in a sorted array are returned, not indices of particles",
        "Sorting loses the indices.",
    ),
    "search-exchanged": (
        "the sorted array and the values that are looked up in it are exchanged",
        "Which is searched, and for which do you want a place? The result has one entry a point.",
    ),
    "counts-returned": (
        "numbers of offspring are returned where indices are asked for",
        "The result is used as particles[:, ancestors].",
    ),
    "points-ignored": ("the points that are given are not used", "Who has drawn the random numbers here?"),
    "one-step-search": (
        "the search moves on by one particle at most for each point",
        "Can two points be further apart than one share?",
    ),
    "search-inverted": (
        "the comparison of point and cumulative weight is the wrong way round",
        "Where does the search start, and until when must it go on?",
    ),
    "nearest-edge": (
        "the nearest edge is taken, not the share into which the point falls",
        "A share has two edges. Which two does the point lie between?",
    ),
    "threshold-typed": ("the threshold is typed into the code", "Which of the arguments should decide?"),
    "overwritten-in-place": (
        "particles are overwritten while they are still needed as ancestors",
        "What has happened to particle 3 when particle 7 wants to copy it?",
    ),
    "landmarks-resampled-only": (
        "only the landmarks are resampled: each map gets the robot of another particle",
        "A particle is a whole state.",
    ),
    "resampled-when-seen": (
        "whether to resample depends on whether something is seen",
        "What should decide, the sensor or the weights?",
    ),
    "noise-resampled": (
        "copies of a particle share their noise: it is chosen along with the particles, or these are moved before they"
        " are chosen",
        "To which particle does column j of the noise belong: to the old one, or to the new one?",
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
    "resampling-fixed": (
        "the same weights always get the same offspring: the points of resampling are not random",
        "Over many runs a particle must get P w_i offspring on average, which is no whole number. Which draw decides?",
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
    "evidence-averaged-twice": ("the weighted sum is divided by P once more", "Even weights are 1 / P each."),
    "evidence-maximum": ("only the best particle counts", "The evidence is an expectation over the whole cloud."),
    "maximum-lost": (
        "the maximum that was taken out of the exponent is not put back",
        "What did you subtract before the exponential, and where does it come back?",
    ),
    "evidence-new-weights": (
        "the weights are those after z_k, which so counts twice",
        "Under which cloud is p(z_k given z_1..z_{k-1}) an expectation?",
    ),
    "weight-not-log": ("weights are added to logarithms", "What is the logarithm of a product?"),
    "ess-of-evidence": ("this is an effective sample size", "What does the question ask for?"),
    "evidence-missing": ("log_evidence is left at 0", "What does each step add to it?"),
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
    "gain-flipped": (
        "the ratio of the two traces is returned, not how much of the earlier one is gone",
        "A landmark that gains nothing has gain 0.",
    ),
    "gain-sign": ("the gain has the wrong sign", "A landmark that gains has a gain above 0."),
    "gain-of-the-rest": (
        "the change is divided by the trace after the sighting, not by the one before",
        "A share of what? A landmark of which all doubt is gone has gain 1.",
    ),
    "gain-absolute": (
        "a difference of variances is returned, in m^2, not a ratio",
        "How much of the uncertainty is gone? A share has no unit.",
    ),
    "gain-percent": ("the gain is in per cent", "A gain of all there is to gain is 1."),
    "gain-of-determinant": ("determinants are compared, not traces", "The table asks for traces."),
    "gain-of-part": ("only one component of each landmark counts", "A landmark has two components."),
    "gain-of-whole": (
        "one gain for the whole map is given to every landmark",
        "The table asks for each landmark's own.",
    ),
    "gain-of-one-landmark": (
        "the gain of the landmark seen is given to all",
        "What does the sighting do to the OTHERS?",
    ),
    "gain-since-last-seen": (
        "the gain is measured from the last sighting and not from the instant before",
        "What did THIS sighting do?",
    ),
    "gain-late": ("the gain is that of the step after the sighting", "Which step brings the information?"),
    "closure-at-loss": (
        "the instants are those at which a landmark is lost from sight",
        "When does a loop close: on leaving, or on meeting again?",
    ),
    "first-closure-only": ("only the first closure of each landmark counts", "How often can a loop close?"),
    "last-instant-missed": ("the last instant is left out", "Which values does your index take? Print them."),
    "columns-exchanged": ("instant and landmark are exchanged", "Look at the order in the table."),
    "order-of-rows": ("the rows are in another order", "Look at the table: by k first, or by m first?"),
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
    "gap-summed": ("a sum stands where a mean belongs", "Should twice as many instants double the gap?"),
    "gap-centred": (
        "the mean gap is taken off first, so that a constant error does not count",
        "Deviation from what: from the exact mean, or from your own average?",
    ),
    "gap-root-inside": ("the root is taken before the mean over all", "Root mean square: in which order?"),
    "gap-maximum": ("the largest gap is taken", "The question asks for a mean."),
    "gap-one-instant": ("only one instant counts", "Which instants does the question name?"),
    "gap-ratio-of-means": ("the deviations are averaged before the division", "Each gap has a deviation of its own."),
    "gap-relative": ("the gap is divided by the mean itself", "In which unit is a gap to be measured?"),
    "gap-whole-covariance": (
        "the whole covariance is used, not the deviation of each component",
        "The table speaks of deviations, component by component.",
    ),
    "gap-of-part": ("only the robot, or only the landmarks, count", "The mean is over all components."),
    "seed-ignored": ("two studies with the same seed give different tables", "What is the argument seed for?"),
    "same-numbers": (
        "every run gets the same random numbers: their spread says nothing",
        "What makes two runs differ?",
    ),
    "deviation-for-error": (
        "the standard deviation is returned where the standard error belongs",
        "More runs make the mean better known, not the runs less scattered.",
    ),
    "error-scaled": (
        "the third column is a multiple, or the square, of the standard error",
        "Which function of the standard deviation and of the number of runs does the table ask for?",
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
    "drawn-with-prior": (
        "the draw is centred on what z_k says, but scatters as if nothing had been seen",
        "How certain is x_k once both its parent and z_k are known?",
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
    "rb-cov-each-particle": (
        "the conditional covariance is updated once for each particle, instead of once",
        "How often was something measured? The covariance is one for all particles.",
    ),
    "rb-robot-spread-added": (
        "the noise of the robot enters the spread of z, although the robots have been drawn",
        "Given the particle, what about its robot is still uncertain?",
    ),
    "rb-conditional-misplaced": (
        "the conditional covariance is added in the wrong place",
        "Whose covariance is it, and which rows of the state are those?",
    ),
    "rb-cross-half": (
        "the covariance is not symmetric: one of the two cross blocks is missing",
        "Look at both corners.",
    ),
    "order-of-components": ("the landmarks come before the robot", "In which order does the state hold them?"),
    "map-correlations-dropped": (
        "correlations within the covariance of the landmarks are dropped",
        "Are the two components of a landmark independent of each other?",
    ),
    "rb-cross-dropped": (
        "the cross terms of robot and landmarks are missing",
        "Robots and maps vary together from particle to particle.",
    ),
}
CATALOGUE = {key: Mistake(key, *texts) for key, texts in (_TEXTS | EKF_TEXTS).items()}
