"""Times of things that take turns: processor time, which other programs on the machine change little."""

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
K = TypeVar("K")


class Times(NamedTuple):
    """Samples of a thing."""

    samples: Array  # (turns, ...) s; of a thing in several parts, those of each part

    @property
    def best(self) -> Array:
        """Shortest time of each part, s."""
        return np.asarray(self.samples.min(axis=0))

    @property
    def median(self) -> Array:
        """Of each part, s."""
        return np.asarray(np.median(self.samples, axis=0))

    @property
    def spread(self) -> float:
        """Distance of the quartiles of the whole, relative to its median."""
        whole = self.samples.reshape(len(self.samples), -1).sum(axis=1)
        low, middle, high = np.quantile(whole, (0.25, 0.5, 0.75))
        return float((high - low) / middle)


def timed(run: Callable[..., Any], *args: Any) -> tuple[float, Any]:
    """Processor time of a call, s, and what it returns."""
    start = time.process_time()
    result = run(*args)
    return time.process_time() - start, result


def seconds(run: Callable[..., Any], *args: Any) -> float:
    """Processor time of a call, s."""
    return timed(run, *args)[0]


def by_turns(
    samplers: Mapping[K, Callable[[], Any]], turns: int, fewer: Mapping[K, int] | None = None,
    most: float = np.inf, done: Callable[[int], None] = lambda turn: None,
) -> dict[K, Times]:  # fmt: skip
    """Time things in turn, again and again, so that slow phases of a machine affect all alike.

    Each of the ``samplers`` prepares a thing and returns its time, s, or those of its parts; some have
    ``fewer`` turns, at equal distances, and none is left once samples took ``most`` seconds in all. ``done``
    receives the number of turns that are over.
    """
    samples: dict[K, list[Any]] = {name: [] for name in samplers}
    counts = dict.fromkeys(samplers, turns) | dict(fewer or {})
    for turn in range(turns):
        for name, sample in samplers.items():
            due = len(samples[name]) * turns <= turn * counts[name]
            if due and (not samples[name] or np.sum(samples[name]) < most):
                samples[name].append(sample())
        done(turn + 1)
    return {name: Times(np.array(times)) for name, times in samples.items()}
