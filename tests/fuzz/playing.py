"""Playing cases of the batch simulator: every call, its result, and the lanes before and after it."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import redundant_envs as rde
from redundant_envs.scene import Scene

from .cases import Array, Case, lanes_of, numbers

Make = Callable[..., Any]


@dataclass(frozen=True)
class Lanes:
    """Numbers of all lanes at one time, (num_envs, ...)."""

    q: Array
    qd: Array
    z: Array
    work: Array
    parameters: Array
    """(num_envs, parameters), in the order of ``Scene.parameters()``."""


@dataclass
class Step:
    """A call that was played."""

    call: dict[str, Any]
    before: Lanes
    after: Lanes
    error: BaseException | None = None
    status: dict[str, Array] = field(default_factory=dict)
    """Status returned by ``advance``, per lane; empty for other calls."""


def lanes_now(batch: Any) -> Lanes:
    memory, dynamics = batch._memory, batch.simulator.dynamics
    names = tuple(dynamics.field_of(p) for p in batch.scene.parameters())
    return Lanes(batch.q, batch.qd, batch.z, batch.work, memory.read(names))


class Player:
    """A simulator of a case, and the data that its calls need."""

    def __init__(self, case: Case, make: Make = rde.BatchSimulator) -> None:
        self.case, self.make = case, make
        self.scene = Scene.from_dict(case["scene"])
        self.batch = self.made()
        self.saved: Any = None

    def made(self) -> Any:
        return self.make(self.scene, self.case["num_envs"], self.case["threads"], track_work=True)

    def play(self, call: dict[str, Any]) -> Step:
        """Make a call; any exception is kept."""
        before, error, status = lanes_now(self.batch), None, {}
        try:
            told = self._make(call)
            if told is not None:
                status = {name: np.array(value) for name, value in told._asdict().items()}
        except Exception as raised:  # judged by the invariants
            error = raised
        return Step(call, before, lanes_now(self.batch), error, status)

    def _make(self, call: dict[str, Any]) -> Any:
        kind, batch = call["call"], self.batch
        if kind == "advance":
            return batch.advance(numbers(call["efforts"]))
        if kind == "advance_partly":
            return batch.advance_partly(numbers(call["efforts"]), call["duration"])
        if kind == "set_state":
            q = call["q"] if call.get("text") else numbers(call["q"])
            batch.set_state(q, numbers(call["qd"]), call.get("lanes"))
        elif kind == "set_parameters":
            values = {name: numbers(value) for name, value in call["parameters"].items()}
            batch.set_parameters(values, lanes_of(self.case, call))
        elif kind == "save":
            self.saved = batch.save()
        elif kind == "restore":
            if self.saved is not None:
                batch.restore(self.saved)
        elif kind == "copy":
            self.batch = copy.copy(batch)
        elif kind == "pickle":
            self.batch = pickle.loads(pickle.dumps(batch))
        elif kind == "npz":
            file, other = io.BytesIO(), self.made()
            np.savez(file, **batch.save())
            file.seek(0)
            with np.load(file) as snapshot:
                other.restore(dict(snapshot))
            self.batch = other
        else:
            raise LookupError(f"no call {kind!r}")
        return None


def play(case: Case, make: Make = rde.BatchSimulator) -> list[Step]:
    """All calls of a case; a LookupError if its initial state is not accepted."""
    player = Player(case, make)
    steps = [player.play(call) for call in case["calls"]]
    first = steps[0]
    if first.call["call"] != "set_state" or isinstance(first.error, ValueError):
        raise LookupError(f"the case does not begin with a state: {first.error}")
    return steps
