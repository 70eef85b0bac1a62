"""Copies and pickles of objects with a simulator: they share it, or find it again and check its equality."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from redundant_envs.model.programs import Simulator


class Copied(ABC):
    """Base of objects with a simulator, which copies share; copies create again what they cannot share."""

    made_anew: ClassVar[tuple[str, ...]]
    """Attributes that copies do not take over: compiled code, threads, and views of other arrays."""
    simulator: Simulator

    @staticmethod
    @abstractmethod
    def _found_simulator(state: Mapping[str, Any]) -> Simulator:
        """The simulator that a pickled state needs, in this process."""

    @abstractmethod
    def _connect(self) -> None:
        """Create the attributes that copies do not take over."""

    def __getstate__(self) -> dict[str, Any]:
        left = ("simulator", *self.made_anew)
        kept = {name: value for name, value in self.__dict__.items() if name not in left}
        return {**kept, "_identity": self.simulator.identity}

    def __setstate__(self, state: dict[str, Any]) -> None:
        simulator = self._found_simulator(state)
        simulator.check_same(state.get("_identity", ""))
        self._take(state, simulator)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        made = memo[id(self)] = object.__new__(type(self))
        made._take(copy.deepcopy(self.__getstate__(), memo), self.simulator)
        return made

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def _take(self, state: dict[str, Any], simulator: Simulator) -> None:
        self.__dict__.update({name: value for name, value in state.items() if name != "_identity"})
        self.simulator = simulator
        self._connect()
