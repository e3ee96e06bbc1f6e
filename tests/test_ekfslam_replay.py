"""Recordings and their replay: exact motion, honest names, misread ones, and what must not change the answer."""

from dataclasses import replace

import batch
import numpy as np
import pytest
from datasets import (
    MRCLAM,
    NTNU,
    VICTORIA_PARK,
    drive,
    needs,
    seen_from,
    wrap,
    write_graph,
    write_mrclam,
    write_ntnu,
)

from lab.ekfslam import drives, fleet
from lab.ekfslam.alignment import apply
from lab.ekfslam.recording import Recording, Step
from lab.ekfslam.replay import Replayed, replay
from lab.ekfslam.scores import score
from lab.records import mrclam, ntnu, victoria_park
from lab.validation import InputError


@pytest.fixture
def simulation(tmp_path):
    world = drive(seed=5)
    return world, drives.from_simulation(
        ntnu.read(write_ntnu(tmp_path / "s.mat", world)), motion=(0.02, 0.02, 0.005), sensor=(0.05, 0.02)
    )


@pytest.fixture
def folder(tmp_path):
    return write_mrclam(tmp_path / "set", n_robots=2, seconds=40)


# motion


def test_commands_are_integrated_exactly():
    """Against ten thousand small steps, over arcs, straight lines and turns on the spot."""
    commands = np.array([[0.5, 0.3, 0.9], [1.25, 0.2, 0.0], [2.0, 0.0, -2.0], [2.5, -0.4, 1e-9]])
    times = np.linspace(0, 3.5, 20001)
    x, y, a = 0.0, 0.0, 0.0
    expected = {0: (x, y, a)}
    for k, t in enumerate(times[:-1]):
        active = commands[commands[:, 0] <= t + 1e-12]
        v, w = active[-1, 1:] if len(active) else (0.0, 0.0)
        dt = times[k + 1] - t
        x, y, a = x + v * dt * np.cos(a + w * dt / 2), y + v * dt * np.sin(a + w * dt / 2), a + w * dt
        expected[k + 1] = (x, y, a)
    wanted = np.arange(0, 20001, 500)
    found = fleet.Track(commands).at(times[wanted])
    np.testing.assert_allclose(found, [expected[k] for k in wanted], atol=3e-4)
    np.testing.assert_array_equal(fleet.Track(commands).at(np.array([0.1]))[0], [0, 0, 0])


def test_the_noise_of_a_motion_against_simulation():
    """Brownian errors of forward, sideways and turn along the displacement, summed over many small steps."""
    rng, n, k, dt = np.random.default_rng(3), 4000, 100, 2.0
    before, after = np.array([1.0, -2.0, 2.5]), np.array([1.5, -1.1, -2.9])
    u, Q = fleet.increment(before, after, dt)
    c, s = np.cos(2.5), np.sin(2.5)
    np.testing.assert_allclose(u, [c * 0.5 + s * 0.9, -s * 0.5 + c * 0.9, wrap(-2.9 - 2.5)])
    deviations = np.array([fleet.FORWARD, fleet.SIDEWAYS, fleet.TURN]) * np.sqrt(dt / k)
    errors = deviations * rng.normal(size=(n, k, 3))
    turned = np.cumsum(errors[..., 2], axis=1)  # what the heading is off by at each step, which displaces the rest
    drawn = np.column_stack(
        [
            errors[..., 0].sum(1) - turned.mean(1) * u[1],
            errors[..., 1].sum(1) + turned.mean(1) * u[0],
            errors[..., 2].sum(1),
        ]
    )
    spread = np.sqrt(np.outer(np.diag(Q), np.diag(Q)))
    # entries of a sample covariance, in units of the deviations: standard error at most sqrt(2 / n) = 0.022
    np.testing.assert_allclose(np.cov(drawn.T) / spread, Q / spread, atol=4 * np.sqrt(2 / n) + 0.01)
    assert np.linalg.eigvalsh(Q).min() > 0


def test_commands_late_and_scaled(folder):
    data = mrclam.read(folder)
    plain, changed = fleet.together(data), fleet.together(data, fleet.Options(delay=0.5, rotation_scale=0.5))
    turned = [sum(m.u[2] for step in r.steps for m in step.motions if m.robot == 1) for r in (plain, changed)]
    assert turned[1] == pytest.approx(turned[0] / 2, rel=0.03)
    log = mrclam.RobotLog(
        np.array([[0.0, 0.1, 0], [1.0, 0.5, 0.0]]), np.zeros(0), np.zeros(0, int), np.zeros((0, 2)), None
    )
    executed = fleet._executed(log, fleet.Options(delay=0.2))
    np.testing.assert_allclose(executed, [[0.2, 0.1, 0], [1.2, 0.5, 0]])
    for bad in ({"delay": -0.1}, {"delay": np.nan}, {"rotation_scale": 0.0}, {"rotation_scale": np.inf}):
        with pytest.raises(InputError):
            fleet.Options(**bad)


# a folder as a recording


def test_each_robots_motions_add_up_to_its_commands(folder):
    data = mrclam.read(folder)
    recording = fleet.together(data)
    for robot, log in data.robots.items():
        pose, moves = np.zeros(3), 0
        for step in recording.steps:
            for motion in step.motions:
                if motion.robot == robot:
                    c, s = np.cos(pose[2]), np.sin(pose[2])
                    dx, dy, turn = motion.u
                    pose = pose + np.array([c * dx - s * dy, s * dx + c * dy, turn])
                    moves += 1
        assert moves > 40
        last = max(t for t in np.arange(1, log.commands[-1, 0], 1.0))
        expected = fleet.Track(log.commands).at(np.array([last, log.commands[-1, 0]]))
        assert np.linalg.norm(pose[:2] - expected[0, :2]) < 0.5  # it ends at an event near the last
        assert expected[0, 2] - 0.5 < pose[2] < expected[1, 2] + 0.5


@pytest.mark.parametrize("filter", ["ekf", "fej"])
def test_perfect_data_give_a_perfect_map(tmp_path, filter):
    """Stamps are rounded to milliseconds, and so is the error."""
    data = mrclam.read(write_mrclam(tmp_path / "set", n_robots=3, seconds=40, noise=False))
    recording = fleet.together(data)
    figures = score([(recording, replay(recording, filter))])
    for name in ("position_rmse", "heading_rmse", "landmark_rmse"):
        assert figures[name] < 2e-3, name


def test_what_is_seen_is_thinned_to_once_a_second(folder):
    data = mrclam.read(folder)
    log = data.robots[1]
    times = np.repeat(log.sighting_times, 3) + np.tile([0.0, 0.1, 0.6], len(log.sighting_times))
    order = np.argsort(times, kind="stable")
    dense = replace(
        log,
        sighting_times=times[order],
        subjects=np.repeat(log.subjects, 3)[order],
        sightings=np.repeat(log.sightings, 3, axis=0)[order],
    )
    kept = fleet._thinned(dense, {3, 4})
    last, expected = {}, []
    for row in range(len(order)):  # the slow way
        subject, t = dense.subjects[row], dense.sighting_times[row]
        if subject in (3, 4) and (subject not in last or t - last[subject] >= 1):
            last[subject] = t
            expected.append((t, row))
    assert [(t, row) for t, rows in kept for row in rows] == expected
    assert 0 < len(expected) < np.isin(dense.subjects, (3, 4)).sum()


def test_robots_that_see_each_other(folder):
    data = mrclam.read(folder)
    together = fleet.together(data)
    pairs = [(step.robot, name) for step in together.steps for name in step.names]
    assert {(1, 2), (2, 1)} & {*pairs}
    seer = next(step for step in together.steps if 2 in step.names)
    assert {motion.robot for motion in seer.motions} <= {1, 2}
    alone = fleet.together(data, fleet.Options(robot_sightings=False))
    assert all(name not in (1, 2) for step in alone.steps for name in step.names)
    runs = [replay(recording) for recording in (together, alone)]
    assert runs[0].updates - runs[1].updates == sum(name in (1, 2) for _, name in pairs)
    apart = fleet.apart(data)
    assert [*apart] == [1, 2]
    assert all(name not in (1, 2) for recording in apart.values() for step in recording.steps for name in step.names)
    assert sum(replay(recording).updates for recording in apart.values()) < runs[1].updates  # each maps for itself
    with pytest.raises(InputError, match="several robots"):
        replay(together, "ri")
    assert np.isfinite(score([(apart[1], replay(apart[1], "ri"))])["position_rmse"])


def test_robots_that_were_not_chosen_are_no_landmarks(folder):
    recording = fleet.together(mrclam.read(folder, [1]))
    assert 2 not in {name for step in recording.steps for name in step.names}
    assert all(name in recording.landmarks for step in recording.steps for name in step.names)


def test_a_landmark_that_the_ground_truth_lacks(folder):
    file = folder / "Landmark_Groundtruth.dat"
    file.write_text("\n".join(file.read_text().splitlines()[:-2]))  # without the last two
    recording = fleet.together(mrclam.read(folder))
    run = replay(recording)
    assert set(run.landmarks) - set(recording.landmarks) == {6, 7}
    assert score([(recording, run)])["landmark_rmse"] < 0.3


def test_truth_is_interpolated_and_no_further():
    truth = np.array([[0.0, 0, 0, 3.0], [1.0, 2, 4, -3.0], [5.0, 2, 4, 0]])
    log = mrclam.RobotLog(np.zeros((1, 3)), np.zeros(0), np.zeros(0, int), np.zeros((0, 2)), truth)
    np.testing.assert_allclose(fleet.true_pose(log, 0.25), [0.5, 1, wrap(3.0 + 0.25 * (2 * np.pi - 6))])
    np.testing.assert_allclose(fleet.true_pose(log, 5.0), [2, 4, 0])
    for t in (-0.1, 2.0, 5.1):
        assert fleet.true_pose(log, t) is None
    assert fleet.true_pose(replace(log, truth=None), 0.0) is None


def test_a_robot_that_starts_in_a_gap_of_its_truth(folder):
    data = mrclam.read(folder)
    log = data.robots[2]
    late = replace(log, truth=log.truth[(log.truth[:, 0] < 0.01) | (log.truth[:, 0] > 3.0)])
    recording = fleet.together(replace(data, robots={**data.robots, 2: late}), fleet.Options(delay=1.0))
    np.testing.assert_allclose(recording.starts[2], log.truth[0, 1:])


def test_without_truth_one_robot_starts_at_the_origin(folder):
    (folder / "Robot2_Groundtruth.dat").unlink()
    with pytest.raises(InputError, match="Robot 2 has no ground truth"):
        fleet.together(mrclam.read(folder))
    recording = fleet.together(mrclam.read(folder, [2]))
    np.testing.assert_array_equal(recording.starts[2], [0, 0, 0])
    figures = score([(recording, replay(recording))])
    assert np.isnan(figures["position_rmse"])
    assert np.isnan(figures["nees_mean"])
    assert figures["landmark_rmse"] > 0.5  # in another frame
    assert figures["landmark_rmse_aligned"] < 0.3


def misread(recording, every, other):
    """Give some measurements the name of another landmark."""
    steps, count = [], 0
    for step in recording.steps:
        names = list(step.names)
        for i, name in enumerate(names):
            count += 1
            if count % every == 0 and name != other and other not in names:
                names[i] = other
        steps.append(replace(step, names=tuple(names)))
    return replace(recording, steps=tuple(steps))


def test_misread_barcodes_are_refused(folder):
    recording = fleet.together(mrclam.read(folder))
    clean, faulty = replay(recording), misread(recording, 9, 3)
    run = replay(faulty)
    assert clean.unused == 0
    assert run.unused > 5
    errors = [score([(r, replay(r))])["position_rmse"] for r in (recording, faulty, replace(faulty, gate=np.inf))]
    assert errors[1] < 1.5 * errors[0]
    assert errors[2] > 3 * errors[0]  # what the gate is there for


def test_a_landmark_begun_with_a_misread_name_is_given_up(folder):
    recording = fleet.together(mrclam.read(folder))
    steps = [*recording.steps]
    k = next(k for k, step in enumerate(steps) if 3 in step.names)
    i = steps[k].names.index(3)
    ys = steps[k].ys.copy()
    ys[i] += [2.0, 2.5]
    steps[k] = replace(steps[k], ys=ys)
    run = replay(replace(recording, steps=tuple(steps)))
    assert run.deleted == 1
    assert np.linalg.norm(run.landmarks[3] - recording.landmarks[3]) < 0.3


def test_a_landmark_refused_twice_at_once_is_given_up_once(simulation):
    _, recording = simulation
    name = recording.steps[0].names[0]
    steps = []
    for k, step in enumerate(recording.steps):
        rows = [i for i, other in enumerate(step.names) if other == name] * (4 if k else 1)
        steps.append(replace(step, ys=step.ys[rows] + (k == 0), Rs=step.Rs[rows], names=(name,) * len(rows)))
    run = replay(replace(recording, steps=tuple(steps), gate=25.0))
    assert run.deleted == 1


def test_robots_are_noted_once_a_second(folder):
    """At sightings alone the estimate would look better than it is."""
    data = mrclam.read(folder)
    run = replay(fleet.together(data))
    for robot, log in data.robots.items():
        assert (run.robots == robot).sum() == len(np.arange(1, log.commands[-1, 0]))
    assert np.isfinite(run.truth).all()


# simulations and factor files


def test_names_from_the_truth(simulation):
    world, recording = simulation
    assert [list(step.names) for step in recording.steps] == [names.tolist() for names in world.names]


def test_what_is_near_no_true_landmark_has_no_name():
    pose, landmarks = np.array([1.0, 2.0, 0.5]), np.array([[4.0, 2.0], [1.0, 7.0], [1.0, 2.0]])
    seen = seen_from(pose, landmarks[:2])[::-1] + np.array([[0.05, -0.01], [0.02, 0.02]])
    names = drives.true_names(pose, landmarks, np.vstack([[[9.0, 1.0]], seen]), np.array([0.05, 0.02]))
    assert names == (None, 1, 0)
    assert drives.true_names(pose, landmarks, np.array([[9.0, 1.0]]), np.array([0.05, 0.02])) == (None,)
    assert drives.true_names(pose, landmarks, np.zeros((0, 2)), np.ones(2)) == ()


@pytest.mark.parametrize("filter", ["ekf", "fej", "ri"])
def test_a_simulation_with_known_names(simulation, filter):
    world, recording = simulation
    run = replay(recording, filter)
    figures = score([(recording, run)])
    np.testing.assert_array_equal(run.truth, world.poses[:-1])
    assert (run.wrong, run.unused, run.deleted) == (0, 0, 0)
    assert set(run.landmarks) == set(np.concatenate(world.names).tolist())
    assert run.updates + len(run.landmarks) == sum(map(len, world.sightings))
    assert figures["position_rmse"] < 0.2
    assert figures["landmark_rmse"] < 0.2
    # dof is twice the updates: the mean of chi-square by degree of freedom has deviation sqrt(2 / dof)
    assert figures["nis_per_dof"] == pytest.approx(1, abs=4 * np.sqrt(2 / run.dof.sum()))
    assert 0.2 < figures["nees_mean"] < 12  # one run, strongly correlated over time


@pytest.mark.parametrize("association", ["nearest", "jcbb"])
def test_a_simulation_with_unknown_names(simulation, association):
    world, recording = simulation
    nameless = replace(recording, steps=tuple(replace(s, names=(None,) * len(s.names)) for s in recording.steps))
    run, blind = (replay(r, association=association) for r in (recording, nameless))
    np.testing.assert_array_equal(run.poses, blind.poses)  # the names are never looked at
    assert run.wrong == 0
    assert len(run.landmarks) == len(np.unique(np.concatenate(world.names)))
    assert sorted(run.identities.values()) == sorted({*np.concatenate(world.names).tolist()})
    assert run.unused < 0.01 * run.updates
    known = score([(recording, replay(recording))])
    assert score([(recording, run)])["position_rmse"] == pytest.approx(known["position_rmse"], rel=0.2)
    with pytest.raises(InputError, match="name no landmark"):
        replay(nameless)


def test_wrong_associations_are_counted(simulation):
    """Names that lie make right associations wrong."""
    _, recording = simulation
    lie = replace(
        recording,
        steps=tuple(
            replace(s, names=tuple(n + 100 * (k > 30) for n in s.names)) for k, s in enumerate(recording.steps)
        ),
    )
    run = replay(lie, association="nearest")
    assert 0 < run.wrong < run.updates


def test_an_unknown_association(simulation):
    with pytest.raises(InputError, match="Unknown association 'psychic'; known are known, nearest, jcbb"):
        replay(simulation[1], association="psychic")


@pytest.mark.parametrize("filter", ["ekf", "fej", "ri"])
def test_the_order_within_an_instant_does_not_matter(simulation, filter):
    _, recording = simulation
    steps = [replace(s, Rs=s.Rs * (1 + np.array(s.names).reshape(-1, 1, 1))) for s in recording.steps]
    recording = replace(recording, steps=tuple(steps))  # each measurement with a noise of its own
    turned = replace(
        recording, steps=tuple(replace(s, ys=s.ys[::-1], Rs=s.Rs[::-1], names=s.names[::-1]) for s in recording.steps)
    )
    np.testing.assert_allclose(replay(turned, filter).poses, replay(recording, filter).poses, atol=1e-9)


def test_the_same_new_thing_twice_at_once(simulation):
    _, recording = simulation
    steps = [*recording.steps]
    first = steps[0]
    steps[0] = replace(
        first, ys=np.vstack([first.ys, first.ys]), Rs=np.concatenate([first.Rs] * 2), names=first.names * 2
    )
    run = replay(replace(recording, steps=tuple(steps)))
    assert run.unused == len(first.names)
    np.testing.assert_allclose(run.poses, replay(recording).poses)


@pytest.mark.parametrize("style", ["gtsam", "g2o", "toro"])
@pytest.mark.parametrize("filter", ["ekf", "fej", "ri"])
def test_a_factor_file_against_its_batch_optimum(tmp_path, filter, style):
    """The world is nearly linear, so that the filter's final map nearly is the optimum's."""
    graph = victoria_park.read(write_graph(tmp_path / "g.txt", drive(seed=5), style))
    best = batch.optimum_by_parts(graph)
    recording = drives.from_factors(graph)
    assert recording.sensor == ("range-bearing" if style == "toro" else "position")
    run = replay(recording, filter)
    assert [*run.landmarks] == graph.landmark_ids.tolist()
    apart = np.array([*run.landmarks.values()]) - best.landmarks
    deviations = np.sqrt([np.trace(cov) for cov in run.covs.values()])
    assert (np.linalg.norm(apart, axis=1) < 0.35 * deviations).all()
    np.testing.assert_allclose(run.poses[-1], best.poses[-1], atol=0.05)
    # the optimum's chi-square is the filter's summed innovations, exactly so where everything is linear
    assert run.nis.sum() == pytest.approx(best.chi2, rel=0.05)
    assert run.dof.sum() == best.dof
    assert np.isnan(run.truth).all()


def test_progress_is_told(simulation):
    seen = []
    replay(simulation[1], on_step=seen.append)
    assert seen == list(range(1, 61))


# scores


def replayed(poses, truth, landmarks=None, nees=None):
    n = len(poses)
    nees = np.full(n, np.nan) if nees is None else nees
    found = {} if landmarks is None else landmarks
    covs = {name: np.eye(2) for name in found}
    names = {name: name for name in found}
    zeros = np.zeros(n)
    return Replayed("ekf", np.zeros(n), poses, truth, nees, zeros + 3, zeros + 2, found, covs, names, n, 0, 0, 0)


def test_scores_by_hand():
    truth = np.array([[0.0, 0, 3.1], [1, 0, 0], [0, 2, 0], [np.nan] * 3])
    poses = np.column_stack([apply(0.3, np.array([1.0, -1.0]), truth[:, :2]), truth[:, 2] + [0.1, -0.1, 0.1, 0]])
    poses[0, 2] = wrap(poses[0, 2])
    recording = Recording({}, (Step(1),), {"a": np.zeros(2), "b": np.ones(2), "unseen": np.ones(2)})
    found = {"a": np.array([3.0, 4.0]), "b": np.array([4.0, 5.0]), "nobody's": np.array([9.0, 9.0])}
    nees = np.array([np.nan, 2.0, 6.0, np.nan])
    figures = score([(recording, replayed(poses, truth, found, nees))])
    expected = np.sqrt(np.mean(np.sum((poses[:3, :2] - truth[:3, :2]) ** 2, axis=1)))
    assert figures["position_rmse"] == pytest.approx(expected)
    assert figures["position_rmse_aligned"] == pytest.approx(0, abs=1e-12)
    assert figures["heading_rmse"] == pytest.approx(0.1)
    assert figures["landmark_rmse"] == pytest.approx(5.0)
    assert figures["landmark_rmse_aligned"] == pytest.approx(0, abs=1e-12)
    assert figures["nees_mean"] == 4.0
    assert figures["nis_per_dof"] == 1.5


def test_separate_maps_are_aligned_separately():
    truth = np.column_stack([np.random.default_rng(0).normal(size=(5, 2)), np.zeros(5)])
    runs = []
    for angle in (0.5, -1.0):
        poses = np.column_stack([apply(angle, np.ones(2), truth[:, :2]), np.zeros(5)])
        runs.append((Recording({}, (), {}), replayed(poses, truth)))
    assert score(runs)["position_rmse_aligned"] == pytest.approx(0, abs=1e-12)
    both = [score([run])["position_rmse"] for run in runs]
    assert score(runs)["position_rmse"] == pytest.approx(np.sqrt(np.mean(np.square(both))))


# the third-party data, figures of an independent probe beside them


@pytest.mark.parametrize(
    ("filter", "error", "nees"),
    [("ekf", (0.50, 0.62), (8, 12)), ("fej", (0.34, 0.38), (2.3, 3.1)), ("ri", (0.35, 0.39), (2.3, 3.2))],
)
@needs(NTNU)
def test_the_simulation_at_hand(filter, error, nees):
    """Probe: 0.56, 0.36, 0.37 m; NEES 10, 2.7, 2.8; NIS by degree of freedom 0.99."""
    recording = drives.from_simulation(ntnu.read(NTNU))
    run = replay(recording, filter)
    figures = score([(recording, run)])
    assert error[0] < figures["position_rmse"] < error[1]
    assert nees[0] < figures["nees_mean"] < nees[1]
    assert figures["nis_per_dof"] == pytest.approx(0.99, abs=0.01)
    assert len(run.landmarks) == 78
    assert run.updates == 9797 - 78


@pytest.mark.parametrize(
    "filter", ["ekf", pytest.param("fej", marks=pytest.mark.long), pytest.param("ri", marks=pytest.mark.long)]
)
@needs(NTNU)
def test_the_simulation_at_hand_without_names(filter):
    run = replay(drives.from_simulation(ntnu.read(NTNU)), filter, association="nearest")
    assert len(run.landmarks) == 78
    assert run.wrong <= 30
    assert run.unused < 50


@needs(VICTORIA_PARK)
@pytest.mark.long
def test_victoria_park_against_its_batch_optimum():
    """Probe: ekf beyond 5 m, fej near 0.8 m, ri near 1.2 m."""
    graph = victoria_park.read(VICTORIA_PARK)
    best = batch.optimum_by_parts(graph)
    recording = drives.from_factors(graph)
    known = dict(zip(graph.landmark_ids.tolist(), best.landmarks, strict=True))
    errors = {}
    for filter in ("ekf", "fej", "ri"):
        run = replay(recording, filter)
        errors[filter] = score([(replace(recording, landmarks=known), run)])["landmark_rmse"]
        assert len(run.landmarks) == 151
        assert run.updates == 3640 - 151
    assert errors["ekf"] > 5
    assert errors["fej"] == pytest.approx(0.8, abs=0.1)
    assert errors["ri"] == pytest.approx(1.2, abs=0.1)


@needs(MRCLAM)
@pytest.mark.long
def test_the_mrclam_set_at_hand():
    """Probe: one map with sightings of robots 0.127 m, without 0.164 m; separate maps 0.74 m."""
    data = mrclam.read(MRCLAM)
    errors = []
    for options in (fleet.Options(), fleet.Options(robot_sightings=False)):
        recording = fleet.together(data, options)
        errors.append(score([(recording, replay(recording))])["position_rmse"])
    separate = fleet.apart(data)
    errors.append(score([(recording, replay(recording)) for recording in separate.values()])["position_rmse"])
    assert errors[0] == pytest.approx(0.13, abs=0.02)
    assert errors[0] < errors[1] < 0.25
    assert errors[2] > 3 * errors[0]
