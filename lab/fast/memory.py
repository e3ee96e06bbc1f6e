"""Where in memory a cloud is, and what of it is asked for ahead.

Question answered: what does a cloud cost that the processor's cache cannot hold?  As little as can be when

    below    resampling touches the memory of one cloud and not of two: ancestors come in ascending order, not far from
             where their descendants go, so these are written a few blocks below the cloud that they are fetched from,
             over particles that have been read and are still in the cache
    ahead    the next block is asked for while the products of this one are summed, some lines at a time: a processor
             does not wait for them, unless it is asked for more than it can keep in mind

There is room for two all the same.  The cloud begins at the top, goes down with each resampling, and from the bottom to
the top again.  Called by `lab.fast.loop` and `lab.fast.moments`.
"""

from typing import Any

from llvmlite import ir
from numba import void
from numba.extending import intrinsic

from lab.fast.kernel import kernel
from lab.fast.normals import LANES
from lab.validation import Array

FEW = 8  # times that a cloud goes down before it is at the bottom: less often, and it goes there at once
CACHED = 1 << 19  # doubles: a cloud of 4 MB is mostly in the cache
LINE = 8  # doubles
SECOND_CACHE = 2  # as LLVM counts them: the first has little more room than for the block at hand


@kernel()
def beside(at: Any, size: Any, new_size: Any, memory: Array) -> Any:
    """Return where the cloud at `at`, of so many places, is now, and where a new one has nothing in common with it."""
    if at >= new_size:
        return at, 0
    if at + size > len(memory) - new_size:
        for place in range(size):
            memory[place] = memory[at + place]
        at = 0
    return at, len(memory) - new_size


@kernel()
def below(at: Any, size: Any, ancestors: Any, blocks: int, n_rows: int, memory: Array) -> Any:
    """Return where the cloud at `at`, of so many places, is now, and where its descendants are to begin.

    They may be written block after block: no ancestor is written over that is still to be fetched.
    """
    n_back = 0
    for b in range(blocks):
        n_back = max(n_back, b - ancestors[b * LANES] // LANES)
    down = (n_back + 1) * n_rows * LANES
    if down <= at and (down * FEW < size or at < size):
        return at, at - down
    return beside(at, size, blocks * n_rows * LANES, memory)


@kernel()
def ahead(b: Any, fetched: bool, ancestors: Any, n: int, blocks: int, n_rows: int) -> Any:
    """Return the places (first, end) of what block b + 1 reads and block b has not read, two blocks at most.

    They are counted from where the cloud begins that is read.
    """
    size = n_rows * LANES
    if not fetched:
        return (b + 1) * size, min(b + 2, blocks) * size
    read = ancestors[min((b + 1) * LANES, n) - 1] // LANES + 1
    end = ancestors[min((b + 2) * LANES, n) - 1] // LANES + 1
    return max(read, end - 2) * size, end * size


@kernel()
def ask_for(memory: Array, first: Any, end: Any) -> None:
    """Let the cache fetch some places, first..end - 1, which begin where a line does."""
    for place in range(first, end, LINE):
        _prefetch(memory, place)


def _prefetched(context: Any, array: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values, at = arguments
        data = context.make_array(signature.args[0])(context, builder, values).data
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        type_ = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], type_)
        reads, is_data = number(0), number(1)
        builder.call(function, [builder.bitcast(builder.gep(data, [at]), byte), reads, number(SECOND_CACHE), is_data])
        return context.get_dummy_value()

    return void(array, place), generate


_prefetch: Any = intrinsic(_prefetched)
