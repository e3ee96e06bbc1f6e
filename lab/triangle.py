"""A symmetric matrix that grows, held as its lower triangle in panels of rows.

Question answered: how is the covariance of thousands of landmarks kept and updated?  An exact update is

    A <- A - W' W        with W (p, size), p small: bound by the memory that A fills

so one triangle is stored, half of the matrix, and BLAS changes it in place, when enough W have come together; until
then what they take away is subtracted from whatever is read.  Panel t holds rows t b .. (t + 1) b - 1 up to the end of
its diagonal block; its transpose is what BLAS calls a column-major matrix, so nothing is copied, and a row that is
appended touches no earlier panel.  Called by the structured exact filter; it knows no robot.
"""

from typing import Any

import numpy as np
from scipy.linalg.blas import dgemm

from lab.validation import Array

PANEL = 256  # rows: the excess over the triangle stays small, and BLAS gets pieces worth its while
RANK = 64  # rows of W for which one walk through the memory of A is worth it


class Triangle:
    """A symmetric (size, size) matrix that starts empty."""

    def __init__(self, panel: int = PANEL, rank: int = RANK) -> None:
        """Start with size 0, `panel` rows, an even number, in each panel, and at most `rank` rows of W waiting."""
        self.size = 0
        self.panel = panel
        self._panels: list[Array] = []
        self._waiting = np.zeros((0, rank))  # columns are rows of W, 0 beyond the size that they had
        self._rank = 0

    def append(self, cross: Array, corner: Array) -> None:
        """Border the matrix below and on the right.

        Parameters
        ----------
        cross : (d, size) array
            The new rows up to the old size.
        corner : (d, d) array
            What they hold beyond, symmetric.
        """
        rows, start = np.hstack([cross, corner]), self.size
        self.size += len(rows)
        while len(self._panels) * self.panel < self.size:
            self._panels.append(np.zeros((self.panel, (len(self._panels) + 1) * self.panel)))
            self._waiting = np.vstack([self._waiting, np.zeros((self.panel, self._waiting.shape[1]))])
        for begin, panel in self._pieces(start):
            low, high = max(start - begin, 0), min(self.size - begin, self.panel)
            part = rows[begin + low - start : begin + high - start, : begin + high]
            panel[low:high, : part.shape[1]] = part
            # the diagonal block is kept whole, because dgemm changes it whole
            panel[:low, begin + low : begin + high] = panel[low:high, begin : begin + low].T

    def subtract_square(self, W: Array) -> None:
        """Subtract W' W; W is (p, size)."""
        if self._rank + len(W) > self._waiting.shape[1]:
            self.settle()
        if len(W) > self._waiting.shape[1]:
            columns = np.zeros((len(self._waiting), len(W)))
            columns[: self.size] = W.T
            self._apply(columns)
        else:
            columns = self._waiting[:, self._rank : self._rank + len(W)]
            columns[: self.size], columns[self.size :] = W.T, 0
            self._rank += len(W)

    def settle(self) -> None:
        """Subtract in place what is waiting."""
        if self._rank:
            self._apply(np.ascontiguousarray(self._waiting[:, : self._rank]))
            self._rank = 0

    def _apply(self, columns: Array) -> None:
        for begin, panel in self._pieces():
            end = begin + self.panel
            dgemm(-1.0, columns[:end].T, columns[begin:end].T, 1.0, panel.T, trans_a=True, overwrite_c=True)

    def add_blocks(self, blocks: Array) -> None:
        """Add (size / 2, 2, 2) symmetric blocks along the diagonal."""
        for begin, panel in self._pieces():
            part = blocks[begin // 2 : (begin + self.panel) // 2]
            i = np.arange(0, 2 * len(part), 2)
            for row in (0, 1):
                for column in (0, 1):
                    panel[i + row, begin + i + column] += part[:, row, column]

    def blocks(self) -> Array:
        """Return the (size / 2, 2, 2) blocks along the diagonal."""
        found = np.zeros((self.size // 2, 2, 2))
        for begin, panel in self._pieces():
            part = found[begin // 2 : (begin + self.panel) // 2]
            i = np.arange(0, 2 * len(part), 2)
            part[:, 0, 0], part[:, 1, 1] = panel[i, begin + i], panel[i + 1, begin + i + 1]
            part[:, 1, 0] = panel[i + 1, begin + i]
        waiting = self._waiting[: self.size, : self._rank].reshape(len(found), 2, self._rank)
        found -= waiting @ waiting.swapaxes(1, 2)
        found[:, 0, 1] = found[:, 1, 0]
        return found

    def rows(self, indices: Any) -> Array:
        """Return whole rows (d, size).

        Parameters
        ----------
        indices : (d,) array of int
            Ascending.
        """
        found = np.empty((len(indices), self.size))
        for begin, panel in self._pieces():
            end = min(begin + self.panel, self.size)
            above, here = np.searchsorted(indices, (begin, end))
            found[above:here, :end] = panel[indices[above:here] - begin, :end]
            found[:above, begin:end] = panel[: end - begin, indices[:above]].T  # the other triangle
        waiting = self._waiting[: self.size, : self._rank]
        found -= waiting[indices] @ waiting.T
        return found

    def _pieces(self, start: int = 0) -> list[tuple[int, Array]]:
        """Return the panels from the one that holds row `start`, each with the number of its first row."""
        first = start // self.panel
        return [(t * self.panel, self._panels[t]) for t in range(first, len(self._panels))]
