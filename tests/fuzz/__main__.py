"""``python -m tests.fuzz --minutes 10 --seed 0`` fuzzes as long as asked; ``--replay FILE`` plays one."""

import argparse
import json
import multiprocessing
import os
import secrets
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import count
from pathlib import Path

from . import cases
from .invariants import Tally
from .running import judged, run

TOLD = 10
"""Number of cases between two lines of progress."""


def replay(path):
    """Plays a file; 1 if it fails."""
    found = judged(cases.read(path))
    for v in found:
        print(f"{v.invariant}: call {v.call}, lane {v.lane}: {v.found}")
    print("it fails" if found else "it does not fail")
    return int(bool(found))


def worker(seed, first, stride, minutes, out):
    """The cases first, first + stride, ... of a seed."""
    warnings.simplefilter("ignore", RuntimeWarning)  # NumPy warns of overflows; the cases provoke them
    start, parent = time.monotonic(), os.getppid()

    def told(number, tally, failed):
        if os.getppid() != parent:
            sys.exit("fuzz: who asked for it is gone")
        if failed or tally.scenes % TOLD == 0:
            text = f"fuzz: {time.monotonic() - start:.0f} of {60 * minutes:.0f} s, case {number}: "
            text += f"{tally.scenes} scenes, {tally.intervals} intervals, {tally.judged} judged"
            print(f"{text}: {failed} failed" if failed else text, file=sys.stderr, flush=True)

    return run(seed, count(first, stride), start + 60.0 * minutes, out, told)


def main(arguments=None):
    parser = argparse.ArgumentParser("python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=None, help="without one, a fresh one is printed")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--stride", type=int, default=1, help="5 with --first 3: environments of many lanes")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz"))
    parser.add_argument("--replay", type=Path, help="a file of a failure, to be played again")
    given = parser.parse_args(arguments)
    # It compiles many kernels, which must not replace those of the user and of the tests.
    os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(given.out / "kernels"))
    if given.replay is not None:
        return replay(given.replay)
    seed = secrets.randbelow(2**31) if given.seed is None else given.seed
    print(f"fuzz: seed {seed}", file=sys.stderr)
    stride, rest = given.processes * given.stride, (given.minutes, given.out)
    with ProcessPoolExecutor(given.processes, multiprocessing.get_context("spawn")) as pool:
        firsts = (given.first + k * given.stride for k in range(given.processes))
        parts = [pool.submit(worker, seed, first, stride, *rest) for first in firsts]
    tally, files = Tally(), []
    for part in parts:
        own, paths = part.result()
        tally.add(own)
        files += [path.name for path in paths]
    data = {"seed": seed, "minutes": given.minutes, **asdict(tally), "files": files}
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "summary.json"
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    for name, value in data.items():
        print(f"{name}: {value}")
    print(f"written to {path}")
    return int(bool(files))


if __name__ == "__main__":
    sys.exit(main())
