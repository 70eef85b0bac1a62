"""Ranges of numbers that every episode draws anew: their distributions, and plain data for them."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from redundant_envs.language.algebra import cases, clamp, exp, log, numbered, physics, sqrt, where
from redundant_envs.robots.parameters import numbers, strengths
from redundant_envs.support.values import check_keys, shown

MAX_CHOICES = 64
"""Values of a choice: each is a number in the memory of every environment, and a comparison at a reset."""
SMALLEST_SHARE = 1e-6
"""Least probability of the part of a normal distribution that is drawn: less means a mistaken mean or end."""
MIDDLE = 0.381966
"""The draw at which a number inside a range is tried: no simple fraction, so that a number that has to be
whole is found to be none."""

# Clamped, because a rounding must not pass the ends, which are what was checked.


@physics
def uniform(draw: Any, low: Any, high: Any) -> Any:
    return clamp(low + draw * (high - low), low, high)


@physics
def log_uniform(draw: Any, low: Any, high: Any, log_low: Any, log_ratio: Any) -> Any:
    """The logarithm is uniform."""
    return clamp(exp(log_low + draw * log_ratio), low, high)


@physics
def normal(
    draw: Any, low: Any, high: Any, mean: Any, deviation: Any, below: Any, above: Any, between: Any
) -> Any:
    """A normal distribution without its parts below and above the ends, whose probabilities are given."""
    lower = below + draw * between
    upper = above + (1.0 - draw) * between
    return clamp(mean + deviation * normal_quantile(lower, upper), low, high)


@physics
def normal_quantile(lower: Any, upper: Any) -> Any:
    """Number of standard deviations from the mean with these probabilities below and above it.

    By rational functions with a relative error of at most 1.2e-9 (P. J. Acklam, 2003): draws have 32 bits,
    which tell less. Both probabilities are given so that each tail has all digits.
    """
    q = 0.5 * (lower - upper)
    r = q * q
    above = -39.69683028665376 * r + 220.9460984245205
    above = ((above * r - 275.9285104469687) * r + 138.3577518672690) * r - 30.66479806614716
    below = -54.47609879822406 * r + 161.5858368580409
    below = ((below * r - 155.6989798598866) * r + 66.80131188771972) * r - 13.28068155288572
    middle = q * (above * r + 2.506628277459239) / (below * r + 1.0)
    tail = where(lower < upper, lower, upper)
    outer = _outer_quantile(tail)
    return where(tail < 0.02425, where(lower < upper, -outer, outer), middle)


@physics
def _outer_quantile(tail: Any) -> Any:
    """The same in a tail, as a positive number."""
    t = sqrt(-2.0 * log(tail))
    above = (-0.007784894002430293 * t - 0.3223964580411365) * t - 2.400758277161838
    above = ((above * t - 2.549732539343734) * t + 4.374664141464968) * t + 2.938163982698783
    below = (0.007784695709041462 * t + 0.3224671290700398) * t + 2.445134137142996
    return -above / ((below * t + 3.754408661907416) * t + 1.0)


def choice_of(count: int) -> Callable[..., Any]:
    """The draw of one of some values, all with the same probability."""

    @physics(takes=("draw", *numbered("value{}", count)))
    def choice(draw: Any, *values: Any) -> Any:
        chosen = [(draw * float(count) < k + 1.0, value) for k, value in enumerate(values[:-1])]
        return cases(*chosen, default=values[-1])

    return choice


@dataclass(frozen=True)
class Uniform:
    """Every number between two ends is equally probable."""

    low: float
    high: float

    kind: ClassVar[str] = "uniform"
    formula = staticmethod(uniform)
    """The number, from a uniform draw and :meth:`numbers`, in their order."""

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest number that is drawn."""
        return self.low, self.high

    @property
    def inside(self) -> tuple[float, ...]:
        """Other numbers that must be valid as the ends must."""
        return (float(self.formula(MIDDLE, *self.numbers().values())),)

    def numbers(self) -> dict[str, float]:
        """What the formula takes beside the draw."""
        return {"low": self.low, "high": self.high}

    def plain(self) -> dict[str, Any]:
        """Plain data that :func:`distribution` takes."""
        return {self.kind: list(self.ends)}


class LogUniform(Uniform):
    """Every factor is equally probable: the logarithm is uniform."""

    kind = "log_uniform"
    formula = staticmethod(log_uniform)

    def numbers(self) -> dict[str, float]:
        of_logarithm = {"log_low": math.log(self.low), "log_ratio": math.log(self.high / self.low)}
        return {**super().numbers(), **of_logarithm}


@dataclass(frozen=True)
class Normal(Uniform):
    """A normal distribution without what lies outside two ends."""

    mean: float
    deviation: float

    kind = "normal"
    formula = staticmethod(normal)

    def shares(self) -> tuple[float, float, float]:
        """Probabilities that a number without ends lies below them, above them, and between."""
        low, high = ((end - self.mean) / (self.deviation * math.sqrt(2.0)) for end in self.ends)
        below, above = 0.5 * math.erfc(-low), 0.5 * math.erfc(high)
        if low > 0.0:  # each difference of numbers that are small where the other ones are nearly 1
            return below, above, 0.5 * math.erfc(low) - above
        return below, above, 0.5 * math.erfc(-high) - below

    def numbers(self) -> dict[str, float]:
        shares = dict(zip(("below", "above", "between"), self.shares(), strict=True))
        return {**super().numbers(), "mean": self.mean, "deviation": self.deviation, **shares}

    def plain(self) -> dict[str, Any]:
        return {self.kind: [self.mean, self.deviation], "within": list(self.ends)}


@dataclass(frozen=True)
class Choice:
    """Every one of some values is equally probable."""

    values: tuple[float, ...]

    kind: ClassVar[str] = "choice"

    @property
    def ends(self) -> tuple[float, float]:
        return min(self.values), max(self.values)

    @property
    def inside(self) -> tuple[float, ...]:
        return self.values

    @property
    def formula(self) -> Callable[..., Any]:
        return choice_of(len(self.values))

    def numbers(self) -> dict[str, float]:
        return dict(zip(numbered("value{}", len(self.values)), self.values, strict=True))

    def plain(self) -> dict[str, Any]:
        return {self.kind: list(self.values)}


Distribution = Uniform | Choice
KINDS = ("uniform", "log_uniform", "normal", "choice")
EXAMPLE = "give one, such as {'uniform': [0, 2]}, or a factor, {'scale': {'log_uniform': [0.8, 1.25]}}"


def distribution(where: str, data: Any) -> Distribution:
    """A distribution from plain data, which ``where`` names in messages."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{where} is {shown(data)}; {EXAMPLE}")
    check_keys(where, data, [*KINDS, "within"])
    kinds = [kind for kind in KINDS if kind in data]
    if len(kinds) != 1:
        raise ValueError(f"{where} has {' and '.join(kinds) or 'none'}; give one of {', '.join(KINDS)}")
    kind = kinds[0]
    field = f"{where}.{kind}"
    if kind == "choice":
        return Choice(_choices(field, data[kind]))
    if kind != "normal":
        low, high = _ends(field, data[kind])
        if kind == "uniform":
            return Uniform(low, high)
        if low <= 0.0:
            raise ValueError(f"{field} begins at {low}; both ends must be positive, as logarithms need")
        return LogUniform(low, high)
    mean, deviation = _two(field, data[kind])
    if deviation <= 0.0:
        raise ValueError(f"{field} has the standard deviation {deviation}; it must be positive")
    if "within" not in data:
        raise ValueError(f"{where} has a normal without ends; give 'within': [low, high]")
    low, high = _ends(f"{where}.within", data["within"])
    normal = Normal(low, high, mean, deviation)
    if (share := normal.shares()[-1]) < SMALLEST_SHARE:
        what = f"{where}.within is {low} to {high}, with {share:.1g} of the draws"
        raise ValueError(f"{what} of the normal; give ends with at least {SMALLEST_SHARE:g}")
    return normal


def _two(field: str, data: Any) -> tuple[float, float]:
    pair: Any = strengths(field, numbers(field, data, 2))
    return pair


def _ends(field: str, data: Any) -> tuple[float, float]:
    low, high = _two(field, data)
    if low >= high:
        raise ValueError(f"{field} is {low} to {high}; give a smaller and a larger number")
    return low, high


def _choices(field: str, data: Any) -> tuple[float, ...]:
    values: Any = strengths(field, numbers(field, data))
    if not 1 <= len(values) <= MAX_CHOICES:
        raise ValueError(f"{field} has {len(values)} values; give 1 to {MAX_CHOICES}")
    if twice := [v for v in values if values.count(v) > 1]:
        raise ValueError(f"{field} has {twice[0]} more than once; name each once")
    return tuple(values)


@dataclass(frozen=True)
class Range:
    """A number of a scene or of a task, by its name, and how it is drawn."""

    name: str
    distribution: Distribution
    scale: bool = False  # whether a factor of the scene's number is drawn
    shared: bool = False  # whether one draw serves all entries of the name

    def plain(self) -> dict[str, Any]:
        """Plain data that :func:`ranges` takes under the name."""
        data = {"scale": self.distribution.plain()} if self.scale else self.distribution.plain()
        return {**data, "shared": True} if self.shared else data

    def drawn(self, value: Any, nominal: float) -> Any:
        """The number, from a value of the distribution and the number of the scene."""
        return nominal * value if self.scale else value


def ranges(data: Any) -> tuple[Range, ...]:
    """Ranges from plain data, a mapping of names; ValueError says what is wrong with it."""
    if isinstance(data, tuple) and all(isinstance(one, Range) for one in data):
        return data
    if not isinstance(data, Mapping):
        raise ValueError(f"randomize is {shown(data)}; give a mapping of names to ranges: {EXAMPLE}")
    unsorted = [_range(name, value) for name, value in data.items()]
    return tuple(sorted(unsorted, key=lambda one: one.name))  # a mapping has no order


def _range(name: Any, data: Any) -> Range:
    if not isinstance(name, str):
        raise ValueError(f"randomize has the key {shown(name)}; give names of numbers, such as 'gravity.g'")
    where = f"randomize[{name!r}]"
    if not isinstance(data, Mapping):
        raise ValueError(f"{where} is {shown(data)}; {EXAMPLE}")
    check_keys(where, data, [*KINDS, "within", "scale", "shared"])
    shared = data.get("shared", False)
    if not isinstance(shared, bool):
        raise ValueError(f"{where}.shared is {shown(shared)}; give True, or leave it out")
    rest = {key: value for key, value in data.items() if key != "shared"}
    if "scale" not in rest:
        return Range(name, distribution(where, rest), shared=shared)
    if len(rest) > 1:
        raise ValueError(f"{where} has {' and '.join(rest)}; put the others into scale, or leave it out")
    return Range(name, distribution(f"{where}.scale", rest["scale"]), scale=True, shared=shared)


def plain_ranges(drawn: Iterable[Range]) -> dict[str, Any]:
    """Plain data of ranges, by their names."""
    return {one.name: one.plain() for one in drawn}
