"""Fixtures of the tests of the command line."""

import base64
import time
from importlib.util import find_spec
from unittest.mock import Mock

import pytest

# one grey point
PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="
)


@pytest.fixture(scope="session")
def compiled_once(tmp_path_factory, request):
    """Let one of several test processes compile the kernels, and the others take them from the disk."""
    import numpy as np
    from worlds import problem

    from lab.solvers import sis

    folder = tmp_path_factory.getbasetemp()
    turn = (folder.parent if hasattr(request.config, "workerinput") else folder) / "compiling"
    try:
        turn.mkdir()
    except FileExistsError:
        deadline = time.monotonic() + 400
        while not (turn / "done").exists() and time.monotonic() < deadline:
            time.sleep(0.2)
    else:
        sis(problem(), np.random.default_rng(0), n_particles=1, backend="numba")
        (turn / "done").touch()


@pytest.fixture(params=["numpy", "numba"])
def backend(request):
    """Both ways of running a filter, where both are there."""
    if request.param == "numba":
        if find_spec("numba") is None:
            pytest.skip("the extra toy-slam-lab[fast] is not installed")
        request.getfixturevalue("compiled_once")
    return request.param


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder as the current one: what a command should not have written shows there."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_pictures(monkeypatch):
    """Leave out the figures, which take most of a command's time, where the test is not about them."""
    from lab.cli import album, pictures

    here = album.execution.here  # in other processes the figures would be real
    monkeypatch.setattr(album, "execution", Mock(here=here, processes=lambda *given, jobs, beside, crew: here(*given)))
    monkeypatch.setattr(pictures, "new_figure", Mock(return_value=Mock(**{"subplots.return_value": (Mock(), Mock())})))
    monkeypatch.setattr(pictures, "plots", Mock())
    monkeypatch.setattr(pictures, "save_png", lambda figure, path, description: path.write_bytes(PICTURE))
