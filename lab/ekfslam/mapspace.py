"""Solà's map space: the slots of x and P that robots and landmarks take, and give back when they are deleted.

Question answered: which rows of the state are free?  A landmark takes as many slots as it has components (2, or 4 for
inverse depth), wherever they are free; what is deleted leaves holes that the next one fills.  The circulating listing
tests whether ANY slot is free and then takes two; here fewer free slots than asked for are an error, or growth.
Source: J. Solà (2014), section on the map's implementation, variable ``mapspace``.
"""

import numpy as np
from numpy.typing import NDArray

from lab.validation import InputError

BLOCK = 64  # slots by which the space grows: copies of P become rare and free rows stay few
Rows = NDArray[np.intp]


class MapSpace:
    """Slots with a free list.

    Parameters
    ----------
    limit : int, optional
        The most slots there may ever be; by default the space grows as needed.
    """

    def __init__(self, limit: int | None = None) -> None:
        if limit is not None and limit < 1:
            raise InputError(f"The limit of a map space must be at least 1, not {limit}.")
        self.limit = limit
        self._taken = np.zeros(min(BLOCK, limit or BLOCK), dtype=bool)

    @property
    def capacity(self) -> int:
        """Number of slots, taken or free: the size of x and P."""
        return len(self._taken)

    @property
    def taken(self) -> Rows:
        """The slots in use, ascending."""
        return np.flatnonzero(self._taken)

    def take(self, n: int) -> Rows:
        """Return n free slots, the lowest, and mark them as taken; the capacity may grow.

        Raises
        ------
        InputError
            Fewer than n slots are free and the space may not grow.
        """
        free = np.flatnonzero(~self._taken)
        if len(free) < n:
            wanted = self.capacity + BLOCK * -(-(n - len(free)) // BLOCK)
            size = wanted if self.limit is None else min(wanted, self.limit)
            if len(free) + size - self.capacity < n:
                raise InputError(f"The map is full: {n} slots are wanted and {self.limit} is its limit.")
            self._taken = np.concatenate([self._taken, np.zeros(size - self.capacity, dtype=bool)])
            free = np.flatnonzero(~self._taken)
        rows = free[:n]
        self._taken[rows] = True
        return rows

    def release(self, rows: Rows) -> None:
        """Give slots back.

        Raises
        ------
        InputError
            One of them is not taken: something was deleted twice.
        """
        if not self._taken[rows].all():
            raise InputError("These slots are free already: a landmark was deleted twice.")
        self._taken[rows] = False
