"""All numbers of environments by their names in options of a reset, with their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.core import Core

OF_ARM = {"m": "masses", "l": "lengths"}
"""First letters of the numbers of an arm, and the names that users give to all of them."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number of an environment, or several with one name: ``value`` and ``unit``.

    In a vector the value is (num_envs,), or (num_envs, entries) of several; a single environment's has no
    first axis. There is one unit, or one for each entry where they differ; "" if none is declared.
    """

    value: Any
    unit: str | tuple[str, ...]


class Parameters(Mapping[str, Parameter]):
    """Numbers by name, in the order of arm, effects and task; ``print`` shows a table.

    They are copies. Options of a reset take them by the same names.
    """

    def __init__(self, found: Mapping[str, Parameter]) -> None:
        self._found = dict(found)

    def __getitem__(self, name: str) -> Parameter:
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def of_lane(self, lane: int) -> Parameters:
        """Those of one environment of a vector."""
        return Parameters({name: Parameter(p.value[lane], p.unit) for name, p in self.items()})

    def __repr__(self) -> str:
        lanes = [len(p.value) for p in self.values() if np.ndim(p.value)]
        vector = len(lanes) == len(self)  # a single environment has numbers without an axis
        heading = f"value in {lanes[0]} environments" if vector else "value"
        rows = [("name", heading, "unit")]
        for name, p in self.items():
            unit = p.unit if isinstance(p.unit, str) else ", ".join(p.unit)
            rows.append((name, _shown(p.value, vector), unit))
        widths = [max(len(row[k]) for row in rows) for k in range(2)]
        return "\n".join(f"{a:{widths[0]}}  {b:{widths[1]}}  {c}".rstrip() for a, b, c in rows)


def _shown(value: NDArray[np.float64], vector: bool) -> str:
    """Entries in a row; where environments differ, from the least to the largest."""
    entries = np.atleast_2d(value.T if vector else np.atleast_1d(value)[:, None])
    ends = [(f"{e.min():.5g}", f"{e.max():.5g}") for e in entries]
    return ", ".join(low if low == high else f"{low} to {high}" for low, high in ends)


def parameters_of(core: Core) -> Parameters:
    """The numbers of all lanes of a core."""
    scene, task = core.scene, core.task
    units = {**scene.robot.units, **task.units}
    for effect in scene.effects:
        units |= {f"{effect.key}.{name}": unit for name, unit in effect.units(scene.robot).items()}
    named: dict[str, list[str]] = {}
    for name in scene.parameters():
        named.setdefault(name.split("[")[0] if "." in name else OF_ARM[name[0]], []).append(name)
    named.update({name: [name] for name in task.parameters()})
    found = {}
    for name, entries in named.items():
        fields = [core.memory.dynamics.field_of(entry) for entry in entries]
        value = core.memory.read(fields)
        each = tuple(units.get(entry, units.get(name, "")) for entry in entries)
        alone = entries == [name]
        found[name] = Parameter(value[:, 0].copy() if alone else value, each if len({*each}) > 1 else each[0])
    return Parameters(found)
