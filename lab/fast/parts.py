"""Functions that the loop calls by their address, compiled by themselves.

Question answered: why is not everything one piece of machine code?  One process compiles one function at a time, and a
function is compiled with all that is linked into it.  So two processes at once take little more than half the time:
one compiles the loop, the other these, which are about as much work.  A call costs next to nothing, since it is for a
block of particles or all of them; but with an argument of another type it is an error, where a kernel would be compiled
for it.
Called by `lab.fast.loop`; `lab.fast.compiled` makes them.
"""

from typing import Any

from llvmlite import ir
from numba import float64, int32, int64, uint64, void
from numba.core.types import StarArgTuple
from numba.extending import intrinsic

from lab.fast import block, genealogy, normals, offspring, sums

ROW, ROWS, BLOCKS = float64[::1], float64[:, ::1], float64[:, :, ::1]
PLACES, STATE = int32[::1], uint64[:, ::1]


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

    @property
    def at(self) -> Any:
        """What another kernel calls: with the address, and then the arguments."""
        signature = self.signature
        given: Any = StarArgTuple

        def call(context: Any, address: Any, *arguments: Any) -> Any:
            def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
                address, packed = values
                types = [context.get_value_type(type_) for type_ in signature.args]
                function = ir.FunctionType(context.get_value_type(signature.return_type), types).as_pointer()
                unpacked = [builder.extract_value(packed, i) for i in range(len(types))]
                builder.call(builder.inttoptr(address, function), unpacked)
                return context.get_dummy_value()

            return signature.return_type(int64, given(signature.args)), generate

        return intrinsic(call)


OFFSPRING = (int64, ROWS, ROW, float64, int64, STATE, ROWS, ROW, ROW, PLACES, PLACES)
RESAMPLE_SYSTEMATIC = Part(offspring.resample_systematic, *OFFSPRING)
RESAMPLE_OTHERWISE = Part(offspring.resample_otherwise, *OFFSPRING)  # compiled when it is asked for
ADD_MOMENTS = Part(
    sums.add_moments,
    *(BLOCKS, ROWS, ROWS, float64, ROWS, PLACES, int64, int64, int64, int64),
    *(ROW, int64, ROWS, ROW, ROW, ROW, ROWS),
)
WEIGH = Part(
    block.weigh_by_measurement,
    *(BLOCKS, ROWS, ROW, ROWS, int64, int64, int64, ROWS, float64, ROWS),
)
NORMALS = Part(normals.normals, STATE, ROWS, int64)
RETIRE = Part(genealogy.retire, BLOCKS, BLOCKS, ROWS, PLACES, int64, int64)
EVERY_RUN = (ADD_MOMENTS, WEIGH, NORMALS, RETIRE)
