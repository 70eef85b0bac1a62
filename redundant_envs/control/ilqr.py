"""Iterative LQR with limited efforts: motions improved along gradients of the simulator.

Each round linearises the control interval along the motion, x' = A x + B u, with the differentiable step; goes
backwards through the motion and finds, at each interval, the change of the efforts within their limits (a box)
that minimises the quadratic model of the cost that remains; and tries changes of several sizes, with the
feedback found on the way, in the compiled simulator. The best of them is the next motion.

Sources: W. Li and E. Todorov, "Iterative linear quadratic regulator design for nonlinear biological movement
systems", ICINCO 2004; Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming",
ICRA 2014 (the box, and the damping of the change of the actions).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.control.holding import effort_limits, stops
from redundant_envs.control.reach_cost import ReachCost
from redundant_envs.effects import EffortLimits, LimitSpring, PrismaticStop
from redundant_envs.model.batch import BatchSimulator
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.extras import needs

Array = NDArray[np.float64]
STIFFNESS, DAMPING = 5000.0, 5000.0
"""Of the springs in place of hard stops, N/m and N s/m^2: the 15 N of an upright link press them in by 3 mm, and
at 1 m/s the damper doubles their force."""
SUBSTEPS = 2  # of rk4: the springs' 100 rad/s with 0.5 kg times 10 ms is 1, and the method is stable below 2.8
SHARES = 0.5 ** np.arange(8.0)  # of a change of the actions that are tried: below 1/128 a round is lost
FIRST, LEAST, MOST, FACTOR = 1e-3, 1e-8, 1e2, 5.0
"""Damping of the change of the actions: of the first round, its range, and the factor after a round that failed
(and 1 / the factor after another). The actions' own weight in the cost is 2e-3; at 1e4 no action changes."""
BOX_ROUNDS = 12  # of Newton's method: with four actions the set of those at a limit settles in fewer


class Plan(NamedTuple):
    """Motions of n lanes over T control intervals, and the feedback that keeps an arm on them."""

    states: Array  # (T + 1, n, 2 joints): q and qd
    actions: Array  # (T, n, joints): efforts / limits, -1 to 1
    gains: Array  # (T, n, joints, 2 joints): change of the actions for a departure from the states
    cost: Array  # (n,)

    def action(self, step: int, q: Array, qd: Array) -> Array:
        """Actions (n, joints) of an interval in the states q and qd, clipped to -1 and 1 as motors do."""
        change = self.gains[step] @ (np.concatenate([q, qd], axis=-1) - self.states[step])[..., None]
        return np.clip(self.actions[step] + change[..., 0], -1.0, 1.0)


def smooth_scene(scene: Scene) -> Scene:
    """The scene as iLQR sees it: sliders end in springs, efforts are not cut, and equal steps of rk4."""
    springs = (
        LimitSpring(scene.robot.joints[k], low, high, STIFFNESS, DAMPING)
        for k, (low, high) in stops(scene).items()
    )
    rest = (x for x in scene.effects if not isinstance(x, EffortLimits | PrismaticStop))
    return dataclasses.replace(
        scene, effects=(*rest, *springs), integrator="rk4", tolerance=None, substeps=SUBSTEPS
    )


def linearised(scene: Scene, limits: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
    """A function of states (T, n, m) and actions (T, n, joints) that returns A (T, n, m, m) and
    B (T, n, m, joints) of the control interval, from the differentiable step."""
    with needs("train"):
        from redundant_envs.compiler.backends.torch import torch
        from redundant_envs.model.torch_step import torch_step
    step, joints, scale = torch_step(scene), len(limits), torch.as_tensor(limits)

    def at(states: Array, actions: Array) -> tuple[Array, Array]:
        x, u = (torch.tensor(a, requires_grad=True) for a in (states, actions))
        after = torch.cat(step(x[..., :joints], x[..., joints:], u * scale), -1)
        rows = torch.eye(2 * joints, dtype=after.dtype)[:, None, None].expand(-1, *after.shape)
        parts = torch.autograd.grad(after, (x, u), rows, is_grads_batched=True)
        a, b = (part.movedim(0, -2).numpy() for part in parts)
        return a, b

    return at


def box_minimum(h: Array, g: Array, low: Array, high: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The x (n, m) with the least x.H x / 2 + g.x between low and high, H (n, m, m) positive definite, by
    projected Newton steps; and which entries are free there. Bounds include 0."""
    x, eye = np.zeros_like(g), np.eye(g.shape[-1])
    for _ in range(BOX_ROUNDS):
        slope = g + (h @ x[..., None])[..., 0]
        free = ~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0)))
        both = free[..., None] & free[..., None, :]
        newton = -np.linalg.solve(np.where(both, h, eye), (slope * free)[..., None])[..., 0]
        if not np.abs(newton).max() > 1e-9:  # shares of the limits
            break
        trial = np.clip(x + SHARES[:, None, None] * newton, low, high)
        value = (((0.5 * h) @ trial[..., None])[..., 0] + g) * trial
        x = _least(trial, value.sum(axis=-1))
    return x, free


def _least(candidates: Array, values: Array) -> Array:
    """Of candidates (shares, n, m) those with the least values (shares, n): (n, m)."""
    return np.take_along_axis(candidates, values.argmin(axis=0)[None, :, None], axis=0)[0]


def ilqr(
    scene: Scene, cost: ReachCost, q: Array, qd: Array, actions: Array, iterations: int = 60
) -> Plan:
    """Motions that cost less than those of given actions.

    Parameters
    ----------
    scene : Scene
        With EffortLimits; it is seen through :func:`smooth_scene`.
    cost : ReachCost
        Or any object with its two methods, whose second derivatives are positive semidefinite.
    q, qd : (n, joints)
        Start.
    actions : (T, n, joints)
        Efforts / limits of the first motion, from -1 to 1.
    iterations : int
        Rounds, each of 20 ms or less a lane and second of motion.

    Returns
    -------
    Plan
        A local minimum at best: other actions to begin with may lead to another.

    Raises
    ------
    ValueError
        If the scene has effects that :func:`torch_step` or :func:`effort_limits` refuses or that have states,
        or the first motion has no finite cost.
    MissingPackage
        Without torch.
    """
    limits, model = effort_limits(scene), smooth_scene(scene)
    if names := tuple(scene.states()):
        raise ValueError(f"scene has effects with the states {', '.join(names)}; iLQR knows q and qd alone")
    jacobians, batch = linearised(model, limits), BatchSimulator(model, len(SHARES) * len(q))
    start = np.concatenate([q, qd], axis=-1)
    states, gains = np.tile(start, (len(actions) + 1, 1, 1)), np.zeros((*actions.shape, start.shape[-1]))
    states, actions, value = _tried(batch, limits, cost, Plan(states, actions, gains, np.zeros(len(q))), 0.0 * actions)
    if not np.isfinite(value).all():
        raise ValueError(f"actions lead {(~np.isfinite(value)).sum()} of {len(q)} lanes to no finite cost; give others")
    damping = np.full(len(q), FIRST)
    for _ in range(iterations):
        change, gains = _backward(*jacobians(states[:-1], actions), cost.expansion(states, actions), actions, damping)
        trial = _tried(batch, limits, cost, Plan(states, actions, gains, value), change)
        better = trial[2] < value
        states, actions = (np.where(better[:, None], *pair) for pair in zip(trial[:2], (states, actions), strict=True))
        value = np.where(better, trial[2], value)
        damping = np.clip(damping * np.where(better, 1.0 / FACTOR, FACTOR), LEAST, MOST)
    _, gains = _backward(*jacobians(states[:-1], actions), cost.expansion(states, actions), actions, damping)
    return Plan(states, actions, gains, value)


def _tried(batch: BatchSimulator, limits: Array, cost: ReachCost, plan: Plan, change: Array) -> tuple[Array, ...]:
    """States, actions and cost of the best of all shares of a change, with the feedback of a plan."""
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
    return states[:, *best], actions[:, *best], value[best]


def _backward(a: Array, b: Array, costs: Any, actions: Array, damping: Array) -> tuple[Array, Array]:
    """Change of the actions and feedback from the last interval to the first (Tassa 2014, equations 5 and 11)."""
    lx, lxx, lu, luu = costs
    eye = np.eye(actions.shape[-1])
    change, gains, vx, vxx = np.zeros_like(actions), np.zeros((*actions.shape, lx.shape[-1])), lx[-1], lxx[-1]
    for k in reversed(range(len(actions))):
        bt = b[k].swapaxes(-1, -2)
        qu = lu[k] + (bt @ vx[..., None])[..., 0]
        qux, quu = bt @ vxx @ a[k], luu[k] + bt @ vxx @ b[k]
        size = np.trace(quu, axis1=-2, axis2=-1) / len(eye)
        damped = quu + (damping * size)[:, None, None] * eye
        change[k], free = box_minimum(damped, qu, -1.0 - actions[k], 1.0 - actions[k])
        both = free[..., None] & free[..., None, :]
        gains[k] = -np.linalg.solve(np.where(both, damped, eye), qux * free[..., None])
        # The cost that remains under the new actions and feedback; sums of squares stay positive in rounding.
        closed, gt, du = a[k] + b[k] @ gains[k], gains[k].swapaxes(-1, -2), change[k][..., None]
        ct = closed.swapaxes(-1, -2)
        vx = lx[k] + (gt @ (lu[k][..., None] + luu[k] @ du) + ct @ (vx[..., None] + vxx @ b[k] @ du))[..., 0]
        vxx = lxx[k] + gt @ luu[k] @ gains[k] + ct @ vxx @ closed
    return change, gains
