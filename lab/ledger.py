"""A finished unit as a line of text, and back to the last digit.

Question answered: what becomes of a line that was half written when the power went?  It stands behind its checksum, so
it counts as none.  Called by `lab.sweep`.
"""

import base64
import json
import zlib
from dataclasses import fields
from typing import Any

import numpy as np

from lab.comparison import Record, Unit
from lab.metrics import Metrics
from lab.result import Filtered
from lab.validation import Array

SERIES = ("ess", "survivors")
MOMENTS = ("means", "covs", "log_evidence")


def line_of(record: Record) -> bytes:
    """Return a record as a line of JSON behind its checksum, without an end of line."""
    text = json.dumps(_row(record)).encode()
    return b"%08x %s" % (zlib.crc32(text), text)


def record_of(line: bytes) -> Record:
    """Return what `line_of` was given.

    Raises
    ------
    ValueError, KeyError, TypeError
        The line is not what it returned.
    """
    checksum, _, text = line.partition(b" ")
    if int(checksum, 16) != zlib.crc32(text):
        raise ValueError("The checksum is wrong.")
    return _record(json.loads(text))


def _row(record: Record) -> dict[str, Any]:
    row = {**vars(record.unit), **vars(record.metrics), "error": record.error}
    row |= {name: _written(getattr(record, name)) for name in SERIES}
    kept = record.filtered
    return row | {name: None if kept is None else _written(getattr(kept, name)) for name in MOMENTS}


def _record(row: dict[str, Any]) -> Record:
    unit = Unit(*(field_type(row[name]) for name, field_type in _UNIT_TYPES.items()))
    metrics = Metrics(**{field.name: float(row[field.name]) for field in fields(Metrics)})
    ess, survivors = (_array(row[name]) for name in SERIES)
    kept = None
    means, covs, log_evidence = (_array(row[name]) for name in MOMENTS)
    if means is not None and covs is not None and log_evidence is not None:
        kept = Filtered(means, covs, log_evidence, ess, survivors)
    return Record(unit, metrics, ess, survivors, kept, str(row["error"]))


_UNIT_TYPES = {"solver": str, "n_particles": int, "run": int, "seed": int, "data_set": int}


def _written(values: Array | None) -> list[Any] | None:
    """Return an array as type, shape and text, to the last digit; None for none."""
    if values is None:
        return None
    values = np.asarray(values)
    return [values.dtype.str, list(values.shape), base64.b64encode(values.tobytes()).decode()]


def _array(written: list[Any] | None) -> Array | None:
    if written is None:
        return None
    type_, shape, text = written
    return np.frombuffer(base64.b64decode(text), type_).reshape(shape).copy()
