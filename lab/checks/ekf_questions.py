"""The questions of notebook 06, EKF-SLAM, as data; the table continues that of `lab.checks.questions`.

Question answered: under which name, with which arguments, shapes and units is an answer of notebook 06 looked for?
The symbols are Solà's:

    r   robot [x, y, a], metres and radians      l   landmark [x, y]      M   landmarks in the map
    u   control [dx, da], step then turn         y   measurement [distance, bearing]
    x   (n,) mean of the map [r, l_1 ... l_M], n = 3 + 2M;   P (n, n) its covariance

Names begin with ``ekf_`` where a helper of another notebook might bear the plain one.  Source: J. Solà (2014).
"""

from lab.checks.question import CODE, TEXT, Question, Value

NOTEBOOK = "06_ekf_slam"

ROBOT = Value("r", "(3,)", "robot x, y, a [m, m, rad]")
MOVED = Value("r", "(3,)", "robot after the control [m, m, rad], heading in [-pi, pi)")
CONTROL = Value("u", "(2,)", "step dx [m], then turn da [rad]")
LANDMARK = Value("landmark", "(2,)", "its position x, y [m]")
MEASURED = Value("y", "(2,)", "distance [m] and bearing [rad]")
X = Value("x", "(n,)", "mean of robot and landmarks [m, m, rad, m, m, ...], n = 3 + 2M")
P = Value("P", "(n, n)", "its covariance")
X_WRAPPED = Value("x", "(n,)", "heading in [-pi, pi)")
Q = Value("Q", "(2, 2)", "covariance of the noise on u")
R = Value("R", "(2, 2)", "covariance of the noise on y")
RAY = Value("L", "(4,)", "landmark by inverse depth: anchor [m, m], direction alpha [rad], rho [1/m]")

EKF_QUESTIONS: tuple[Question, ...] = (
    Question(
        "q11-move",
        CODE,
        2,
        NOTEBOOK,
        "The robot moves: the new pose and its Jacobians",
        "ekf_move",
        "ekf_move(r, u)",
        (ROBOT, CONTROL),
        (
            MOVED,
            Value("R_r", "(3, 3)", "its Jacobian with respect to r"),
            Value("R_n", "(3, 2)", "with respect to the noise n, which is added to u"),
        ),
    ),
    Question(
        "q11-observe",
        CODE,
        3,
        NOTEBOOK,
        "What the robot expects to measure of a landmark, and the Jacobians",
        "ekf_observe",
        "ekf_observe(r, landmark)",
        (ROBOT, LANDMARK),
        (
            Value("y", "(2,)", "distance [m] and bearing [rad], the bearing in [-pi, pi)"),
            Value("Y_r", "(2, 3)", "its Jacobian with respect to r"),
            Value("Y_l", "(2, 2)", "with respect to the landmark"),
        ),
    ),
    Question(
        "q11-invert",
        CODE,
        2,
        NOTEBOOK,
        "Where the landmark is that gave a measurement, and the Jacobians",
        "ekf_invert",
        "ekf_invert(r, y)",
        (ROBOT, MEASURED),
        (
            LANDMARK,
            Value("L_r", "(2, 3)", "its Jacobian with respect to r"),
            Value("L_y", "(2, 2)", "with respect to y"),
        ),
    ),
    Question(
        "q12-predict",
        CODE,
        3,
        NOTEBOOK,
        "Prediction: the robot moves, and with it all of its covariances",
        "ekf_predict",
        "ekf_predict(x, P, u, Q)",
        (X, P, CONTROL, Q),
        (X_WRAPPED, P),
        "the whole matrix or its blocks",
    ),
    Question(
        "q12-update",
        CODE,
        4,
        NOTEBOOK,
        "Correction: landmark i is measured again",
        "ekf_correct",
        "ekf_correct(x, P, y, i, R)",
        (X, P, MEASURED, Value("i", "int", "which landmark of the map, 0..M-1"), R),
        (X_WRAPPED, P),
        "any form of the update",
    ),
    Question(
        "q12-initialise",
        CODE,
        4,
        NOTEBOOK,
        "Initialisation: a new landmark enters the map, behind the others",
        "ekf_initialise",
        "ekf_initialise(x, P, y, R)",
        (X, P, MEASURED, R),
        (
            Value("x", "(n + 2,)", "the old one, then the landmark [m]"),
            Value("P", "(n + 2, n + 2)", "with the landmark's rows and columns"),
        ),
    ),
    Question("q12-text", TEXT, 3, NOTEBOOK, "What the cross-covariances are for"),
    Question(
        "q13-nees",
        CODE,
        2,
        NOTEBOOK,
        "Normalised estimation error squared of the pose",
        "pose_nees",
        "pose_nees(r, P, truth)",
        (
            Value("r", "(3,)", "estimated pose [m, m, rad]"),
            Value("P", "(3, 3)", "its covariance"),
            Value("truth", "(3,)", "true pose [m, m, rad]"),
        ),
        (Value("nees", "()", "d' P^-1 d of the error d"),),
    ),
    Question("q13-text", TEXT, 4, NOTEBOOK, "NIS is fine and NEES is not: what has happened?"),
    Question(
        "q14-directions",
        CODE,
        2,
        NOTEBOOK,
        "The three directions in which no measurement can tell anything",
        "frame_directions",
        "frame_directions(x)",
        (Value("x", "(n,)", "robot and landmarks [m, m, rad, m, m, ...], n = 3 + 2M"),),
        (Value("N", "(n, 3)", "columns: how x changes when everything is shifted, or turned"),),
        "any three columns that span the same space",
    ),
    Question("q14-text", TEXT, 4, NOTEBOOK, "The heading that knows too much"),
    Question("q15-text", TEXT, 3, NOTEBOOK, "Two filters that do not learn their own frame"),
    Question(
        "q16-ray",
        CODE,
        2,
        NOTEBOOK,
        "From a landmark by inverse depth to a point, to first order",
        "ray_to_point",
        "ray_to_point(L, P)",
        (RAY, Value("P", "(4, 4)", "its covariance")),
        (Value("p", "(2,)", "the point [m]"), Value("cov", "(2, 2)", "its covariance to first order [m^2]")),
    ),
    Question("q16-text", TEXT, 2, NOTEBOOK, "Good and bad linearisation"),
)
