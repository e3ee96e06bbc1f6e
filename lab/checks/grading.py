"""Grading what people hand in: every answer in a child process of its own, with limits of time and memory.

Question answered: which questions does a submission answer, and how well?  A broken or missing answer fails its own
question only: an answer that fails and uses others of the submission that fail, too, is judged again with right ones in
their place.  A child that hangs, eats memory or ends Python takes nothing with it.  Called by ``slam-lab check``.
"""

import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from lab.checks import guard, submission
from lab.checks.questions import CODE, QUESTIONS, Question
from lab.checks.submission import Submission
from lab.checks.verdict import Verdict

NEAR = 0.8  # likeness of two names, of which one may be meant for the other
SECONDS, MEGABYTES = 150.0, 4096
STARTING = 30.0  # seconds that a child may take before its work begins


@dataclass(frozen=True)
class Limits:
    """What a child may use: seconds of time and megabytes of address space."""

    seconds: float = SECONDS
    megabytes: int = MEGABYTES

    def inactive(self) -> tuple[str, ...]:
        """Return a sentence for each limit that this platform does not have."""
        if sys.platform.startswith("linux"):
            return ()
        return (f"the memory limit of {self.megabytes} MB is inactive here: this platform has none for a process",)


@dataclass(frozen=True)
class Graded:
    """One submission: its verdicts in the order of the table, and what could not be run when it was loaded."""

    name: str
    verdicts: tuple[Verdict, ...]
    faults: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every question passed."""
        return all(verdict.passed for verdict in self.verdicts)


class Answer(NamedTuple):
    """What a child tells: the verdict, the other answers that this one uses, faults and statements that hung."""

    verdict: Verdict
    uses: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    hung: tuple[str, ...] = ()


def questions_of(handed_in: Submission) -> list[Question]:
    """Return the questions that a submission is asked: those with code of every notebook that it touches.

    One that answers none is asked all.
    """
    names = submission.defined(handed_in)
    codes = [question for question in QUESTIONS if question.kind == CODE]
    notebooks = {question.notebook for question in codes if question.function in names}
    return [question for question in codes if question.notebook in notebooks] or codes


def grade(
    handed_in: Submission,
    asked: Sequence[Question],
    *,
    limits: Limits | None = None,
    jobs: int = 1,
    on_done: Callable[[Verdict], None] | None = None,
) -> Graded:
    """Judge one submission.

    Parameters
    ----------
    handed_in : Submission
    asked : sequence of Question
        With code.
    limits : Limits, optional
    jobs : int
        Children at a time.
    on_done : function of Verdict, optional
        Called as each question is done.
    """
    limits = limits or Limits()
    files = tuple(str(file.resolve()) for file in handed_in.files)

    hung = set[str]()  # statements: the first child waits for each, the others leave them out

    def judge(question: Question, stand_ins: Iterable[str] = ()) -> Answer:
        answer = _in_child((handed_in.name, files, question.key, tuple(stand_ins), tuple(hung), limits), limits)
        hung.update(answer.hung)
        if on_done and not stand_ins and question in asked:
            on_done(answer.verdict)
        return answer

    with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
        first = {asked[0].key: judge(asked[0])}
        first |= dict(zip([question.key for question in asked[1:]], pool.map(judge, asked[1:]), strict=True))
        used = {
            name for question in asked if not first[question.key].verdict.passed for name in first[question.key].uses
        }
        others = [question for question in QUESTIONS if question.function in used and question.key not in first]
        helping = dict(zip(others, pool.map(judge, others), strict=True))
        failed = {question.function for question in asked if not first[question.key].verdict.passed}
        failed |= {question.function for question, answer in helping.items() if not answer.verdict.passed}
        again = {}
        for question in asked:
            verdict, uses = first[question.key].verdict, first[question.key].uses
            helpers = sorted((failed & set(uses)) - {question.function})
            if helpers and not verdict.passed:
                again[question.key] = (question, helpers)
        second = dict(zip(again, pool.map(lambda pair: judge(*pair), again.values()), strict=True))
    verdicts = []
    for question in asked:
        verdict = first[question.key].verdict
        if question.key in second:
            helpers = again[question.key][1]
            verdict = second[question.key].verdict
            note = f"judged with the laboratory's {', '.join(helpers)}, since that of the submission fails"
            verdict = replace(verdict, notes=(*verdict.notes, note))
        verdicts.append(verdict)
    faults = first[asked[0].key].faults
    return Graded(handed_in.name, tuple(verdicts), faults)


def _in_child(task: tuple[Any, ...], limits: Limits) -> Answer:
    """Run a task in a child."""
    methods = multiprocessing.get_all_start_methods()
    context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    if "forkserver" in methods:
        context.set_forkserver_preload(["lab.checks.grading"])
    near, far = context.Pipe(duplex=False)
    # the folder is removed here, since a child that is stopped cannot do it
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        child = context.Process(target=_work, args=(far, folder, *task), daemon=False)
        child.start()
        far.close()
        key = task[2]
        try:
            if near.poll(limits.seconds + STARTING):
                answer: Answer = near.recv()
                notes = (*answer.verdict.notes, *limits.inactive())
                return answer._replace(verdict=replace(answer.verdict, notes=notes))
            reason = f"It did not come back within {limits.seconds:g} s, and was stopped."
        except (EOFError, OSError):
            child.join(5)
            reason = _how_it_died(child.exitcode)
        finally:
            near.close()
            _end(child)
    return Answer(Verdict(key, False, reason, "Run the check of this question alone, in the notebook.", "died"))


def _how_it_died(status: int | None) -> str:
    if status is not None and status < 0:
        return f"The process that ran it was killed (signal {-status}): out of memory, or a crash in compiled code."
    return f"It ended Python itself (status {status}) instead of returning."


def _end(child: Any) -> None:
    """Stop a child and whatever it has started, which may go on when the child itself has ended."""
    if hasattr(os, "killpg") and child.pid:
        with suppress(OSError):  # the group that the child led has ended, or it has not begun to lead one
            os.killpg(child.pid, 9)
    if child.is_alive():
        child.kill()
    child.join(5)


def _work(
    connection: Connection,
    folder: str,
    name: str,
    files: tuple[str, ...],
    key: str,
    stand_ins: tuple[str, ...],
    hung: tuple[str, ...],
    limits: Limits,
) -> None:
    """Load a submission and judge one answer: the child's whole life."""
    if hasattr(os, "setsid"):
        os.setsid()
    _limit_memory(limits.megabytes)
    os.environ["MPLBACKEND"] = "Agg"
    silence = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silence, stream)
    sys.dont_write_bytecode = True  # nothing is written beside what was handed in
    os.chdir(folder)  # what a submission writes ends up here
    try:
        answer = _judged(Submission(name, tuple(map(Path, files))), key, stand_ins, hung)
    except MemoryError:
        answer = Answer(Verdict(key, False, f"It needs more than {limits.megabytes} MB of memory."))
    os.chdir(tempfile.gettempdir())  # a folder that somebody is in cannot be removed everywhere
    connection.send(answer)
    connection.close()


def _judged(handed_in: Submission, key: str, stand_ins: tuple[str, ...], hung: tuple[str, ...]) -> Answer:
    from lab.checks.examination import check
    from lab.checks.questions import question_named
    from lab.checks.stand_ins import stand_in

    loaded = submission.load(handed_in, hung)
    for helper in stand_ins:
        loaded.scope[helper] = stand_in(helper)
    question = question_named(key)
    answer = loaded.answer(question.function)
    verdict = check(key, answer)
    names = {other.function for other in QUESTIONS if other.function}
    told = [fault for fault in loaded.faults if question.function in fault or not loaded.own]
    if answer is None and told:
        verdict = replace(verdict, reason=f"{question.function} could not be run: {told[0]}")
    elif answer is None and (near := get_close_matches(question.function, sorted(loaded.own.keys() - names), 1, NEAR)):
        verdict = replace(verdict, reason=f"{verdict.reason}; did you mean {near[0]}?")
    uses = tuple(sorted(guard.used_names(answer) & names))
    return Answer(verdict, uses, tuple(loaded.faults), tuple(loaded.hung))


def _limit_memory(megabytes: int) -> None:
    if sys.platform.startswith("linux"):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
