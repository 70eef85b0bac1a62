"""Iterative LQR with limited efforts: motions improved along gradients of the simulator.

Each round linearises the control intervals along the motion; goes backwards through it and finds the change
of the efforts, within their limits, that minimises the quadratic model of the cost that remains; and
simulates changes of several sizes with the feedback that belongs to them. The best of them is the next
motion. So the scene's own simulator judges every change, and gradients only propose it.

Sources: W. Li and E. Todorov, "Iterative linear quadratic regulator design for nonlinear biological movement
systems", ICINCO 2004; Y. Tassa et al. 2014 (:mod:`box_lqr`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.box_lqr import SHARES, backward
from redundant_envs.control.holding import effort_limits, stops
from redundant_envs.control.linearisation import from_differences, from_torch, unlimited
from redundant_envs.control.reach_cost import ReachCost
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene

Array = NDArray[np.float64]
FIRST, LEAST, MOST, FACTOR = 1e-3, 1e-8, 1e2, 5.0
"""Damping of the first round, its range, and by what it changes after a round that failed, or did not. Below
1e-8 rounding makes second derivatives negative; at 100 a change is a hundredth of Newton's."""


class Plan(NamedTuple):
    """Motions of n lanes over T control intervals, and the feedback that keeps an arm on them."""

    states: Array  # (T + 1, n, 2 joints): q and qd
    actions: Array  # (T, n, joints): efforts / limits, -1 to 1
    gains: Array  # (T, n, joints, 2 joints): change of the actions for a departure from the states
    cost: Array  # (n,)

    def action(self, step: int, q: Array, qd: Array) -> Array:
        """Actions (n, joints) of an interval in the states q and qd, clipped to -1 and 1 as motors do."""
        change = self.gains[step] @ (np.concatenate([q, qd], axis=-1) - self.states[step])[..., None]
        action: Array = np.clip(self.actions[step] + change[..., 0], -1.0, 1.0)
        return action


def ilqr_plan(scene: Scene, cost: ReachCost, q: Array, qd: Array, actions: Array, rounds: int = 60) -> Plan:
    """Motions that cost less than those of given actions.

    Derivatives are those of :func:`redundant_envs.torch_step` or, of a scene with hard stops, which it
    refuses, central differences of the compiled interval.

    Parameters
    ----------
    scene : Scene
        With EffortLimits, and without effects that have states.
    cost : ReachCost
        Or another object with its two methods, whose second derivatives are positive semidefinite.
    q, qd : (n, joints)
        Start.
    actions : (T, n, joints)
        Efforts / limits of the first motion, from -1 to 1.
    rounds : int
        Improvements. A lane that does not improve is damped more, and stays as it is.

    Returns
    -------
    Plan
        A local minimum at best: other first actions may lead to another.

    Raises
    ------
    ValueError
        If the scene has effects other than those above, actions are not as above, or a first motion
        has no finite cost.
    MissingPackage
        Without torch, of a scene without hard stops.
    """
    limits, lanes = effort_limits(scene), len(q)
    jacobians = (from_differences if stops(scene) else from_torch)(scene)
    batch = BatchSimulator(unlimited(scene), len(SHARES) * lanes)
    start, shape = np.concatenate([q, qd], axis=-1), (lanes, len(limits))
    if actions.ndim != 3 or actions.shape[1:] != shape or not (np.abs(actions) <= 1.0).all():
        raise ValueError(f"actions has shape {actions.shape}; give (T, {lanes}, {len(limits)}) from -1 to 1")
    gains = np.zeros((*actions.shape, start.shape[-1]))
    plan = Plan(np.tile(start, (len(actions) + 1, 1, 1)), actions, gains, np.full(lanes, np.inf))
    plan = _tried(batch, limits, cost, plan, np.zeros_like(actions))
    if failed := int((~np.isfinite(plan.cost)).sum()):
        raise ValueError(f"actions lead {failed} of {lanes} lanes to a cost that is not finite; give others")

    def proposed(damping: Array) -> tuple[Array, Plan]:
        a, b = jacobians(plan.states[:-1], plan.actions * limits)
        expansion = cost.expansion(plan.states, plan.actions)
        change, gains = backward(a, b * limits, expansion, plan.actions, damping)
        return change, plan._replace(gains=gains)

    damping = np.full(lanes, FIRST)
    for _ in range(rounds):
        change, with_feedback = proposed(damping)
        trial = _tried(batch, limits, cost, with_feedback, change)
        better = trial.cost < plan.cost
        lane = better[:, None]
        plan = Plan(
            np.where(lane, trial.states, plan.states), np.where(lane, trial.actions, plan.actions), gains,
            np.where(better, trial.cost, plan.cost),
        )  # fmt: skip
        damping = np.clip(damping * np.where(better, 1.0 / FACTOR, FACTOR), LEAST, MOST)
    return proposed(damping)[1]


def _tried(batch: BatchSimulator, limits: Array, cost: ReachCost, plan: Plan, change: Array) -> Plan:
    """The best motions among those with shares of a change of the actions, and the feedback of a plan."""
    lanes, joints = plan.actions.shape[1:]
    x = np.tile(plan.states[0], (len(SHARES), 1, 1))
    all_states, all_actions = [x], []
    batch.set_state(*np.split(x.reshape(-1, 2 * joints), 2, axis=-1))
    for k, action in enumerate(plan.actions):
        back = (plan.gains[k] @ (x - plan.states[k])[..., None])[..., 0]
        u = np.clip(action + SHARES[:, None, None] * change[k] + back, -1.0, 1.0)
        batch.advance((u * limits).reshape(-1, joints))
        x = np.concatenate([batch.q, batch.qd], axis=-1).reshape(len(SHARES), lanes, -1)
        all_states.append(x)
        all_actions.append(u)
    states, actions = np.stack(all_states), np.stack(all_actions)
    value = cost.value(states, actions)
    value = np.where(np.isfinite(value), value, np.inf)
    best = value.argmin(axis=0), np.arange(lanes)
    return Plan(states[:, *best], actions[:, *best], plan.gains, value[best])
