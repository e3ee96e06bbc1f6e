"""One function over many items: here, in threads or in worker processes, one result after the other.

Question answered: who computes what, and what becomes of an item whose worker dies?  Every way yields results as they
end, in no fixed order, and goes on when a worker is killed: that item's result is what `lost` makes of it.

    execute(function, items, lost) -> iterator of results

Worker processes: `lab.workers`; other machines: `lab.cluster`.  Knows no filters; called by `lab.compare` and
where figures are drawn.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, as_completed, wait
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from lab.validation import InputError

if TYPE_CHECKING:
    from lab.workers import Crew, Worker

Item = TypeVar("Item")
Result = TypeVar("Result")
DIED = "its worker process died: it was killed, ran out of memory, or the solver ended Python itself"


class Execute(Protocol):
    """The way units are run; see the module's docstring."""

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result]
    ) -> Iterator[Result]:
        """Yield one result for each item, in any order."""
        ...


def here(
    function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result]
) -> Iterator[Result]:
    """Run one item after the other in this process, which nothing can outlive."""
    return map(function, items)


def threads(
    function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result], *, jobs: int
) -> Iterator[Result]:
    """Run items in `jobs` threads of this process (-1: one per processor), which nothing can outlive.

    For functions that leave Python alone most of the time: they start at once and share what they load.  One that is
    stopped waits for the items under way.
    """
    pool = ThreadPoolExecutor(max_workers=_count(jobs))
    try:
        for future in as_completed([pool.submit(function, item) for item in items]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def processes(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    lost: Callable[[Item, str], Result],
    *,
    jobs: int,
    beside: bool = False,
    crew: "Crew | None" = None,
) -> Iterator[Result]:
    """Run items in `jobs` processes (-1: one per processor), each with one item at a time.

    Parameters
    ----------
    function : function of an item
        Sent to each worker process.
    items : sequence
        Given out in this order.
    lost : function of item and str
        Makes the result of an item whose worker died, given the reason; the worker is replaced.
    jobs : int
    beside : bool
        Whether this process is one of them: it works while the others start, which pays when they take long to.  They
        have one item more in hand, since this process may be busy when they end one; so a death may lose two.
    crew : Crew, optional
        Workers that were started before; others join as needed, they serve this call only and are ended with it.

    Raises
    ------
    InputError
        The function cannot be pickled.

    Yields
    ------
    object
        Results, in the order in which they end.
    """
    import cloudpickle

    from lab.workers import Crew  # brings loky, which threads do without

    try:
        pickled = cloudpickle.dumps(function)
    except Exception as error:
        raise InputError(f"The work cannot be sent to other processes ({error}); run it in this one, jobs=1.") from None
    waiting = deque(items)
    with crew or Crew() as crew:
        crew.instruct(pickled)
        needed = max(min(_count(jobs), len(items)) - beside, 0)
        workers = crew.call(needed).workers[:needed]
        running: dict[Future[Any], tuple[Worker, Item]] = {}
        for worker in workers * (1 + beside):
            if len(waiting) > beside:  # one is left for this process
                item = waiting.popleft()
                running[worker.submit(item)] = (worker, item)
        while waiting or running:
            if beside and waiting:
                yield function(waiting.popleft())
            at_once = 0 if beside and waiting else None
            for future in wait(running, at_once, FIRST_COMPLETED).done:
                worker, item = running.pop(future)
                try:
                    result = future.result()
                except BrokenExecutor:
                    result = lost(item, DIED)
                if waiting:  # before the result is looked at, so that the worker has work
                    following = waiting.popleft()
                    running[worker.submit(following)] = (worker, following)
                yield result
        for worker in workers:
            worker.end()


def _count(jobs: int) -> int:
    if jobs != -1:
        return jobs
    import loky

    return int(loky.cpu_count())
