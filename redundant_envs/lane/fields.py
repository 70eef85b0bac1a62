"""The fields of a scene's lanes, each declared by the module that gives it its meaning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from redundant_envs.algebra import gives_of
from redundant_envs.effects.attached import identifier
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.memory import ENGINE, PARAMETER, SCRATCH, STATE, Field


def motion_fields(dynamics: Dynamics) -> Iterator[Field]:
    """State, parameters and what every interval has."""
    arm, of_arm = dynamics.arm, f"the arm {dynamics.arm.kind}"
    owned = {name: of_arm for f in arm.prepared for name in gives_of(f)} | dict.fromkeys(
        dynamics.carried, of_arm
    )
    owned |= {dynamics.field_of(name): of_arm for name in arm.parameter_values()}
    for effect in dynamics.scene.effects:
        for name in (*effect.parameters(), *effect.states(arm)):
            owned[identifier(f"{effect.key}.{name}")] = f"the effect {type(effect).__name__}"
    units = ["m" if slides else "rad" for slides in arm.prismatic]
    for name, unit in zip(arm.coordinates, units, strict=True):
        yield Field(name, unit, "generalized coordinate", STATE, owner=of_arm)
    for name, unit in zip(arm.rates, units, strict=True):
        yield Field(name, f"{unit}/s", "generalized velocity", STATE, owner=of_arm)
    for name, state in dynamics.effect_states.items():
        yield Field(name, state.unit, f"state {state.name}", STATE, owner=owned[name])
    if dynamics.track_work:
        yield Field("work", "J", "work of motors and of forces without a potential", STATE, book=True)
    yield Field("h", "s", "length of the common step", PARAMETER)
    yield Field("interval", "s", "control interval", PARAMETER)
    for name in dynamics.parameters:
        yield Field(name, "SI", "parameter of the scene", PARAMETER, owner=owned.get(name, ENGINE))
    for name in dynamics.prepared:
        doc = "what follows from the parameters alone"
        yield Field(name, "SI", doc, PARAMETER, owner=owned.get(name, ENGINE))
    for k, name in enumerate(dynamics.commands):
        yield Field(name, "N" if arm.prismatic[k] else "N m", "commanded effort of a motor", SCRATCH)
    yield Field("error", "m", "estimated tip error of the interval so far", SCRATCH)
    yield Field("fault", "", "faults of the interval", SCRATCH)


def copies(fields: Iterable[Field], form: str, doc: str) -> Iterator[Field]:
    """Scratch fields that hold earlier values of others."""
    for f in fields:
        yield Field(form.format(f.name), f.unit, f"{f.name} {doc}", SCRATCH, book=f.book)
