"""Keys of episodes: 128 random bits each, from the generator of the lane."""

from __future__ import annotations

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from redundant_envs.batch.environment import KEY_WORDS

AHEAD = 8  # keys that one call draws for each lane if there are several: 16 words take hardly longer than 2


class EpisodeKeys:
    """The generators of lanes, and keys from them.

    A lane's keys are the successive words of its generator, whether they were drawn ahead or not.
    """

    def __init__(self, count: int) -> None:
        self._generators: list[np.random.Generator | None] = [None] * count
        self._drawn = np.zeros((count, AHEAD if count > 1 else 1, KEY_WORDS), dtype="<u4")
        self._left = np.zeros(count, dtype=np.int64)

    @property
    def generators(self) -> list[np.random.Generator | None]:
        """The generators, advanced by the keys taken so far; an entry of the list may be replaced."""
        for lane in np.flatnonzero(self._left).tolist():
            generator = self._generators[lane]
            assert generator is not None
            generator.bit_generator.advance(-2 * int(self._left[lane]))  # type: ignore[attr-defined]
        self._left[:] = 0
        return self._generators

    @generators.setter
    def generators(self, generators: list[np.random.Generator | None]) -> None:
        self._generators = generators
        self._left[:] = 0

    def seed(self, lane: int, seed: int | None) -> int:
        """Give a lane a new generator; returns the seed used."""
        self._generators[lane], used = seeding.np_random(seed)
        self._left[lane] = 0
        return used

    def take(self, lanes: NDArray[np.int64]) -> NDArray[np.uint32]:
        """The next keys of some lanes, (n, 4); a lane without a generator is given one."""
        for lane in lanes[self._left[lanes] == 0].tolist():
            self._draw(lane)
        keys = self._drawn[lanes, -self._left[lanes]]
        self._left[lanes] -= 1
        return keys

    def _draw(self, lane: int) -> None:
        if self._generators[lane] is None:
            self.seed(lane, None)
        generator, drawn = self._generators[lane], self._drawn[lane]
        assert generator is not None
        bits = generator.bit_generator
        if type(bits) is np.random.PCG64:
            drawn[:] = bits.random_raw(2 * len(drawn)).astype("<u8").view("<u4").reshape(drawn.shape)
            self._left[lane] = len(drawn)
        else:
            drawn[-1] = generator.integers(0, 2**32, size=KEY_WORDS, dtype=np.uint32)
            self._left[lane] = 1
