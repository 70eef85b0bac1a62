"""Every name that the commands and ``gymnasium.make`` take."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from redundant_envs import effects
from redundant_envs.envs.registration import ids
from redundant_envs.numerics.tableaus import METHODS
from redundant_envs.scene import scene_names


def signature(effect: type[Any]) -> str:
    """An effect with its numbers, and their defaults."""
    parts = []
    for f in dataclasses.fields(effect):
        required = f.default is dataclasses.MISSING
        parts.append(f.name if required else f"{f.name}={f.default}")
    return f"{effect.__name__}({', '.join(parts)})"


def names(studies: Sequence[str]) -> str:
    """The names, grouped by kind; those of ``studies`` are passed in."""
    groups = {
        "environments": ids(),
        "scenes": scene_names(),
        "effects": [signature(e) for _, e in sorted(effects.REGISTRY.items())],
        "integrators": list(METHODS),
        "studies": list(studies),
    }
    return "\n".join(f"{title}\n" + "".join(f"  {n}\n" for n in group) for title, group in groups.items())
