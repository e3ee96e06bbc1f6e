"""The bank: right answers that must be accepted, wrong ones that must be refused, and how often that fails.

    python tests/bank.py [--first 6000] [--second 2400] [--seeds 200] [--jobs 2] [--out results/bank]

prints which check kills which mistake, runs every right answer of ``wheats`` over many seeds, measures the rate of
false alarms on right code with a confidence bound, and writes all that to ``bank.md`` in the output folder.
"""

import argparse
import os
import sys
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a worker
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import joblib
import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "chaffs")]

from lab.checks import check  # noqa: E402
from lab.checks.questions import CODE, QUESTIONS  # noqa: E402

CODES = {question.key: question for question in QUESTIONS if question.kind == CODE}
RANDOM = ("q4-filter", "q6-filter", "q6-resample", "q9", "q9-filter", "q10-filter")


def wheats() -> list[tuple[str, str]]:
    """Return the right answers: file and question."""
    found = []
    for path in sorted((HERE / "wheats").glob("*.py")):
        scope = load(path.read_text(encoding="utf-8"))
        found += [(path.name, key) for key, question in CODES.items() if question.function in scope]
    return found


def load(source: str) -> dict:
    """Run the source of a submission; functions that it only imports do not count."""
    scope = {"__name__": "submission"}
    exec(compile(source, "submission", "exec"), scope)
    mine = {name: v for name, v in scope.items() if getattr(v, "__module__", "submission") == "submission"}
    return mine


def chaffs() -> list[tuple[int, str, str]]:
    """Return the wrong answers: number, question, key of the mistake ('' where a refusal is enough)."""
    return [(number, edit[0], edit[1]) for number, edit in enumerate(all_edits())]


def all_edits() -> list[tuple]:
    """Return the edits of every notebook."""
    from edits import EDITS
    from ekf_edits import EKF_EDITS

    return [*EDITS, *EKF_EDITS]


def chaff(number: int):
    """Return the function of a wrong answer.

    Raises
    ------
    ValueError
        The text that it replaces is not in the plain answers any more.
    """
    question, _, *pairs = all_edits()[number]
    plain = "ekf_plain.py" if CODES[question].notebook.startswith("06") else "plain.py"
    source = (HERE / "wheats" / plain).read_text(encoding="utf-8")
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        if old not in source:
            raise ValueError(f"chaff {number} ({question}): {old!r} is not in {plain}")
        source = source.replace(old, new)
    return load(source)[CODES[question].function]


def verdict_on_wheat(name: str, key: str):
    """Return the verdict of `check` on a right answer."""
    scope = load((HERE / "wheats" / name).read_text(encoding="utf-8"))
    return check(key, scope[CODES[key].function])


def refusals_of_wheat(name: str, key: str, seeds: int) -> tuple[str, str, int, int]:
    """Return how often a right random answer is refused over so many seeds."""
    from lab.checks import filters, importance, schemes

    answer = load((HERE / "wheats" / name).read_text(encoding="utf-8"))[CODES[key].function]
    few = partial(schemes.examine, calls=schemes.FEWEST)  # the chance of a refusal does not grow with the calls
    examine = {"q6-resample": few, "q9": importance.examine}.get(key, filters.examine)
    refused = 0
    with np.errstate(all="ignore"):
        for seed in range(1, seeds + 1):
            refused += not examine(CODES[key], answer, None, seed).passed
    return name, key, seeds, refused


def verdict_on_chaff(number: int, key: str):
    """Return the verdict of `check` on a wrong answer."""
    return check(key, chaff(number))


def main() -> int:
    """Run the bank."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=6000, help="verdicts on right code, first stage")
    parser.add_argument("--second", type=int, default=2400, help="verdicts on right code, second stage")
    parser.add_argument("--schemes", type=int, default=200_000, help="verdicts on right resampling schemes")
    parser.add_argument("--seeds", type=int, default=200, help="seeds of every right answer to a random question")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/bank"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    begun, fine = time.perf_counter(), True
    workers = joblib.Parallel(n_jobs=options.jobs)
    lines = ["# The bank of answers", ""]

    def say(*text: str) -> None:
        print(*text, sep="\n", flush=True)
        lines.extend(text)
        (options.out / "bank.md").write_text("\n".join(lines) + "\n", encoding="utf-8")

    tried = wheats()
    verdicts = workers(joblib.delayed(verdict_on_wheat)(*wheat) for wheat in tried)
    refused = [(wheat, v) for wheat, v in zip(tried, verdicts, strict=True) if not v.passed]
    files = len({name for name, _ in tried})
    say(
        f"Right answers: {len(tried)} in {files} files, {len(refused)} refused.",
        *(f"- {w}: {v.reason}" for w, v in refused),
    )
    fine &= not refused

    wrong = chaffs()
    verdicts = workers(joblib.delayed(verdict_on_chaff)(number, key) for number, key, _ in wrong)
    fine &= kill_matrix(wrong, verdicts, say)

    random = [(name, key) for name, key in tried if key in RANDOM]
    counts = workers(joblib.delayed(refusals_of_wheat)(*wheat, options.seeds) for wheat in random)
    say(
        "",
        f"Right answers to random questions over {options.seeds} seeds:",
        "",
        "| file | question | seeds | refused |",
    )
    say("|---|---|---|---|", *(f"| {name} | {key} | {n} | {r} |" for name, key, n, r in counts))
    fine &= not any(r for *_, r in counts)
    say("", f"The whole of it so far took {(time.perf_counter() - begun) / 60:.0f} minutes.")

    import false_alarms

    tasks = false_alarms.jobs(options.first, options.second, options.schemes)
    stages = false_alarms.merged(workers(joblib.delayed(function)(*arguments) for function, arguments in tasks))
    say("", "Right code before the random checks (exceeding: beyond the bound of a stage; largest: in units of it):")
    say("", "| question | right code | stage | verdicts | exceeding | largest |", "|---|---|---|---|---|---|")
    say(*(f"| {s.question} | {s.what} | {s.stage} | {s.verdicts} | {s.exceeding} | {s.largest:.2f} |" for s in stages))
    bounds = false_alarms.bounds(stages)
    say("", "False alarms, 95 % upper bound of their rate:", "", "| question | right code | bound |", "|---|---|---|")
    say(*(f"| {question} | {what} | {bound:.1e} |" for (question, what), bound in bounds.items()))
    fine &= all(bound <= 1e-4 for bound in bounds.values()) or options.first < 5000
    say("", f"The bank took {(time.perf_counter() - begun) / 60:.0f} minutes with {options.jobs} workers.")
    return 0 if fine else 1


def kill_matrix(wrong, verdicts, say) -> bool:
    """Print a row per mistake and a column per question: n named, r refused without that name, A accepted."""
    cells: dict[str, dict[str, str]] = {}
    named = asked = accepted = 0
    for (_, key, mistake), verdict in zip(wrong, verdicts, strict=True):
        mark = "A" if verdict.passed else "n" if mistake and mistake in verdict.mistake.split() else "r"
        row = cells.setdefault(mistake or "(no name asked)", {})
        row[key] = row.get(key, "") + mark
        asked, named, accepted = asked + bool(mistake), named + (mark == "n"), accepted + verdict.passed
    columns = [key for key in CODES if any(key in row for row in cells.values())]
    say("", f"Wrong answers: {len(wrong)}, accepted {accepted}; named {named} of the {asked} that have a name.")
    say("", "n: refused by its name, r: refused, A: accepted", "", f"| mistake | {' | '.join(columns)} |")
    say("|---" * (len(columns) + 1) + "|")
    for mistake, row in sorted(cells.items()):
        say(f"| {mistake} | {' | '.join(row.get(key, '') for key in columns)} |")
    return not accepted and named >= 0.9 * asked


if __name__ == "__main__":
    sys.exit(main())
