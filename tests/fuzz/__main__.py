"""``python -m tests.fuzz --minutes 10 --seed 0`` fuzzes as long as asked; ``--replay FILE`` plays one."""

import argparse
import itertools
import json
import os
import secrets
import sys
import time
import warnings
from pathlib import Path

from .cases import read
from .running import NAMES, judged, run


def main(arguments=None):
    parser = argparse.ArgumentParser("python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=None, help="without one, a fresh one is printed")
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz"))
    parser.add_argument("--replay", type=Path, help="a file of a failure, to be played again")
    parser.add_argument("--only", nargs="+", default=(), choices=sorted(NAMES), help="promises to judge")
    given = parser.parse_args(arguments)
    # It compiles many kernels, which must not replace those of the user and of the tests.
    os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(given.out / "kernels"))
    if given.replay is not None:
        found = judged(read(given.replay), only=given.only)
        for v in found:
            print(f"{v.invariant}: call {v.call}, lane {v.lane}: {v.found}")
        print("it fails" if found else "it does not fail")
        return int(bool(found))
    seed = secrets.randbelow(2**31) if given.seed is None else given.seed
    print(f"fuzz: seed {seed}", file=sys.stderr)
    warnings.simplefilter("ignore", RuntimeWarning)  # NumPy warns of overflows; the cases provoke them
    end = time.monotonic() + 60.0 * given.minutes
    tally, files = run(seed, itertools.count(), end, given.out, given.only)
    data = {"seed": seed, "minutes": given.minutes, **tally, "files": [path.name for path in files]}
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "summary.json"
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    for name, value in data.items():
        print(f"{name}: {value}")
    print(f"written to {path}")
    return int(bool(files))


if __name__ == "__main__":
    sys.exit(main())
