"""The curve that a target follows: an ellipse or a figure eight, turned and moved."""

from collections.abc import Callable, Sequence
from typing import Any

from redundant_envs.language.algebra import clamp, physics, where

TURN = 6.283185307179586
CURVE = ("phase", "spin", "along", "across", "eight", "tilt_s", "tilt_c", "centre_x", "centre_y")
"""Memory of a curve: the angle of the target on it [rad] and its rate [rad/s], half length and half width
[m], whether it is a figure eight, sine and cosine of its tilt, and its centre [m]."""
SHAPE = CURVE[2:]


@physics
def point_of(s, c, along, across, eight, tilt_s, tilt_c, centre_x, centre_y):
    """The point at an angle whose sine and cosine are given."""
    x, y = along * c, across * where(eight > 0.5, 2.0 * s * c, s)
    return centre_x + x * tilt_c - y * tilt_s, centre_y + x * tilt_s + y * tilt_c


def point_at(name: str, sine: str, cosine: str) -> Callable[..., Any]:
    """A function that gives ``<name>_x`` and ``<name>_y``, the point at an angle."""

    @physics(gives=(f"{name}_x", f"{name}_y"), takes=(sine, cosine, *SHAPE))
    def point(*values: Any) -> Any:
        return point_of(*values)

    return point


def sizes(draws: Sequence[str]) -> Callable[..., Any]:
    """A function of six draws: the tilt, half length and share of the half width, shape, rate and angle."""

    @physics(
        gives="tilt_a drawn_along slenderness eight spin phase",
        takes=(*draws, "reach", "smallest", "largest", "period"),
    )
    def sizes(tilt, length, width, shape, sense, start, reach, smallest, largest, period):
        return (
            TURN * tilt, reach * (smallest + length * (largest - smallest)), 0.4 + 0.6 * width,
            where(shape > 0.5, 1.0, 0.0), where(sense > 0.5, 1.0, -1.0) * TURN / period, TURN * start,
        )  # fmt: skip

    return sizes


@physics(gives="ramp phase_next")
def next_phase(phase, spin, steps, interval, wait, rise):
    """Share of the full pace in this step, and the angle after it."""
    ramp = clamp((steps * interval - wait) / rise, 0.0, 1.0)
    return ramp, phase + spin * interval * ramp


@physics(gives="slope_x slope_y")
def slope(phase_s, phase_c, along, across, eight, tilt_s, tilt_c, spin, ramp):
    """Velocity of the target, m/s."""
    dx = -along * phase_s
    dy = across * where(eight > 0.5, 2.0 * (phase_c * phase_c - phase_s * phase_s), phase_c)
    rate = spin * ramp
    return rate * (dx * tilt_c - dy * tilt_s), rate * (dx * tilt_s + dy * tilt_c)
