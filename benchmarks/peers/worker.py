"""What every peer's worker does around its own few lines: prepare, act when told, say how long it took.

A worker is a process in its own environment.  It computes once (which compiles, and gives the answer that is checked),
prints one line of JSON, and then, for every line that it reads, prepares and acts for a second, once at least, and
prints the mean time of an act; so a driver can take turns between peers, and who is quick is not measured by what the
others left of the caches alone.  The seconds are the processor's (all threads added), so that other work on the machine
does not count.  In the scripts beside this one `prepare` and `act` are what `serve` calls them.  Needs
numpy alone, in any version.
"""

import json
import os
import sys
import time

import numpy as np

TURN = 1.0  # seconds of processor time, preparing included, until no other act is begun


def peak_megabytes():
    """Return the peak memory of this process [MB], or None where the system does not say."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) / 1000 for line in status if line.startswith("VmHWM"))
    except OSError:
        return None


def serve(prepare, act, answer_to, before=None):
    """Work until the input ends.

    Parameters
    ----------
    prepare : function
        Called without being timed; what it returns is given to `act`.
    act : function
        The work; returns a dictionary of arrays.
    answer_to : str
        The .npz file for the first answer.
    before : float, optional
        The peak memory before anything was computed [MB]; that of now.
    """
    lines = os.fdopen(os.dup(1), "w")  # a library that prints must not end up between the lines of JSON
    os.dup2(2, 1)
    before = peak_megabytes() if before is None else before
    state = prepare()
    start = time.perf_counter()
    answer = act(state)
    first = time.perf_counter() - start
    np.savez(answer_to, **answer)
    del answer, state
    print(json.dumps({"first": first, "before": before, "peak": peak_megabytes()}), file=lines, flush=True)
    for _ in sys.stdin:
        began, seconds, acts = time.process_time(), 0.0, 0
        while acts == 0 or time.process_time() - began < TURN:
            state = prepare()
            start = time.process_time()
            act(state)
            seconds += time.process_time() - start
            acts += 1
            del state
        print(json.dumps({"seconds": seconds / acts, "peak": peak_megabytes()}), file=lines, flush=True)
