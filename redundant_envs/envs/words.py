"""The first words of NumPy's generators of many seeds at a time: to make the generators takes 10 us each. The
algorithms are those of ``numpy.random.SeedSequence`` and ``PCG64``, whose streams NumPy keeps (NEP 19)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]
Wide = tuple[Words, Words]  # the upper and the lower words of numbers of 128 bits
BITS = 2**32 - 1
POOL = 4
"""Words of a SeedSequence."""
FIRST_A, FACTOR_A, FIRST_B, FACTOR_B = 0x43B0D7E5, 0x931E8875, 0x8B51F9DD, 0x58F38DED
MIX_LEFT, MIX_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
FACTOR = 0x2360ED051FC65DA44385DF649FCCF645
"""Of PCG's 128-bit congruential generator."""
LARGEST_SEED = 2**64 - 1
HIGH, LOW = np.uint64(FACTOR >> 64), np.uint64(FACTOR & LARGEST_SEED)
HALF, MASK = np.uint64(32), np.uint64(BITS)


def first_words(seeds: Sequence[int], count: int) -> Words:
    """The first words of ``np.random.PCG64(seed)`` of seeds up to :data:`LARGEST_SEED`, (seeds, count)."""
    high, low, above, below = _states(np.array(seeds, dtype=np.uint64))
    one = np.uint64(1)
    increment = above << one | below >> np.uint64(63), below << one | one
    state = _stepped(_sum(increment, (high, low)), increment)
    words = np.empty((len(seeds), count), dtype=np.uint64)
    for k in range(count):
        state = high, low = _stepped(state, increment)
        both, turn = high ^ low, high >> np.uint64(58)
        words[:, k] = both >> turn | both << (-turn & np.uint64(63))
    return words


def _hashed(constant: int, factor: int) -> Callable[[Any], Any]:
    """The hash of a SeedSequence, whose constant changes with every call."""

    def hashed(value: Any) -> Any:
        nonlocal constant
        value = value ^ np.uint32(constant)
        constant = constant * factor & BITS
        value = value * np.uint32(constant)
        return value ^ value >> np.uint32(16)

    return hashed


def _states(seeds: Words) -> list[Words]:
    """The four words of 64 bits with which SeedSequences seed a generator."""
    nothing = np.zeros(len(seeds), dtype=np.uint32)
    entropy = [(seeds & MASK).astype(np.uint32), (seeds >> HALF).astype(np.uint32), nothing, nothing]
    hashed = _hashed(FIRST_A, FACTOR_A)
    pool = [hashed(word) for word in entropy]
    for source, to in itertools.permutations(range(POOL), 2):
        mixed = MIX_LEFT * pool[to] - MIX_RIGHT * hashed(pool[source])
        pool[to] = mixed ^ mixed >> np.uint32(16)
    hashed = _hashed(FIRST_B, FACTOR_B)
    halves = [hashed(pool[k % POOL]).astype(np.uint64) for k in range(2 * POOL)]
    return [low | high << HALF for low, high in zip(halves[::2], halves[1::2], strict=True)]


def _sum(a: Wide, b: Wide) -> Wide:
    low = a[1] + b[1]
    return a[0] + b[0] + (low < b[1]), low


def _stepped(state: Wide, increment: Wide) -> Wide:
    """state * FACTOR + increment, in 128 bits."""
    high, low = state
    (a, b), (c, d) = (low >> HALF, low & MASK), (LOW >> HALF, LOW & MASK)
    middle = (b * d >> HALF) + (a * d & MASK) + (b * c & MASK)
    carried = a * c + (a * d >> HALF) + (b * c >> HALF) + (middle >> HALF)
    return _sum((carried + high * LOW + low * HIGH, low * LOW), increment)
