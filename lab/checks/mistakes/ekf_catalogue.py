"""The words for the named mistakes of notebook 06, EKF-SLAM; `catalogue` adds them to its own."""

EKF_TEXTS: dict[str, tuple[str, str]] = {
    # angles
    "heading-not-wrapped": (
        "the heading is not wrapped: it leaves the interval from -pi to pi",
        "Every statement that changes the heading can push it over pi. Which ones are there?",
    ),
    "bearing-not-wrapped": (
        "the bearing is the difference of two angles, and is not wrapped",
        "A difference of two angles lies between -2 pi and 2 pi. In which interval is a bearing asked for?",
    ),
    "innovation-not-wrapped": (
        "the difference of two angles is not wrapped: just left and just right of straight behind seem to be a whole"
        " turn apart",
        "Take -3.1 rad from 3.1 rad: how far are the two directions apart?",
    ),
    "wrapped-once": (
        "an angle is wrapped by adding or subtracting a single turn, which is not always enough",
        "What becomes of 10 rad? The remainder of a division works for any number of turns.",
    ),
    "wrapped-to-turn": (
        "the angle is brought into the interval from 0 to 2 pi",
        "Which interval does the table ask for?",
    ),
    "degrees": (
        "an angle, or its variance, is converted between degrees and radians",
        "All angles here, and all trigonometric functions of numpy, are in radians.",
    ),
    # models
    "rotation-sign": (
        "the rotation has the wrong sign: R(a)' stands where R(a) belongs, or the reverse",
        "Put the robot at the origin with a heading of a quarter turn. Where in the map is a point one metre ahead?",
    ),
    "turn-before-step": (
        "the robot turns before it steps (or while it does), and so steps in another direction",
        "The control is a step and THEN a turn: which heading does the step have?",
    ),
    "jacobian-after-move": (
        "the Jacobians of the move are taken at the heading after the turn",
        "With respect to which heading is the derivative asked for?",
    ),
    "turn-sign": ("the turn is subtracted from the heading", "A positive da turns to the left."),
    "turn-dropped": ("the heading does not change", "The second component of u is a turn."),
    "heading-column-missing": (
        "the derivative by the heading is missing from a Jacobian",
        "Turn the robot a little: does the result not move?",
    ),
    "heading-column-sign": (
        "the derivative by the heading has the wrong sign, or its components are exchanged",
        "The derivative of R(a) p by a is R(a) p turned by a quarter. Turned which way?",
    ),
    "jacobian-transposed": (
        "a Jacobian is transposed",
        "Rows belong to the components of the result, columns to those of the argument.",
    ),
    "jacobian-once": (
        "a covariance is multiplied by its Jacobian on one side only, or twice by the same",
        "y = A x has the covariance A P A'.",
    ),
    "noise-jacobian-unturned": (
        "the Jacobian of the noise is that of a robot with heading 0",
        "The noise of the step goes along the step. In which direction is that?",
    ),
    "heading-ignored": (
        "the heading of the robot is ignored: a bearing is measured from the robot's nose, not from the map's x axis",
        "What does the bearing become when the robot turns on the spot?",
    ),
    "arctan-for-atan2": (
        "arctan of a quotient cannot tell ahead from behind",
        "There is a function of two arguments that knows all four quadrants.",
    ),
    "arctan-swapped": ("the two arguments of arctan2 are exchanged", "arctan2 takes y first."),
    "scan-jacobian-px": (
        "the Jacobian of the bearing is divided by p_x, which is 0 abeam, or by its square alone",
        "What is the derivative of arctan2(p_y, p_x)? Only the squared distance stands below.",
    ),
    "scan-jacobian-d": (
        "the Jacobian of the bearing is divided by the distance instead of its square",
        "Check the unit of that row: radians per metre.",
    ),
    "scan-jacobian-sign": (
        "the row of the bearing in the Jacobian has a wrong sign or the wrong order",
        "A landmark ahead moves to the left: what happens to its bearing?",
    ),
    "chain-rule-missing": (
        "the derivative between the frame of the robot and that of the map is missing from a Jacobian",
        "Two functions follow one another, so two Jacobians are multiplied. Which two?",
    ),
    "landmark-jacobian-sign": (
        "the Jacobians by the robot's position and by the landmark have the same sign, or the two are exchanged",
        "What is measured depends on the difference of landmark and robot.",
    ),
    "polar-swapped": ("distance and bearing are exchanged", "Look at the order of y in the table."),
    "local-not-global": (
        "the landmark is given relative to the robot, whose position is not added",
        "The map has one frame for all.",
    ),
    "lever-missing": (
        "a derivative by an angle lacks the distance as a factor",
        "Turn a ray by a small angle: how far does its end move?",
    ),
    # prediction
    "noise-unmapped": (
        "the noise enters the covariance without its Jacobian",
        "The noise is on u or on y. In which frame are the rows of P?",
    ),
    "noise-on-landmarks": ("noise is added to the landmarks, too", "What moves, and what does not?"),
    "cross-not-predicted": (
        "the covariances of robot and landmarks are those of before the move",
        "P_rm is the expectation of the error of r times that of m. What happens to the first factor?",
    ),
    "cross-one-side": (
        "only one of the two blocks P_rm and P_mr is written, so P is not symmetric any more",
        "Compare P with its transpose.",
    ),
    "cross-lost": (
        "the covariances of robot and landmarks are set to zero by the move",
        "Does the robot forget with respect to which landmarks it is well placed?",
    ),
    "mean-not-predicted": ("the covariance is predicted, but not the mean", "What becomes of your new pose?"),
    # correction
    "jacobians-late": (
        "the covariance is updated with Jacobians at the corrected mean",
        "One linearisation serves the whole correction: where was it made?",
    ),
    "wrong-slot": (
        "the wrong two components of the state are taken for landmark i",
        "The robot takes three components. At which one does landmark 0 begin, and landmark i?",
    ),
    "landmark-known": (
        "the covariance of the innovation has only the robot's uncertainty, as if the landmark were known",
        "H has five columns that are not zero, and P a block of five by five for them.",
    ),
    "robot-known": (
        "the covariance of the innovation has only the landmark's uncertainty, as if the robot were known",
        "H has five columns that are not zero, and P a block of five by five for them.",
    ),
    "landmark-only": (
        "only the landmark that is seen is corrected",
        "The innovation is news about everything that is correlated with it.",
    ),
    "covariance-order": (
        "the factors of the covariance update stand in the wrong order",
        "P H' has n rows and 2 columns. Which product gives n rows and n columns with P on the right side of K H?",
    ),
    "covariance-with-noise-only": (
        "R stands where the covariance Z of the innovation belongs",
        "What is the covariance of K z?",
    ),
    "covariance-uninverted": ("Z is inverted once too often in the covariance", "What is the covariance of K z?"),
    # initialisation
    "cross-left-out": (
        "the new landmark has no covariance with the rest of the map",
        "Its position came from that of the robot. If the robot turns out to be elsewhere, what of the landmark?",
    ),
    "cross-robot-only": (
        "the new landmark is correlated with the robot, but not with the other landmarks",
        "The robot's error is correlated with theirs.",
    ),
    "cross-wrong-jacobian": (
        "the covariance with the rest of the map has the wrong Jacobian",
        "How does an error of the robot, heading included, show in the landmark?",
    ),
    "cross-sign": ("the covariance with the rest of the map has the wrong sign", "Shift the robot: which way goes l?"),
    "landmark-without-robot": (
        "the covariance of the new landmark lacks the robot's uncertainty",
        "It has two reasons to be wrong: the measurement, and where it was made from.",
    ),
    "landmark-without-noise": (
        "the covariance of the new landmark lacks the measurement's noise",
        "It has two reasons to be wrong: the measurement, and where it was made from.",
    ),
    "landmark-without-heading": (
        "the covariance of the new landmark has the robot's position only, not its heading",
        "An error of the heading is a lever: how long?",
    ),
    "landmark-first": ("the new landmark stands before the others", "Where does the table want it?"),
    # consistency
    "nees-root": ("this is the square root of the NEES, a Mahalanobis distance", "S stands for squared."),
    "nees-per-dof": ("the NEES is divided by its degrees of freedom", "A consistent filter has a mean of 3 here."),
    "nees-not-inverted": ("the error is multiplied by P, not by its inverse", "Which unit does the result have?"),
    "nees-uncorrelated": ("the covariances of the components are ignored", "P is a full matrix."),
    "nees-unweighted": ("this is a squared error, whatever P says", "In which unit is metres plus radians?"),
    "nees-position": ("the heading is left out", "A pose has three components."),
    "direction-heading-missing": (
        "the column of the turn leaves the heading of the robot as it is",
        "Turn the whole map by a small angle: what happens to the robot's heading?",
    ),
    "direction-turn-sign": (
        "robot and landmarks turn one way, the heading turns the other",
        "A point on the x axis that turns to the left moves upwards.",
    ),
    "direction-heading-only": (
        "only the heading turns, while all points stay where they are",
        "A turn about the origin moves every point that is not there.",
    ),
    "direction-scaled": (
        "points move away from the origin instead of around it",
        "Which way does a point go when everything turns about the origin?",
    ),
    "direction-robot-only": (
        "the landmarks are left behind",
        "The whole map is shifted and turned, not the robot alone.",
    ),
    "direction-robot-left": (
        "the robot's position is left behind when the map turns",
        "Everything turns, the robot too.",
    ),
    "direction-swapped": ("x and y are exchanged without a change of sign", "Turn the point (1, 0) by a quarter."),
    "ray-depth": ("rho is used as a distance", "rho is the inverse of one."),
    "ray-slope": (
        "the derivative by rho is not that of 1 / rho",
        "Which way does the point go when rho grows, and how fast when the point is far?",
    ),
    "anchor-left-out": ("the anchor is missing from the point or from its Jacobian", "Where does the ray begin?"),
}
