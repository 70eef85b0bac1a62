"""Kinks of a right-hand side that are looked for and not located: what changes its sign there."""

from __future__ import annotations

from typing import Any

from redundant_envs.effects.hooks import Actuation, Effect, Force
from redundant_envs.quantities import Quantities
from redundant_envs.simulator.dynamics import Dynamics


def kinks_of(dynamics: Dynamics) -> list[tuple[Effect, Force | Actuation]]:
    """Forces that tell of kinks, and links of motors that do behind states that change within an interval."""
    if dynamics.scene.tolerance is None or not dynamics.located:
        return []
    found: list[tuple[Effect, Force | Actuation]] = [
        (e, h) for e, h in dynamics.hooks if isinstance(h, Force) and h.kink is not None
    ]
    for chain in dynamics.chains:
        moves = False
        for effect, link in chain:
            moves = moves or any(s.derivative is not None for s in link.states)
            if moves and link.kink is not None:
                found.append((effect, link))
    return found


def kink_value(dynamics: Dynamics, effect: Effect, hook: Force | Actuation, x: Quantities) -> Any:
    """What changes its sign at a kink, from quantities."""
    assert hook.kink is not None
    if isinstance(hook, Force):
        return dynamics.apply(effect, hook, hook.kink, x)
    name = dynamics.commands[hook.joint]
    command = x[name]
    for other, link in dynamics.chains[hook.joint]:
        if link is hook:
            break
        x[name] = dynamics.apply(other, link, link.function, x)
    value = dynamics.apply(effect, hook, hook.kink, x)
    x[name] = command
    return value
