"""How every kernel here is compiled.

Question answered: what do all of them ask of the compiler?  Division as the processor does it; no count of who holds an
array, since they make and keep none and each count is an atomic operation; no entry for Python but where one is asked
for; and vectors of 512 bits where the processor has them.  LLVM prefers 256, because processors of 2017 slowed down for
wider ones; those since do not, and a filter takes a tenth to a sixth less time.
"""

from contextlib import suppress
from typing import Any

from numba import njit, void
from numba.extending import intrinsic

SUMS = {"contract", "reassoc", "nsz"}  # of a kernel whose sums may be taken in any order
PRODUCTS = {"contract"}  # of one that may round a product and a sum at once


def kernel(fastmath: Any = False, *, from_python: bool = False) -> Any:
    """Return the decorator of a kernel.

    Parameters
    ----------
    fastmath : set of str
        What LLVM may do to arithmetic, as `numba.njit`.
    from_python : bool
        Whether Python calls it, too.
    """
    unlisted: dict[str, Any] = {"_nrt": False, "no_cpython_wrapper": not from_python, "no_cfunc_wrapper": True}
    return njit(error_model="numpy", fastmath=fastmath, nogil=True, **unlisted)


def _wide(context: Any) -> Any:
    """Let the loops of the function that calls this use vectors of 512 bits."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        with suppress(AttributeError, TypeError):  # llvmlite's list of known attributes lacks it, but a set it is
            set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return void(), generate


wide: Any = intrinsic(_wide)
