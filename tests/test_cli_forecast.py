"""``slam-lab forecast``: what it prints is what the theory says, and it writes what it promises."""

import json
import shlex

import pandas as pd
import pytest
from program import call
from worlds import REFERENCE, reference

from lab import theory

FILE = REFERENCE / "experiment_1.mat"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forecast") / "out"
    return call("forecast", "--experiment", FILE, "--out", folder), folder


def test_the_table_has_the_theorys_figures(done):
    answer, _ = done
    assert answer.status == 0
    rows = [line.split() for line in answer.out.splitlines()]
    for name, last in (("prior", "-39.3"), ("delayed", "-13.9"), ("rbpf-prior", "-29.3"), ("rbpf-optimal", "-11.2")):
        assert next(row for row in rows if row[:1] == [name])[-1] == last
    assert "-0.0" not in answer.out.split()
    assert "10^40.3" in answer.out  # particles for an ESS of 10 with the prior proposal at the end
    assert "that is no theorem" in answer.out


def test_the_files(done):
    _, folder = done
    assert sorted(file.name for file in folder.iterdir()) == [
        *("config.json", "experiment.npz", "forecast.csv", "forecast.png")
    ]
    table = pd.read_csv(folder / "forecast.csv")
    prior = table[table["proposal"] == "prior"].set_index("k")
    expected = theory.forecast(reference(1).problem, "prior")
    assert prior["log10_ess_ratio"].to_numpy() == pytest.approx(expected)
    assert prior["log10_particles_needed"].to_numpy() == pytest.approx(1 - expected)
    assert prior.loc[2, "bootstrap_particles_needed"] == pytest.approx(1e5, rel=0.1)
    repeat = shlex.split(json.loads((folder / "config.json").read_text())["repeat"])
    assert repeat[:2] == ["slam-lab", "forecast"]
    assert f"--experiment={FILE}" in repeat


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--ess", "0.5"), "ess must be at least 1"),
        (("--experiment", "absent.mat"), "absent.mat does not exist"),
        (("--scenario", "moon"), "Unknown scenario 'moon'"),
    ],
)
def test_bad_input(arguments, word):
    call("forecast", *arguments).assert_refused(word)
