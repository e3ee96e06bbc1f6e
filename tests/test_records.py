"""Files: what goes in comes out, the original's both editions, and one sentence for whatever cannot be read."""

import shutil
import subprocess

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from worlds import REFERENCE, experiment, full_scenario

from data_simulation import TWO_LANDMARKS, data_simulation
from lab import records
from lab.problem import Experiment
from lab.validation import InputError


def assert_same(one, two):
    for name in ("F", "B", "Q", "m0", "P0"):
        np.testing.assert_array_equal(getattr(one.problem.model, name), getattr(two.problem.model, name))
    for name in ("z", "H", "R"):
        np.testing.assert_array_equal(getattr(one.problem, name), getattr(two.problem, name))
    np.testing.assert_array_equal(one.centre, two.centre)
    assert (one.truth is None) == (two.truth is None)
    if one.truth is not None:
        np.testing.assert_array_equal(one.truth, two.truth)


@pytest.mark.parametrize("ending", ["npz", "mat"])
@pytest.mark.parametrize("with_truth", [True, False])
def test_round_trip(tmp_path, ending, with_truth):
    world = experiment(full_scenario(3))
    world = world if with_truth else Experiment(world.problem, None, world.centre)
    world.save(tmp_path / f"world.{ending}")
    assert_same(Experiment.load(tmp_path / f"world.{ending}"), world)
    assert [file.name for file in tmp_path.iterdir()] == [f"world.{ending}"]


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_round_trip_of_a_single_instant(tmp_path, ending):
    """MATLAB drops a last axis of length 1."""
    world = experiment(full_scenario(2, n_steps=1))
    world.save(tmp_path / f"world.{ending}")
    assert_same(Experiment.load(tmp_path / f"world.{ending}"), world)


def original(number=1):
    variables = scipy.io.loadmat(REFERENCE / f"experiment_{number}.mat")
    return {name: value for name, value in variables.items() if not name.startswith("__")}


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_originals_files(number):
    world, raw = Experiment.load(REFERENCE / f"experiment_{number}.mat"), original(number)
    np.testing.assert_array_equal(world.problem.z.T, raw["Z"])
    np.testing.assert_array_equal(np.moveaxis(world.problem.R, 0, -1), raw["arrayR"])
    np.testing.assert_array_equal(world.truth.T, raw["X"])
    np.testing.assert_array_equal(world.problem.model.B, raw["B"].ravel())
    assert world.problem.n_landmarks == 5


def test_optional_variables_may_be_missing(tmp_path):
    raw = {name: value for name, value in original().items() if not name.startswith("draw_") and name != "X"}
    scipy.io.savemat(tmp_path / "e.mat", raw)
    world = Experiment.load(tmp_path / "e.mat")
    assert world.truth is None
    assert_same(world, Experiment(Experiment.load(REFERENCE / "experiment_1.mat").problem, None, [-1.5, 0]))


def test_older_edition(tmp_path):
    """Two landmarks, no M, B, CC, arrayH, arrayR, in_fov: B and CC are 0, H and R follow from Z."""
    simulation = data_simulation(scenario=TWO_LANDMARKS, rng=4)
    missing = ("M", "B", "CC", "arrayH", "arrayR", "in_fov")
    variables = {name: np.atleast_2d(value) for name, value in simulation._asdict().items() if name not in missing}
    variables["mX0"] = variables["mX0"].T
    scipy.io.savemat(tmp_path / "old.mat", variables)
    assert_same(Experiment.load(tmp_path / "old.mat"), Experiment.from_simulation(simulation))


def test_b_and_cc_follow_from_each_other(tmp_path):
    whole = Experiment.load(REFERENCE / "experiment_1.mat")
    for name in ("B", "CC"):
        scipy.io.savemat(tmp_path / "e.mat", without(name))
        world = Experiment.load(tmp_path / "e.mat")
        np.testing.assert_allclose(world.problem.model.B, whole.problem.model.B, atol=1e-12)
        np.testing.assert_allclose(world.centre, whole.centre, atol=1e-12)


def test_sparse_matrices_and_endings_in_capitals(tmp_path):
    raw = original() | {"F": scipy.sparse.csc_matrix(original()["F"])}
    scipy.io.savemat(tmp_path / "E.MAT", raw, appendmat=False)
    assert_same(Experiment.load(tmp_path / "E.MAT"), Experiment.load(REFERENCE / "experiment_1.mat"))


def test_all_16_variables_of_a_simulation(tmp_path):
    simulation = data_simulation(rng=1)
    records.write_simulation(tmp_path / "s.mat", simulation)
    written, shapes = scipy.io.loadmat(tmp_path / "s.mat"), original()
    for name in simulation._fields:
        assert written[name].shape == shapes[name].shape, name
        assert written[name].dtype == shapes[name].dtype == np.float64
        np.testing.assert_array_equal(np.squeeze(written[name]), getattr(simulation, name))
    assert_same(Experiment.load(tmp_path / "s.mat"), Experiment.from_simulation(simulation))


@pytest.mark.skipif(not shutil.which("octave-cli"), reason="GNU Octave is not installed")
def test_octave_reads_what_we_write(tmp_path):
    world = experiment()
    world.save(tmp_path / "e.mat")
    script = "load e.mat; printf('%d %d %.15g %.15g', N, M, sum(X(:)), sum(arrayR(~isnan(arrayR))));"
    done = subprocess.run(
        ["octave-cli", "-qf", "--eval", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    values = [float(word) for word in done.stdout.split()]
    assert values == pytest.approx([50, 5, world.truth.sum(), np.nansum(world.problem.R)])


def without(*names):
    return {name: value for name, value in original().items() if name not in names}


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        (without("Z"), "the variable Z is missing"),
        (without("B", "CC"), "the variables B and CC are missing"),
        (without("Z", "F"), "the variables Z and F are missing"),
        (without("arrayH", "Hfull"), "the variable arrayH or Hfull is missing"),
        (without("arrayR", "Rv", "Qw"), "the variables Qw and arrayR or Rv are missing"),
        (original() | {"Z": original()["Z"][:8]}, r"Z has shape \(8, 50\), which does not fit M = \[5.0\] landmarks"),
        (
            original() | {"Z": original()["Z"][:, :40]},
            r"Z has shape \(10, 40\), which does not fit N = \[50.0\] instants",
        ),
        (original() | {"arrayH": np.zeros((10, 12, 49))}, r"arrayH must have shape \(10, 12, 50\), not \(10, 12, 49\)"),
        (original() | {"arrayR": np.zeros((10, 10))}, r"arrayR must have shape \(10, 10, 50\), not \(10, 10\)"),
        (original() | {"F": np.eye(11)}, r"F must have shape \(12, 12\), not \(11, 11\)"),
        (original() | {"mX0": np.zeros((11, 1))}, r"mX0 must have shape \(12,\), not \(11,\)"),
        (original() | {"X": np.zeros((50, 12))}, r"X must have shape \(12, 50\), not \(50, 12\)"),
        (original() | {"Qw": original()["Qw"].astype(complex)}, "Qw must hold real numbers"),
        (original() | {"F": "identity"}, "F must hold real numbers"),
        (original() | {"F": {"nested": 1.0}}, "F must hold real numbers"),
        (original() | {"F": np.array([1.0, "x"], dtype=object)}, "F must hold real numbers"),
        (original() | {"PX0": np.triu(np.ones((12, 12)))}, "PX0 is not symmetric"),
    ],
)
def test_bad_mat_files_are_named(tmp_path, variables, message):
    scipy.io.savemat(tmp_path / "bad.mat", variables)
    with pytest.raises(InputError, match=message) as caught:
        Experiment.load(tmp_path / "bad.mat")
    assert str(caught.value).startswith(str(tmp_path / "bad.mat"))


def test_unreadable_files(tmp_path):
    text = tmp_path / "text.mat"
    text.write_text("not a matrix at all " * 50)
    octave = tmp_path / "octave.mat"
    octave.write_text("# Created by Octave 7.3.0\n# name: Z\n# type: matrix\n")
    empty = tmp_path / "empty.mat"
    empty.write_bytes(b"")
    hdf = tmp_path / "hdf.mat"
    hdf.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" * 8)
    whole = (REFERENCE / "experiment_1.mat").read_bytes()
    cut = tmp_path / "cut.mat"
    cut.write_bytes(whole[: len(whole) // 2])
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK\x03\x04 and no more")
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, F=np.array([{"a": 1}], dtype=object))
    other = tmp_path / "other.npz"
    np.savez(other, F=np.eye(3))
    plain = tmp_path / "plain.npz"
    with plain.open("wb") as file:
        np.save(file, np.eye(3))
    for path, message in (
        (text, "damaged, or not a .mat"),
        (octave, "in Octave, save it with '-v7'"),
        (empty, "damaged, or not a .mat"),
        (hdf, "-v7.3 file"),
        (cut, "cannot be read"),
        (broken, "damaged, or not a .npz"),
        (pickled, "damaged, or not a .npz"),
        (other, "it has no B, Q"),
        (plain, "it has no F, B"),
        (tmp_path / "none.mat", "does not exist"),
        (tmp_path / "file.csv", "ends in .mat or .npz"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            Experiment.load(path)
        assert str(path) in str(caught.value)
    (tmp_path / "folder.mat").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        Experiment.load(tmp_path / "folder.mat")


def test_damaged_bytes_are_always_one_sentence(tmp_path):
    """Flip bytes at random: whatever the readers raise must arrive as an InputError that names the file."""
    rng = np.random.default_rng(0)
    experiment(full_scenario(1, n_steps=3)).save(tmp_path / "whole.npz")
    messages = []
    for source in (REFERENCE / "experiment_1.mat", tmp_path / "whole.npz"):
        path = tmp_path / f"damaged{source.suffix}"
        for _ in range(150):
            data = np.frombuffer(source.read_bytes(), np.uint8).copy()
            data[rng.integers(0, min(len(data), 4000), size=2)] = rng.integers(0, 256, size=2)
            path.write_bytes(data.tobytes()[: rng.integers(1, 2 * len(data))])
            try:
                Experiment.load(path)
            except InputError as error:
                messages.append(str(error))
    assert len(messages) > 100
    assert all("damaged." in message for message in messages)


def test_writing_is_all_or_nothing(tmp_path, monkeypatch):
    world = experiment()
    target = tmp_path / "e.npz"
    world.save(target)
    before = target.read_bytes()

    def half(path, **arrays):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", half)
    with pytest.raises(KeyboardInterrupt):
        world.save(target)
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]


def test_where_nothing_can_be_written(tmp_path):
    world = experiment()
    with pytest.raises(InputError, match="cannot be written"):
        world.save(tmp_path / "missing" / "e.npz")
    (tmp_path / "d.npz").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        world.save(tmp_path / "d.npz")
    with pytest.raises(InputError, match=r"ends in \.mat or \.npz"):
        world.save(tmp_path / "e.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["d.npz"]


def test_a_saved_file_is_readable_by_others(tmp_path):
    experiment().save(tmp_path / "e.npz")
    assert (tmp_path / "e.npz").stat().st_mode & 0o044
