"""What is kept of a comparison under way, and going on from it: every result equal to that of one go."""

from dataclasses import fields, replace

import numpy as np
import pytest
from worlds import full_scenario, problem

from lab.compare import compare
from lab.comparison import Record
from lab.execution import here as in_this_process
from lab.metrics import Metrics
from lab.solvers import kalman, rbpf, sir
from lab.sweep import Unfinished, moments_table, resumable
from lab.validation import InputError

CONFIG = {
    "arguments": {"runs": 3, "seed": 4, "experiment": "a.mat"},
    "inputs": {"experiment": {"file": "a.mat", "sha256": "12"}},
    "versions": {"toy-slam-lab": "1", "numpy": "2", "scipy": "3", "filterpy": "4", "matplotlib": "5"},
}


def silent(problem, rng, *, n_particles):
    """Give neither ESS nor survivors, and fail now and then."""
    if n_particles == 7 and rng.random() < 0.5:
        raise ValueError("no luck")
    return kalman(problem)


@pytest.fixture(scope="module")
def given():
    worlds = [problem(full_scenario(2, n_steps=6), seed) for seed in (0, 1)]
    solvers = {"sir": sir, "a/b é": rbpf, "silent": silent}
    return {"problem": worlds, "solvers": solvers, "n_particles": [7, 20], "runs": 3, "seed": 4}


@pytest.fixture(scope="module")
def whole(given):
    return compare(**given, keep_moments=True)


@pytest.fixture
def unfinished(tmp_path):
    return Unfinished(tmp_path / "result")


def assert_same(one, other):
    assert one.runs.drop(columns="seconds").equals(other.runs.drop(columns="seconds"))
    for mine, yours in zip(one.records, other.records, strict=True):
        for name in ("ess", "survivors"):
            assert np.array_equal(getattr(mine, name), getattr(yours, name))
        assert (mine.filtered is None) == (yours.filtered is None)
        if mine.filtered is not None:
            for field in fields(mine.filtered):
                assert np.array_equal(getattr(mine.filtered, field.name), getattr(yours.filtered, field.name))


class Counting:
    """Runs batches here, notes their units, and stops after some."""

    def __init__(self, stop_after=10**9):
        self.units, self.left = [], stop_after

    def __call__(self, function, items, lost):
        for item in items:
            if not self.left:
                raise KeyboardInterrupt
            self.left -= 1
            self.units += item
            yield function(item)


@pytest.mark.parametrize("keep_moments", [False, True])
def test_a_comparison_stopped_twice_equals_one_that_never_was(given, whole, unfinished, keep_moments):
    done = []
    for stop_after in (3, 4, 10**9):
        execute = Counting(stop_after)
        try:
            with unfinished.begun(CONFIG):
                result = compare(**given, keep_moments=keep_moments, execute=resumable(execute, unfinished))
        except KeyboardInterrupt:
            assert execute.left == 0
            assert execute.units
        done += execute.units
    assert len(done) == len(set(done)) == 36
    assert_same(result, whole if keep_moments else compare(**given))
    assert len(result.failures) > 0
    kept = unfinished.finished()
    assert [kept[r.unit].metrics.seconds for r in result.records] == pytest.approx(
        [r.metrics.seconds for r in result.records], nan_ok=True
    )
    unfinished.remove()
    assert not unfinished.folder.exists()


def test_damaged_lines_are_computed_again(given, whole, unfinished):
    with unfinished.begun(CONFIG):
        compare(**given, keep_moments=True, execute=resumable(in_this_process, unfinished))
    file = unfinished.folder / "finished.lines"
    lines = file.read_bytes().split(b"\n")[1:]
    assert len(lines) == 36
    lines[0] = lines[0][:100]
    lines[1] = b""
    lines[2] = lines[2][:400] + bytes(400) + lines[2][800:]  # a power cut
    lines[-1] = lines[-1][:-1]  # a kill
    file.write_bytes(b"\n" + b"\n".join(lines))
    assert len(unfinished.finished()) == 32
    execute = Counting()
    result = compare(**given, keep_moments=True, execute=resumable(execute, unfinished))
    assert len(execute.units) == 4
    assert_same(result, whole)
    assert len(unfinished.finished()) == 36  # what follows a half written line is a line of its own


def test_a_line_with_a_changed_byte_is_as_good_as_none(given, unfinished):
    with unfinished.begun(CONFIG):
        unfinished.keep(compare(**given | {"runs": 1}).records[0])
        file = unfinished.folder / "finished.lines"
        whole = file.read_bytes()
        assert len(unfinished.finished()) == 1
        for place in range(1, len(whole), 7):
            file.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
            assert unfinished.finished() == {}


def test_a_half_written_line_alone_is_removed(given, unfinished):
    """Of a disk that was full at the first one: the same command is to begin again."""
    with unfinished.begun(CONFIG):
        unfinished.keep(compare(**given | {"runs": 1}).records[0])
        file = unfinished.folder / "finished.lines"
        file.write_bytes(file.read_bytes()[:50])
    assert not unfinished.folder.exists()


def test_what_somebody_else_left_there_is_not_removed(unfinished):
    with unfinished.begun(CONFIG):
        (unfinished.folder / "notes.txt").touch()
    assert [path.name for path in unfinished.folder.glob("notes*")] == ["notes.txt"]
    (unfinished.folder / "notes.txt").unlink()
    with unfinished.begun(CONFIG):
        pass
    assert not unfinished.folder.exists()


def test_a_unit_whose_worker_died_is_tried_again(given, unfinished):
    record = compare(**given | {"runs": 1}).records[0]
    with unfinished.begun(CONFIG):
        unfinished.keep(Record(record.unit, Metrics(), error="died", died=True))
        assert unfinished.finished() == {}
        unfinished.keep(replace(record, error="raised"))
        assert unfinished.finished()[record.unit].error == "raised"


def test_it_is_removed_at_once_or_not_at_all(given, unfinished, monkeypatch):
    """Half removed, it would look like another program's."""
    with unfinished.begun(CONFIG):
        unfinished.keep(compare(**given | {"runs": 1}).records[0])
    monkeypatch.setattr("lab.sweep.shutil.rmtree", lambda *_, **__: None)
    unfinished.remove()
    assert unfinished.config is None
    assert [path.name[:9] for path in unfinished.folder.parent.iterdir()] == [".partial-"]


def test_it_is_removed_twice_and_nothing_remains(given, unfinished):
    """Once when the result is written, and once more when the block ends."""
    with unfinished.begun(CONFIG):
        unfinished.keep(compare(**given | {"runs": 1}).records[0])
        (unfinished.folder.parent / "result").touch()
        unfinished.remove()
    assert [path.name for path in unfinished.folder.parent.iterdir()] == ["result"]


def test_nothing_finished_leaves_nothing(unfinished):
    with unfinished.begun(CONFIG):
        assert unfinished.config == CONFIG
    assert not unfinished.folder.parent.exists()
    unfinished.folder.parent.mkdir()
    with unfinished.begun(CONFIG):
        pass
    assert not list(unfinished.folder.parent.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"arguments": {"runs": 5, "seed": 4}}, r"was begun with --runs 3, not 5; give the same, or leave it out"),
        ({"arguments": {"runs": 3, "seed": 4, "moments": True}}, "was begun with --moments None, not True"),
        ({"inputs": {"experiment": {"file": "b.mat", "sha256": "13"}}}, r"b\.mat is not the file with which .* begun"),
        ({"inputs": {}}, r"a\.mat is not the file with which"),
        ({"versions": CONFIG["versions"] | {"numpy": "3"}}, "was begun with numpy 2, and this is 3"),
    ],
)
def test_what_would_not_fit_is_refused(given, unfinished, change, message):
    with unfinished.begun(CONFIG):
        unfinished.keep(compare(**given | {"runs": 1}).records[0])
    with pytest.raises(InputError, match=message), unfinished.begun(CONFIG | change):
        pass
    assert len(unfinished.finished()) == 1
    same = CONFIG | {
        "arguments": CONFIG["arguments"] | {"experiment": "./a.mat"},
        "versions": CONFIG["versions"] | {"matplotlib": "6"},
    }
    with unfinished.begun(same):
        pass
    assert len(unfinished.finished()) == 1


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"arguments": 1, "inputs": {}, "versions": {}}', None])
def test_another_programs_folder_is_left_alone(unfinished, text):
    unfinished.folder.mkdir(parents=True)
    (unfinished.folder / ("config.json" if text is not None else "thesis.txt")).write_text(text or "mine")
    with pytest.raises(InputError, match="not ours"), unfinished.begun(CONFIG):
        pass
    assert len(list(unfinished.folder.iterdir())) == 1


def test_moments_are_those_of_the_records(whole):
    table = moments_table(whole)
    assert len(table) == 6 * (2 + 36 - len(whole.failures))
    row = table.query("data_set == 1 and solver == 'sir' and n_particles == 20 and run == 2 and k == 3").iloc[0]
    (record,) = [r for r in whole.of("sir", 20) if (r.unit.data_set, r.unit.run) == (1, 2)]
    assert (row["mean"] == record.filtered.means[3]).all()
    assert (row["cov"] == record.filtered.covs[3].ravel()).all()
    assert (row["log_evidence"], row["ess"]) == (record.filtered.log_evidence[3], record.ess[3])
    exact = table.query("data_set == 1 and solver == 'exact' and k == 3").iloc[0]
    assert (exact["mean"] == whole.exacts[1].means[3]).all()
    assert np.isnan(exact["ess"])


def test_summary_over_data_sets_first(whole):
    runs, summary = whole.runs, whole.summary().set_index(["solver", "n_particles"])
    mine = runs[(runs["solver"] == "sir") & (runs["n_particles"] == 7)]
    means = [mine[mine["data_set"] == i]["mean_gap"].mean() for i in (0, 1)]
    row = summary.loc[("sir", 7)]
    assert (row["data_sets"], row["runs"]) == (2, 6)
    assert row["mean_gap"] == pytest.approx(sum(means) / 2)
    assert row["mean_gap_se"] == pytest.approx(abs(means[0] - means[1]) / 2)  # sd / sqrt(2) of two
