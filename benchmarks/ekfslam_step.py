"""What one step of EKF-SLAM costs: prediction and one landmark's correction, sparse against dense.

Prediction touches the robot's rows only, O(n) for ekf and fej (for ri it is a rank-2 update of all of P, O(n^2)); the
correction by one landmark is O(n^2).  The dense filter does what a textbook prints: F P F' + G Q G' and Joseph's form
with full matrices, O(n^3).  Both are timed in this process; see README.md here.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from lab.ekfslam import FILTERS, Map, Sensor, compatible
from lab.ekfslam.motion import move
from lab.ekfslam.sensor import observe

SIZES = (25, 50, 100, 200, 400, 800)
WANTED = 50.0  # times faster than dense at the largest size
LINEAR = 1.5  # how much faster than n the time of a prediction may grow, for the noise of a clock
SENSOR = Sensor()
Q = np.diag([0.01, 0.02]) ** 2
U = np.array([0.1, 0.05])


def build(filter: str, n_landmarks: int) -> Map:
    """Return a map of landmarks that are all correlated: initialised from a moving robot, some of them corrected."""
    rng = np.random.default_rng(0)
    m = Map(filter)
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    for i in range(n_landmarks):
        m.move(robot, U)
        m.initialise(robot, SENSOR, np.array([rng.uniform(1, 20), rng.uniform(-3, 3)]), i)
    return m


def median(act: Callable[[], object], repetitions: int) -> float:
    """Return the median time of a call [s]."""
    act()
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        act()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def correct(m: Map) -> None:
    """Correct by one landmark with what is expected of it: no estimate moves, the work is the same."""
    robot, landmark = m.robots[0], m.landmarks[len(m.landmarks) // 2]
    y = SENSOR.difference(observe(m.x[robot.rows], m.x[landmark.rows], SENSOR)[0], np.zeros(2))
    o = m.observe(robot, SENSOR, landmark, y)
    if not compatible(o):
        raise AssertionError("The expected measurement must pass its gate.")
    m.correct(o)


def dense(n_landmarks: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return the dense prediction and the dense update of a map of this size, working on copies of P."""
    m = build("ekf", n_landmarks)
    rows = np.concatenate([m.robots[0].rows, *(landmark.rows for landmark in m.landmarks.values())])
    x, P = m.x[rows], np.ascontiguousarray(m.P[np.ix_(rows, rows)])
    n, i = len(x), 3 + 2 * (n_landmarks // 2)

    def predict() -> object:
        _, R_r, R_n = move(x[:3], U)
        F, G = np.eye(n), np.zeros((n, 2))
        F[:3, :3], G[:3] = R_r, R_n
        return F @ P @ F.T + G @ Q @ G.T

    def update() -> object:
        _, Y_r, Y_l = observe(x[:3], x[i : i + 2], SENSOR)
        H = np.zeros((2, n))
        H[:, :3], H[:, i : i + 2] = Y_r, Y_l
        Z = H @ P @ H.T + SENSOR.R
        K = P @ H.T @ np.linalg.inv(Z)
        left = np.eye(n) - K @ H
        return left @ P @ left.T + K @ SENSOR.R @ K.T

    return predict, update


def main() -> int:
    """Print the table and return the status."""
    head = [f"{name} {what}" for name in FILTERS for what in ("predict", "correct")]
    print(f"{'N':>4} {'n':>5}" + "".join(f"{h:>14}" for h in head) + f"{'dense both':>14}{'dense/ekf':>11}   [us]")
    predictions: dict[str, list[float]] = {name: [] for name in FILTERS}
    ratio = 0.0
    for size in SIZES:
        cells = []
        for name in FILTERS:
            m = build(name, size)
            repetitions = max(20, 8000 // size)
            predictions[name].append(median(lambda m=m: m.move(m.robots[0], U), repetitions))
            cells += [predictions[name][-1], median(lambda m=m: correct(m), repetitions)]
        both = sum(median(act, 3 if size >= 400 else 10) for act in dense(size))
        ratio = both / (cells[0] + cells[1])
        shown = "".join(f"{1e6 * cell:>14.0f}" for cell in cells)
        print(f"{size:>4} {3 + 2 * size:>5}{shown}{1e6 * both:>14.0f}{ratio:>11.0f}", flush=True)
    growth = (3 + 2 * SIZES[-1]) / (3 + 2 * SIZES[0])
    linear = all(predictions[name][-1] < LINEAR * growth * predictions[name][0] for name in ("ekf", "fej"))
    print(f"At N = {SIZES[-1]} a step of ekf is {ratio:.0f} times faster than a dense one (wanted: {WANTED:.0f}).")
    print(f"Prediction of ekf and fej grows {'no faster than' if linear else 'FASTER THAN'} the state.")
    return 0 if linear and ratio >= WANTED else 1


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        sys.exit(main())
