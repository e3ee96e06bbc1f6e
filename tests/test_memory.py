"""A cloud that is resampled within the memory of two: nothing is written over that is still to be read."""

import numpy as np
import pytest

numba = pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
block = pytest.importorskip("lab.fast.block")
memory = pytest.importorskip("lab.fast.memory")

LANES = 256


def caller(kernel):
    """Return a kernel as Python can call it."""
    return numba.njit(lambda *given: kernel(*given))


BELOW, BESIDE, AHEAD, FETCH, ASK = (
    caller(k) for k in (memory.below, memory.beside, memory.ahead, block.fetch, memory.ask_for)
)


def offspring(rng, n, left, spread):
    """Return ascending ancestors of `left` particles, the further from their places the larger `spread` is."""
    weights = np.repeat(rng.exponential(size=-(-n // spread)), spread)[:n]
    ends = np.cumsum(weights) / weights.sum() * left
    return np.searchsorted(ends, np.arange(left) + 0.5).clip(max=n - 1).astype(np.int32)


def as_blocks(rows):
    """Return rows (n_rows, n) as blocks, with zeros beyond the last particle."""
    n_rows, n = rows.shape
    padded = np.zeros((n_rows, -(-n // LANES) * LANES))
    padded[:, :n] = rows
    return padded.reshape(n_rows, -1, LANES).transpose(1, 0, 2)


@pytest.mark.parametrize("n_rows", [2, 3])
@pytest.mark.parametrize("spread", [1, 30, 1000, 10_000])
@pytest.mark.parametrize("n", [1, 300, 9000])
def test_descendants_are_what_indexing_says_wherever_the_cloud_is(n, spread, n_rows):
    rng, places = np.random.default_rng(n + spread), np.empty(LANES, np.uint64)
    cloud = rng.normal(size=(n_rows, n))
    blocks = as_blocks(cloud)
    room = np.full(2 * blocks.size, np.nan)
    at = blocks.size
    room[at:] = blocks.ravel()
    gone_down = moved = 0
    for step in range(200):
        left = n if step % 40 else -(-n * 9 // 10)
        ancestors = offspring(rng, n, left, spread)
        cloud, size, before, n = cloud[:, ancestors], blocks.size, at, left
        source, at = BELOW(at, size, ancestors, -(-n // LANES), n_rows, room)
        gone_down += 0 < before - at < size
        moved += source != before
        assert source in (before, 0)
        blocks = room[at : at + -(-n // LANES) * n_rows * LANES].reshape(-1, n_rows, LANES)
        for b in range(len(blocks)):
            FETCH(blocks, room[source:], ancestors, b, n, n_rows, places)
        np.testing.assert_array_equal(blocks, as_blocks(cloud))
    if n > 2000 and spread < 1000:
        assert gone_down > 100  # it does stay within one cloud's memory
        assert moved < 50


@pytest.mark.parametrize("at", [0, 1, 300, 512, 700, 1024])
@pytest.mark.parametrize("new_size", [1, 256, 1000, 1024])
def test_there_is_room_beside_a_cloud_wherever_it_is(at, new_size):
    """Both hold what they should, and have no place in common."""
    cloud = np.random.default_rng(at).normal(size=1024)
    room = np.full(2 * 1024, np.nan)
    room[at : at + 1024] = cloud
    source, new = BESIDE(at, 1024, new_size, room)
    assert new + new_size <= source or source + 1024 <= new
    assert 0 <= new <= 2 * 1024 - new_size
    np.testing.assert_array_equal(room[source : source + 1024], cloud)
    has_room = at >= new_size or at + 1024 <= 2 * 1024 - new_size
    assert (source == at) == has_room


def test_asking_is_an_instruction_of_the_processor():
    room = np.zeros(64)
    ASK(room, 0, 64)
    assert "call void @llvm.prefetch" in next(iter(ASK.inspect_llvm().values()))


@pytest.mark.parametrize("spread", [1, 30, 1000])
def test_each_block_asks_for_what_is_new_to_the_next_one(spread):
    """Where that is more than two blocks, for the last two of them."""
    rng, n, n_rows = np.random.default_rng(spread), 9000, 3
    n_blocks, size = -(-n // LANES), 3 * LANES
    ancestors = offspring(rng, n, n, spread)
    for b in range(n_blocks):
        read, following = (np.unique(ancestors[i * LANES : (i + 1) * LANES] // LANES) for i in (b, b + 1))
        first, end = AHEAD(b, True, ancestors, n, n_blocks, n_rows)
        new = np.setdiff1d(following, read)
        asked = np.arange(first // size, end // size)
        assert len(asked) <= 2
        assert set(new[-2:]) <= set(asked) if len(new) else not len(asked)
        first, end = AHEAD(b, False, ancestors, n, n_blocks, n_rows)
        assert (first, end) == ((b + 1) * size, min(b + 2, n_blocks) * size)
