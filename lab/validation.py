"""What counts as an acceptable array; `InputError` says why another one is not.

Question answered: may this value enter the laboratory?  numpy is lenient (``asarray`` takes text and drops imaginary
parts), so type, dtype, shape and finiteness are looked at first and each has its own sentence, which names the field.
Called by every type of floor 2 and by the solvers.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.errors import InputError as InputError

Array = NDArray[np.float64]

SYMMETRY_TOLERANCE = 1e-9  # of the product of the two deviations: rounding of a file, not a modelling mistake
PSD_TOLERANCE = 1e-9  # on the correlation scale, for the same reason


def real_array(name: str, value: Any, shape: Sequence[int], *, finite: bool = True) -> Array:
    """Return `value` as a read-only float copy of the wanted shape.

    Parameters
    ----------
    name : str
        The field, for the message.
    value : array_like
        What was given.
    shape : sequence of int
        The shape wanted; -1 stands for any length.
    finite : bool
        Whether NaN is refused; infinities always are.

    Raises
    ------
    InputError
        The value is not numeric, not real, not of this shape or not finite.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f"{name} must be a rectangular array of numbers.") from None
    if np.ma.isMaskedArray(value):
        raise InputError(f"{name} must be a plain array: a mask would be lost, use NaN for what is not seen.")
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must hold real numbers, not values of type {array.dtype}.")
    if array.ndim != len(shape) or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name} must have shape {_shown(shape)}, not {_shown(array.shape)}.")
    result = array.astype(np.float64)  # a copy: the caller's array stays the caller's
    if np.isinf(result).any() or (finite and np.isnan(result).any()):
        raise InputError(f"{name} must be finite, but holds {'NaN' if np.isnan(result).any() else 'infinite values'}.")
    result.flags.writeable = False
    return result


def check_covariance(name: str, cov: Array) -> None:
    """Refuse a matrix that is not symmetric positive semidefinite.

    Parameters
    ----------
    name : str
        The field, for the message.
    cov : (d, d) array
        Finite.

    Raises
    ------
    InputError
        Not symmetric, or not positive semidefinite, to a relative 1e-9 on the scale of each component.
    """
    variances = np.diag(cov)
    if (variances < 0).any():
        raise InputError(f"{name} is not positive semidefinite: it has a negative variance, {variances.min():.3g}.")
    deviations = np.sqrt(variances)
    scale = np.outer(deviations, deviations)
    if (np.abs(cov - cov.T) > SYMMETRY_TOLERANCE * scale).any():
        i, j = np.unravel_index(np.argmax(np.abs(cov - cov.T)), cov.shape)
        raise InputError(
            f"{name} is not symmetric: entry ({i}, {j}) is {cov[i, j]:.6g}, entry ({j}, {i}) is {cov[j, i]:.6g}."
        )
    if (np.abs(cov) > (1 + PSD_TOLERANCE) * scale).any():
        raise InputError(f"{name} is not positive semidefinite: a covariance exceeds the product of the deviations.")
    correlation = np.divide(cov, scale, out=np.eye(len(cov)), where=scale > 0)
    try:
        np.linalg.cholesky(correlation + PSD_TOLERANCE * np.eye(len(cov)))
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh((cov + cov.T) / 2).min()
        raise InputError(f"{name} is not positive semidefinite: its smallest eigenvalue is {smallest:.3g}.") from None


def whole_number(name: str, value: Any, *, at_least: int) -> int:
    """Return `value` as an int, or say what is wrong with it.

    Raises
    ------
    InputError
        Not a whole number, or too small.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InputError(f"{name} must be a whole number, not {value!r}.")
    if value < at_least:
        raise InputError(f"{name} must be at least {at_least}, not {value}.")
    return int(value)


def require_generator(rng: Any) -> np.random.Generator:
    """Return `rng` when it is a numpy Generator.

    Raises
    ------
    InputError
        It is something else, such as a seed.
    """
    if not isinstance(rng, np.random.Generator):
        raise InputError(f"rng must be a numpy Generator, as from numpy.random.default_rng(0), not {rng!r}.")
    return rng


def _shown(shape: Sequence[int]) -> str:
    sides = ["any" if side == -1 else str(side) for side in shape]
    return f"({sides[0]},)" if len(sides) == 1 else f"({', '.join(sides)})"
