"""Are all quantities finite when nothing moves?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from redundant_envs.effects.bound_hooks import Functions
from redundant_envs.language.algebra import gives_of, numbered
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.checks import OF_LANES, OWN_NAMES
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.verify.checks import Sample, check
from redundant_envs.verify.hints import Motion
from redundant_envs.verify.promises import Finding, Promise

FINITE = Promise(0.0, "quantities", "at most")


@check("numbers at rest", FINITE)
def numbers_at_rest(trial: Sample) -> Finding:
    """Quantities of the arm, forces, links, changes of states, readings and accelerations are finite without
    velocities and efforts: in random poses, at ends of travel, straight, folded and square."""
    dynamics = Dynamics(trial.scene, track_work=True)
    q = np.concatenate([trial.states[0], trial.poses[0], trial.square])
    q = q[np.isfinite(dynamics.arm.points(q)).all(axis=(1, 2))]
    motion = Motion(dynamics, q @ dynamics.arm.motor_map, np.zeros_like(q))
    wrong, where = [], ""
    for what, value in _values(dynamics, motion):
        good = np.isfinite(np.broadcast_to(np.asarray(value, float), len(q)))
        if not good.all():
            pose = zip(dynamics.arm.joints, motion.joints[np.argmin(good)].round(4), strict=True)
            where = where or f"{what} at {', '.join(f'{k} {v:g}' for k, v in pose)}"
            wrong.append(what)
    words = (
        f"at rest, without efforts, {', '.join(wrong[:5])} {'is' if len(wrong) == 1 else 'are'} not finite; "
        "do not divide by a rate or an effort, which may be 0"
    )
    return Finding(len(wrong), where, words)


def _values(dynamics: Dynamics, motion: Motion) -> Iterator[tuple[str, Any]]:
    """The checked quantities, by names that a reader knows."""
    arm, x = dynamics.arm, motion.values()
    for a in dynamics.scene.attached:
        parts: list[Functions] = [a.functions, *a.states.values()]
        for field, function in (named for part in parts for named in part.items()):
            found = function(x) if field != "kink" else ()
            for value in found if isinstance(found, tuple) else (found,):
                yield f"{field} of {a.key}", value
    others = (f"the change of {name}" for name in dynamics.states[2 * dynamics.count :])
    names = [*numbered("qdd{}", len(arm.joints)), *others]
    yield from zip(names, dynamics.accelerations(motion.values()), strict=True)
    x.update({f"t{k + 1}": 0.0 for k in range(len(arm.joints))})
    given = {name for f in (*arm.functions, arm.column_norms) for name in gives_of(f)}
    all_of_them = Quantities(x, (*dynamics.functions, arm.column_norms), arm.sincos)
    for name in sorted(n for n in given if OWN_NAMES.fullmatch(n) or n in OF_LANES):
        yield name, all_of_them[name]
