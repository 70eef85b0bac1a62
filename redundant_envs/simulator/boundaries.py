"""Boundaries at which motions have events: stops of sliders, and positions at which force laws change."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stop:
    """A slider whose travel ends at stops: its joint, and the fields with its numbers."""

    joint: int
    name: str
    lower: str
    upper: str
    restitution: str


@dataclass(frozen=True)
class Switch:
    """A joint on which a force changes its law at two positions.

    Attributes
    ----------
    joint : int
    name : str
    side : the field with the law that holds: 1 above the upper position, -1 below the lower, 0 between
    lower, upper : the fields with these positions
    """

    joint: int
    name: str
    lower: str
    upper: str

    @property
    def side(self) -> str:
        return f"side_{self.name}"
