"""Independent simulation of impacts at stops: SciPy's event location, impulses from the mass matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import Gravity
from redundant_envs.extras import needs
from redundant_envs.scene import Scene
from studies.accuracy_config import States
from studies.accuracy_metrics import stops

Array = NDArray[np.float64]

MOST_IMPACTS = 1000
"""Most impacts of one motion; more are bounces without end."""


def impact_motion(
    scene: Scene, start: States, seconds: float, rtol: float
) -> tuple[Array, list[list[float]]]:
    """Motions of an arm with gravity and prismatic stops, each computed separately.

    Parameters
    ----------
    scene : Scene
    start : q, qd, joint efforts, (n, 4) each
    seconds : float
    rtol : float
        Relative and absolute tolerance of DOP853.

    Returns
    -------
    q, qd : (n, 8)
    times : list of list of float
        For each motion, the times at which a slider met a stop, s.
    """
    with needs("verify"):
        from scipy.integrate import solve_ivp

    arm: Any = scene.robot
    g = 0.0
    for effect in scene.effects:
        if isinstance(effect, Gravity) and effect.down == (0.0, -1.0):
            g = effect.g
        elif effect.key != "prismatic_stop":
            raise ValueError(f"scene has the effect {effect!r}; impacts are known with upright gravity alone")
    restitution = scene.parameters()["prismatic_stop.restitution"]
    places = [
        (joint, place, way)
        for joint, ends in (stops(scene) or {}).items()
        for place, way in zip(ends, (-1.0, 1.0), strict=True)
    ]

    def event(joint: int, place: float, way: float) -> Any:
        def beyond(t: float, y: Array) -> float:
            return float(way * (y[joint] - place))

        beyond.terminal, beyond.direction = True, 1.0  # type: ignore[attr-defined]
        return beyond

    events = [event(*place) for place in places]
    ends, times = np.empty((len(start[0]), 8)), []
    for i, (q, qd, efforts) in enumerate(zip(*start, strict=True)):
        Q = arm.motor_map @ efforts

        def slope(t: float, y: Array, Q: Array = Q) -> Array:
            return np.concatenate([y[4:], arm.forward_dynamics(y[:4], y[4:], Q, g)])

        t, y, met = 0.0, np.concatenate([q, qd]), []
        while t < seconds:
            piece = solve_ivp(slope, (t, seconds), y, "DOP853", events=events, rtol=rtol, atol=rtol)
            t, y = float(piece.t[-1]), piece.y[:, -1]
            for (joint, place, _), found in zip(places, piece.t_events, strict=True):
                if len(found):
                    y[joint] = place
                    y[4:] = bounced(arm, y[:4], y[4:], joint, restitution)
                    met.append(t)
            if len(met) > MOST_IMPACTS:
                raise ValueError(
                    f"state {i} meets its stops more than {MOST_IMPACTS} times; let it be elastic"
                )
        ends[i] = y
        times.append(met)
    return ends, times


def bounced(arm: Any, q: Array, qd: Array, joint: int, restitution: float) -> Array:
    """Velocities after an impulse along one coordinate that reverses its speed, (4,)."""
    push = np.linalg.solve(arm.mass_matrix(q), np.eye(4)[joint])
    return qd - (1.0 + restitution) * qd[joint] / push[joint] * push
