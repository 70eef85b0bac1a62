"""Numbers of hooks that must fit each other, in a scene and in each lane."""

from __future__ import annotations

from collections.abc import Iterable

from redundant_envs.effects.hooks import Effect, Force, Hook, Impact
from redundant_envs.robots.arm import Arm


def check_numbers(where: str, effect: Effect, arm: Arm, hooks: Iterable[Hook]) -> None:
    """ValueError if ends of a travel, or positions at which a force changes its law, are in the wrong order,
    or if an impact would create energy."""
    numbers = effect.parameters()
    for hook in hooks:
        if isinstance(hook, Force) and hook.switch is not None:
            _check_order(f"{where}: switch", *hook.switch, numbers)
        elif isinstance(hook, Impact):
            _check_order(f"{where}: an impact's travel", hook.lower, hook.upper, numbers)
            restitution = numbers[hook.restitution[1:]]
            if not 0.0 <= restitution <= 1.0:
                raise ValueError(f"{where}{hook.restitution} is {restitution}; it must lie in 0 to 1")
    for joint, ends in effect.travel(arm).items():
        for end in ends:
            if end not in numbers:
                raise ValueError(
                    f"{where}.travel gives {end!r}, which is not a number of this effect; it has "
                    f"{', '.join(numbers) or 'none'}"
                )
        lower, upper = ends
        _check_order(f"{where}: the travel of {arm.joints[int(joint)]!r}", f".{lower}", f".{upper}", numbers)


def _check_order(what: str, lower: str, upper: str, numbers: dict[str, float]) -> None:
    low, high = numbers[lower[1:]], numbers[upper[1:]]
    if not low < high:
        raise ValueError(
            f"{what} is {lower} to {upper}, which are {low} and {high}; the first must be below the second"
        )
