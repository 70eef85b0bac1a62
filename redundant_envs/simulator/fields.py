"""The fields of a scene's lanes, each declared by the module that gives it its meaning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from redundant_envs.simulator.dynamics import Dynamics
from redundant_envs.simulator.lane import PARAMETER, SCRATCH, STATE, Field


def motion_fields(dynamics: Dynamics) -> Iterator[Field]:
    """State, parameters and what every interval has."""
    arm = dynamics.arm
    units = ["m" if slides else "rad" for slides in arm.prismatic]
    for name, unit in zip(arm.coordinates, units, strict=True):
        yield Field(name, unit, "generalized coordinate", STATE)
    for name, unit in zip(arm.rates, units, strict=True):
        yield Field(name, f"{unit}/s", "generalized velocity", STATE)
    for name, state in dynamics.effect_states.items():
        yield Field(name, state.unit, "state of an effect", STATE)
    if dynamics.track_work:
        yield Field("work", "J", "work of motors and of forces without a potential", STATE, book=True)
    yield Field("h", "s", "length of the common step", PARAMETER)
    yield Field("interval", "s", "control interval", PARAMETER)
    for name in dynamics.parameters:
        yield Field(name, "SI", "parameter of the scene", PARAMETER)
    for name in dynamics.prepared:
        yield Field(name, "SI", "what follows from the parameters alone", PARAMETER)
    for k, name in enumerate(dynamics.commands):
        yield Field(name, "N" if arm.prismatic[k] else "N m", "commanded effort of a motor", SCRATCH)
    yield Field("error", "m", "estimated tip error of the interval so far", SCRATCH)
    yield Field("fault", "", "faults of the interval", SCRATCH)


def copies(fields: Iterable[Field], form: str, doc: str) -> Iterator[Field]:
    """Scratch fields that hold earlier values of others."""
    for f in fields:
        yield Field(form.format(f.name), f.unit, f"{f.name} {doc}", SCRATCH, book=f.book)
