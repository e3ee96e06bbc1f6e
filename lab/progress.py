"""A progress bar with the time left, on a terminal or in a notebook; none where nobody watches.

Called by comparisons and commands, always around work whose results come one by one.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(description: str, total: float | None = None) -> Iterator[Callable[[float], None]]:
    """Show a bar while the block runs, on standard error; it vanishes at the end.

    Parameters
    ----------
    description : str
    total : float, optional
        The work in any unit.

    Yields
    ------
    function of a float
        To be told how much more is done.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    watched = console.is_terminal or console.is_jupyter
    with Progress(*columns, console=console, transient=True, disable=not watched) as progress:
        bar = progress.add_task(description, total=total)
        yield lambda amount: progress.advance(bar, amount)
