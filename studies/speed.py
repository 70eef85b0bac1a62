"""What studies of speed share: one core, its rate of products of matrices, and the second of two calls."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from redundant_envs.model.batch import BatchSimulator
from redundant_envs.support.timing import Times, seconds
from redundant_envs.support.values import say

Array = NDArray[np.float64]
MATRIX = 1024


def dgemm() -> Callable[[], float]:
    """A function that multiplies two square matrices, and returns the time, s."""
    a = np.random.default_rng(0).standard_normal((MATRIX, MATRIX))
    return functools.partial(seconds, np.matmul, a, a, np.empty_like(a))


def dgemm_rate(times: Times) -> float:
    """Best rate of :func:`dgemm`, 1e9 floating point operations per second."""
    return float(2.0 * MATRIX**3 / times.best / 1e9)


def second_call(batch: BatchSimulator, efforts: Array, again: bool = False) -> Callable[[], float]:
    """A function that advances from the present state, then once more, or ``again`` from the same one, and
    gives the time of the second call, s: the first one brings the memory of the batch into the caches."""
    snapshot, efforts = batch.save(), np.ascontiguousarray(efforts)

    def sample() -> float:
        batch.restore(snapshot)
        batch.advance(efforts)
        if again:
            batch.restore(snapshot)
        return seconds(batch.advance, efforts)

    return sample


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep the calling thread on one core and BLAS in the calling thread, as far as possible."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with contextlib.ExitStack() as stack:
        try:
            from threadpoolctl import threadpool_limits
        except ImportError:
            if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
                fix = "set OPENBLAS_NUM_THREADS=1 for the rate of one core"
                say(f"threadpoolctl is not installed: {fix}", file=sys.stderr)
        else:
            stack.enter_context(threadpool_limits(limits=1, user_api="blas"))
        if allowed is not None:
            os.sched_setaffinity(0, {min(allowed)})
            stack.callback(os.sched_setaffinity, 0, allowed)
        yield
