"""The live map of a run in a window, as the guide's demo shows it.

Question answered: what does it look like while it happens?  True and estimated robot and landmarks, ellipses, and the
strip of NEES below, step by step.  Called by ``slam-lab ekf-slam --live``.
"""

from matplotlib.animation import FuncAnimation

from lab.ekfslam.demo import Run
from lab.plots.slam import FILM_SIZE, draw_run
from lab.validation import InputError

FILES_ONLY = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")  # matplotlib's backends without a window


def require_screen() -> None:
    """Refuse where no window can be opened.

    Raises
    ------
    InputError
        matplotlib finds no screen, or was told to use none.
    """
    from matplotlib import pyplot as plt

    try:
        plt.switch_backend(plt.get_backend())
    except ImportError:  # a backend was asked for that finds no screen
        found = False
    else:
        found = plt.get_backend().lower() not in FILES_ONLY
    if not found:
        raise InputError("No screen is found here; --animate FILE.gif saves the animation instead.")


def show_run(run: Run, *, interval: float = 80) -> None:
    """Show a run in a window until it is closed.

    Parameters
    ----------
    run : Run
    interval : float
        Time between frames [ms].

    Raises
    ------
    InputError
        As `require_screen`.
    """
    from matplotlib import pyplot as plt

    require_screen()
    figure = plt.figure(figsize=FILM_SIZE, layout="constrained")
    animation = FuncAnimation(figure, draw_run(figure, run), frames=range(1, len(run.frames) + 1), interval=interval)
    plt.show()
    plt.close(figure)
    del animation  # it had to live as long as its window
