"""What a timing needs: one core, and its rate of products of matrices.

All studies measure processor time: other programs on the machine then change little.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator

import numpy as np

from redundant_envs.values import say

MATRIX = 1024


def dgemm_rate(repeats: int = 4, size: int = MATRIX) -> float:
    """Best rate of a product of two square matrices, 1e9 floating point operations per second."""
    a = np.random.default_rng(0).standard_normal((size, size))
    out = np.empty_like(a)
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        np.matmul(a, a, out=out)
        best = min(best, time.process_time() - start)
    return 2.0 * size**3 / best / 1e9


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep the calling thread on one core and BLAS in the calling thread, as far as possible."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with contextlib.ExitStack() as stack:
        try:
            from threadpoolctl import threadpool_limits
        except ImportError:
            if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
                say(
                    "threadpoolctl is not installed: set OPENBLAS_NUM_THREADS=1 for the rate of one core",
                    file=sys.stderr,
                )
        else:
            stack.enter_context(threadpool_limits(limits=1, user_api="blas"))
        if allowed is not None:
            os.sched_setaffinity(0, {min(allowed)})
            stack.callback(os.sched_setaffinity, 0, allowed)
        yield
