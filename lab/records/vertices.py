"""Values of a factor graph: where its poses and landmarks are, as an optimiser has written them.

Question answered: what may stand in for a truth that nobody measured?  A line is a value:

    VERTEX_SE2 or VERTEX2 id x y theta     a pose          VERTEX_XY id x y     a landmark

Whether they are an optimum or a first guess the file does not say; who names it as a reference knows.  All other lines
are passed over.  Called by lab.ekfslam.app_data.  Source: g2o, file format; GTSAM, gtsam/slam/dataset.cpp.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.records.lines import MALFORMED, Skipped, content, numbers
from lab.validation import Array, InputError

WIDTHS = {"VERTEX_SE2": 4, "VERTEX2": 4, "VERTEX_XY": 3}


@dataclass(frozen=True, eq=False)
class Values:
    """Values by the file's numbers, poses (3,) [m, m, rad] and landmarks (2,) [m], and the lines left out."""

    poses: dict[int, Array]
    landmarks: dict[int, Array]
    skipped: Skipped


def read(path: str | Path) -> Values:
    """Return the values of a file; of two lines with the same number the first counts.

    Raises
    ------
    InputError
        The file is missing, cannot be read, or holds no value.
    """
    path = Path(path)
    values = Values({}, {}, Skipped())
    for line, text in content(path):
        tag, *rest = text.split()
        if tag not in WIDTHS:
            continue
        where = f"{path.name}:{line}"
        row = numbers(rest, WIDTHS[tag])
        known = values.landmarks if tag == "VERTEX_XY" else values.poses
        if row is None or row[0] % 1:
            values.skipped.add(MALFORMED, where)
        elif int(row[0]) in known:
            values.skipped.add("repeated vertex", where)
        else:
            known[int(row[0])] = np.array(row[1:])
    if not values.poses and not values.landmarks:
        raise InputError(f"{path} holds no value of a pose or a landmark (VERTEX_SE2, VERTEX2, VERTEX_XY).")
    return values
