"""Machine code on disk: damaged files and full disks cost time, but no run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba", reason="the extra toy-slam-lab[fast] is not installed")
ROOT = Path(__file__).resolve().parents[1]
TWICE = """
from lab.fast.keeping import keep
from lab.fast.kernel import kernel
from numba import float64
from numba.core.ccallback import CFunc
import twice

dispatcher = kernel(from_python=True)(twice.as_called)
keep(dispatcher, twice.as_called)
c_function = CFunc(twice.by_address, ((float64,), float64), {}, {})
keep(c_function, twice.by_address)
c_function.compile()
print(dispatcher(4.0), c_function.ctypes(4.0), sum(dispatcher.stats.cache_hits.values()), c_function.cache_hits)
"""


@pytest.fixture
def compiled(tmp_path):
    """Return a function that runs a process which compiles two functions or finds them, and says what it printed."""
    (tmp_path / "twice.py").write_text("def as_called(x):\n    return 2 * x\ndef by_address(x):\n    return 2 * x\n")
    places = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}

    def run(code=TWICE):
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, env=os.environ | places, capture_output=True, text=True
        )
        assert not done.returncode, done.stderr
        return done.stdout.split()

    return run


FOUND, MADE = ["8.0", "8.0", "1", "1"], ["8.0", "8.0", "0", "0"]


def make_a_hole(file):
    """Put zeros in the place of machine code, as a power cut may."""
    code = file.read_bytes()
    middle = len(code) // 2
    file.write_bytes(code[:middle] + bytes(500) + code[middle + 500 :])


DAMAGES = {
    "index, empty": ("nbi", lambda file: file.write_bytes(b"")),
    "index, something else": ("nbi", lambda file: file.write_text("garbage\n")),
    "code, cut off": ("nbc", lambda file: file.write_bytes(file.read_bytes()[:-20])),
    "code, with a hole": ("nbc", make_a_hole),
    "code, away": ("nbc", Path.unlink),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_file_is_replaced(compiled, tmp_path, name):
    kind, damage = DAMAGES[name]
    assert compiled() == MADE
    files = list((tmp_path / "kernels").rglob(f"*.{kind}"))
    assert len(files) == 2
    for file in files:
        damage(file)
    assert compiled() == MADE
    assert compiled() == FOUND


def test_what_is_kept_is_loaded_without_what_compiles(compiled):
    """numba's implementations of Python take longer to import than kernels take to load."""
    asked = TWICE + "import sys\nprint('numba.typed.typeddict' in sys.modules)"
    assert compiled(asked) == [*MADE, "True"]
    assert compiled(asked) == [*FOUND, "False"]


FULL = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))\n"  # bytes of a file


def test_a_function_that_cannot_be_written_runs(compiled):
    pytest.importorskip("resource", reason="Windows cannot limit what a process writes")
    assert compiled(FULL + TWICE) == MADE
    assert compiled() == MADE
    assert compiled() == FOUND


def test_a_folder_without_room_is_told_of(compiled, tmp_path):
    pytest.importorskip("resource", reason="Windows cannot limit what a process writes")
    code = (
        "import warnings; from lab import fast\n"
        "with warnings.catch_warnings(record=True) as said:\n"
        "    warnings.simplefilter('always')\n"
        "    kernels = fast.load(), fast.load()\n"
        "print(kernels[0].KEPT, kernels[0].is_cold(['systematic']), *(w.message for w in said))"
    )
    said = compiled(FULL + code)
    assert (said[:4], said.count("NUMBA_CACHE_DIR")) == (["False", "False", "no", "folder"], 1)
    assert compiled(code) == ["True", "True"]
    assert not list((tmp_path / "kernels").rglob("*.nb?"))
