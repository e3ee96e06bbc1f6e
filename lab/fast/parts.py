"""Functions that the loop calls by their address, compiled by themselves.

Question answered: why is not everything one piece of machine code?  One process compiles one function at a time, and a
function is compiled with all that is linked into it.  So two processes at once take half the time: one compiles the
loop, the other these, which are about as much work.  A call costs next to nothing, since it is for a block of particles
or all of them; but it takes arguments of the types that are written down here and no others.
Called by `lab.fast.loop`; `lab.fast.compiled` makes them.
"""

from typing import Any, cast

from llvmlite import ir
from numba import float64, int32, int64, uint64, void
from numba.core.errors import TypingError
from numba.core.types import BaseTuple, Integer, IntegerLiteral, StarArgTuple
from numba.extending import intrinsic

from lab.fast import block, genealogy, normals, offspring, sums

ROW, ROWS, BLOCKS = float64[::1], float64[:, ::1], float64[:, :, ::1]
PLACES, STATE = int32[::1], uint64[:, ::1]
WHOLE = {Integer, IntegerLiteral}  # kinds of types


class Part:
    """A kernel that is compiled by itself.

    Parameters
    ----------
    kernel : Dispatcher
    *arguments : numba type
        What it takes; it returns nothing.
    """

    def __init__(self, kernel: Any, *arguments: Any) -> None:
        self.kernel = kernel
        self.signature = void(*arguments)

    def caller(self) -> Any:
        """Return what another kernel calls, with an address and the arguments: any part of this signature."""
        signature, several = self.signature, cast(Any, StarArgTuple)

        def call(context: Any, address: Any, *arguments: Any) -> Any:
            _check(signature.args, arguments)

            def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
                address, packed = values
                types = [context.get_value_type(type_) for type_ in signature.args]
                function = ir.FunctionType(context.get_value_type(signature.return_type), types).as_pointer()
                unpacked = [builder.extract_value(packed, i) for i in range(len(types))]
                builder.call(builder.inttoptr(address, function), unpacked)
                return context.get_dummy_value()

            return signature.return_type(int64, several(signature.args)), generate

        return intrinsic(call)


def _check(wanted: Any, given: Any) -> None:
    """Raise a TypingError where other bits would be read than are meant; whole numbers may have any size."""
    given = given[0] if len(given) == 1 and isinstance(given[0], BaseTuple) else given
    pairs = zip(given, wanted, strict=False)
    fit = [one == other or {type(one), type(other)} <= WHOLE for one, other in pairs]
    if len(given) != len(wanted) or not all(fit):
        raise TypingError(f"A part takes {wanted}, not {tuple(given)}.")


OFFSPRING = (int64, ROWS, ROW, float64, int64, STATE, ROWS, ROW, ROW, PLACES, PLACES)
RESAMPLE_SYSTEMATIC = Part(offspring.resample_systematic, *OFFSPRING)
RESAMPLE_OTHER = Part(offspring.resample_other, *OFFSPRING)
ADD_MOMENTS = Part(
    sums.add_moments,
    *(ROW, int64, int64),
    *(BLOCKS, ROWS, ROWS, float64, ROWS, PLACES, int64, int64, int64, int64),
    *(ROW, int64, ROWS, ROW, ROW, ROW, ROWS),
)
WEIGH = Part(
    block.weigh_by_measurement,
    *(BLOCKS, ROWS, ROW, ROWS, int64, int64, int64, ROWS, float64, ROWS),
)
NORMALS = Part(normals.normals, STATE, ROWS, int64)
RETIRE = Part(genealogy.retire, BLOCKS, BLOCKS, ROWS, PLACES, int64, int64)


def parts_for(resample: str) -> tuple[Part, ...]:
    """Return what a run with this scheme calls, in the order of the loop's arguments."""
    scheme = RESAMPLE_SYSTEMATIC if resample == "systematic" else RESAMPLE_OTHER
    return scheme, ADD_MOMENTS, WEIGH, NORMALS, RETIRE
