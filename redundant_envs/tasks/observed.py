"""Observed quantities that serve any task and arm, bounded by construction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from redundant_envs.algebra import numbered, physics, squash
from redundant_envs.robots.arm import Arm


def observed_rates(arm: Arm) -> Callable[..., Any]:
    n = len(arm.joints)

    @physics(
        gives=" ".join(numbered("rate{}_obs", n)), takes=" ".join((*numbered("phid{}", n), "rate_scale"))
    )
    def observed_rates(*values):
        *rates, rate_scale = values
        return tuple(squash(rate, rate_scale) for rate in rates)

    return observed_rates


def observed_travel(arm: Arm) -> list[Callable[..., Any]]:
    """How far each slider is from the middle of its travel."""

    def of_slider(joint: int) -> Callable[..., Any]:
        @physics(gives=f"travel{joint}_obs", takes=f"phi{joint} low{joint} high{joint}")
        def observed_travel(position, low, high):
            return squash(2.0 * position - low - high, high - low)

        return observed_travel

    return [of_slider(k + 1) for k in arm.sliders()]


@physics(gives="tip_x_obs tip_y_obs tip_vx_obs tip_vy_obs")
def observed_tip(tip_x, tip_y, tip_vx, tip_vy, reach):
    return (
        squash(tip_x, reach),
        squash(tip_y, reach),
        squash(tip_vx, 0.5 * reach),
        squash(tip_vy, 0.5 * reach),
    )


def posture_and_tip(arm: Arm) -> dict[str, str]:
    """Names of these quantities and their meaning: positions and velocities of the joints and the tip."""
    rates = {f"rate{k + 1}_obs": f"squash(joint rate {k + 1} / rate_scale)" for k in range(len(arm.joints))}
    travel = {
        f"travel{k + 1}_obs": f"squash({arm.joints[k]} from mid-travel / half travel)" for k in arm.sliders()
    }
    return {
        **arm.posture, **travel, **rates,
        "tip_x_obs": "squash(tip x / reach)",
        "tip_y_obs": "squash(tip y / reach)",
        "tip_vx_obs": "squash(tip velocity x / (0.5 reach per s))",
        "tip_vy_obs": "squash(tip velocity y / (0.5 reach per s))",
    }  # fmt: skip
