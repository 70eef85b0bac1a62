"""The one implementation behind all environments: a batch of lanes and its compiled task."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import ArrayLike, NDArray

from redundant_envs.effects import EffortLimits
from redundant_envs.evaluators import cpu
from redundant_envs.evaluators.assemble import assemble
from redundant_envs.evaluators.assemble_task import DISABLED, NEXT_STEP, OBSERVE, RESET, SAME_STEP, STEP
from redundant_envs.model.batch import BatchSimulator, Numerics, unknown_parameter
from redundant_envs.scene import Scene, identifier, load_scene
from redundant_envs.tasks.reach import ReachTask

OPTION_KEYS = ("q", "qd", "goal", "parameters", "reset_mask")
NO_LIMIT = float("inf")
_EMPTY_OBS = np.empty((0, 0), dtype=np.float32)
_EMPTY_OUT = np.empty((0, 0))


class Core:
    """Lanes of a reach scene.

    Lane i owns ``np_random(seed + i)``; each episode draws one 128-bit key from it, and all else
    of the episode follows from that key inside the compiled code.
    """

    def __init__(
        self,
        scene: str | Mapping[str, Any] | Scene,
        num_envs: int,
        task: ReachTask | None = None,
        limit: float = NO_LIMIT,
    ) -> None:
        self.scene = load_scene(scene)
        self.task = task or ReachTask()
        limits = [e for e in self.scene.effects if isinstance(e, EffortLimits)]
        if not limits or self.scene.actuation != "joint":
            raise ValueError(
                "scene cannot be an environment: actions are fractions of the motors' limits, so "
                "its effects need EffortLimits and its actuation must be 'joint'"
            )
        self.num_envs = num_envs
        self.assembly = assemble(self.scene, self.task)
        kernels = cpu.compiled(self.assembly)
        self._kernel = kernels["environment"]
        self._goal_reward = kernels["goal_reward"]
        self.memory = cpu.Memory(self.assembly, num_envs)
        arm = self.scene.robot
        rest = [0.5 * (low + high) for low, high in self.start_ranges()]
        named = dict(zip(("phi1", "phi2", "phi3", "phi4"), rest, strict=True))
        self.memory.blocks[:, [self.memory.rows[q] for q in arm.coordinates]] = np.reshape(
            arm.coordinates_of_joints(**named), (4, 1)
        )
        self.limit = limit
        self.begun: NDArray[np.bool_] | None = None
        """Lanes that began a new episode in the last step, if any did."""
        self.columns = {name: k for k, name in enumerate(self.assembly.outputs)}
        self.generators: list[np.random.Generator | None] = [None] * num_envs
        self.keys = np.zeros((num_envs, 4), dtype=np.uint32)
        self.waiting = np.zeros(num_envs, dtype=np.bool_)  # keys drawn and not yet used
        self.mask = np.zeros(num_envs, dtype=np.uint8)
        self._no_actions = np.zeros((num_envs, 4), dtype=np.float32)
        self.memory.blocks[:, self.memory.rows["limit"]] = limit
        self.obs_size = len(self.assembly.observed)
        self.reach = float(sum(arm.lengths)) + sum(
            self.scene.parameters()[high] for _, high in self.scene.travel().values()
        ) * (arm.kind == "RPRP")

    def start_ranges(self) -> list[tuple[float, float]]:
        """Range of each joint's start position: the travel, or +- the start angle."""
        aliases, values = self.task.aliases(self.scene), self.scene.parameters()
        fixed = self.task.constants(self.scene)
        ranges = []
        for k in range(1, 5):
            low, high = f"low{k}", f"high{k}"
            if low in fixed:
                ranges.append((fixed[low], fixed[high]))
            else:
                ranges.append((values[aliases[low]], values[aliases[high]]))
        return ranges

    # ---- randomness ------------------------------------------------------------------------------

    def seed(self, lane: int, seed: int | None) -> int:
        """Give a lane a new generator; returns the seed used."""
        self.generators[lane], used = seeding.np_random(seed)
        self.waiting[lane] = False
        return used

    def provide_keys(self, lanes: NDArray[np.int64]) -> None:
        """Draw the key of the next episode for those of some lanes that have none waiting."""
        for lane in lanes[~self.waiting[lanes]].tolist():
            generator = self.generators[lane]
            if generator is None:
                self.seed(lane, None)
                generator = self.generators[lane]
                assert generator is not None
            self.keys[lane] = generator.integers(0, 2**32, size=4, dtype=np.uint32)
            self.waiting[lane] = True

    # ---- stepping --------------------------------------------------------------------------------

    def tables(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Fresh tables for observations and outputs."""
        n = self.num_envs
        return (
            np.empty((n, self.obs_size), dtype=np.float32),
            np.empty((n, len(self.columns))),
        )

    def step(
        self, actions: NDArray[np.float32], autoreset: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float32], NDArray[np.float64]]:
        """One control step of all lanes: observations, outputs, and those before an autoreset.

        With autoreset NEXT_STEP the rows of lanes that began anew have no reward and no flags.
        """
        if autoreset == SAME_STEP and not self.waiting.all():
            self.provide_keys(np.flatnonzero(~self.waiting))
        obs, out = self.tables()
        last_obs, last_out = self.tables() if autoreset == SAME_STEP else (_EMPTY_OBS, _EMPTY_OUT)
        self._kernel(
            self.memory.flat, actions, obs, out, last_obs, last_out, self.keys, self.mask,
            STEP, autoreset, self.scene.substeps,
        )  # fmt: skip
        if autoreset != DISABLED and self.mask.any():
            self.begun = self.mask == (2 if autoreset == NEXT_STEP else 1)
            self.waiting[self.begun] = False
            self.mask[self.begun] = 0
            self.provide_keys(np.flatnonzero(self.mask))
        else:
            self.begun = None
        return obs, out, last_obs, last_out

    def reset(self, lanes: NDArray[np.bool_]) -> None:
        """Begin new episodes in the lanes of a mask; their keys are drawn here."""
        self.provide_keys(np.flatnonzero(lanes))
        self.mask[:] = lanes
        self._call(RESET)
        self.mask[:] = 0
        self.waiting[lanes] = False

    def observe(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Observations and outputs of the present states."""
        return self._call(OBSERVE)

    def _call(self, op: int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        obs, out = self.tables()
        self._kernel(
            self.memory.flat, self._no_actions, obs, out, _EMPTY_OBS, _EMPTY_OUT, self.keys,
            self.mask, op, 0, self.scene.substeps,
        )  # fmt: skip
        return obs, out

    # ---- options ---------------------------------------------------------------------------------

    def apply(self, options: Mapping[str, Any], lanes: NDArray[np.int64]) -> None:
        """Set pose, rates, goal and parameters of lanes after a reset."""
        for key in options:
            if key not in OPTION_KEYS:
                raise ValueError(f"options has the unknown key {key!r}; valid: {', '.join(OPTION_KEYS)}")
        arm, n = self.scene.robot, len(lanes)
        writes: list[tuple[tuple[str, ...], NDArray[np.float64]]] = []
        parameters = self.scene.parameters()
        given = options.get("parameters") or {}
        if not isinstance(given, Mapping):
            raise ValueError(f"options['parameters'] is {given!r}; give a mapping of names to numbers")
        for name, value in given.items():
            names = cpu.identifiers(parameters, name)
            if not names:
                raise ValueError(unknown_parameter(name, parameters))
            table = BatchSimulator._parameter_table(name, value, n, len(names))
            if name in ("masses", "lengths") and not (table > 0.0).all():
                raise ValueError(f"{name} has the entry {table.min()}; it must be positive")
            writes.append((tuple(identifier(p) for p in names), table))
        for key, rows, width in (
            ("q", arm.coordinates, 4),
            ("qd", arm.rates, 4),
            ("goal", ("goal_x", "goal_y"), 2),
        ):
            if options.get(key) is not None:
                table = BatchSimulator._table(f"options[{key!r}]", options[key], n, width)
                if not np.isfinite(table).all():
                    raise ValueError(f"options[{key!r}] has non-finite entries; give finite numbers")
                writes.append((rows, table))
        if options.get("q") is not None:
            self._check_travel(np.asarray(options["q"], dtype=np.float64))
        if options.get("goal") is not None:
            radius = float(np.linalg.norm(np.asarray(options["goal"], float), axis=-1).max())
            if radius > self.reach:
                raise ValueError(
                    f"options['goal'] is {radius:.6g} m from the base; the arm reaches "
                    f"{self.reach:.6g} m: choose a goal within it"
                )
        for rows, table in writes:
            self.memory.write(rows, table, lanes)
        if given:
            self.memory.prepare()

    def _check_travel(self, q: NDArray[np.float64]) -> None:
        """A start beyond a limit would put energy into the arm: refuse it."""
        arm, values = self.scene.robot, self.scene.parameters()
        positions = q @ np.asarray(arm.motor_map)  # type: ignore[attr-defined]
        for joint, (low, high) in self.scene.travel().items():
            x = positions[..., joint]
            if np.any(x < values[low]) or np.any(x > values[high]):
                worst = float(np.ravel(x)[np.argmax(np.abs(np.ravel(x) - (values[low] + values[high]) / 2))])
                raise ValueError(
                    f"options['q'] puts {arm.joints[joint]} at {worst:.6g}; its travel is "
                    f"[{values[low]:.6g}, {values[high]:.6g}]: start inside it"
                )

    def observation(self, obs: NDArray[np.float32], out: NDArray[np.float64], goal: bool) -> Any:
        """Observations as their space has them, from the tables of a step."""
        if not goal:
            return obs
        places = out[:, -4:]
        return {
            "observation": obs,
            "achieved_goal": places[:, :2].copy(),
            "desired_goal": places[:, 2:].copy(),
        }

    # ---- goals and snapshots ---------------------------------------------------------------------

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> NDArray[np.float64]:
        """The compiled reward of goal pairs, (n, 2) each."""
        a = np.ascontiguousarray(np.atleast_2d(np.asarray(achieved, dtype=np.float64)))
        d = np.ascontiguousarray(np.atleast_2d(np.asarray(desired, dtype=np.float64)))
        reward = np.empty(len(a))
        self._goal_reward(a, d, self.reach, self.task.goal_tolerance, reward)
        return reward

    def goals(self) -> NDArray[np.float64]:
        """Goals, (num_envs, 2), m."""
        return self.memory.read(("goal_x", "goal_y"))

    def get_state(self) -> dict[str, Any]:
        """Everything that decides the future: numbers, keys and generators."""
        return {
            "numbers": self.memory.flat.copy(),
            "keys": self.keys.copy(),
            "mask": self.mask.copy(),
            "waiting": self.waiting.copy(),
            "generators": copy.deepcopy(self.generators),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state of :meth:`get_state`; the continuation is the same to the last bit."""
        missing = [k for k in ("numbers", "keys", "mask", "waiting", "generators") if k not in state]
        if missing:
            raise ValueError(f"state lacks {', '.join(missing)}; use what get_state returned")
        if state["numbers"].shape != self.memory.flat.shape:
            raise ValueError("state is of another scene or num_envs; use one of this environment")
        self.memory.flat[:] = state["numbers"]
        self.keys[:] = state["keys"]
        self.mask[:] = state["mask"]
        self.waiting[:] = state["waiting"]
        self.generators = copy.deepcopy(state["generators"])


def check_action(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Actions as float32, or a ValueError about their shape or dtype."""
    if not (
        type(actions) is np.ndarray
        and actions.dtype == np.float32
        and actions.shape == shape
        and actions.flags.c_contiguous
    ):
        array = np.asarray(actions)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"action has dtype {array.dtype}; give numbers")
        if array.shape != shape:
            raise ValueError(f"action has shape {array.shape}; give {shape}")
        return np.ascontiguousarray(array, dtype=np.float32)
    return actions if actions.flags.writeable else actions.copy()


def refuse_bad_action(actions: NDArray[np.float32]) -> None:
    """Raise for actions that are not finite."""
    if not np.isfinite(actions).all():
        raise ValueError(
            f"action has non-finite entries: {actions.tolist()}; give finite numbers, or make the "
            "environment with on_bad_action='terminate'"
        )


def numerics_name(code: int) -> str:
    """Readable names of numerics flags."""
    return "|".join(f.name or "" for f in Numerics(code)) or "ok"
