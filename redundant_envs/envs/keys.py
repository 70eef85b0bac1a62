"""Keys of episodes: each is the next 128 bits of the generator of a lane."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from redundant_envs.language.draws import KEY_WORDS

MANY = 40  # lanes whose first keys are drawn together in less time than their generators are made
AHEAD = 8  # keys that one call draws for each lane if there are several: 16 words take hardly longer than 2
LARGEST_SEED = 2**64 - 1  # that :func:`first_keys` takes
Wide = tuple[Any, Any]  # the upper and the lower words of numbers of 128 bits


class EpisodeKeys:
    """The generators of lanes. Keys are drawn ahead; where many lanes are seeded at once, a generator is made
    when it is asked for, or when its first keys are used up."""

    def __init__(self, count: int) -> None:
        self._generators: list[np.random.Generator | None] = [None] * count
        self.seeds = [-1] * count
        """The seeds of these; -1 if one is unknown. One that is not made has given its first keys."""
        self._drawn = np.zeros((count, AHEAD if count > 1 else 1, KEY_WORDS), dtype="<u4")
        self._left = np.zeros(count, dtype=np.int64)

    def seed(self, lanes: NDArray[np.int64], seeds: list[int]) -> None:
        if len(lanes) >= MANY and max(seeds) <= LARGEST_SEED:
            self._drawn[lanes], self._left[lanes] = first_keys(seeds), AHEAD
            for lane, seed in zip(lanes.tolist(), seeds, strict=True):
                self._generators[lane], self.seeds[lane] = None, seed
        else:
            self._left[lanes] = 0
            for lane, seed in zip(lanes.tolist(), seeds, strict=True):
                self._generators[lane], self.seeds[lane] = seeding.np_random(seed)

    def seed_new(self, lanes: Iterable[int]) -> None:
        """Give generators of their own to those of some lanes that have none."""
        if new := [lane for lane in lanes if self._generators[lane] is None and self.seeds[lane] < 0]:
            self.seed(np.array(new), np.random.SeedSequence().generate_state(len(new), np.uint64).tolist())

    def _made(self, lane: int) -> Any:
        """The generator of a lane, behind all keys that it has given."""
        if self._generators[lane] is None:
            generator: Any = seeding.np_random(self.seeds[lane])[0]
            generator.bit_generator.advance(2 * AHEAD)
            self._generators[lane] = generator
        return self._generators[lane]

    @property
    def generators(self) -> list[np.random.Generator | None]:
        """The generators, behind the keys that were taken; an entry of the list may be replaced."""
        for lane, left in enumerate(self._left.tolist()):
            if left or (self._generators[lane] is None and self.seeds[lane] >= 0):
                self._made(lane).bit_generator.advance(-2 * left)
        self._left[:] = 0
        return self._generators

    def take(self, lanes: NDArray[np.int64]) -> NDArray[np.uint32]:
        """The next keys of some lanes, (n, 4)."""
        out = lanes[self._left[lanes] == 0].tolist()
        self.seed_new(out)
        for lane in out:
            if self._left[lane]:
                continue  # it is new, with its first keys
            generator, drawn = self._made(lane), self._drawn[lane]
            if type(generator.bit_generator) is np.random.PCG64:
                words = generator.bit_generator.random_raw(2 * len(drawn))
                drawn[:] = words.astype("<u8").view("<u4").reshape(drawn.shape)
                self._left[lane] = len(drawn)
            else:  # of others the words are not the same, and they do not go back
                drawn[-1] = generator.integers(0, 2**32, size=KEY_WORDS, dtype=np.uint32)
                self._left[lane] = 1
        self._left[lanes] -= 1
        return self._drawn[lanes, -1 - self._left[lanes]]


# To make a generator takes 10 us. The algorithms of SeedSequence and PCG64 stay as they are (NumPy's NEP 19).
def generator_states(seeds: Sequence[int]) -> tuple[Wide, Wide]:
    """State and increment of ``np.random.PCG64(seed)`` of seeds up to :data:`LARGEST_SEED`."""
    pool = np.zeros((4, len(seeds)), np.uint32)
    pool[:2] = np.array(seeds, dtype="<u8").view("<u4").reshape(-1, 2).T
    pool = _hashed(pool, IN[:5])
    for k in range(4):
        others = [n for n in range(4) if n != k]
        mixed = MIX * pool[others] - MIX_HASHED * _hashed(pool[k], IN[4 + 3 * k :][:4])
        pool[others] = mixed ^ mixed >> 16
    halves = _hashed(np.concatenate([pool, pool]), OUT).astype(np.uint64)
    high, low, above, below = halves[::2] | halves[1::2] << HALF
    increment = above << ONE | below >> np.uint64(63), below << ONE | ONE
    return _sum(_product(_sum((high, low), increment), FACTOR), increment), increment


def first_keys(seeds: Sequence[int]) -> NDArray[np.uint32]:
    """The first keys of generators of seeds, (seeds, AHEAD, 4)."""
    state, increment = generator_states(seeds)
    change = _sum(_product(state, FACTOR_LESS_1), increment)  # to the next state; times SUMS to others
    words = np.empty((len(seeds), 2 * AHEAD), dtype="<u8")
    for k, sums in SUMS.items():
        high, low = _sum(_product(change, sums), state)
        both, turn = high ^ low, high >> np.uint64(58)
        words[:, k : k + TOGETHER] = (both >> turn | both << (-turn & np.uint64(63))).T
    return words.view("<u4").reshape(len(seeds), AHEAD, KEY_WORDS)


def _hashed(values: Any, constants: Any) -> Any:
    """The hash of a SeedSequence, of values along the first axis, each with its own constants."""
    values = (values ^ constants[:-1]) * constants[1:]
    return values ^ values >> 16


def _sum(a: Wide, b: Wide) -> Wide:
    low = a[1] + b[1]
    return a[0] + b[0] + (low < b[1]), low


def _product(a: Wide, b: Wide) -> Wide:
    """a * b, in 128 bits."""
    (high, low), (other_high, other_low) = a, b
    (w, x), (y, z) = (low >> HALF, low & MASK), (other_low >> HALF, other_low & MASK)
    middle = (x * z >> HALF) + (w * z & MASK) + (x * y & MASK)
    carried = w * y + (w * z >> HALF) + (x * y >> HALF) + (middle >> HALF)
    return carried + high * other_low + low * other_high, low * other_low


def _constants(first: int, factor: int, count: int) -> Any:
    return np.array([first * factor**k % 2**32 for k in range(count)], np.uint32)[:, None]


def _wide(*numbers: int) -> Wide:
    high, low = (np.array([n >> shift & LARGEST_SEED for n in numbers], np.uint64) for shift in (64, 0))
    return high[:, None], low[:, None]


ONE, HALF, MASK = np.uint64(1), np.uint64(32), np.uint64(2**32 - 1)
IN, OUT = _constants(0x43B0D7E5, 0x931E8875, 17), _constants(0x8B51F9DD, 0x58F38DED, 9)
MIX, MIX_HASHED = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
PCG = 0x2360ED051FC65DA44385DF649FCCF645  # the next state is this one times PCG, and an increment
FACTOR, FACTOR_LESS_1 = _wide(PCG), _wide(PCG - 1)
TOGETHER = 2  # words of all lanes that are computed at a time: more do not fit into the cache of a core
SUMS = {
    first: _wide(*(sum(PCG**n for n in range(k + 1)) for k in range(first, first + TOGETHER)))
    for first in range(0, 2 * AHEAD, TOGETHER)
}
