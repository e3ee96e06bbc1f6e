"""What the compiled loop is made of: functions as exact as those of the C library, vectors, and what is left out."""

import numpy as np
import pytest
from test_proposals import PROPOSALS, mixed
from worlds import WORLDS, reference

from lab.solvers import compiled
from lab.solvers.plan import PATIENCE, plan

numba = pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
arithmetic = pytest.importorskip("lab.fast.arithmetic")
kernels = pytest.importorskip("lab.fast.compiled")
memory = pytest.importorskip("lab.fast.room")

RNG = np.random.default_rng(5)
QUARTER = RNG.uniform(-np.pi / 4, np.pi / 4, 200_000)
ARGUMENTS = {
    "log": np.concatenate([RNG.random(200_000), 2.0 ** -RNG.uniform(0, 52, 200_000), [1.0, 0.5, 2.0**-52]]),
    "exp": np.concatenate([-RNG.exponential(5, 200_000), -RNG.uniform(0, 700, 200_000), [0.0]]),
    "sine": QUARTER,
    "cosine": QUARTER,
}
PEERS = {"log": np.log, "exp": np.exp, "sine": np.sin, "cosine": np.cos}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_functions_are_exact_to_two_units_in_the_last_place(name):
    kernel = getattr(arithmetic, name)

    @numba.njit
    def all_of(arguments, values):
        for i in range(len(arguments)):
            values[i] = kernel(arguments[i])

    arguments = ARGUMENTS[name]
    values = np.empty_like(arguments)
    all_of(arguments, values)
    exact = PEERS[name](arguments.astype(np.longdouble))
    assert (np.abs(values - exact) <= 2 * np.spacing(np.abs(exact.astype(float)))).all()


def test_kernels_prefer_wide_vectors():
    kernels.uniforms(kernels.seed(RNG), np.empty((1, 256)), 0)
    assert '"prefer-vector-width"="512"' in next(iter(kernels.uniforms.inspect_llvm().values()))


def test_rows_become_static_after_their_last_touch():
    """Landmarks drawn at first sight are the particles' own until the last of them is seen, and no longer."""
    world = reference(1).problem
    last = max(np.flatnonzero(~np.isnan(world.z[:, j]))[0] for j in range(world.z.shape[1]))
    active = plan(world, PROPOSALS["delayed"]).sizes[:, 2]
    np.testing.assert_array_equal(active, np.where(np.arange(1, world.n_instants) <= last, 12, 2))
    assert (plan(world, PROPOSALS["rbpf-optimal"]).sizes[:, 2] == 12).all()  # all are corrected to the end
    assert (plan(world, PROPOSALS["prior"]).sizes[:, 2] == 2).all()
    assert (plan(mixed(), PROPOSALS["prior"]).sizes[:, 2] == 4).all()  # F moves all


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("name", PROPOSALS)
def test_no_step_touches_a_static_row(world, name):
    laws = plan(WORLDS[world](), PROPOSALS[name])
    touched = (laws.K != 0).any(axis=2) | (laws.spread != 0).any(axis=2)
    for k, active in enumerate(laws.sizes[:, 2]):
        assert active >= laws.n_moving
        assert not touched[k:, active:].any()
        changes = np.flatnonzero(np.diff(laws.sizes[k : k + PATIENCE, 2]))
        assert len(changes) <= 1  # each time that rows become static costs some steps


@pytest.mark.parametrize("sizes", [(1, 2, 2, 0, 0), (1000, 12, 2, 4, 2), (513, 7, 5, 3, 6)])
def test_the_arrays_of_a_run_begin_with_lines_of_the_cache_and_lie_apart(sizes):
    n, d, a, p, e = sizes
    parts, lanes = memory.room(*sizes), memory.LANES
    blocks = -(-n // lanes)
    assert [part.shape for part in parts] == [
        *((2, blocks * lanes * a), (2, blocks, lanes), (d, blocks * lanes + memory.PAD), (n + 1,), (blocks + 1,)),
        *((memory.COUNTS, n + 1), (blocks,), (d, lanes), (d, lanes), (e + 2, lanes), (p + 1, lanes), (a + 1, lanes)),
        *((lanes,), (d, d), (5, d), (d,)),
    ]
    assert all(part.ctypes.data % 64 == 0 and part.flags.c_contiguous for part in parts)
    ends = [part.ctypes.data + part.nbytes for part in parts]
    starts = [part.ctypes.data for part in parts]
    assert all(end <= start for end, start in zip(ends, starts[1:], strict=False))


@pytest.mark.parametrize("world", ["plain", "mixed"])
@pytest.mark.parametrize("name", PROPOSALS)
def test_what_the_memory_of_a_run_held_before_changes_nothing(name, world, monkeypatch):
    given = reference().problem if world == "plain" else mixed()
    options = {"proposal": PROPOSALS[name], "n_particles": 300, "ess_threshold": 0.5, "resample": "residual"}
    expected = compiled.run(given, np.random.default_rng(0), **options)

    def used(*sizes):
        parts = memory.room(*sizes)
        for part in parts:
            part[...] = np.nan if part.dtype == float else 2**30
        return parts

    monkeypatch.setattr(kernels, "room", used)
    answer = compiled.run(given, np.random.default_rng(0), **options)
    for one, other in zip(vars(answer).values(), vars(expected).values(), strict=True):
        np.testing.assert_array_equal(one, other)
