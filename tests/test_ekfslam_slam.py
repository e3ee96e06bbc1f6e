"""The guide's loop and what serves it: association, managers, inverse depth, rings, the world and the demo."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import chi2, kstest
from slam_worlds import measured

from lab.ekfslam import Map, Sensor, compatible
from lab.ekfslam.association import gate, jcbb, nearest
from lab.ekfslam.consistency import assess, gauge
from lab.ekfslam.demo import SENSORS, follow, run
from lab.ekfslam.map import stacked
from lab.ekfslam.rings import Ring, ring_size
from lab.ekfslam.slam import Feed, Raw, Settings, Slam
from lab.ekfslam.uncertainty import cov2elli, mahalanobis, sigma_probabilities
from lab.ekfslam.world import CONTROL, START, cloister, drive
from lab.gaussian import chi2_band
from lab.validation import InputError

Q = np.diag([0.01, 0.02]) ** 2
SENSOR = Sensor()
CAMERA = Sensor("bearing", (0.01,))
SONAR = Sensor("range", (0.05,))
SPACING = 0.25  # rad between neighbours of an arc


# uncertainty


def test_sigma_probabilities():
    np.testing.assert_allclose(100 * sigma_probabilities(2), [39.3, 86.5, 98.9, 99.97], atol=0.05)
    np.testing.assert_allclose(100 * sigma_probabilities(3), [19.9, 73.9, 97.1, 99.89], atol=0.05)
    draws = np.random.default_rng(0).standard_normal((200_000, 2))
    inside = np.mean(np.linalg.norm(draws, axis=1) <= 2)
    assert inside == pytest.approx(sigma_probabilities(2)[1], abs=5 * np.sqrt(0.87 * 0.13 / 200_000))


def test_cov2elli_is_closed_and_at_n_sigmas():
    m, P = np.array([1.0, -2.0]), np.array([[2.0, 0.9], [0.9, 0.5]])
    points = cov2elli(m, P, 3)
    assert points.shape == (17, 2)
    np.testing.assert_array_equal(points[0], points[-1])
    for point in points:
        assert mahalanobis(point, m, P) == pytest.approx(3)
    assert cov2elli(m, P, 1, 7).shape == (8, 2)
    np.testing.assert_array_equal(cov2elli(m, np.zeros((2, 2))), np.tile(m, (17, 1)))
    with pytest.raises(InputError, match="singular"):
        mahalanobis(m, m, np.zeros((2, 2)))


# association


def test_the_gate_depends_on_the_degrees_of_freedom():
    assert gate(2) == pytest.approx(9.21, abs=0.01)
    assert gate(1) == pytest.approx(6.63, abs=0.01)
    assert chi2.cdf(9, 2) == pytest.approx(0.9889, abs=1e-4)
    with pytest.raises(InputError, match="strictly between"):
        gate(2, 1.0)


def grid(sigma_heading):
    """Return a map of an arc of landmarks and one before it, a robot whose heading is badly known, and their places."""
    m = Map()
    robot = m.add_robot(np.zeros(3))
    angles = SPACING * np.array([-1.5, -0.5, 0.5, 1.5])
    places = np.vstack([4 * np.stack([np.cos(angles), np.sin(angles)], axis=1), [2.0, 0.0]])
    precise = Sensor(noise=(0.01, 0.003))
    for i, place in enumerate(places):
        m.initialise(robot, precise, measured(np.zeros(3), place), i)
    m.move(robot, np.zeros(2), np.diag([1e-4, sigma_heading**2]))
    return m, robot, places, precise


def brute_force(m, robot, sensor, ys):
    """All assignments: the most pairs within gates, single and joint, then the least joint distance."""
    landmarks = list(m.landmarks.values())
    best = (0, -np.inf, ())
    for choice in product(range(-1, len(landmarks)), repeat=len(ys)):
        used = [j for j in choice if j >= 0]
        if len(set(used)) < len(used):
            continue
        pairs = [(i, j) for i, j in enumerate(choice) if j >= 0]
        if not pairs:
            continue
        observations = [m.observe(robot, sensor, landmarks[j], ys[i]) for i, j in pairs]
        rows, H = stacked(observations)
        Z = H @ m.joint.block(rows) @ H.T + np.kron(np.eye(len(pairs)), sensor.R)
        z = np.concatenate([o.z for o in observations])
        distance = z @ np.linalg.solve(Z, z)
        if distance > gate(len(z)) or not all(compatible(o) for o in observations):
            continue
        best = max(best, (len(pairs), -distance, tuple(pairs)))
    return dict(best[2])


@pytest.mark.parametrize("seed", range(4))
def test_jcbb_is_the_best_of_all_matchings(seed):
    rng = np.random.default_rng(seed)
    m, robot, places, sensor = grid(0.15)
    truth = np.array([0.0, 0.0, 0.15 * rng.standard_normal()])
    seen = rng.permutation(5)[:4]
    ys = [measured(truth, places[j]) + sensor.noise * rng.standard_normal(2) for j in seen]
    ys[0] = np.array([5.0, 1.0])  # of no landmark
    found = jcbb(m, robot, sensor, ys)
    expected = brute_force(m, robot, sensor, ys)
    assert [t.name if t else None for t in found.targets] == [expected.get(i) for i in range(4)]


def test_joint_compatibility_where_the_nearest_is_wrong():
    """A turn of one spacing: every measurement lies on a neighbour of its landmark, and only together they tell."""
    m, robot, places, sensor = grid(0.12)
    truth = np.array([0.0, 0.0, SPACING])
    ys = [measured(truth, place) for place in places]
    alone = nearest(m, robot, sensor, ys)
    together = jcbb(m, robot, sensor, ys)
    assert [t.name for t in together.targets] == [0, 1, 2, 3, 4]
    assert [t.name if t else None for t in alone.targets] == [None, 0, 1, 2, 4]


def test_among_matchings_of_the_same_size_the_closest_is_taken():
    """The first measurement is nearest to a, which the second needs more."""
    m = Map()
    robot = m.add_robot(np.zeros(3))
    for name, bearing in (("a", 0.0), ("b", 0.01)):
        m.initialise(robot, SENSOR, np.array([4.0, bearing]), name, R=1e-8 * np.eye(2))
    ys = [np.array([4.0, 0.004]), np.array([4.0, -0.02])]
    for match in (jcbb, nearest):
        assert [t.name for t in match(m, robot, SENSOR, ys).targets] == ["b", "a"]
    assert brute_force(m, robot, SENSOR, ys) == {0: 1, 1: 0}


def test_nearest_gives_each_landmark_once_and_says_what_is_new():
    m, robot, places, sensor = grid(0.01)
    ys = [measured(np.zeros(3), places[0]), measured(np.zeros(3), places[0]) + 1e-4, np.array([9.0, 3.0])]
    found = nearest(m, robot, sensor, ys)
    assert sum(t is m.landmarks[0] for t in found.targets) == 1
    assert found.targets[2] is None
    assert found.new() == [2]
    assert found.nearest[:2].max() < 1
    empty = nearest(Map(), robot, sensor, ys)
    assert empty.new() == [0, 1, 2]
    assert jcbb(m, robot, sensor, []).targets == []


# world


@pytest.mark.parametrize(("n", "points"), [(4, 12), (7, 36), (9, 52)])
def test_cloister(n, points):
    W = cloister(-4, 4, -4, 4, n)
    assert len(W) == points == 8 * n - 20
    assert len(np.unique(W.round(9), axis=0)) == points
    assert np.abs(W).max() == 4
    rounded = {tuple(p) for p in W.round(9) + 0.0}
    assert {tuple(p) for p in (W[:, ::-1] * [-1, 1]).round(9) + 0.0} == rounded  # a quarter turn
    assert (4.0, 4.0) not in rounded  # no corners outside, all four inside
    inner = round(8 * ((n - 1) / 2 - 1) / (n - 1), 9)
    assert (inner, inner) in rounded
    assert cloister(0, 2, 10, 20, n).mean(axis=0) == pytest.approx([1, 15])


@pytest.mark.parametrize(("arguments", "message"), [((-4, 4, -4, 4, 3), "no inner ring"), ((4, -4, -4, 4, 7), "walls")])
def test_no_cloister(arguments, message):
    with pytest.raises(InputError, match=message):
        cloister(*arguments)


def test_who_is_perturbed():
    worlds = [drive(np.random.default_rng(seed)) for seed in (0, 1)]
    listing = [drive(np.random.default_rng(seed), perturb="estimator") for seed in (0, 1)]
    assert (worlds[0].u == CONTROL).all()
    assert np.abs(worlds[0].truth - worlds[1].truth).max() > 0.1
    np.testing.assert_array_equal(listing[0].truth, listing[1].truth)
    assert np.std(listing[0].u - CONTROL, axis=0) == pytest.approx([0.01, 0.02], rel=0.25)
    centre = np.array([START[0], START[1] + 2])
    np.testing.assert_allclose(np.linalg.norm(listing[0].truth[:, :2] - centre, axis=1), 2, atol=0.06)
    turned = np.abs(np.diff(np.unwrap(listing[0].truth[:, 2]))).sum()
    assert turned / (2 * np.pi) == pytest.approx(1.6, abs=0.01)


def test_measurements_have_the_noise_they_say():
    world = drive(np.random.default_rng(3))
    z = [
        world.sensor.difference(world.y[k, i], measured(world.truth[k + 1], world.W[i]))
        for k in range(0, 200, 4)
        for i in range(36)
    ]
    normalised = (np.array(z) / world.sensor.noise).ravel()
    assert kstest(normalised, "norm").pvalue > 1e-4


# the loop and the managers


def feed(robot, *raws, u=None):
    return [Feed(robot, u, raws)]


def test_one_new_landmark_a_step():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    slam = Slam(m, np.random.default_rng(0))
    raw = Raw(np.array([[2.0, 0.0], [2.0, 1.0], [2.0, 2.0]]), ["a", "b", "c"])
    for k in range(1, 5):
        events = slam.step(feed(robot, raw, u=np.zeros(2)))
        assert [e.what for e in events].count("initialised") == (k <= 3)
        assert len(m.landmarks) == min(k, 3)
    assert sorted(m.landmarks) == ["a", "b", "c"]
    assert {e.what for e in events} == {"corrected"}


def test_a_void_control_moves_nothing():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    Slam(m, np.random.default_rng(0)).step(feed(robot, Raw(np.array([[2.0, 0.0]]), ["a"])))
    assert not m.joint.block(robot.rows).any()


def test_several_robots_and_sensors_share_one_map():
    m = Map()
    first = m.add_robot(np.zeros(3), name="first", sensors=[SENSOR, CAMERA], Q=Q)
    second = m.add_robot(np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-4, name="second", sensors=[SENSOR], Q=Q)
    slam = Slam(m, np.random.default_rng(0))
    place = np.array([3.0, 2.0])
    for _ in range(4):
        poses = [m.x[robot.rows] for robot in (first, second)]
        whole = [Raw(measured(pose, place)[None], ["column"]) for pose in poses]
        ray = Raw(measured(poses[0], place, "bearing")[None], ["column"])
        slam.step([Feed(first, np.zeros(2), [whole[0], ray]), Feed(second, np.zeros(2), [whole[1]])])
    assert [*m.landmarks] == ["column"]
    assert m.landmarks["column"].matches == 11  # twelve times measured, once to start with
    assert m.joint.block(first.rows, second.rows).any()


def test_a_landmark_that_moves_away_is_deleted_and_found_again():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    slam = Slam(m, np.random.default_rng(0))
    events = []
    for k in range(40):
        y = [[2.0, 0.0], [3.0, 1.0] if k < 10 else [6.0, -1.0]]
        events += [(k, e) for e in slam.step(feed(robot, Raw(np.array(y), ["fixed", "cart"]), u=np.zeros(2)))]
    deleted = [(k, e.name) for k, e in events if e.what == "deleted"]
    assert [name for _, name in deleted] == ["cart"]
    assert 18 <= deleted[0][0] <= 21  # as many misses as hits
    np.testing.assert_allclose(m.point(m.landmarks["cart"])[0], [6 * np.cos(-1), 6 * np.sin(-1)], atol=0.2)


def test_a_landmark_that_is_never_found_again_is_deleted():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    slam = Slam(m, np.random.default_rng(0))
    slam.step(feed(robot, Raw(np.array([[2.0, 0.0]]), ["ghost"])))
    for _ in range(9):
        slam.step(feed(robot, Raw(np.empty((0, 2)), [])))
    assert "ghost" in m.landmarks
    slam.step(feed(robot, Raw(np.empty((0, 2)), [])))
    assert not m.landmarks


def test_a_landmark_out_of_view_is_not_searched():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    slam = Slam(m, np.random.default_rng(0), Settings(feasible=lambda sensor, e: e[0] < 3))
    for _ in range(2):
        slam.step(feed(robot, Raw(np.array([[2.0, 0.0], [4.0, 0.0]]), ["near", "far"])))
    for _ in range(30):
        slam.step(feed(robot, Raw(np.empty((0, 2)), [])))
    assert [*m.landmarks] == ["far"]


def test_settings_and_data_that_do_not_go_together():
    with pytest.raises(InputError, match="Unknown association 'guess'"):
        Settings(association="guess")
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[SENSOR], Q=Q)
    with pytest.raises(InputError, match="needs the names"):
        Slam(m, np.random.default_rng(0)).step(feed(robot, Raw(np.ones((1, 2)))))
    bearing = m.add_robot(np.zeros(3), sensors=[CAMERA], Q=Q)
    with pytest.raises(InputError, match="for range and bearing"):
        Slam(m, np.random.default_rng(0), Settings("nearest")).step(feed(bearing, Raw(np.ones((1, 1)))))


# partial observations


def test_a_ray_enters_with_a_singular_covariance_and_no_cholesky():
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[CAMERA], Q=Q)
    m.move(robot, np.array([0.1, 0.05]))
    ray = m.initialise(robot, CAMERA, np.array([0.3]), "a")
    assert np.linalg.matrix_rank(m.joint.block(np.concatenate([robot.rows, ray.rows]))) < 7
    np.testing.assert_array_equal(m.joint.block(ray.rows[:2]), m.joint.block(robot.rows[:2]))  # the anchor is the robot
    m.correct(m.observe(robot, CAMERA, ray, np.array([0.31])))
    assert np.isfinite(m.P).all()
    assert np.linalg.eigvalsh(m.P).min() > -1e-12


def test_a_ray_becomes_a_point():
    """Triangulated from a base of 4 m the landmark lies where it is, with four slots first and two afterwards."""
    m = Map()
    robot = m.add_robot(np.zeros(3), sensors=[CAMERA], Q=1e-6 * np.eye(2))
    slam = Slam(m, np.random.default_rng(0))
    place, rng = np.array([3.0, 4.0]), np.random.default_rng(1)
    slots = []
    for k in range(1, 41):
        truth = np.array([0.1 * k, 0.0, 0.0])
        y = measured(truth, place, "bearing") + 0.01 * rng.standard_normal(1)
        slam.step(feed(robot, Raw(y[None], ["a"]), u=np.array([0.1, 0.0])))
        slots.append(len(m.landmarks["a"].rows))
    assert slots[0] == 4
    assert slots[-1] == 2
    mean, P = m.point(m.landmarks["a"])
    assert mahalanobis(place, mean, P) < 3
    assert np.linalg.norm(place - mean) < 0.3
    assert len(m.joint.space.taken) == 5


def test_conversion_to_a_point_keeps_the_gaussian_to_first_order():
    m = Map()
    robot = m.add_robot(np.zeros(3), 1e-4 * np.eye(3), Q=Q)
    ray = m.initialise(robot, CAMERA, np.array([0.3]), "a", rho=(0.5, 0.01))
    other = m.initialise(robot, SENSOR, np.array([2.0, 0.0]), "b")
    mean, P = m.point(ray)
    cross = (
        m.joint.block(other.rows, ray.rows)
        @ np.array([[1, 0, -2 * np.sin(0.3), -4 * np.cos(0.3)], [0, 1, 2 * np.cos(0.3), -4 * np.sin(0.3)]]).T
    )
    m.to_point(ray)
    np.testing.assert_allclose(m.point(ray)[0], mean)
    np.testing.assert_allclose(m.point(ray)[1], P, atol=1e-14)
    np.testing.assert_allclose(m.joint.block(other.rows, ray.rows), cross, atol=1e-14)


def test_a_negative_rho_is_repaired():
    m = Map()
    robot = m.add_robot(np.zeros(3), Q=Q)
    ray = m.initialise(robot, CAMERA, np.array([np.pi / 2]), "a")
    m.move(robot, np.array([1.0, 0.0]))
    m.correct(m.observe(robot, CAMERA, ray, np.array([np.pi / 2 - 0.5])))  # the ray would have to end behind
    assert m.x[ray.rows[3]] == 0.001


def test_a_ring_bows_little():
    for distance in (1.0, 4.0, 8.0):
        n = ring_size(distance, 0.1)
        assert distance * (1 - np.cos(np.pi / n)) <= 0.5 * 0.1 * 1.01
    assert ring_size(0.01, 0.1) == 12
    assert ring_size(1e6, 0.1) == 60


@pytest.mark.parametrize("filter", ["ekf", "ri"])
def test_a_ring_finds_its_landmark_and_gives_its_slots_back(filter):
    m = Map(filter)
    robot = m.add_robot(np.zeros(3), sensors=[SONAR], Q=1e-6 * np.eye(2))
    slam = Slam(m, np.random.default_rng(0))
    rng, place, truth = np.random.default_rng(2), np.array([1.0, 3.0]), np.zeros(3)
    sizes = []
    for k in range(60):
        turn = 0.1 if k < 30 else 0.0
        truth = np.array([truth[0] + 0.1 * np.cos(truth[2]), truth[1] + 0.1 * np.sin(truth[2]), truth[2] + turn])
        y = measured(truth, place, "range") + 0.05 * rng.standard_normal(1)
        slam.step(feed(robot, Raw(y[None], ["a"]), u=np.array([0.1, turn])))
        sizes.append(len(m.joint.space.taken))
        weights = slam.rings["a"].weights.sum() if slam.rings else 1
        assert weights == pytest.approx(1)
    assert sizes[0] > 3 + 2 * 12
    assert sizes[-1] == 5
    mean, P = m.point(m.landmarks["a"])
    assert mahalanobis(place, mean, P) < 3
    assert np.linalg.norm(mean - place) < 0.2
    assert not m.hypotheses


def test_a_ring_moves_no_robot():
    m = Map()
    robot = m.add_robot(np.zeros(3), np.diag([0.01, 0.01, 0.01]), sensors=[SONAR], Q=Q)
    ring = Ring(m, robot, SONAR, np.array([3.0]), "a")
    x, P = m.x[robot.rows].copy(), m.joint.block(robot.rows)
    ring.refine(m, robot, SONAR, np.array([3.3]))
    np.testing.assert_array_equal(m.x[robot.rows], x)
    np.testing.assert_array_equal(m.joint.block(robot.rows), P)
    ring.give_up(m)
    np.testing.assert_array_equal(m.joint.space.taken, robot.rows)


def test_rings_are_for_ranges_and_not_for_fej():
    m = Map()
    with pytest.raises(InputError, match="only the range"):
        Ring(m, m.add_robot(np.zeros(3)), SENSOR, np.array([1.0, 0.0]), "a")
    m = Map("fej")
    with pytest.raises(InputError, match="fej is not implemented for rings of range-only landmarks; use ekf"):
        Ring(m, m.add_robot(np.zeros(3)), SONAR, np.array([1.0]), "a")


# consistency and the demo


def test_nees_of_a_singular_covariance_is_infinite():
    m = Map()
    robot = m.add_robot(np.zeros(3), Q=Q)
    m.move(robot, np.array([0.1, 0.05]))
    assert m.nees(robot, np.zeros(3)) == np.inf


def test_nees_wraps_the_heading():
    m = Map()
    robot = m.add_robot(np.array([0.0, 0.0, np.pi - 0.01]), 1e-4 * np.eye(3))
    assert m.nees(robot, np.array([0.0, 0.0, -np.pi + 0.01])) == pytest.approx(4)


def test_gauge_by_hand():
    assert gauge(np.array([0, 0.1, 0.2, 0.05, 0.3]), np.array([0, 1, 2, 3, 3])) == pytest.approx(0.5)
    assert gauge(np.ones(3), np.zeros(3, dtype=int)) == 1


@pytest.fixture(scope="module")
def demos():
    return {name: [run(name, seed=seed) for seed in range(3)] for name in ("ekf", "fej", "ri")}


@pytest.mark.parametrize(("filter", "holds"), [("ekf", False), ("fej", True), ("ri", True)])
def test_gauge(demos, filter, holds):
    """The heading never becomes surer than when the first landmark was mapped, but for ekf, in every run."""
    found = [gauge(each.heading_std, each.mapped) for each in demos[filter]]
    assert min(found) > 1 - 1e-9 if holds else max(found) < 0.95


def test_the_demo_maps_the_cloister(demos):
    for runs in demos.values():
        for each in runs:
            assert sorted(each.whose) == list(range(36))
            np.testing.assert_array_equal(each.mapped[1:37], np.arange(1, 37))
            assert each.errors[-1] < 0.4
            assert (each.wrong, each.deleted) == (0, 0)
            assert each.rejected < 0.03 * each.updates
            assert np.isnan(each.nees[:3]).all()
            assert np.isfinite(each.nees[3:]).all()


def test_filters_with_the_same_seed_see_the_same_world(demos):
    for a, b in zip(demos["ekf"], demos["ri"], strict=True):
        np.testing.assert_array_equal(a.drive.y, b.drive.y)
        np.testing.assert_array_equal(a.whose, b.whose)


def test_the_order_of_consistency(demos):
    """Paired, the heading of ekf is the surest and its error the largest; NIS does not see it."""
    found = {name: assess(runs) for name, runs in demos.items()}
    assert found["ekf"].nees_mean > 1.2 * found["ri"].nees_mean
    for each in found.values():
        assert each.nis_mean == pytest.approx(1, abs=0.03)
    assert "seen its own frame turn" in " ".join(found["ekf"].words("ekf"))
    assert not any("frame" in line for line in found["ri"].words("ri"))
    stds = {name: np.mean([each.heading_std[-1] for each in runs]) for name, runs in demos.items()}
    assert stds["ekf"] < 0.95 * min(stds["fej"], stds["ri"])


def test_frames_are_kept_when_asked_for():
    world = drive(np.random.default_rng(0), steps=5)
    kept = follow("ri", world, np.random.default_rng(0), frames=True)
    assert [len(frame.points) for frame in kept.frames] == [1, 2, 3, 4, 5]
    np.testing.assert_array_equal(kept.frames[-1].points, kept.points)
    assert follow("ri", world, np.random.default_rng(0)).frames == []


def test_unknown_association_finds_the_same_landmarks():
    for association in ("nearest", "jcbb"):
        each = run("ri", seed=2, settings=Settings(association))
        assert sorted(each.whose) == list(range(36))
        assert each.wrong <= 5
        assert each.errors[-1] < 0.2


@pytest.mark.long
def test_the_demos_figures():
    """Forty paired worlds.  Independent figures: NEES ekf 4.65, fej 3.16, ri 3.03; position 0.080, 0.069, 0.069 m."""
    runs = {name: [run(name, seed=seed) for seed in range(40)] for name in ("ekf", "fej", "ri")}
    found = {name: assess(each) for name, each in runs.items()}
    low, high = chi2_band(3, 40, 0.999)
    assert found["ekf"].nees_mean > high
    for name in ("fej", "ri"):
        assert low < found[name].nees_mean < high
    for name, expected in (("ekf", 0.080), ("fej", 0.069), ("ri", 0.069)):
        errors = np.array([np.sqrt(np.mean(each.errors[1:] ** 2)) for each in runs[name]])
        assert errors.mean() == pytest.approx(expected, abs=3 * np.sqrt(2) * errors.std(ddof=1) / np.sqrt(40))
    paired = [a.nees_mean - b.nees_mean for a, b in zip(runs["ekf"], runs["ri"], strict=True)]
    assert np.mean(paired) > 2 * np.std(paired, ddof=1) / np.sqrt(40)


@pytest.mark.long
def test_the_partial_sensors_figures():
    """Bearing-only with rho 0.5 +- 0.25: independent figures 0.083 m for the pose, 0.13 m for landmarks."""
    runs = [run("ekf", seed=seed, sensor="bearing") for seed in range(20)]
    errors = np.array([np.sqrt(np.mean(each.errors[1:] ** 2)) for each in runs])
    landmarks = [np.sqrt(np.mean(np.sum((each.points - each.drive.W[each.whose]) ** 2, axis=1))) for each in runs]
    assert errors.mean() == pytest.approx(0.083, abs=3 * np.sqrt(2) * errors.std(ddof=1) / np.sqrt(20))
    assert np.mean(landmarks) == pytest.approx(0.13, abs=3 * np.sqrt(2) * np.std(landmarks, ddof=1) / np.sqrt(20))
    ranges = [run("ri", seed=seed, sensor="range") for seed in range(8)]
    assert np.mean([len(each.points) for each in ranges]) > 34
    assert np.mean([each.errors[-1] for each in ranges]) < 0.4
    assert assess(ranges).nees_mean < 8
    assert set(SENSORS) == {"range-bearing", "bearing", "range"}
