"""``python -m lab`` is ``slam-lab``."""

from lab.cli import main

main()
