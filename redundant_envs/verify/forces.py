"""Do forces agree with the declarations of their effects: with potentials, and laws where they meet?"""

from typing import Any, cast

import numpy as np

from redundant_envs.effects.bound_hooks import Attached
from redundant_envs.effects.hooks import Effect, Field, Force
from redundant_envs.language.algebra import numbered
from redundant_envs.model.energy import at_joints, potential_energy, scene_quantities
from redundant_envs.scenes.scene import Scene
from redundant_envs.verify.checks import BEYOND, LEAST_SHARE, ROUNDING, Array, Sample, check, ratio, worst_of
from redundant_envs.verify.equations import columns
from redundant_envs.verify.promises import Finding, at_most

STEP = 1e-5  # rad, m: far below lengths over which a potential changes (1e-2), far above rounding (1e-11)
SHARE_OF_TRAVEL = 0.01  # largest step, in units of a travel or of a width between switches: few straddle it
AGREEMENT = 1e-5  # in units of the force: a thousand times the error of differences of a smooth potential
SMOOTH = 1e-6
"""If two differences agree to this, in units of the force, the potential is smooth there and the state
judged: at a kink, such as the limit of a spring, no difference is a derivative."""
SMALL_FORCE = 1e-6  # a force below this, in units of the largest of all states, is compared with that


@check("potentials against forces", at_most(AGREEMENT))
def potentials(trial: Sample) -> Finding:
    """Every conservative force is minus the slope of its potential, beyond the travel and turns, too."""
    attached = trial.scene.attached
    booked = {a.key for a in attached if isinstance(a.hook, Field) or "conservative" in a.functions}
    findings = [_potential(trial, x, trial.poses[0]) for x in trial.scene.effects if x.key in booked]
    return worst_of(findings, "no effect has a potential")


def _potential(trial: Sample, effect: Effect, q: Array) -> Finding:
    arm: Any = trial.scene.robot
    alone = Scene(arm, (effect,))
    inverse = np.linalg.inv(arm.motor_map)  # from joint positions to coordinates
    step, values = np.full(len(arm.joints), STEP), alone.parameters()
    forces, ends = alone.attached.of(Force), list[Any](alone.travel().items())
    ends += [(a.hook.joint, map(a.parameter, a.hook.switch)) for a in forces if a.hook.switch]
    for k, (lower, upper) in ends:
        step[k] = min(step[k], SHARE_OF_TRAVEL * (values[upper] - values[lower]))

    def difference(joint: int, steps: int) -> Array:
        move = steps * step[joint] * inverse[joint]
        above, below = q + move, q - move
        moved = ((above - below) @ arm.motor_map)[:, joint]  # for a large angle not exactly the step
        return (potential_energy(alone, above) - potential_energy(alone, below)) / moved

    x, force = scene_quantities(alone, q), np.zeros_like(q)
    for a in forces:
        if "conservative" in a.functions:
            force += at_joints(alone, a, "conservative", x)
    if alone.attached.of(Field):
        force -= columns(x.each(numbered("G{}", q.shape[1])), len(q)) @ inverse.T
    near, far = (np.stack([difference(k, n) for k in range(len(step))], axis=1) for n in (1, 2))
    slope = -(4.0 * near - far) / 3.0
    largest = np.maximum(np.abs(force), np.abs(slope)).max(axis=1)
    scale = np.maximum(largest, SMALL_FORCE * largest.max())[:, None]
    noise = ROUNDING * np.abs(potential_energy(alone, q))[:, None] / step
    smooth = np.all(np.abs(near - far) <= SMOOTH * scale + noise, axis=1)
    gap = np.maximum(np.abs(force - slope) - noise, 0.0) / scale
    gap = np.where(smooth[:, None] & (scale > 0.0), gap, 0.0)
    if (share := np.mean(smooth)) < LEAST_SHARE:
        words = f"{effect.key}: the potential is smooth at {share:.0%} of the states only"
        return Finding(np.inf, effect.key, words)
    most, where, state = trial.worst(gap)
    words = f"{effect.key}: the conservative forces are {force[state]}, those of the potential {slope[state]}"
    return Finding(most, f"{where}, {effect.key}", words)


CONTINUOUS = 1e-9  # largest jump of a force where its law changes, in units of the largest force nearby


@check("forces at their switches", at_most(CONTINUOUS))
def forces_at_switches(trial: Sample) -> Finding:
    """Both laws of a force with a ``switch`` meet there, at random rates, with initial states."""
    findings = [
        _jump(trial, a, limit, side)
        for a in trial.scene.attached.of(Force)
        for limit, side in zip(a.hook.switch or (), (-1.0, 1.0), strict=False)
    ]
    return worst_of(findings, "no force changes its law at a position")


def _jump(trial: Sample, a: Attached[Force], limit: str, side: float) -> Finding:
    arm, hook, joint = trial.scene.robot, a.hook, cast(int, a.hook.joint)
    q, qd, _ = trial.states
    joints = q @ arm.motor_map
    lower, upper = map(a.number, hook.switch or ())
    width = upper - lower if np.isfinite(upper - lower) else 1.0
    if not np.isfinite(a.number(limit)):
        return Finding(0.0)

    def force(beyond: Array | float, side: float) -> Array:
        joints[:, joint] = a.number(limit) + beyond
        x = scene_quantities(trial.scene, joints @ np.linalg.inv(arm.motor_map), qd)
        x[a.side] = side
        return np.broadcast_to(np.asarray(a.functions["function"](x), np.float64), len(q))

    inside, outside = force(0.0, 0.0), force(0.0, side)
    share = np.linspace(0.0, BEYOND, len(q))
    nearby = np.maximum(np.abs(force(side * share * width, side)), np.abs(force(-side * share * width, 0.0)))
    # The position itself is rounded, which matters for a stiff force between close limits.
    rounding = ROUNDING * (1.0 + np.abs(joints).sum(axis=1)) * nearby.max() / (BEYOND * width)
    gap = np.maximum(np.abs(inside - outside) - rounding, 0.0)
    most, where, state = trial.worst(ratio(gap, nearby.max()))
    words = (
        f"{a.key}: where {arm.joints[joint]} is at {limit} = {a.number(limit):g}, the force is "
        f"{inside[state]:.6g} by the law between and {outside[state]:.6g} by the law beyond; make them equal"
    )
    return Finding(most, f"{where}, {a.key}", words)
