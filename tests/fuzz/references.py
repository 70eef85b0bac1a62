"""References for a control interval: the same scene in many equal steps, and its energies."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs.effects.hooks import Force
from redundant_envs.model import parameters
from redundant_envs.model.energy import scene_quantities
from redundant_envs.scene import Scene
from redundant_envs.verify.judging import agree

from .cases import Array, numbers
from .playing import Lanes, Step, lanes_now

FINE = ((96, 160), (1536, 2560))
"""Steps per control interval of the two references; more of both for lanes where they do not agree."""
FINE_ACROSS_KINKS = ((1536, 2560, 4297), (12288, 20483, 34381))
"""Where a force changes its law errors depend on where a step meets the change: of 96 and 160 steps both were
off by three tolerances, and by the same."""
ROUNDING = 1e-9
"""The tolerance of scenes that have none, in units of the arm's length."""


@dataclass(frozen=True)
class Judgement:
    """For the lanes of an interval: those for which the references agree, and the results of the finer
    one."""

    agreed: NDArray[np.bool_]
    finer: Lanes
    coarser: Lanes


def lane_parameters(scene: Scene, lanes: Lanes) -> dict[str, Array]:
    """Parameter name -> its value in each lane."""
    return {name: lanes.parameters[:, k] for k, name in enumerate(scene.parameters())}


def quantities(
    scene: Scene, lanes: Lanes, names: list[str], more: dict[str, Any] | None = None
) -> list[Array]:
    """Quantities of the arm, (num_envs,) each, with each lane's own masses and lengths."""
    arm = scene.loaded_robot
    values: dict[str, Any] = {**arm.parameter_values(), "ax": 0.0, "ay": 0.0, **(more or {})}
    values |= {k: v for k, v in lane_parameters(scene, lanes).items() if "." not in k}
    values |= {name: lanes.q[:, k] for k, name in enumerate(arm.coordinates)}
    values |= {name: lanes.qd[:, k] for k, name in enumerate(arm.rates)}
    with np.errstate(all="ignore"):
        return [np.broadcast_to(x, len(lanes.q)) for x in arm.evaluate(names, values)]


def tips(scene: Scene, lanes: Lanes) -> Array:
    """(num_envs, 2), m."""
    return np.stack(quantities(scene, lanes, ["tip_x", "tip_y"]), axis=1)


def energies(scene: Scene, lanes: Lanes) -> tuple[Array, Array]:
    """Kinetic and potential energy of each lane, J."""
    with np.errstate(all="ignore"):
        x = scene_quantities(scene, lanes.q, parameters=lane_parameters(scene, lanes))
        springs: Any = np.zeros(len(lanes.q))
        for a in scene.attached:
            if "potential" in a.functions:
                springs = springs + a.functions["potential"](x)
        kinetic, potential = quantities(scene, lanes, ["T", "U"], {"ax": x["ax"], "ay": x["ay"]})
        return kinetic, potential + springs


def tolerance_of(scene: Scene) -> float:
    """m."""
    robot: Any = scene.robot
    return scene.tolerance if scene.tolerance is not None else ROUNDING * sum(robot.lengths)


def fine_interval(scene: Scene, step: Step, lanes: NDArray[np.intp], steps: int) -> tuple[Lanes, Array]:
    """Lanes after an interval of equal rk8 steps, and their flags."""
    finer = dataclasses.replace(scene, integrator="rk8", tolerance=None, substeps=steps)
    batch = rde.BatchSimulator(finer, len(lanes), track_work=True)
    before = step.before
    table = {name: before.parameters[lanes, k] for k, name in enumerate(scene.parameters())}
    parameters.write(finer, batch._memory, np.arange(len(lanes)), table)
    batch.set_state(before.q[lanes], before.qd[lanes])
    if batch.z.size:
        batch._memory.write(tuple(batch.simulator.dynamics.effect_states), before.z[lanes])
    batch._memory.write(("work",), before.work[lanes, None])
    efforts = numbers(step.call["efforts"])[lanes]
    if step.call["call"] == "advance":
        status = batch.advance(efforts)
    else:
        status = batch.advance_partly(efforts, step.call["duration"])
    return lanes_now(batch), status.numerics


def judged(scene: Scene, step: Step, lanes: NDArray[np.intp]) -> Judgement:
    """Results of the references for an interval of some lanes, whose states are finite."""
    left, done = np.arange(len(lanes)), np.zeros(len(lanes), np.bool_)
    pairs: list[list[Array]] = []
    kinked = any(a.law for a in scene.attached.of(Force))
    for steps in FINE_ACROSS_KINKS if kinked else FINE:
        if not len(left):
            break
        ends, flags = zip(*(fine_interval(scene, step, lanes[left], n) for n in steps), strict=True)
        coarser, finer = ends[0], ends[-1]
        within = agree([tips(scene, end) for end in reversed(ends)], tolerance_of(scene))
        exact = rounding_of(scene, finer, steps[-1]) <= tolerance_of(scene)
        agreed = (np.bitwise_or.reduce(flags) == 0) & within & exact
        if not pairs:
            pairs = [list(astuple(coarser)), list(astuple(finer))]
        else:
            for arrays, found in zip(pairs, (coarser, finer), strict=True):
                for array, new in zip(arrays, astuple(found), strict=True):
                    array[left] = new
        done[left] = agreed
        left = left[~agreed]
    return Judgement(done, Lanes(*pairs[1]), Lanes(*pairs[0]))


def rounding_of(scene: Scene, lanes: Lanes, steps: int) -> Array:
    """Largest error of the tip by rounding, in a number of steps that all round the same way, m."""
    own, arm = lane_parameters(scene, lanes), scene.loaded_robot
    slides = list(arm.sliders())
    size = np.sum([own[name] for name in own if "." not in name and name.startswith("l")], axis=0)
    size = size + np.abs(lanes.q[:, slides]).sum(axis=1)
    angles = np.abs(np.delete(lanes.q, slides, axis=1)).max(axis=1, initial=1.0)
    return np.asarray(steps * np.finfo(np.float64).eps * size * angles)


def astuple(lanes: Lanes) -> tuple[Array, ...]:
    return tuple(getattr(lanes, f.name) for f in dataclasses.fields(Lanes))


def of_lanes(all_lanes: Lanes, chosen: NDArray[np.intp]) -> Lanes:
    return Lanes(*(array[chosen] for array in astuple(all_lanes)))
