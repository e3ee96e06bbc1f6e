"""The figures of a comparison: which there are, in what order a report shows them, and who draws which.

Question answered: why is the first one drawn elsewhere?  A process that draws has to import matplotlib before, which
takes as long as a figure or two.  Nothing here does, so a worker that was started early draws while this process gets
ready.  How each is drawn: `lab.cli.pictures`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from lab import execution
from lab.comparison import Comparison
from lab.execution import Execute
from lab.problem import Experiment
from lab.workers import Crew

if TYPE_CHECKING:
    from lab.cli.captions import Picture

GENERAL = ("gap", "cost", "evidence", "ess")
OF_SOLVER = ("loop-closure", "corridors", "map")
LONGEST_FIRST = ("corridors", "ess", "loop-closure", "gap", "map", "cost", "evidence")  # processes end together
LONGEST = 60  # characters of a label in a file's name


class Leaf(NamedTuple):
    """One figure; a solver's has its label, and the end of the file's name."""

    kind: str
    solver: str = ""
    suffix: str = ""


def write_comparison(
    folder: Path,
    comparison: Comparison,
    experiment: Experiment,
    on_done: Callable[[int, int], None],
    *,
    jobs: int = 1,
    crew: Crew | None = None,
) -> "list[Picture]":
    """Write the figures of a comparison, and for each solver those of its first good run kept, with the largest N.

    Parameters
    ----------
    folder : Path
        Gets gap.png, cost.png, evidence.png and ess.png, and for each solver loop-closure, corridors and map.
    comparison : Comparison
    experiment : Experiment
        The first data set's, for the truth.
    on_done : function of int and int
        Told after each figure how many of how many are there.
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
    leaves = [Leaf(kind) for kind in GENERAL]
    leaves += [Leaf(kind, *named) for named in _suffixes(comparison.solvers).items() for kind in OF_SOLVER]
    run: Execute = execution.here if jobs == 1 else partial(execution.processes, jobs=jobs, beside=True, crew=crew)
    written: dict[Leaf, Picture | None] = {}
    ordered = sorted(leaves, key=lambda leaf: LONGEST_FIRST.index(leaf.kind))
    for leaf, picture in run(drawing, ordered, lambda leaf, _: drawing(leaf)):
        written[leaf] = picture
        on_done(len(written), len(leaves))
    return [picture for leaf in leaves if (picture := written[leaf]) is not None]


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Writes one figure, if there is anything to be drawn."""

    folder: Path
    comparison: Comparison
    experiment: Experiment

    def __call__(self, leaf: Leaf) -> "tuple[Leaf, Picture | None]":
        from lab.cli import pictures

        return leaf, pictures.write(leaf.kind, self.folder, self.comparison, self.experiment, leaf.solver, leaf.suffix)


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
