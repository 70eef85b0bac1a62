"""Random numbers of effects: which words of a counter-based generator each of them is made of.

A draw follows from the key of its lane, the number of the control interval, the effect and the state that
takes it, and its own number; from nothing else. So no draw depends on what else a scene has, on the number of
lanes, on threads, or on which draws were made before.
"""

import functools
import hashlib
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from redundant_envs.language import algebra
from redundant_envs.language.algebra import log, physics, sincos, sqrt

KEY_WORDS = 4
WORDS = 4
"""Words of a group: of one key and one counter."""
GROUPS = 256
"""Groups of a stream, every other one of uniform and of normal numbers."""
STREAM_BYTES = 3
"""Bytes of the number of a stream: with its group it is a word of the counter."""
MAX_DRAWS = GROUPS // 2 * WORDS
"""Uniform draws of a stream; and as many normal ones."""
DRAW = re.compile(r"(uniform|normal)([1-9]\d*)")
"""Arguments of functions that are draws."""
START_OF_EPISODES = 0
"""The stream of the start and the task of an episode."""


class Draw(NamedTuple):
    """A random number of a lane in an interval."""

    stream: int
    normal: bool  # whether it is standard normal, or uniform in (0, 1)
    place: int  # among those of its stream and kind, from 0

    @property
    def counter(self) -> float:
        """The word of the counter for its stream and group."""
        return float(self.stream * GROUPS + 2 * (self.place // WORDS) + self.normal)


def stream_of(effect: str, state: str) -> int:
    """The stream of the states of a name of an effect, both without an index: a hash, the same for ever."""
    return int.from_bytes(hashlib.sha256(f"{effect}.{state}".encode()).digest()[:STREAM_BYTES], "big")


@physics
def uniform(word: Any) -> Any:
    """A 32-bit word as a number in (0, 1)."""
    return (word + 0.5) * 2.3283064365386963e-10


@physics
def normals(first: Any, second: Any) -> Any:
    """Two independent standard normal numbers from two uniform ones (Box and Muller 1958).

    It needs no approximation beyond those of the primitives and takes as many words in every lane, as
    rejection would not; the largest radius, sqrt(66 ln 2), is 6.8. An inverse of the distribution function
    would take other polynomials in its tails, and a choice between them.
    """
    radius = sqrt(-2.0 * log(first))
    sine, cosine = sincos(6.283185307179586 * second)
    return radius * cosine, radius * sine


def drawn(draws: Iterable[Draw], interval: Any, key: list[Any]) -> dict[Draw, Any]:
    """Draws of a lane for the control interval of a number, from 0, and the key of the lane."""

    @functools.cache
    def words(counter: float) -> tuple[Any, ...]:
        return algebra.philox(counter, interval, *key)

    @functools.cache
    def pair(counter: float, k: int) -> Any:
        return normals(*map(uniform, words(counter)[2 * k : 2 * k + 2]))

    values: dict[Draw, Any] = {}
    for draw in draws:
        word = draw.place % WORDS
        value = pair(draw.counter, word // 2)[word % 2] if draw.normal else uniform(words(draw.counter)[word])
        values[draw] = value
    return values
