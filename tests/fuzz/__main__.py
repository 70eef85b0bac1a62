"""``python -m tests.fuzz --minutes 10 --seed 0`` fuzzes as long as asked; ``--replay FILE`` plays one."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import secrets
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from . import cases
from .played import Tally
from .running import judged, summary, worker, write_summary


def replay(path: Path) -> int:
    """Plays a file; 1 if it fails."""
    case = cases.read(path)
    found = judged(case)
    for v in found:
        print(f"{v.invariant}: call {v.call}, lane {v.lane}: {v.found}")
    print("it fails" if found else "it does not fail")
    return int(bool(found))


def main(arguments: list[str] | None = None) -> int:
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
    rest = (given.processes * given.stride, given.minutes, given.out)
    if given.processes == 1:
        parts = [worker(seed, given.first, *rest)]
    else:
        with ProcessPoolExecutor(given.processes, multiprocessing.get_context("spawn")) as pool:
            asked = [
                pool.submit(worker, seed, given.first + k * given.stride, *rest)
                for k in range(given.processes)
            ]
            parts = [one.result() for one in asked]
    tally, files = Tally(), []
    for own, paths in parts:
        tally.add(own)
        files += paths
    data = summary(tally, seed, given.minutes, files)
    path = write_summary(data, given.out)
    for name, value in data.items():
        print(f"{name}: {value}")
    print(f"written to {path}")
    return int(bool(files))


if __name__ == "__main__":
    sys.exit(main())
