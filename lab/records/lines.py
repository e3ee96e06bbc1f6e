"""Text files of numbers, line by line, where one bad line is no reason to refuse the rest.

Question answered: which lines of a log can be used, and how many cannot, of which kind?  Recorded data have lines that
were cut, stamps that run backwards and numbers that are none; a reader skips such a line and counts it by kind, so that
nobody mistakes a tenth of a data set for the whole.  Comments (# and %), blank lines and the line ends of any system
are no faults.  Files that end in .gz are decompressed.  Called by the readers of the EKF-SLAM data sets.
"""

import gzip
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.records.files import readable
from lab.validation import Array, InputError

MALFORMED = "malformed"
COMMENTS = ("#", "%")
SAMPLE = 1000  # bytes by which a text is told from something else; later, a log may hold what a crash left
LARGEST = 1e15  # beyond it neither a metre nor a second nor a number of a pose is meant


@dataclass
class Skipped:
    """The lines that were left out, by kind.

    Attributes
    ----------
    counts : dict
        How many lines of each kind.
    first : dict
        Where the first of each kind stands, as file:line.
    """

    counts: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)

    @property
    def total(self) -> int:
        """All lines left out."""
        return sum(self.counts.values())

    def add(self, kind: str, where: str, lines: int = 1) -> None:
        """Count lines of a kind."""
        self.counts[kind] = self.counts.get(kind, 0) + lines
        self.first.setdefault(kind, where)

    def sentences(self) -> list[str]:
        """Return one line of text for each kind, such as "3 unknown barcode (first: Robot3_Measurement.dat:812)"."""
        return [f"{n} {kind} (first: {self.first[kind]})" for kind, n in self.counts.items()]


def content(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the number of each line that says something, from 1, and what it says.

    Raises
    ------
    InputError
        The file is missing, cannot be read, is no text, or is cut short or damaged where it is compressed.
    """
    with readable(path):
        raw = path.read_bytes()
        raw = gzip.decompress(raw) if path.suffix == ".gz" else raw
    if b"\0" in raw[:SAMPLE]:
        raise InputError(f"{path} is no text file.")
    text = raw.decode("utf-8-sig", errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith(COMMENTS):
            yield number, stripped


def numbers(texts: list[str], count: int) -> list[float] | None:
    """Return the numbers that the words stand for, or None when they are not `count` finite numbers."""
    try:
        values = [float(text) for text in texts]
    except ValueError:
        return None
    return values if len(values) == count and all(abs(value) < LARGEST for value in values) else None


def table(path: Path, width: int, skipped: Skipped) -> tuple[Array, NDArray[np.int64]]:
    """Return the lines with exactly `width` finite numbers, and count the others.

    Parameters
    ----------
    path : Path
    width : int
        Numbers a line.
    skipped : Skipped
        Where the other lines are counted.

    Returns
    -------
    values : (n, width) array
        n >= 1.
    lines : (n,) array of int
        The number of each line in the file, from 1.

    Raises
    ------
    InputError
        The file cannot be read, or no line of it can be used.
    """
    found = list(content(path))
    lines = np.array([number for number, _ in found], dtype=np.int64)
    values = _all_numbers([text for _, text in found], width)
    if values is None:  # line by line, which takes several times as long
        each = [numbers(text.split(), width) for _, text in found]
        for number in lines[[row is None for row in each]]:
            skipped.add(MALFORMED, f"{path.name}:{number}")
        lines = lines[[row is not None for row in each]]
        values = np.array([row for row in each if row is not None], dtype=np.float64).reshape(-1, width)
    if not len(values):
        reason = f"has no line of {width} numbers; line {found[0][0]} is something else" if found else "is empty"
        raise InputError(f"{path} {reason}.")
    return values, lines


def _all_numbers(texts: list[str], width: int) -> Array | None:
    """Return the numbers where every line is as it should be, else None."""
    try:
        values = np.loadtxt(texts, comments=None, ndmin=2) if texts else np.zeros((0, width))
    except ValueError:
        return None
    usable = values.shape[1] == width and (np.abs(values) < LARGEST).all()  # NaN is not smaller than anything
    return values if usable else None
