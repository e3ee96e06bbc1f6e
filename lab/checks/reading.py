"""Reading what an answer returned: type, number, dtype and shape, each with its own sentence.

Question answered: which arrays did the answer mean?  numpy is lenient, so nothing is converted that is not a real
number already.  A reader takes the returned value and the arguments of the call, and returns arrays; or raises
`Unreadable`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import stats

from lab.checks.questions import Question
from lab.checks.reference import RADIUS
from lab.validation import Array

Reader = Callable[[Any, Sequence[Any]], tuple[Array, ...]]
IMPOSSIBLE = -1e8  # a log-density below it is that of an impossible state: exp gives 0 long before
REACHES = (0.9965, 0.9975)  # the corridor of 99.7 %: 2.97 and 3 deviations, but not the 3.035 of the ellipse
LEVELS = (0.9895, 0.9905)  # the ellipse of 99 %: not the one of 3 deviations
WIDEST = 1.2  # radians between neighbours on an ellipse, seen as a circle: half an ellipse leaves pi


class Unreadable(Exception):
    """What was returned cannot be read; the message is half a sentence about it."""


def number_of(name: str, value: Any, *, whole: bool = False) -> Array:
    """Return `value` as an array of float, if it is one of real numbers.

    Raises
    ------
    Unreadable
        It is not.
    """
    if value is None:
        raise Unreadable(f"{name} is None: nothing is returned there")
    try:
        array = np.asarray(value)
    except ValueError:
        raise Unreadable(f"{name} is no rectangular array of numbers") from None
    except Exception:
        raise Unreadable(f"{name} is {_article(type(value).__name__)}, not an array of numbers") from None
    if np.ma.isMaskedArray(value):
        raise Unreadable(f"{name} is a masked array: return a plain one")
    if array.dtype.kind == "O":
        if array.size and all(isinstance(entry, np.ndarray | float | int) for entry in array.flat):
            raise Unreadable(f"{name} is an array of arrays (dtype object), not of numbers")
        raise Unreadable(f"{name} is {_article(type(value).__name__)}, not an array of numbers")
    if array.dtype.kind not in "fiu":
        kinds = {"b": "truth values", "c": "complex numbers", "U": "text", "S": "text"}
        raise Unreadable(f"{name} holds {kinds.get(array.dtype.kind, str(array.dtype))}, not real numbers")
    if whole and array.size and array.dtype.kind not in "iu":
        raise Unreadable(f"{name} must be whole numbers (int) and is {array.dtype}: they are used as indices")
    if array.dtype.kind == "f" and array.dtype.itemsize < 8:
        raise Unreadable(f"{name} is computed in {array.dtype}, which keeps too few digits: stay with float64")
    return array.astype(np.float64)


def shaped(name: str, array: Array, shape: tuple[int, ...], symbols: str) -> Array:
    """Return the array in the wanted shape, sides of length 1 apart.

    Raises
    ------
    Unreadable
        It has another one.
    """
    if array.shape == shape:
        return array
    squeezed = tuple(side for side in array.shape if side != 1)
    if array.size == np.prod(shape) and squeezed == tuple(side for side in shape if side != 1):
        return array.reshape(shape)
    turned = ": transposed?" if array.shape == shape[::-1] else ""
    raise Unreadable(f"{name} has shape {_shown(array.shape)} where {symbols} = {_shown(shape)} is asked for{turned}")


def several(value: Any, names: Sequence[str]) -> Sequence[Any]:
    """Return the results in order.

    Raises
    ------
    Unreadable
        It is nothing, or another number of things.
    """
    if value is None:
        raise Unreadable("nothing comes back (None): is there a return at the end?")
    if len(names) == 1:
        return [value]
    if all(hasattr(value, name) for name in names):
        return [getattr(value, name) for name in names]
    if not isinstance(value, tuple | list) and not (isinstance(value, np.ndarray) and len(value) == len(names)):
        raise Unreadable(f"it returns {_article(type(value).__name__)} where {len(names)} results are asked for")
    if len(value) != len(names):
        raise Unreadable(f"it returns {len(value)} results where {len(names)} are asked for: {', '.join(names)}")
    return list(value)


def plain(question: Question, *sizes: Callable[[Sequence[Any]], tuple[int, ...]], whole: Sequence[int] = ()) -> Reader:
    """Return the reader of results whose shapes follow from the arguments."""
    names = [value.name for value in question.returns]

    def read(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
        results = []
        for i, (result, size) in enumerate(zip(several(value, names), sizes, strict=True)):
            array = number_of(names[i], result)
            shaped(names[i], array, size(args), question.returns[i].shape.removesuffix(" int"))
            array = number_of(names[i], result, whole=i in whole)
            results.append(array.reshape(size(args)))
        return tuple(results)

    return read


def like(index: int) -> Callable[[Sequence[Any]], tuple[int, ...]]:
    """Return the shape of the argument with this index."""
    return lambda args: np.shape(args[index])


def scalar(args: Sequence[Any]) -> tuple[int, ...]:
    """Return the shape of a number."""
    return ()


def sorted_ancestors(question: Question) -> Reader:
    """Return the reader of ancestors in any order."""
    read = plain(question, like(0), whole=(0,))

    def read_sorted(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
        (ancestors,) = read(value, args)
        return (np.sort(ancestors),)

    return read_sorted


def ellipse(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
    """Return centre (2,) and shape matrix (2, 2) of the ellipse through the points: (x - c)' S^-1 (x - c) = 1.

    A radius that gives 99 % when rounded to a tenth of a per cent, such as 3.035, counts as the exact one.
    """
    n_points = args[2] if len(args) > 2 else 100
    (result,) = several(value, ["points"])
    points = number_of("points", result)
    if points.shape == (n_points, 2) and n_points != 2:
        points = points.T
    points = shaped("points", points, (2, n_points), "(2, n_points)")
    if not np.isfinite(points).all():
        return np.full(2, np.nan), np.full((2, 2), np.nan)
    middle = points.mean(axis=1, keepdims=True)
    size = np.abs(points - middle).max() or 1.0
    x, y = (points - middle) / size
    design = np.stack([x**2, 2 * x * y, y**2, x, y], axis=1)
    (a, b, c, d, e), _, rank, _ = np.linalg.lstsq(design, np.ones(n_points), rcond=1e-12)
    if rank < 5 or np.abs(design @ (a, b, c, d, e) - 1).max() > 1e-7 or a * c <= b * b:
        raise Unreadable("the points do not lie on an ellipse, or on a part of one only")
    conic = np.array([[a, b], [b, c]])
    centre = -0.5 * np.linalg.solve(conic, [d, e])
    level = 1 + centre @ conic @ centre
    shape = np.linalg.inv(conic) * level
    circle = np.linalg.solve(np.linalg.cholesky(shape), np.stack([x, y]) - centre[:, np.newaxis])
    angles = np.arctan2(circle[1], circle[0])
    steps = (np.diff(np.r_[angles, angles[0]]) + np.pi) % (2 * np.pi) - np.pi
    if np.abs(steps).max() > WIDEST or abs(abs(steps.sum()) - 2 * np.pi) > 1e-6:
        raise Unreadable("the points do not go once around the ellipse, one after the other")
    shape = size**2 * shape
    squared = float(np.sqrt(np.linalg.det(shape) / np.linalg.det(np.asarray(args[1], dtype=np.float64))))
    if LEVELS[0] <= 1 - np.exp(-squared / 2) < LEVELS[1]:
        shape *= RADIUS**2 / squared
    return (middle[:, 0] + size * centre, shape)


def corridor(question: Question) -> Reader:
    """Return the reader of a corridor: every factor that gives 99.7 % when rounded to a tenth counts as 3."""
    read = plain(question, like(0), like(0))

    def read_corridor(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
        lower, upper = read(value, args)
        factor = common_factor(upper - lower, 2 * np.sqrt(np.diagonal(args[1], axis1=1, axis2=2)))
        inside = 2 * stats.norm.cdf(factor) - 1
        if REACHES[0] <= inside < REACHES[1]:
            middle = (lower + upper) / 2
            lower, upper = (middle + (bound - middle) * (3 / factor) for bound in (lower, upper))
        return lower, upper

    return read_corridor


def common_factor(array: Array, unit: Array) -> float:
    """Return the number by which `unit` was multiplied to give `array`; NaN when no single number was."""
    size = float(np.sum(unit * unit))
    factor = float(np.sum(array * unit)) / size if array.shape == unit.shape and size > 0 else np.nan
    fits = bool(np.abs(array - factor * unit).max() <= 1e-6 * np.abs(array).max())
    return factor if fits else float("nan")


def closures(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
    """Return closures (C, 2) and gains (C, M)."""
    found, gains = several(value, ["closures", "gains"])
    M = args[0].shape[1] // 2
    rows = number_of("closures", found, whole=True)
    table = number_of("gains", gains)
    rows = rows.reshape(0, 2) if not rows.size else rows
    table = table.reshape(0, M) if not table.size else table
    rows = shaped("closures", rows, (len(rows), 2), "(C, 2)")
    table = shaped("gains", table, (len(rows), M), "(C, M)")
    return rows, table


def directions(value: Any, args: Sequence[Any]) -> tuple[Array, ...]:
    """Return the orthogonal projector (n, n) onto the space that three columns span: any basis of it gives the same."""
    (result,) = several(value, ["N"])
    N = shaped("N", number_of("N", result), (len(args[0]), 3), "(n, 3)")
    if not np.isfinite(N).all():
        return (np.full((len(N), len(N)), np.nan),)
    axes, sizes, _ = np.linalg.svd(N, full_matrices=False)
    if sizes[2] <= 1e-9 * sizes[0]:
        raise Unreadable("the three columns of N are not independent")
    return (axes @ axes.T,)


def log_densities(values: Sequence[Array]) -> Array:
    """Return log-densities (C,) with what is impossible as -inf."""
    result = np.concatenate([np.ravel(value) for value in values])
    result[result < IMPOSSIBLE] = -np.inf
    return result


def relative(values: Array) -> Array:
    """Return log-densities without their constant: relative to the first that is finite."""
    finite = np.flatnonzero(np.isfinite(values))
    return values - values[finite[0]] if len(finite) else values


def _shown(shape: tuple[int, ...]) -> str:
    return f"({shape[0]},)" if len(shape) == 1 else str(tuple(shape))


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
