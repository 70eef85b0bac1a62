"""Guards of a lane: which laws of effects hold, and which joints stick."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from redundant_envs.language.algebra import where
from redundant_envs.simulator.lane.engine_fields import engine
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import Variable
from redundant_envs.simulator.lane.memory import Lane


class Guards:
    """Procedures of lanes whose laws change where guards change their signs."""

    def __init__(self, features: Features) -> None:
        self.features, self.dynamics = features, features.dynamics

    def fields(self) -> Iterator[Variable]:
        """Fields about all guards."""
        return iter(())

    def begin_resolving(self, lane: Lane) -> None:
        """Where contacts begin to be resolved."""

    def resolve(self, lane: Lane) -> None:
        """Where contacts are resolved once more, perhaps after an impulse."""

    def end_resolving(self, lane: Lane) -> None:
        """Where contacts are resolved, or have not begun to be."""

    def begin_laws(self, lane: Lane) -> None:
        """Before a common step: which laws the state selects."""
        features = self.features
        for law in features.laws:
            law.begin_law(lane)
        self.settle(lane, True)
        for joint in features.sticking:
            joint.begin_mode(lane)
        lane.copy(features.stiction.rests, to="{}_start")
        for b in features.guards:
            lane.copy((b.side, b.pull), to="{}_start")

    def settle(self, lane: Lane, here: Any) -> None:
        """Let the state of some lanes decide which laws of guards hold."""
        x = self.features.quantities(lane)
        for name, value in self.dynamics.guard_values(x, begins=True).items():
            side, pull = f"side_{name}", f"pull_{name}"
            lane[side] = where(here, x[side], lane[side])
            lane[pull] = where(here, -abs(value), lane[pull])

    def record_pulls(self, lane: Lane) -> None:
        """After a step: the values of guards in the present state; those of joints that stick are from the
        last stage."""
        held = {b.name: lane[b.last] for b in self.features.sticking}
        for name, value in self.features.pulls(self.features.quantities(lane), held).items():
            lane[f"pull_{name}"] = value


class GuardsAtImpacts(Guards):
    """Guards whose signs impulses at stops may change."""

    def fields(self) -> Iterator[Variable]:
        yield from engine("resolving")

    def begin_resolving(self, lane: Lane) -> None:
        lane.resolving = True

    def resolve(self, lane: Lane) -> None:
        self.settle(lane, lane.resolving)

    def end_resolving(self, lane: Lane) -> None:
        lane.resolving = False


def guards_of(features: Features) -> Guards:
    """The guards of a scene."""
    return (GuardsAtImpacts if features.dynamics.guarded and features.stops else Guards)(features)
