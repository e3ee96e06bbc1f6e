"""The peers' environments: one virtual environment for each file of requirements/, since they contradict each other.

    python benchmarks/environments.py [NAME ...] [--python INTERPRETER]

builds benchmarks/.environments/NAME for every NAME.txt, or for those named, and leaves alone what is there and made
from the same pins.  One that cannot be built is said, with pip's last words, and the others go on; the drivers ask
`python_of` and leave out a peer that has no environment.  Nothing but Python itself is needed to run this file.
"""

import argparse
import hashlib
import os
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
REQUIREMENTS = HERE / "requirements"
ENVIRONMENTS = HERE / ".environments"
MARK = "built-from"  # holds the hash of the pins, once everything is installed


def names() -> list[str]:
    """Return the environments that can be built."""
    return sorted(path.stem for path in REQUIREMENTS.glob("*.txt"))


def python_of(name: str) -> Path | None:
    """Return the interpreter of an environment, or None where it is not built from the present pins."""
    folder = ENVIRONMENTS / name
    mark = folder / MARK
    if not mark.exists() or mark.read_text(encoding="ascii") != _pins(name):
        return None
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def build(name: str, interpreter: str) -> str | None:
    """Build one environment; return None, or why it could not be built."""
    folder = ENVIRONMENTS / name
    if interpreter == sys.executable:
        venv.create(folder, clear=True, with_pip=True)
    else:
        subprocess.run([interpreter, "-m", "venv", "--clear", str(folder)], check=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    # a wheel of an older build rather than an hour of compiling
    arguments = ["install", "--quiet", "--disable-pip-version-check", "--prefer-binary"]
    arguments += ["-r", str(REQUIREMENTS / f"{name}.txt")]
    done = subprocess.run([str(python), "-m", "pip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        return lines[-1] if lines else f"pip ended with status {done.returncode}"
    (folder / MARK).write_text(_pins(name), encoding="ascii")
    return None


def main() -> int:
    """Build what was asked for and say what stands; return the status."""
    parser = argparse.ArgumentParser(description="Build the environments of the peers.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names())}; all when none is given")
    parser.add_argument("--python", default=sys.executable, help="the interpreter to build them with")
    options = parser.parse_args()
    unknown = set(options.names) - set(names())
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    failed = False
    for name in options.names or names():
        if python_of(name):
            print(f"{name:12} is there", flush=True)
            continue
        reason = build(name, options.python)
        failed |= reason is not None
        print(f"{name:12} {'built' if reason is None else f'CANNOT BE BUILT: {reason}'}", flush=True)
    return 1 if failed else 0


def _pins(name: str) -> str:
    return hashlib.sha256((REQUIREMENTS / f"{name}.txt").read_bytes()).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
