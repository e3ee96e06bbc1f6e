"""The figures that the commands write, as PNG files with a description inside for those who cannot see them."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lab import execution, plots
from lab.cli import captions
from lab.cli.captions import Picture
from lab.comparison import Comparison
from lab.execution import Execute
from lab.plots.comparison import ess_grid
from lab.plots.corridors import MOST_LANDMARKS
from lab.plots.loop_closure import kept, loop_closure
from lab.plots.style import new_figure, record_in_words, save_png
from lab.problem import Experiment
from lab.result import Filtered
from lab.validation import Array
from lab.workers import Crew

Group = str | tuple[str, str]
LONGEST = 60  # characters of a label in a file's name


def write_comparison(
    folder: Path,
    comparison: Comparison,
    experiment: Experiment,
    on_done: Callable[[int, int], None],
    *,
    jobs: int = 1,
    crew: Crew | None = None,
) -> list[Picture]:
    """Write the figures of a comparison, and for each solver those of its first good run kept, with the largest N.

    Parameters
    ----------
    folder : Path
        Gets gap.png, cost.png, evidence.png and ess.png, and for each solver loop-closure, corridors and map.
    comparison : Comparison
    experiment : Experiment
        The first data set's, for the truth.
    on_done : function of int and int
        Told after each figure, or group of figures, how many of how many are there.
    jobs : int
        Processes that draw, this one among them; -1 for one per processor.
    crew : Crew, optional
        Of a worker that was started before, and is ended.

    Returns
    -------
    list of Picture
        Name, title and description of each file, in the order in which a report shows them.
    """
    drawing = _Drawing(folder, comparison, experiment)
    groups: list[Group] = [*_GENERAL, *_suffixes(comparison.solvers).items()]
    run: Execute = execution.here if jobs == 1 else partial(execution.processes, jobs=jobs, beside=True, crew=crew)
    written: dict[Group, list[Picture]] = {}
    for group, pictures in run(drawing, groups[::-1], lambda group, _: drawing(group)):
        written[group] = pictures
        on_done(len(written), len(groups))
    return [picture for group in groups for picture in written[group]]


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Writes a group of figures: a general one, or those of a solver, given as label and end of the files' names."""

    folder: Path
    comparison: Comparison
    experiment: Experiment

    def __call__(self, group: Group) -> tuple[Group, list[Picture]]:
        if isinstance(group, str):
            return group, [_GENERAL[group](self.folder, self.comparison)]
        solver, suffix = group
        record = kept(self.comparison, solver)
        if record is None:
            return group, []
        closure = _write_closure(self.folder, suffix, self.comparison, solver)
        label, exact = record_in_words(self.comparison, record), self.comparison.exacts[0]
        return group, [closure, *write_estimate(self.folder, suffix, record.filtered, exact, self.experiment, label)]


def _write_gap(folder: Path, comparison: Comparison) -> Picture:
    picture = captions.gap(comparison, "gap.png")
    figure = new_figure(10, 4.8)
    axes = figure.subplots(1, 2)
    for ax, metric in zip(axes, ("mean_gap", "cov_gap"), strict=True):
        plots.draw_gap(ax, comparison, metric)
    figure.suptitle(picture.title)
    plots.legend_below(figure, axes[0])
    return _saved(figure, folder, picture)


def _write_cost(folder: Path, comparison: Comparison) -> Picture:
    figure = new_figure(7.5, 5.8)
    ax = figure.subplots()
    plots.draw_cost(ax, comparison)
    plots.legend_below(figure, ax)
    return _saved(figure, folder, captions.cost(comparison, "cost.png"))


def _write_evidence(folder: Path, comparison: Comparison) -> Picture:
    figure = new_figure(9, 5.5)
    ax = figure.subplots()
    plots.draw_evidence(ax, comparison)
    plots.legend_below(figure, ax)
    return _saved(figure, folder, captions.evidence(comparison, "evidence.png"))


def _write_ess(folder: Path, comparison: Comparison) -> Picture:
    rows, width = ess_grid(len(comparison.solvers))
    figure = new_figure(1 + max(3.0 * width, 5), 0.8 + 5.4 * rows)
    plots.draw_ess(figure, comparison)
    return _saved(figure, folder, captions.ess(comparison, "ess.png"))


_GENERAL = {"gap": _write_gap, "cost": _write_cost, "evidence": _write_evidence, "ess": _write_ess}


def _write_closure(folder: Path, suffix: str, comparison: Comparison, solver: str) -> Picture:
    closes = loop_closure(comparison.problems[0], comparison.exacts[0])
    figure = new_figure(11, 8 if closes else 1.5)
    plots.draw_loop_closure(figure, comparison, solver)
    return _saved(figure, folder, captions.closure(comparison, solver, f"loop-closure{suffix}.png"))


def _saved(figure: Any, folder: Path, picture: Picture) -> Picture:
    save_png(figure, folder / picture.file, picture.alt)
    return picture


def write_forecast(folder: Path, forecasts: dict[str, Array], errors: dict[int, Array], limit: float) -> None:
    """Write forecast.png: degeneracy of each proposal, and the bootstrap filter's predicted error."""
    figure = new_figure(11, 4.8)
    left, right = figure.subplots(1, 2)
    plots.draw_forecast(left, forecasts)
    plots.draw_predicted_error(right, errors, limit)
    description = "Forecast ESS/N of five proposals over time, and predicted error of the bootstrap filter, log scales."
    save_png(figure, folder / "forecast.png", description)


def write_estimate(
    folder: Path, suffix: str, filtered: Filtered | None, exact: Filtered, experiment: Experiment, label: str
) -> list[Picture]:
    """Write corridors and map of one estimate beside the exact ones; None for `filtered` draws the exact alone."""
    rows = min(exact.means.shape[1] // 2, 1 + MOST_LANDMARKS)
    figure = new_figure(10, 1.4 + 1.6 * rows)
    plots.draw_corridors(figure, filtered, exact, experiment.truth, label=label)
    picture = captions.corridors(filtered, exact, experiment.truth, label, f"corridors{suffix}.png")
    corridors = _saved(figure, folder, picture)
    figure = new_figure(7.5, 7.5)
    ax = figure.subplots()
    plots.draw_map(ax, filtered, exact, experiment.truth, label=label)
    plots.legend_below(figure, ax)
    return [corridors, _saved(figure, folder, captions.final_map(filtered, exact, label, f"map{suffix}.png"))]


def _suffixes(solvers: list[str]) -> dict[str, str]:
    """Return the end of a file's name for each label: one of its own even where the system ignores case."""
    suffixes: dict[str, str] = {}
    for solver in solvers:
        plain = stem = f"-{re.sub(r'[^A-Za-z0-9_.-]', '-', solver)[:LONGEST]}"
        number = 2
        while stem.casefold() in (taken.casefold() for taken in suffixes.values()):
            stem, number = f"{plain}-{number}", number + 1
        suffixes[solver] = stem
    return suffixes
