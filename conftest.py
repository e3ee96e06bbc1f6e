"""What ``pytest --nbval solutions`` needs: this interpreter's kernel, pictures left out, a limit of time for a cell.

So the short command does what the long one does, from any folder, and so does whoever types all of it.
"""

from pathlib import Path

NBVAL_DEFAULT_TIMEOUT = 2000  # seconds: longer than anybody waits for a cell
CELL_TIMEOUT = 120


def pytest_configure(config):
    """Fill in the options of nbval that were not given."""
    option = config.option
    if not getattr(option, "nbval", False):
        return
    if not option.nbval_kernel_name:
        option.nbval_current_env = True
    if not option.nbval_sanitize_with:
        option.nbval_sanitize_with = str(Path(__file__).parent / "solutions" / "nbval.cfg")
    if option.nbval_cell_timeout == NBVAL_DEFAULT_TIMEOUT:
        option.nbval_cell_timeout = CELL_TIMEOUT
    import matplotlib.font_manager  # noqa: F401 - where its cache is built, it says so, and that would be an output
