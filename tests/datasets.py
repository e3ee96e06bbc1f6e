"""Data sets for the tests: tiny ones of each format, written here, and the third-party files where there are any.

The files of others are not part of the project.  They are looked for in the folder that SLAM_LAB_DATASETS names, by
default `shared/datasets` beside the checkout; tests of them are skipped where they are absent.
"""

import gzip
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.io

DATASETS = Path(os.environ.get("SLAM_LAB_DATASETS", Path(__file__).resolve().parents[2] / "shared" / "datasets"))
VICTORIA_PARK = DATASETS / "victoria_park_graph" / "victoria_park.txt"
NTNU = DATASETS / "ntnu_simulated" / "simulatedSLAM.mat"
MRCLAM = DATASETS / "mrclam_ds7"


def needs(path):
    """Skip a test whose third-party file is not there."""
    return pytest.mark.skipif(not path.exists(), reason=f"third-party data: {path} is absent (see SLAM_LAB_DATASETS)")


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def seen_from(pose, points):
    """Range and bearing, (n, 2), in closed form."""
    dx, dy = (np.asarray(points) - pose[:2]).T
    return np.column_stack([np.hypot(dx, dy), wrap(np.arctan2(dy, dx) - pose[2])])


@dataclass
class Drive:
    """A robot on a circle among landmarks: K + 1 poses, K motions with noise, what was seen at each of the K first."""

    poses: np.ndarray
    odometry: np.ndarray
    landmarks: np.ndarray
    sightings: list  # K arrays (n, 2) of range and bearing
    names: list  # K arrays (n,): rows of `landmarks`


MOTION_NOISE = np.array([0.02, 0.02, 0.005])
SIGHTING_NOISE = np.array([0.05, 0.02])


def drive(steps=60, n_landmarks=8, seed=0, reach=6.0):
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi, n_landmarks, endpoint=False)
    landmarks = np.column_stack([5 * np.cos(angles), 3 + 5 * np.sin(angles)]) + rng.normal(0, 0.3, (n_landmarks, 2))
    k = np.arange(steps)  # no two motions are the same: one mistaken for the next shows
    motions = np.column_stack([0.3 + 0.1 * np.sin(k / 3), 0.03 * np.cos(k), 0.1 + 0.08 * np.cos(k / 2)])
    poses = [np.zeros(3)]
    for dx, dy, turn in motions:
        x, y, a = poses[-1]
        c, s = np.cos(a), np.sin(a)
        poses.append(np.array([x + c * dx - s * dy, y + s * dx + c * dy, wrap(a + turn)]))
    odometry = motions + MOTION_NOISE * rng.normal(size=(steps, 3))
    sightings, names = [], []
    for pose in poses[:-1]:
        exact = seen_from(pose, landmarks)
        near = np.flatnonzero(exact[:, 0] < reach)
        noisy = exact[near] + SIGHTING_NOISE * rng.normal(size=(len(near), 2))
        noisy[:, 1] = wrap(noisy[:, 1])
        order = rng.permutation(len(near))
        sightings.append(noisy[order])
        names.append(near[order])
    return Drive(np.array(poses), odometry, landmarks, sightings, names)


def write_ntnu(path, world, *, by_rows=False, truth=True):
    """Write a .mat, or a .txt of tagged lines."""
    if path.suffix == ".txt":
        lines = ["# a simulation"]
        for k, (u, seen) in enumerate(zip(world.odometry, world.sightings, strict=True)):
            lines += [f"SIGHTING {k} {d!r} {b!r}" for d, b in seen.tolist()]
            lines.append(f"ODOMETRY {k} {' '.join(map(repr, u.tolist()))}")
        if truth:
            lines += [f"POSE {k} {' '.join(map(repr, pose.tolist()))}" for k, pose in enumerate(world.poses)]
            lines += [f"LANDMARK {x!r} {y!r}" for x, y in world.landmarks.tolist()]
        path.write_text("\n".join(lines))
        return path
    cells = np.empty((len(world.sightings), 1), dtype=object)
    for k, seen in enumerate(world.sightings):
        cells[k, 0] = (seen if by_rows else seen.T) if len(seen) else np.zeros((0, 0))
    turned = (lambda table: table) if by_rows else np.transpose
    variables = {"odometry": turned(world.odometry), "z": cells}
    if truth:
        variables |= {"poseGT": turned(world.poses), "landmarks": turned(world.landmarks)}
    scipy.io.savemat(path, variables)
    return path


def write_graph(path, world, style="gtsam"):
    """Write factors as GTSAM, g2o or TORO would; landmark numbers follow the poses' where one series is meant."""
    q, (sd, sb) = MOTION_NOISE**2, SIGHTING_NOISE
    lines, first = [], {}
    number = 0  # of the next pose or landmark, in one series
    pose_number = []
    for k in range(len(world.sightings)):
        pose_number.append(number if style == "gtsam" else k)
        number += 1
        if k:
            ends = f"{pose_number[k - 1]} {pose_number[k]}"
            motion = " ".join(map(repr, world.odometry[k - 1].tolist()))
            if style == "gtsam":
                lines.append(f"ODOMETRY {ends} {motion} {q[0]} 0 0 {q[1]} 0 {q[2]}")
            elif style == "g2o":
                lines.append(f"EDGE_SE2 {ends} {motion} {1 / q[0]} 0 0 {1 / q[1]} 0 {1 / q[2]}")
            else:
                lines.append(f"EDGE2 {ends} {motion} {1 / q[0]} 0 {1 / q[1]} {1 / q[2]} 0 0")
        for (d, b), name in zip(world.sightings[k].tolist(), world.names[k].tolist(), strict=True):
            if name not in first:
                first[name] = number if style == "gtsam" else name
                number += 1
            along, across = np.array([np.cos(b), np.sin(b)]), np.array([-np.sin(b), np.cos(b)])
            cov = sd**2 * np.outer(along, along) + (d * sb) ** 2 * np.outer(across, across)
            ends, place = f"{pose_number[k]} {first[name]}", " ".join(map(repr, (d * along).tolist()))
            if style == "toro":
                lines.append(f"BR {ends} {b!r} {d!r} {sb} {sd}")
            else:
                matrix = cov if style == "gtsam" else np.linalg.inv(cov)
                tag = "LANDMARK" if style == "gtsam" else "EDGE_SE2_XY"
                lines.append(f"{tag} {ends} {place} {' '.join(map(repr, matrix[np.triu_indices(2)].tolist()))}")
    path.write_text("\n".join(lines) + "\n")
    return path


def write_mrclam(folder, *, n_robots=2, seconds=20.0, seed=0, packed=False, newline="\r\n", noise=True):
    """Write a folder of robots on circles that see the landmarks ahead and each other; subjects follow the robots'."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    landmarks = np.array([[3.0, 0.5], [0.3, 3.0], [-3.0, -0.4], [-0.5, -3.0], [2.5, 2.0]])
    start, rate = 1248446188.323, 20.0

    def write(name, rows):
        text = newline.join(["# a comment", *("\t".join(map(str, row)) + " " for row in rows)]) + newline
        data = text.encode()
        file = folder / f"{name}.dat{'.gz' if packed else ''}"
        file.write_bytes(gzip.compress(data) if packed else data)

    subjects = list(range(n_robots + 1, n_robots + 1 + len(landmarks)))
    write("Barcodes", [(n, 3 * n + 1) for n in [*range(1, n_robots + 1), *subjects]])
    write("Landmark_Groundtruth", [(n, *place, 1e-4, 1e-4) for n, place in zip(subjects, landmarks, strict=True)])
    times = np.arange(0, seconds, 1 / rate)
    paths = []
    for robot in range(1, n_robots + 1):
        v, w = 0.3, 0.2 if robot % 2 else -0.15
        poses = [np.array([0.8 * robot - 1.2, 0.5 * robot - 0.5, 0.4 * robot])]
        for _ in times[1:]:
            x, y, a = poses[-1]
            turn = w / rate
            poses.append(
                np.array(
                    [
                        x + v / w * (np.sin(a + turn) - np.sin(a)),
                        y - v / w * (np.cos(a + turn) - np.cos(a)),
                        wrap(a + turn),
                    ]
                )
            )
        paths.append(np.array(poses))
        slip = [0.01, 0.02] * rng.normal(size=(len(times), 2)) if noise else np.zeros((len(times), 2))
        write(
            f"Robot{robot}_Odometry",
            [(f"{start + t:.3f}", v + s, w + c) for t, (s, c) in zip(times, slip, strict=True)],
        )
        write(f"Robot{robot}_Groundtruth", [(f"{start + t:.3f}", *p) for t, p in zip(times, poses, strict=True)])
    for robot, path in enumerate(paths, start=1):
        rows = []
        for k in range(5, len(times), 10):
            targets = {3 * (n_robots + 1 + i) + 1: place for i, place in enumerate(landmarks)}
            targets |= {3 * (r + 1) + 1: other[k, :2] for r, other in enumerate(paths) if r + 1 != robot}
            for barcode, place in targets.items():
                ((d, b),) = seen_from(path[k], [place])
                if abs(b) < 1.2 and d > 0.3:
                    jitter = [0.06 + 0.06 * d, 0.02] * rng.normal(size=2) if noise else np.zeros(2)
                    rows.append((f"{start + times[k]:.3f}", barcode, max(d + jitter[0], 0.05), b + jitter[1]))
        write(f"Robot{robot}_Measurement", rows)
    return folder
