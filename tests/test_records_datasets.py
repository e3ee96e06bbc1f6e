"""Readers of the EKF-SLAM data sets: what was written comes out; all damage is counted or one sentence."""

import gzip

import numpy as np
import pytest
import scipy.io
from datasets import MRCLAM, NTNU, VICTORIA_PARK, drive, needs, write_graph, write_mrclam, write_ntnu

from lab.records import mrclam, ntnu, victoria_park
from lab.validation import InputError


def edit(file, change):
    """Rewrite a text file, compressed or not, line by line."""
    packed = file.suffix == ".gz"
    text = (gzip.decompress(file.read_bytes()) if packed else file.read_bytes()).decode()
    data = "\r\n".join(change(text.splitlines())).encode()
    file.write_bytes(gzip.compress(data) if packed else data)


def replaced(number, line):
    return lambda lines: [*lines[: number - 1], line, *lines[number:]]


# MRCLAM


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("newline", ["\r\n", "\n", "\r"])
def test_a_mrclam_folder(tmp_path, packed, newline):
    data = mrclam.read(write_mrclam(tmp_path / "set", n_robots=3, packed=packed, newline=newline))
    assert list(data.robots) == [1, 2, 3]
    assert set(data.landmarks) == {4, 5, 6, 7, 8}
    np.testing.assert_allclose(data.landmarks[4], [3.0, 0.5])
    assert data.others == frozenset()
    assert data.skipped.total == data.sorted_lines == 0
    log = data.robots[2]
    assert log.commands.shape == (400, 3)
    np.testing.assert_allclose(log.commands[:, 0], np.arange(400) / 20, atol=2e-3)  # from the first command on
    np.testing.assert_allclose(log.truth[0, 1:], [0.4, 0.5, 0.8])
    assert {1, 3} <= set(log.subjects.tolist()) | {1, 3}
    assert set(log.subjects.tolist()) <= {1, 3, 4, 5, 6, 7, 8}
    assert log.sightings.shape == (len(log.sighting_times), 2)


def test_sightings_of_mrclam_are_range_and_bearing_of_the_right_subject(tmp_path):
    data = mrclam.read(write_mrclam(tmp_path / "set", noise=False))
    log = data.robots[1]
    for t, subject, (distance, bearing) in zip(log.sighting_times, log.subjects, log.sightings, strict=True):
        pose = log.truth[np.argmin(abs(log.truth[:, 0] - t)), 1:]
        if subject in data.landmarks:
            seen = pose[:2] + distance * np.array([np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)])
            np.testing.assert_allclose(seen, data.landmarks[subject], atol=1e-6)
    assert 2 in log.subjects


def test_chosen_robots_and_the_others(tmp_path):
    folder = write_mrclam(tmp_path / "set", n_robots=3)
    data = mrclam.read(folder, [3, 1])
    assert list(data.robots) == [3, 1]
    assert data.others == {2}
    for stem in ("Odometry", "Measurement", "Groundtruth"):
        (folder / f"Robot2_{stem}.dat").unlink()
    (folder / "Robot1_Measurement.dat").unlink()  # nobody asked for it
    assert mrclam.read(folder, [3]).others == {1, 2}


def test_a_fleet_of_another_size(tmp_path):
    """Seven robots; and the fourth subject of a fleet of three is a landmark."""
    assert len(mrclam.read(write_mrclam(tmp_path / "seven", n_robots=7, seconds=2)).robots) == 7
    assert mrclam.read(write_mrclam(tmp_path / "three", n_robots=3), [1]).others == {2, 3}


def test_bad_lines_of_mrclam_are_counted(tmp_path):
    folder = write_mrclam(tmp_path / "set")
    clean = mrclam.read(folder)
    edit(folder / "Robot1_Odometry.dat", replaced(7, "1248446188.6 0.3"))
    edit(folder / "Robot1_Odometry.dat", replaced(9, "1248446188.7 nan 0.2"))
    edit(folder / "Robot1_Odometry.dat", replaced(10, "1248446188.75 0.3 inf"))
    edit(folder / "Robot2_Groundtruth.dat", replaced(4, "x y z 0"))
    edit(folder / "Robot2_Measurement.dat", lambda lines: [*lines, "1248446190 999 1.0 0.1", "1248446190 7 1.0 0.1"])
    edit(folder / "Robot2_Measurement.dat", lambda lines: [*lines, "1248446190 10 -1.0 0.1", "1248446190 4 0 0.1"])
    edit(folder / "Landmark_Groundtruth.dat", lambda lines: [*lines, "3 9 9 0 0"])
    data = mrclam.read(folder)
    assert data.skipped.counts == {
        "malformed": 4,
        "unknown barcode": 1,
        "sighting of itself": 1,
        "range not positive": 2,
        "repeated landmark": 1,
    }
    assert data.skipped.first["malformed"] == "Robot1_Odometry.dat:7"
    assert data.skipped.total == 9
    assert len(data.robots[1].commands) == len(clean.robots[1].commands) - 3
    assert len(data.robots[2].truth) == len(clean.robots[2].truth) - 1
    np.testing.assert_array_equal(data.robots[2].sightings, clean.robots[2].sightings)
    np.testing.assert_array_equal(data.landmarks[3], clean.landmarks[3])


@pytest.mark.parametrize("number", ["nan", "-inf", "1e300"])
def test_a_line_whose_only_fault_is_a_number(tmp_path, number):
    folder = write_mrclam(tmp_path / "set", seconds=2)
    edit(folder / "Robot1_Odometry.dat", replaced(3, f"1248446188.6 0.3 {number}"))
    data = mrclam.read(folder)
    assert data.skipped.counts == {"malformed": 1}
    assert len(data.robots[1].commands) == 39


def test_stamps_that_stand_still_or_run_backwards(tmp_path):
    folder = write_mrclam(tmp_path / "set")
    clean = mrclam.read(folder)
    edit(folder / "Robot1_Odometry.dat", lambda lines: [lines[0], lines[2], lines[1], *lines[3:]])
    edit(folder / "Robot2_Odometry.dat", lambda lines: [*lines, lines[-1].replace(lines[-1].split()[1], "0.77")])
    edit(folder / "Robot2_Measurement.dat", lambda lines: [lines[0], *lines[:0:-1]])
    data = mrclam.read(folder)
    np.testing.assert_array_equal(data.robots[1].commands, clean.robots[1].commands)
    assert data.skipped.counts == {"repeated time stamp": 1}
    assert data.robots[2].commands[-1, 1] == 0.77  # the newest command counts
    assert len(data.robots[2].commands) == len(clean.robots[2].commands)
    assert (np.diff(data.robots[2].sighting_times) >= 0).all()
    assert sorted(data.robots[2].sightings.tolist()) == sorted(clean.robots[2].sightings.tolist())
    assert data.sorted_lines > 1


def test_mrclam_without_ground_truth(tmp_path):
    folder = write_mrclam(tmp_path / "set")
    for name in ("Robot1_Groundtruth.dat", "Landmark_Groundtruth.dat"):
        (folder / name).unlink()
    data = mrclam.read(folder)
    assert data.robots[1].truth is None
    assert data.robots[2].truth is not None
    assert data.landmarks == {}
    assert data.others == {3, 4, 5}  # of the original fleet: without the landmarks' file nothing says otherwise


def cut(file):
    file.write_bytes(file.read_bytes()[:-40])


def garble(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 20] = bytes(20)
    file.write_bytes(data)


def comments_alone(file):
    file.write_bytes(gzip.compress(b"# nothing\r\n\r\n"))


def not_compressed(file):
    file.write_bytes(b"1 2 3")


@pytest.mark.parametrize(
    ("damage", "name", "words"),
    [
        (lambda file: file.unlink(), "Barcodes", ["Barcodes.dat"]),
        (lambda file: file.unlink(), "Robot1_Measurement", ["Robot1_Measurement.dat"]),
        (cut, "Robot1_Odometry", ["Robot1_Odometry.dat.gz", "cut short"]),
        (garble, "Robot2_Groundtruth", ["Robot2_Groundtruth.dat.gz"]),
        (comments_alone, "Robot2_Odometry", ["Robot2_Odometry.dat.gz", "empty"]),
        (not_compressed, "Robot2_Odometry", ["Robot2_Odometry.dat.gz", "compressed"]),
        (lambda file: file.write_bytes(b""), "Robot1_Measurement", ["Robot1_Measurement.dat.gz"]),
    ],
)
def test_mrclam_files_that_cannot_be_used(tmp_path, damage, name, words):
    folder = write_mrclam(tmp_path / "set", packed=True)
    damage(folder / f"{name}.dat.gz")
    with pytest.raises(InputError) as caught:
        mrclam.read(folder)
    for word in words:
        assert word in str(caught.value)


def test_mrclam_folders_that_are_none(tmp_path):
    folder = write_mrclam(tmp_path / "set")
    for path, robots, word in (
        (tmp_path / "nowhere", None, "does not exist"),
        (folder / "Barcodes.dat", None, "is a file"),
        (tmp_path, None, "no RobotN_Odometry"),
        (folder, [1, 9], "no robot 9: there are 1, 2"),
        (folder, [], "No robot"),
    ):
        with pytest.raises(InputError, match=word):
            mrclam.read(path, robots)
    edit(folder / "Robot1_Odometry.dat", lambda lines: ["one two", "three four five"])
    with pytest.raises(InputError, match=r"Robot1_Odometry\.dat has no line of 3 numbers; line 1"):
        mrclam.read(folder)
    edit(folder / "Barcodes.dat", lambda lines: [*lines, "9 4"])
    with pytest.raises(InputError, match=r"Barcodes\.dat, line 9: barcode 4 belongs to subject 1"):
        mrclam.read(folder)


@needs(MRCLAM)
def test_the_mrclam_set_at_hand():
    data = mrclam.read(MRCLAM)
    assert len(data.robots) == 5
    assert len(data.landmarks) == 15
    assert data.skipped.counts == {"repeated time stamp": 29, "unknown barcode": 9}
    assert sum(len(log.subjects) for log in data.robots.values()) == 20282 - 9


# factor files


@pytest.mark.parametrize("style", ["gtsam", "g2o", "toro"])
def test_a_factor_file(tmp_path, style):
    world = drive(seed=2)
    graph = victoria_park.read(write_graph(tmp_path / "graph.txt", world, style))
    n_seen = sum(map(len, world.sightings))
    np.testing.assert_allclose(graph.odometry, world.odometry[:59])
    np.testing.assert_allclose(graph.odometry_covs, np.broadcast_to(np.diag([4e-4, 4e-4, 2.5e-5]), (59, 3, 3)))
    assert len(graph.pose_ids) == 60
    assert len(graph.landmark_ids) == len(np.unique(np.concatenate(world.names)))
    assert graph.sightings.shape == (n_seen, 2)
    ranges_bearings = np.concatenate(world.sightings)
    np.testing.assert_allclose(np.hypot(*graph.sightings.T), ranges_bearings[:, 0])
    np.testing.assert_allclose(np.arctan2(*graph.sightings.T[::-1]), ranges_bearings[:, 1], atol=1e-12)
    d, b = ranges_bearings[7]
    turn = np.array([[np.cos(b), -np.sin(b)], [np.sin(b), np.cos(b)]])
    np.testing.assert_allclose(graph.sighting_covs[7], turn @ np.diag([0.05**2, (0.02 * d) ** 2]) @ turn.T, rtol=1e-9)
    first = {}
    for name in np.concatenate(world.names).tolist():
        first.setdefault(name, len(first))
    assert (graph.polar is None) == (style != "toro")
    if graph.polar is not None:
        np.testing.assert_allclose(graph.polar, ranges_bearings)
        np.testing.assert_allclose(graph.polar_covs, np.broadcast_to(np.diag([0.05**2, 0.02**2]), (n_seen, 2, 2)))
    assert graph.landmarks_of.tolist() == [first[name] for name in np.concatenate(world.names).tolist()]
    assert graph.skipped.total == graph.sorted_lines == 0


def test_the_covariance_of_every_tag(tmp_path):
    """Full matrices: an order mistaken, or an information taken for a covariance, shows."""
    A = np.array([[4.0, 0.3, 0.2], [0.3, 5.0, 0.1], [0.2, 0.1, 6.0]])
    B = A[:2, :2]
    rows = "4 0.3 0.2 5 0.1 6"
    (tmp_path / "g.g2o").write_text(
        f"VERTEX_SE2 0 0 0 0\nODOMETRY 0 1 1 2 3 {rows}\nEDGE_SE2 1 2 1 2 3 {rows}\nEDGE2 2 3 1 2 3 4 0.3 5 6 0.2 0.1\n"
        "EDGE 3 4 1 2 3 4 0.3 5 6 0.2 0.1\nLANDMARK 0 0 3 4 4 0.3 5\nEDGE_SE2_XY 1 0 3 4 4 0.3 5\n"
        "LANDMARK2 2 0 3 4 4 0.3 5\nBR 3 0 0 5 0.1 0.2\nBR 4 0 1.5707963267948966 5 0.1 0.2\n"
    )
    graph = victoria_park.read(tmp_path / "g.g2o")
    np.testing.assert_allclose(graph.odometry_covs, [A, *[np.linalg.inv(A)] * 3])
    np.testing.assert_allclose(graph.sighting_covs[:3], [B, *[np.linalg.inv(B)] * 2])
    np.testing.assert_allclose(graph.sighting_covs[3], np.diag([0.04, 0.25]))
    np.testing.assert_allclose(graph.sighting_covs[4], np.diag([0.25, 0.04]), atol=1e-15)
    np.testing.assert_allclose(graph.sightings[3:], [[5, 0], [0, 5]], atol=1e-12)
    assert graph.landmark_ids.tolist() == [0]  # the number of a pose, too
    assert graph.polar is None  # some are places


def test_lines_in_any_order_and_edges_backwards(tmp_path):
    """GTSAM writes edges from the later pose to the earlier one: here, the motion that undoes them."""
    world = drive(steps=12)
    file = write_graph(tmp_path / "g.txt", world)
    straight = victoria_park.read(file)
    lines = file.read_text().splitlines()
    shuffled = [lines[i] for i in np.random.default_rng(1).permutation(len(lines))]
    file.write_text("\n".join(shuffled))
    mixed = victoria_park.read(file)
    np.testing.assert_array_equal(mixed.odometry, straight.odometry)
    assert mixed.sorted_lines > 0
    assert (np.diff(mixed.poses_of) >= 0).all()
    seen = {(k, tuple(z)) for k, z in zip(straight.poses_of, straight.sightings.tolist(), strict=True)}
    assert seen == {(k, tuple(z)) for k, z in zip(mixed.poses_of, mixed.sightings.tolist(), strict=True)}
    c, s = np.cos(0.7), np.sin(0.7)
    back = -np.array([[c, s], [-s, c]]) @ [2.0, 1.0]
    file.write_text(f"ODOMETRY 1 0 {back[0]} {back[1]} -0.7 0.04 0.01 0.002 0.05 0.003 0.06\nLANDMARK 0 7 1 1 1 0 1\n")
    graph = victoria_park.read(file)
    np.testing.assert_allclose(graph.odometry, [[2.0, 1.0, 0.7]])
    rng = np.random.default_rng(0)
    cov = 1e-4 * np.array([[0.04, 0.01, 0.002], [0.01, 0.05, 0.003], [0.002, 0.003, 0.06]])
    draws = rng.multivariate_normal([*back, -0.7], cov, size=40000)
    undone = np.array([[-np.cos(a) * x - np.sin(a) * y, np.sin(a) * x - np.cos(a) * y, -a] for x, y, a in draws])
    # relative error of a sample variance: sqrt(2 / n) = 0.7 %; entries are compared at four of these
    np.testing.assert_allclose(np.cov(undone.T), 1e-4 * graph.odometry_covs[0], atol=0.03 * 1e-4 * 0.4)


def test_bad_lines_of_factors_are_counted(tmp_path):
    world = drive(steps=12)
    file = write_graph(tmp_path / "g.txt", world)
    clean = victoria_park.read(file)
    more = [
        "# comment",
        "",
        "VERTEX2 3 0 0 0",
        "LANDMARK 0 99 1 2 nan 0 1",
        "LANDMARK 0 99 1 2 1 0",
        "LANDMARK 0.5 99 1 2 1 0 1",
        "LANDMARK 0 99 1 2 -1 0 1",
        "LANDMARK 77777 99 1 2 1 0 1",
        "BR 0 99 0.1 -3 0.1 0.1",
        "ODOMETRY 4 4 1 0 0 1 0 0 1 0 1",
        "EDGE_SE3:QUAT 0 1 2",
        f"ODOMETRY {clean.pose_ids[0]} {clean.pose_ids[5]} 1 0 0 1 0 0 1 0 1",
        f"ODOMETRY {clean.pose_ids[0]} {clean.pose_ids[1]} 9 0 0 1 0 0 1 0 1",
        f"ODOMETRY {clean.pose_ids[2]} {clean.pose_ids[1]} 9 0 0 1 0 0 1 0 1",
    ]
    file.write_text("\r\n".join([*file.read_text().splitlines(), *more]))
    graph = victoria_park.read(file)
    assert graph.skipped.counts == {
        "malformed": 5,
        "edge of a pose to itself": 1,
        "unknown tag EDGE_SE3:QUAT": 1,
        "repeated edge": 2,
        victoria_park.CLOSURE: 1,
        "sighting from an unknown pose": 1,
    }
    np.testing.assert_array_equal(graph.odometry, clean.odometry)
    np.testing.assert_array_equal(graph.sightings, clean.sightings)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no motion"]),
        ("LANDMARK 0 1 1 1 1 0 1\n", ["no motion"]),
        ("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n", ["no sighting"]),
        ("EDGE_SE3:QUAT 0 1 2\n", ["no motion", "EDGE_SE3:QUAT"]),
        ("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\nLANDMARK 5 9 1 1 1 0 1\n", ["no sighting", "unknown pose", "g.txt:2"]),
        (
            "ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\nODOMETRY 1 2 x 0 0 1 0 0 1 0 1\nODOMETRY 2 3 1 0 0 1 0 0 1 0 1\n"
            "LANDMARK 0 9 1 1 1 0 1\n",
            ["from pose 1 to pose 2", "malformed", "g.txt:2"],
        ),
        ("\x00\x01\x02garbage", ["g.txt is no text file"]),
        (
            "".join(f"{chr(300 + i)} 1\nTAG{i} 2\n" for i in range(9)),
            ["no motion", "9 malformed (first: g.txt:1)", "..."],
        ),
    ],
)
def test_factor_files_that_cannot_be_used(tmp_path, text, words):
    (tmp_path / "g.txt").write_text(text)
    with pytest.raises(InputError) as caught:
        victoria_park.read(tmp_path / "g.txt")
    for word in words:
        assert word in str(caught.value)


def test_what_a_crash_leaves_at_the_end_is_a_bad_line(tmp_path):
    file = write_graph(tmp_path / "g.txt", drive(steps=30))
    with file.open("a") as handle:
        handle.write("LANDMARK 0 1 2" + "\0" * 50 + "\n")
    assert victoria_park.read(file).skipped.counts == {"malformed": 1}


def test_factor_files_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        victoria_park.read(tmp_path / "g.txt")
    with pytest.raises(InputError, match="is a folder"):
        victoria_park.read(tmp_path)


@needs(VICTORIA_PARK)
def test_victoria_park():
    graph = victoria_park.read(VICTORIA_PARK)
    assert (len(graph.pose_ids), len(graph.landmark_ids), len(graph.sightings)) == (6969, 151, 3640)
    assert graph.skipped.total == graph.sorted_lines == 0
    assert np.hypot(*graph.odometry.T[:2]).sum() == pytest.approx(4000, rel=0.02)  # the way driven [m]


# NTNU


def assert_drive(log, world):
    np.testing.assert_allclose(log.odometry, world.odometry)
    np.testing.assert_allclose(log.truth, world.poses[: len(world.sightings)])
    np.testing.assert_allclose(log.landmarks, world.landmarks)
    for seen, expected in zip(log.sightings, world.sightings, strict=True):
        np.testing.assert_allclose(seen, expected)
    assert log.skipped.total == 0


@pytest.mark.parametrize("by_rows", [False, True])
@pytest.mark.parametrize("name", ["s.mat", "s.txt"])
def test_a_simulation(tmp_path, name, by_rows):
    world = drive(seed=4, reach=4.0)
    assert 2 in map(len, world.sightings)  # a square table among them
    assert_drive(ntnu.read(write_ntnu(tmp_path / name, world, by_rows=by_rows)), world)


def test_steps_without_sightings(tmp_path):
    world = drive(seed=4, reach=2.0)
    assert {0, 1} <= {*map(len, world.sightings)}
    for name in ("s.mat", "s.txt"):
        assert_drive(ntnu.read(write_ntnu(tmp_path / name, world)), world)


@pytest.mark.parametrize("name", ["s.mat", "s.txt"])
def test_a_simulation_without_truth(tmp_path, name):
    log = ntnu.read(write_ntnu(tmp_path / name, drive(), truth=False))
    assert log.truth is None
    assert log.landmarks is None


def test_bad_sightings_of_a_simulation_are_counted(tmp_path):
    world = drive()
    world.sightings[3] = np.vstack([world.sightings[3], [[np.nan, 0.1], [1.0, np.inf], [-1.0, 0.2]]])
    log = ntnu.read(write_ntnu(tmp_path / "s.mat", world))
    assert log.skipped.counts == {ntnu.UNUSABLE: 3}
    assert log.skipped.first[ntnu.UNUSABLE] == "s.mat:z{4}"
    np.testing.assert_allclose(log.sightings[3], world.sightings[3][:-3])
    log = ntnu.read(write_ntnu(tmp_path / "s.txt", world))
    assert log.skipped.total == 3
    with (tmp_path / "s.txt").open("a") as file:
        file.write("\nODOMETRY 2 9 9 9\nODOMETRY -1 0 0 0\nSIGHTING 1.5 1 1\nSIGHTING 99 1 1\nWORD 1\n")
    log = ntnu.read(tmp_path / "s.txt")
    assert log.skipped.counts == {
        "malformed": 2 + 3,
        ntnu.UNUSABLE: 1,
        "repeated step": 1,
        "sighting at an unknown step": 1,
    }
    np.testing.assert_allclose(log.odometry, world.odometry)


def cells(content):
    found = np.empty((60, 1), dtype=object)
    for k in range(60):
        found[k, 0] = content
    return found


def without(name, **others):
    def change(variables):
        return {key: value for key, value in variables.items() if key != name} | others

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without("z"), ["variable z is missing"]),
        (without("odometry"), ["variable odometry is missing"]),
        (without("", odometry=np.zeros((3, 7))), ["7"]),
        (without("", odometry=np.full((3, 60), np.nan)), ["odometry", "finite"]),
        (without("", odometry=np.zeros((4, 60))), ["odometry", "shape"]),
        (without("", poseGT=np.zeros((3, 5))), ["5 true poses for 60 steps"]),
        (without("", poseGT=np.full((3, 61), np.inf)), ["poseGT", "finite"]),
        (without("", landmarks=np.zeros((3, 5))), ["landmarks", "shape"]),
        (without("", z=np.zeros((60, 2))), ["z must be a cell array"]),
        (without("", z=cells("text")), ["z{1}"]),
        (without("", z=cells(np.zeros((3, 3)))), ["z{1}", "shape"]),
    ],
)
def test_simulations_that_cannot_be_used(tmp_path, change, words):
    file = write_ntnu(tmp_path / "s.mat", drive())
    variables = {key: value for key, value in scipy.io.loadmat(file).items() if not key.startswith("__")}
    scipy.io.savemat(file, change(variables))
    with pytest.raises(InputError) as caught:
        ntnu.read(file)
    assert "s.mat" in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_simulation_files_of_another_kind(tmp_path):
    (tmp_path / "a.mat").write_text("not a mat file")
    (tmp_path / "a.txt").write_text("1 2 3\n")
    (tmp_path / "b.txt").write_text("ODOMETRY 1 1 0 0\nSIGHTING 0 1 1\n")
    (tmp_path / "c.txt").write_text("ODOMETRY 0 1 0 0\n")
    (tmp_path / "a.csv").write_text("1,2,3\n")
    for name, word in (
        ("a.mat", "damaged"),
        ("a.txt", "no line ODOMETRY"),
        ("b.txt", "line ODOMETRY of step 0"),
        ("c.txt", "no sighting"),
        ("a.csv", r"\.mat or \.txt"),
        ("b.mat", "does not exist"),
    ):
        with pytest.raises(InputError, match=word):
            ntnu.read(tmp_path / name)


@needs(NTNU)
def test_the_simulation_at_hand():
    log = ntnu.read(NTNU)
    assert (len(log.odometry), len(log.truth), len(log.landmarks)) == (1000, 1000, 108)
    assert sum(map(len, log.sightings)) == 9797
