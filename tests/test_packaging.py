"""What a fresh machine meets: the pins, the range of Python, the script that builds .venv, and the wheel."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOW, HIGH = (3, 11), (3, 14)  # the oldest and the newest Python that the pins are tested with


NO_WHEEL = re.escape('; sys_platform != "darwin" or platform_machine != "x86_64"')  # of numba, for Macs with Intel's


def pins():
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    matches = [re.fullmatch(rf"([A-Za-z0-9._-]+)==(\d[A-Za-z0-9.]*)({NO_WHEEL})?", line) for line in lines]
    assert all(matches), f"not of the form name==version: {[x for x, m in zip(lines, matches, strict=True) if not m]}"
    return [(canonicalize_name(match[1]), match[2]) for match in matches]


def ranges():
    project = PROJECT["project"]
    lines = [*project["dependencies"], *(line for extra in project["optional-dependencies"].values() for line in extra)]
    return [Requirement(line) for line in lines]


def test_every_direct_dependency_is_pinned_once_and_nothing_else_is():
    assert sorted(name for name, _ in pins()) == sorted(canonicalize_name(r.name) for r in ranges())


def test_only_the_compiler_is_left_out_anywhere():
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    assert [line.split("==")[0] for line in lines if ";" in line] == ["numba", "llvmlite"]


def test_every_pin_is_within_its_range():
    pinned = dict(pins())
    outside = [str(r) for r in ranges() if pinned[canonicalize_name(r.name)] not in r.specifier]
    assert not outside


def test_the_range_of_python_is_the_same_everywhere():
    specifier = SpecifierSet(PROJECT["project"]["requires-python"])
    minors = [(3, minor) for minor in range(100) if f"3.{minor}" in specifier]
    assert (minors[0], minors[-1]) == (LOW, HIGH)
    assert PROJECT["tool"]["ruff"]["target-version"] == "py{}{}".format(*LOW)
    for document in ["README.md", "CONTRIBUTING.md", "Makefile", ".ci/venv"]:
        text = (ROOT / document).read_text(encoding="utf-8")
        for low, high in re.findall(r"\b3\.(\d+)(?:\s+to\s+|\s*(?:-|\N{EN DASH})\s*)3\.(\d+)", text):
            assert ((3, int(low)), (3, int(high))) == (LOW, HIGH), document


@pytest.fixture
def checkout(tmp_path):
    """Return a function that runs .ci/venv where only the interpreters given exist; a build fails for want of pins."""
    if os.name == "nt" or not shutil.which("sh"):
        pytest.skip("the stand-ins for interpreters are shell scripts")
    root = tmp_path / "a checkout"
    (root / ".ci").mkdir(parents=True)
    shutil.copy(ROOT / ".ci/venv", root / ".ci/venv")
    shutil.copy(ROOT / "pyproject.toml", root)
    (root / "environment.txt").write_text("/no/such/file\n", encoding="utf-8")
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ["sh", "dirname", "tr", "sed", "cat", "cksum", "rm", "mkdir", "tail"]:
        (tools / tool).symlink_to(shutil.which(tool))

    def run(interpreters, chosen=""):
        for name, before in interpreters.items():
            script = f"import sys; {before}; exec(sys.argv[1])"
            (tools / name).write_text(f"#!/bin/sh\nexec '{sys.executable}' -c '{script}' \"$2\"\n", encoding="utf-8")
            (tools / name).chmod(0o755)
        command = [shutil.which("sh"), str(root / ".ci/venv")]
        environment = {"PATH": str(tools), "PYTHON": chosen, "PIP_NO_INDEX": "1"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, cwd=tmp_path)
        assert done.returncode != 0
        assert done.stdout == ""
        return done.stderr.splitlines(), (root / ".venv").exists()

    return run


OLD = f"sys.version_info = ({LOW[0]}, {LOW[1] - 1}, 7)"
NEW = f"sys.version_info = ({HIGH[0]}, {HIGH[1] + 1}, 0)"
BARE = 'sys.modules["ensurepip"] = None'
SHIM = "sys.exit(127)"
GOOD = "pass"


@pytest.mark.parametrize(
    ("interpreters", "chosen", "words"),
    [
        ({}, "", "No Python found: install Python 3.11 to 3.14"),
        ({"python3": SHIM, "python3.12": SHIM}, "", "No Python found"),
        ({"python3": OLD}, "", "Python 3.10.7 (python3) is too old: install Python 3.11 to 3.14"),
        ({"python": NEW}, "", "Python 3.15.0 (python) is too new: install Python 3.11 to 3.14"),
        ({"python3": OLD, "python": BARE}, "", "(python) lacks the module venv or ensurepip: add it"),
        ({"mine": OLD, "python3": GOOD}, "mine", "Python 3.10.7 (mine) is too old"),
        ({"python3": GOOD}, "mine", "PYTHON=mine does not run"),
    ],
)
def test_one_sentence_says_what_is_missing(checkout, interpreters, chosen, words):
    lines, built = checkout(interpreters, chosen)
    assert len(lines) == 1
    assert words in lines[0]
    assert not built


def test_the_first_usable_interpreter_is_taken(checkout):
    lines, _ = checkout({"python3": SHIM, "python3.14": OLD, "python3.13": BARE, "python3.12": GOOD, "python": GOOD})
    assert lines[0].startswith("building .venv with Python {}.{}.{} ".format(*sys.version_info))
    assert lines[-1].startswith("pip could not install environment.txt")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--wheel-dir", folder, ROOT)
    (path,) = folder.glob("*.whl")
    return path


def pip(*arguments):
    command = [sys.executable, "-m", "pip", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def test_the_wheel_carries_lab_and_the_simulator(wheel):
    files = [path for path in (ROOT / "lab").rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    expected = {"data_simulation.py", *(path.relative_to(ROOT).as_posix() for path in files)}
    with zipfile.ZipFile(wheel) as archive:
        carried = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert carried == expected


def test_the_wheel_works_in_a_clean_environment(wheel, tmp_path):
    home = tmp_path / "clean"
    venv.create(home)
    scripts = home / ("Scripts" if os.name == "nt" else "bin")
    # Not compiled: only what is imported below needs it, and the whole of jupyter takes half a minute.
    pip("--python", scripts / "python", "install", "--no-compile", "-c", ROOT / "environment.txt", wheel)

    def run(*command):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    code = "import data_simulation, lab; print(data_simulation.__file__, lab.__file__, sep='\\n')"
    origins = run(scripts / "python", "-c", code)
    assert [Path(line).is_relative_to(home) for line in origins.splitlines()] == [True, True]
    assert "compare" in run(scripts / "slam-lab", "--help")
    assert "compare" in run(scripts / "python", "-m", "lab", "--help")
    run(scripts / "slam-lab", "compare", "--particles", "10", "--runs", "1", "--out", "results")
    assert (tmp_path / "results" / "summary.csv").is_file()
