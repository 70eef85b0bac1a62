"""The first words of NumPy's generators of many seeds at a time: to make the generators takes 10 us each.

The algorithms are those of ``numpy.random.SeedSequence`` and ``PCG64``, whose streams NumPy keeps (NEP 19).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]
BITS = 2**32 - 1
POOL = 4
"""Words of a SeedSequence."""
FIRST_A, FACTOR_A, FIRST_B, FACTOR_B = 0x43B0D7E5, 0x931E8875, 0x8B51F9DD, 0x58F38DED
MIX_LEFT, MIX_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
FACTOR = 0x2360ED051FC65DA44385DF649FCCF645
"""Of PCG's 128-bit congruential generator."""
HIGH, LOW = np.uint64(FACTOR >> 64), np.uint64(FACTOR & (2**64 - 1))
LOW_HIGH, LOW_LOW = np.uint64((FACTOR >> 32) & BITS), np.uint64(FACTOR & BITS)
HALF, MASK = np.uint64(32), np.uint64(BITS)
LARGEST_SEED = 2**64 - 1


def first_words(seeds: Sequence[int], count: int) -> Words:
    """The first ``count`` words of ``np.random.PCG64(seed)`` of each seed up to :data:`LARGEST_SEED`,
    (seeds, count)."""
    state, increment = _seeded(*_states(np.array(seeds, dtype=np.uint64)))
    words = np.empty((len(seeds), count), dtype=np.uint64)
    for k in range(count):
        state = _stepped(state, increment)
        high, low = state
        both, turn = high ^ low, high >> np.uint64(58)
        words[:, k] = both >> turn | both << (-turn & np.uint64(63))
    return words


def _hashed(first: int, factor: int) -> Callable[[Any], Any]:
    """The hash of a SeedSequence, whose constant changes with every call."""
    constant = first

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
    for source in range(POOL):
        for to in range(POOL):
            if to != source:
                mixed = MIX_LEFT * pool[to] - MIX_RIGHT * hashed(pool[source])
                pool[to] = mixed ^ mixed >> np.uint32(16)
    hashed = _hashed(FIRST_B, FACTOR_B)
    halves = [hashed(pool[k % POOL]).astype(np.uint64) for k in range(2 * POOL)]
    return [low | high << HALF for low, high in zip(halves[::2], halves[1::2], strict=True)]


def _seeded(*words: Words) -> tuple[tuple[Words, Words], tuple[Words, Words]]:
    """The state of PCG64, its upper and lower word, and its increment."""
    high, low, increment_high, increment_low = words
    one = np.uint64(1)
    increment = increment_high << one | increment_low >> np.uint64(63), increment_low << one | one
    return _stepped(_sum(increment, (high, low)), increment), increment


def _sum(a: tuple[Words, Words], b: tuple[Words, Words]) -> tuple[Words, Words]:
    low = a[1] + b[1]
    return a[0] + b[0] + (low < b[1]), low


def _stepped(state: tuple[Words, Words], increment: tuple[Words, Words]) -> tuple[Words, Words]:
    """state * FACTOR + increment, in 128 bits."""
    high, low = state
    a, b = low >> HALF, low & MASK
    cross, other = a * LOW_LOW, b * LOW_HIGH
    middle = (b * LOW_LOW >> HALF) + (cross & MASK) + (other & MASK)
    carried = a * LOW_HIGH + (cross >> HALF) + (other >> HALF) + (middle >> HALF)
    return _sum((carried + high * LOW + low * HIGH, low * LOW), increment)
