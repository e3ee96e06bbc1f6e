"""The command line when all goes well: what it writes, says, repeats and leaves alone."""

import json
import shlex
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
import scipy.io
from PIL import Image
from program import call, everything_in
from worlds import REFERENCE

from data_simulation import HANDOUT, TWO_LANDMARKS, data_simulation
from lab.compare import compare
from lab.findings import findings
from lab.problem import Experiment
from lab.solvers import SOLVERS, kalman
from lab.units import unit_seed

FIRST_COLUMNS = (
    "solver,n_particles,runs,mean_gap,mean_gap_se,cov_gap,cov_gap_se,log_evidence_gap,log_evidence_gap_se,"
    "ess_min,collapsed_at,seconds_per_run,ancestors_left"
)
ARGUMENTS = ("--solvers", "sis,low=sir:ess_threshold=0.2:resample=residual", "--particles", "20,60")
ARGUMENTS += ("--runs", "3", "--seed", "7", "--scenario", "two-landmarks")


def runs_in(folder):
    return pd.read_csv(folder / "runs.csv", keep_default_na=True).drop(columns="seconds")


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """One comparison with all its figures, in a folder whose parents are missing."""
    folder = tmp_path_factory.mktemp("compared") / "deep" / "result"
    return folder, call("compare", *ARGUMENTS, "--out", folder)


def test_a_comparison_ends_well(compared):
    folder, done = compared
    assert (done.status, done.err) == (0, "")
    assert done.out.endswith(f"Tables and figures are in {folder}.\n")


def test_the_columns_and_rows_of_the_summary(compared):
    folder, _ = compared
    lines = (folder / "summary.csv").read_text().splitlines()
    assert lines[0].startswith(FIRST_COLUMNS)
    assert [line.split(",")[:3] for line in lines[1:]] == [
        ["sis", "20", "3"],
        ["sis", "60", "3"],
        ["low", "20", "3"],
        ["low", "60", "3"],
    ]


def test_one_row_per_unit_with_its_seed(compared):
    runs = runs_in(compared[0])
    units = [(s, n, r) for s in ("sis", "low") for n in (20, 60) for r in range(3)]
    assert list(zip(runs["solver"], runs["n_particles"], runs["run"], strict=True)) == units
    assert runs["seed"].tolist() == [unit_seed(7, *unit) for unit in units]
    assert runs["error"].isna().all()


def test_the_summary_is_that_of_the_runs(compared):
    summary, runs = pd.read_csv(compared[0] / "summary.csv"), runs_in(compared[0])
    grouped = runs.groupby(["solver", "n_particles"], sort=False)
    for name in ("mean_gap", "cov_gap", "log_evidence_gap", "ess_min", "ancestors_left"):
        np.testing.assert_allclose(summary[name], grouped[name].mean())
    np.testing.assert_allclose(summary["mean_gap_se"], grouped["mean_gap"].std() / np.sqrt(3))


def test_the_files_are_those_listed(compared):
    folder, _ = compared
    names = ["config.json", "corridors-low.png", "corridors-sis.png", "cost.png", "ess.png", "evidence.png"]
    names += ["experiment.npz", "gap.png", "loop-closure-low.png", "loop-closure-sis.png"]
    names += ["map-low.png", "map-sis.png", "report.html", "runs.csv", "runs.parquet", "summary.csv"]
    assert sorted(everything_in(folder)) == names
    assert json.loads((folder / "config.json").read_text())["files"] == names


def test_figures_are_pictures_that_say_what_they_show(compared):
    words = {"gap": "against N", "ess": "ancestors", "corridors-low": "low (N = 60, run 0)", "map-sis": "99 % ellipses"}
    pictures = sorted(compared[0].glob("*.png"))
    assert {picture.stem for picture in pictures} >= set(words)
    for picture in pictures:
        with Image.open(picture) as image:
            image.load()
            assert min(image.size) >= 500
            assert len(image.convert("L").getcolors()) > 50  # not blank
            assert words.get(picture.stem, "") in image.text["Description"]


def test_what_filters_are_compared_with_is_filterpys_answer(here, no_pictures):
    """To 1e-9, though it is computed in another form."""
    call("compare", "--solvers", "sir", "--particles", "5", "--runs", "1", "--moments", "--out", "a")
    table = pd.read_parquet("a/moments.parquet")
    exact, theirs = (
        table[table["solver"] == "exact"],
        kalman(Experiment.load("a/experiment.npz").problem, method="dense"),
    )
    assert exact["k"].tolist() == list(range(len(theirs.means)))
    for name, values in (("mean", theirs.means), ("cov", theirs.covs), ("log_evidence", theirs.log_evidence)):
        found = np.array(exact[name].tolist())
        np.testing.assert_allclose(found, values.reshape(found.shape), rtol=1e-9, atol=1e-11)


def test_the_experiment_is_kept(compared):
    kept = Experiment.load(compared[0] / "experiment.npz")
    simulated = Experiment.from_simulation(data_simulation(scenario=TWO_LANDMARKS, rng=7))
    np.testing.assert_array_equal(kept.problem.z, simulated.problem.z)
    np.testing.assert_array_equal(kept.truth, simulated.truth)


def test_the_table_and_the_plain_words(compared):
    table, *words = compared[1].out.split("\n\n")
    assert all(unit in table for unit in ("[exact std]", "[relative]", "ESS/N"))
    rows = [line.split()[:3] for line in table.splitlines()[2:]]
    assert rows == [["sis", "20", "3"], ["sis", "60", "3"], ["low", "20", "3"], ["low", "60", "3"]]
    summary = pd.read_csv(compared[0] / "summary.csv")
    assert f"{summary['mean_gap'][0]:.3g} ({summary['mean_gap_se'][0]:.2g})" in table
    solvers = {"sis": SOLVERS["sis"], "low": partial(SOLVERS["sir"], ess_threshold=0.2, resample="residual")}
    problem = Experiment.from_simulation(data_simulation(scenario=TWO_LANDMARKS, rng=7)).problem
    expected = findings(compare(problem, solvers, n_particles=[20, 60], runs=3, seed=7))
    assert words[0].splitlines() == expected
    assert any("collapse" in sentence for sentence in expected)


def test_numbers_are_written_as_people_write_them():
    from lab.cli.tables import _number

    assert [_number(value, 2) for value in (130.4, 0.00094321, 10000, 3.0, -2791)] == [
        "130",
        "0.00094",
        "10000",
        "3",
        "-2800",
    ]


@pytest.mark.usefixtures("no_pictures")
def test_the_command_in_config_json_repeats_the_result(here):
    (here / "my filters").mkdir()
    (here / "my filters" / "own.py").write_text("from lab.solvers import sir as mine\n")
    (here / "data.mat").write_bytes((REFERENCE / "experiment_2.mat").read_bytes())
    solvers = "sis,my=my filters/own.py:mine:ess_threshold=1"
    more = ("--experiment", "data.mat", "--landmark-noise", "0.01", "--solvers", solvers)
    assert call("compare", *more, "--particles", "30,10", "--runs", "2", "--seed", "5", "--out", "one").status == 0
    config = json.loads((here / "one" / "config.json").read_text())
    program, *again = shlex.split(config["repeat"])
    assert program == "slam-lab"
    assert call(*again, "--out", "two").status == 0
    one, two = (pd.read_csv(here / name / "runs.csv").drop(columns="seconds") for name in ("one", "two"))
    assert len(one) == 8
    assert one.equals(two)
    assert set(config["inputs"]) == {"experiment", "solver my"}
    assert len(config["inputs"]["solver my"]["sha256"]) == 64
    assert {"numpy", "toy-slam-lab", "python"} <= set(config["versions"])


@pytest.mark.usefixtures("no_pictures")
def test_a_scenario_is_repeated_by_its_name(here):
    call("compare", "--particles", "10", "--runs", "1", "--solvers", "sis", "--scenario", "two-landmarks", "--out", "a")
    arguments = json.loads((here / "a" / "config.json").read_text())["arguments"]
    assert arguments["scenario"] == "two-landmarks"
    call("compare", "--particles", "10", "--runs", "1", "--solvers", "sis", "--out", "b")
    assert "--scenario=handout" in json.loads((here / "b" / "config.json").read_text())["repeat"]


def test_landmark_noise_belongs_to_the_model_of_all(here):
    """Else the exact filter and the particles would answer different questions."""
    plain = call("run", "kalman").out
    assert call("run", "kalman", "--landmark-noise", "0").out == plain
    noisy = call("run", "kalman", "--landmark-noise", "0.05").out
    problem = Experiment.from_simulation(data_simulation(rng=0)).problem.with_landmark_noise(0.05)
    assert f"log-evidence {kalman(problem).log_evidence[-1]:.4f} (exact)" in noisy
    assert noisy != plain


def test_without_out_nothing_is_written(here):
    assert call("compare", "--particles", "10", "--runs", "1").status == 0
    assert call("run", "sir", "--particles", "10").status == 0
    assert call("simulate").status == 0
    assert everything_in(here) == {}


def test_run_kalman_shows_the_exact_moments_once(here):
    done = call("run", "kalman", "--experiment", REFERENCE / "experiment_1.mat")
    assert (done.status, done.err) == (0, "")
    experiment = Experiment.load(REFERENCE / "experiment_1.mat")
    exact = kalman(experiment.problem)
    lines = done.out.splitlines()
    assert lines[0].split() == ["exact_mean", "exact_std", "truth"]
    assert lines[1].split() == ["k", "=", "49", "[m]", "[m]", "[m]"]
    names = ["r_x", "r_y", *(f"m{i}_{axis}" for i in range(1, 6) for axis in "xy")]
    rows = zip(names, exact.means[-1], exact.stds[-1], experiment.truth[-1], strict=True)
    assert [line.split() for line in lines[2:14]] == [[name, *(f"{v:.4f}" for v in values)] for name, *values in rows]


@pytest.mark.usefixtures("no_pictures")
def test_run_gives_the_numbers_of_that_run_of_a_comparison(here):
    source = ("--experiment", REFERENCE / "experiment_3.mat", "--seed", "11")
    call("compare", *source, "--solvers", "sir", "--particles", "40,80", "--runs", "4", "--out", "all")
    row = runs_in(here / "all").query("n_particles == 80 and run == 3").iloc[0]
    done = call("run", "sir", *source, "--particles", "80", "--run", "3", "--out", "one")
    assert (done.status, done.err) == (0, "")
    assert f"seed {row['seed']}" in done.out
    assert f"mean gap {row['mean_gap']:.4g} [exact std], cov gap {row['cov_gap']:.4g} [relative]" in done.out
    moments = pd.read_csv(here / "one" / "moments.csv")
    assert list(moments.columns) == ["k", "component", "mean", "std", "exact_mean", "exact_std", "truth"]
    assert len(moments) == 50 * 12
    later = moments[moments["k"] > 0]
    gaps = (later["mean"] - later["exact_mean"]) / later["exact_std"]
    assert np.sqrt((gaps**2).mean()) == pytest.approx(row["mean_gap"], rel=1e-12)
    assert sorted(everything_in(here / "one")) == [
        "config.json",
        "corridors.png",
        "experiment.npz",
        "map.png",
        "moments.csv",
    ]
    _, *again = shlex.split(json.loads((here / "one" / "config.json").read_text())["repeat"])
    call(*again, "--out", "two")
    assert (here / "two" / "moments.csv").read_bytes() == (here / "one" / "moments.csv").read_bytes()


def test_run_draws_kalman_alone_and_without_a_truth(here):
    experiment = Experiment.load(REFERENCE / "experiment_1.mat")
    Experiment(experiment.problem, None, experiment.centre).save(here / "real.npz")
    done = call("run", "kalman", "--experiment", "real.npz", "--out", "exact")
    assert (done.status, done.err) == (0, "")
    assert "truth" not in done.out
    assert list(pd.read_csv(here / "exact" / "moments.csv").columns) == ["k", "component", "exact_mean", "exact_std"]
    with Image.open(here / "exact" / "map.png") as image:
        assert "kalman" in image.text["Description"]


@pytest.mark.parametrize("ending", ["npz", "mat"])
@pytest.mark.parametrize(("name", "scenario"), [("handout", HANDOUT), ("two-landmarks", TWO_LANDMARKS)])
def test_simulate_and_load_back(here, ending, name, scenario):
    done = call("simulate", "--scenario", name, "--seed", "3", "--out", f"e.{ending}")
    assert (done.status, done.err) == (0, "")
    simulation = data_simulation(scenario=scenario, rng=3)
    counts = np.bincount((~np.isnan(simulation.Z[::2, 1:])).sum(axis=0))
    for n, count in enumerate(counts):
        assert f"{n} seen at {count}" in done.out
    assert f"Written: e.{ending}" in done.out
    assert list(everything_in(here)) == [f"e.{ending}"]
    one, two = Experiment.load(f"e.{ending}"), Experiment.from_simulation(simulation)
    np.testing.assert_array_equal(one.problem.z, two.problem.z)
    np.testing.assert_array_equal(one.truth, two.truth)
    if ending == "mat":
        assert {*simulation._fields} <= {*scipy.io.loadmat("e.mat")}
    assert (
        call("run", "kalman", "--experiment", f"e.{ending}").out
        == call("run", "kalman", "--scenario", name, "--seed", "3").out
    )


def test_simulate_writes_the_animation(here, monkeypatch):
    monkeypatch.setattr("data_simulation.TWO_LANDMARKS", replace(TWO_LANDMARKS, n_steps=4))
    done = call("simulate", "--scenario", "two-landmarks", "--out", "e.npz", "--animate", "e.gif")
    assert (done.status, done.err) == (0, "")
    assert sorted(everything_in(here)) == ["e.gif", "e.npz"]
    with Image.open("e.gif") as image:
        assert image.n_frames == 4


@pytest.mark.parametrize("arguments", [["--help"], ["compare", "--help"], ["run", "--help"], ["simulate", "--help"]])
def test_help(arguments):
    done = call(*arguments)
    assert (done.status, done.err) == (0, "")
    assert "Usage: slam-lab" in done.out
    options = {"compare": ("--experiment", "--landmark-noise", "--jobs"), "run": ("--run",), "simulate": ("--animate",)}
    words = options.get(arguments[0], ("simulate", "run", "compare", "--version"))
    assert all(word in done.out for word in words)


def test_no_command_shows_the_help():
    done = call()
    assert done.status == 2
    assert "Usage: slam-lab" in done.out
    assert done.err == ""


def test_version():
    import lab

    assert call("--version") == (0, f"slam-lab {lab.__version__}\n", "")


def test_output_in_a_file_is_not_folded():
    label = "long" * 30
    table, words = call("compare", "--solvers", f"{label}=sir", "--particles", "10", "--runs", "1").out.split("\n\n")
    assert table.splitlines()[2].startswith(f"{label}  10")
    assert all(line.startswith(f"{label}: ") for line in words.splitlines())


def test_no_progress_unless_on_a_terminal():
    """On one, test_cli_process.py sees it."""
    assert call("compare", "--solvers", "sis", "--particles", "10", "--runs", "1").err == ""
