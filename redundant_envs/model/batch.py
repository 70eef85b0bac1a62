"""Many copies of a scene, stepped together by the compiled core."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.effects.hooks import Impact
from redundant_envs.language.philox import LOW, philox
from redundant_envs.model import parameters
from redundant_envs.model.memory import Memory, alone, first
from redundant_envs.model.programs import Copied, Simulator, Team, address, batch_simulator
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.simulator.lane.event_log import MAX_LOGGED
from redundant_envs.simulator.lane.faults import Fault
from redundant_envs.simulator.lane.fields import LOG
from redundant_envs.support.values import shown, whole_number

Numerics = Fault
OUTPUTS: dict[str, type[Any]] = {
    "finite": np.bool_, "evaluations": np.int64, "error": np.float64, "events": np.int64, "numerics": np.int8,
}  # fmt: skip
"""Arrays that the kernel fills, and their types, in the order of ``Status``."""
EVENT_KINDS = {1: "upper impact", 2: "lower impact", 3: "rest", 4: "release"}


@dataclass(frozen=True)
class Event:
    """An event at a stop of a slider."""

    time: float  # s
    kind: str  # "upper impact", "lower impact", "rest" or "release"
    joint: str  # name of the slider, such as "r1"
    speed: float  # before an impact, towards the stop, m/s; else 0
    lane: int = 0  # index of the motion in a batch


class Status(NamedTuple):
    """Results of one control interval, per lane: (num_envs,) each. ``error_estimate`` is the tip error of the
    interval [m]; of dop853 that of its last step in units of its tolerance; NaN for methods without an
    estimate. Arrays that are the same in every interval are read-only."""

    finite: NDArray[np.bool_]  # whether all states are finite
    evaluations: NDArray[np.int64]  # of the right-hand side
    error_estimate: NDArray[np.float64]
    events: NDArray[np.int64]  # located ones
    numerics: NDArray[np.int8]  # flags of Numerics


def draws_of(seed: int, lanes: NDArray[np.int64]) -> NDArray[np.float64]:
    """What the draws of some lanes follow from at the start of a motion, as :attr:`BatchSimulator.draws`."""
    seed, zero = int(seed), np.zeros(len(lanes), np.uint64)
    key = [zero + np.uint64(seed & LOW), zero + np.uint64(seed >> 32)]
    with np.errstate(over="ignore"):
        words = philox(key, [lanes.astype(np.uint64), 0, zero, zero])
    return np.stack([*words, zero], axis=1).astype(np.float64)


class BatchSimulator(Copied):
    """``num_envs`` copies of a scene with their own states and parameters.

    A lane's result does not depend on ``num_envs``, on its index, on ``threads`` or on its
    neighbours, to the last bit. A copy (``copy``, ``pickle``) is independent and continues to the
    same bits, in another process too.

    Parameters
    ----------
    scene : Scene
    num_envs : int
    threads : int
        Threads over blocks of lanes.
    track_work : bool
        Also integrate the work of motors and of forces without a potential (``work``, J).
    seed : int
        Of the draws of effects, 0 to 2^64 - 1; those of lane i follow from the seed and i. Each motion that
        ``set_state`` begins has the same draws again; give another seed for others.
    """

    made_anew = ("_team", "_beginning", "_outputs", "_facts")

    def __init__(
        self, scene: Scene, num_envs: int = 1, threads: int = 1, track_work: bool = False, seed: int = 0
    ) -> None:
        check_scene(scene)
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**64:
            raise ValueError(f"seed is {shown(seed)}; give a whole number from 0 to 2^64 - 1")
        self.scene = scene
        self.num_envs = whole_number("num_envs", num_envs)
        self.threads = whole_number("threads", threads)
        self.track_work = bool(track_work)
        self.simulator = batch_simulator(scene, self.track_work)
        self._memory = Memory(self.simulator.dynamics, self.simulator.layout, self.num_envs, {})
        self._connect()
        if self.simulator.dynamics.draws:
            self.set_draws(draws_of(seed, self._memory.index))
        self._begin(self._memory.index)

    def _connect(self) -> None:
        simulator, memory, dynamics = self.simulator, self._memory, self.simulator.dynamics
        self._team = Team(simulator, "advance", memory, self.threads)
        self._beginning = Team(simulator, "begin", memory, 1) if dynamics.effect_states.computed else None
        filled = {name: np.zeros(memory.blocks * LANES, kind) for name, kind in OUTPUTS.items()}
        filled["error"][:] = np.nan
        filled["evaluations"][:] = self.scene.substeps * dynamics.method.stages
        for part in self._team.parts:
            part.set(**{name: column[part.first * LANES :] for name, column in filled.items()})
        filled["error"].flags.writeable = bool(dynamics.method.error5)
        filled["evaluations"].flags.writeable = simulator.features.counts_evaluations
        filled["events"].flags.writeable = bool(simulator.features.stops)
        self._outputs = [(column[: self.num_envs], column.flags.writeable) for column in filled.values()]

    @staticmethod
    def _found_simulator(state: Mapping[str, Any]) -> Simulator:
        return batch_simulator(state["scene"], state["track_work"])

    @property
    def q(self) -> NDArray[np.float64]:
        """Generalized coordinates, (num_envs, joints): rad and m. A copy."""
        return self._memory.read(self.scene.robot.coordinates)

    @property
    def qd(self) -> NDArray[np.float64]:
        """Generalized velocities, (num_envs, joints). A copy."""
        return self._memory.read(self.scene.robot.rates)

    @property
    def z(self) -> NDArray[np.float64]:
        """States of the effects, (num_envs, states), in the order of ``Scene.states()``. A copy."""
        return self._memory.read(tuple(self.simulator.dynamics.effect_states))

    @property
    def work(self) -> NDArray[np.float64]:
        """Work done since the state was set, (num_envs,), J; needs ``track_work``."""
        if "work" not in self._memory:
            raise ValueError("the work is not tracked; build BatchSimulator with track_work=True")
        return self._memory.read(("work",))[:, 0]

    @alone
    def events(self, start: float = 0.0) -> list[Event]:
        """Events at stops in the last interval, which began at ``start`` [s]; needs ``track_work``. A
        ValueError if a lane had more events, rests and releases included, than are kept."""
        if not self.simulator.features.stops:
            return []
        if not self.track_work:
            raise ValueError("events are not kept; build BatchSimulator with track_work=True")
        counts, happened = self._memory.read(("logged",))[:, 0], []
        for lane in np.flatnonzero(counts).tolist():
            if counts[lane] >= MAX_LOGGED:
                raise ValueError(
                    f"environment {lane} had {MAX_LOGGED} events or more at its stops in one interval, and "
                    f"no more are kept; shorten control_dt, which is {self.scene.control_dt} s"
                )
            row = self._memory.arrays[str(LOG)][lane // LANES, : 3 * int(counts[lane]), lane % LANES]
            for time, code, speed in row.reshape(-1, 3).tolist():
                slider, kind = divmod(int(code), 10)
                joint = self.simulator.features.stops[slider].name
                happened.append(Event(start + time, EVENT_KINDS[kind], joint, speed, lane))
        return happened

    @first
    def set_state(self, q: ArrayLike, qd: ArrayLike, index: ArrayLike | None = None) -> None:
        """Set coordinates and velocities, (..., joints), of all lanes or of those in ``index``. States of
        effects get their initial values, and no slider is held at a stop."""
        lanes, arm = parameters.lanes_of(index, self.num_envs), self.scene.robot
        positions, rates = (self._table(name, x, len(lanes)) for name, x in (("q", q), ("qd", qd)))
        parameters.check_stops(self.scene, positions, parameters.stops_of(self._memory, lanes))
        self._memory.write(arm.coordinates, positions, lanes)
        self._memory.write(arm.rates, rates, lanes)
        self._begin(lanes)

    def _begin(self, lanes: NDArray[np.int64]) -> None:
        """Begin a new motion in some lanes, which have its positions and rates."""
        memory, names = self._memory, self.simulator.dynamics.effect_states.computed
        memory.begin(lanes)
        if self._beginning is not None:
            values = np.zeros((memory.blocks * LANES, len(names)))
            self._beginning.parts[0].set(initial=values)
            self._beginning()
            memory.write(names, values[lanes], lanes)

    @property
    def draws(self) -> NDArray[np.float64]:
        """What the draws of effects follow from, (num_envs, 5): the four words of each lane's key, and the
        number of control intervals since its motion began. (num_envs, 0) if no effect draws. A copy."""
        return self._memory.read(self.simulator.dynamics.draw_fields)

    @first
    def set_draws(self, draws: ArrayLike, index: ArrayLike | None = None) -> None:
        """Let the draws of lanes follow from others, (5,) or (lanes, 5), as :attr:`draws` has them. States
        keep their values; :meth:`set_state` begins with the new draws."""
        lanes, names = parameters.lanes_of(index, self.num_envs), self.simulator.dynamics.draw_fields
        if not names:
            raise ValueError("no effect of the scene draws; leave set_draws out")
        rows = parameters.table("draws", draws, len(lanes), len(names))
        if not ((rows >= 0.0) & (rows == np.floor(rows)) & (rows < 2.0**53)).all():
            raise ValueError("draws has entries that are no whole numbers; give those that 'draws' returned")
        self._memory.write(names, rows, lanes)

    @first
    def set_parameters(self, values: Mapping[str, ArrayLike], index: ArrayLike | None = None) -> None:
        """Set physical parameters of lanes.

        Parameters
        ----------
        values : mapping
            "masses", "lengths", or an effect's number such as "gravity.g" or
            "limit_spring.r1.upper" -> array that broadcasts to (lanes,) or (lanes, entries).
        """
        lanes, scene, memory = parameters.lanes_of(index, self.num_envs), self.scene, self._memory
        parameters.check_given(scene, values)
        table = parameters.lane_values(scene, memory, lanes, values, fresh=False)
        parameters.check_stops(scene, memory.read(scene.robot.coordinates, lanes), table)
        parameters.write(scene, memory, lanes, table)
        if any(name.startswith(f"{key}.") for key in scene.attached.keys_of(Impact) for name in values):
            memory.forget(lanes)  # a stop that holds a slider may be gone

    __getstate__ = first(Copied.__getstate__)

    @first
    def save(self) -> dict[str, Any]:
        """A snapshot of everything: states, parameters and modes of all lanes. It may be pickled, and
        ``np.savez(file, **snapshot)`` writes it; :meth:`restore` takes the result of ``np.load(file)``."""
        return {"simulator": self._facts, **self._memory.save()}

    @first
    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Return to a snapshot of :meth:`save`; the continuation is the same to the last bit. If the snapshot
        belongs to another scene, ``num_envs`` or ``track_work``, a ValueError names the difference, and
        nothing changes."""
        parameters.check_keys("snapshot", snapshot, ("simulator", "states", "parameters"), "save")
        parameters.check_facts("snapshot", snapshot["simulator"], self._facts)
        parameters.check_numbers("snapshot", snapshot, self._memory)
        self._memory.restore(snapshot["states"], snapshot["parameters"])

    @cached_property
    def _facts(self) -> str:
        return parameters.simulator_facts(self.simulator, self.num_envs)

    @first
    def advance(self, efforts: ArrayLike | None = None) -> Status:
        """Advance all lanes by one control interval under constant efforts.

        Parameters
        ----------
        efforts : (num_envs, joints) array, optional
            N m and N at the joints (``Scene.actuation``), or as many commands as ``Scene.command_units()``
            has, in these units; zero by default.
        """
        return self._advanced(efforts)

    def _advanced(self, efforts: ArrayLike | None) -> Status:
        count = len(self.simulator.dynamics.commands)
        values = parameters.numbers("efforts", np.zeros(count) if efforts is None else efforts)
        table = parameters.shaped("efforts", values, self.num_envs, count)
        if not table.flags.carray:
            table = table.copy(order="C")
        start, size = address(table), table.strides[0]
        for part in self._team.parts:
            part.set(efforts=start + part.first * LANES * size)
        self._team()
        return Status(*[column.copy() if changes else column for column, changes in self._outputs])

    @first
    def advance_partly(self, efforts: ArrayLike | None, duration: float) -> Status:
        """Advance by ``duration`` [s] instead of a control interval, in as many substeps. It is an interval
        of its own, with a start and an end; an instant of an effect happens in it if it is nearer to the
        start than ``duration``."""
        number = isinstance(duration, int | float | np.integer | np.floating)
        duration = float(duration) if isinstance(duration, np.floating) else duration
        if not number or not 0.0 < duration <= sys.float_info.max:
            raise ValueError(f"duration is {shown(duration)} s; it must be a finite and positive number")
        times = {"h": duration / self.scene.substeps, "interval": duration}
        # Pieces of an interval have steps of their own lengths.
        columns = {n: self._memory.column(n) for n in times if n in self._memory}
        usual = {name: column.copy() for name, column in columns.items()}
        try:
            for name, column in columns.items():
                column[:] = times[name]
            return self._advanced(efforts)
        finally:
            for name, column in columns.items():
                column[:] = usual[name]

    def _table(self, name: str, values: ArrayLike, lanes: int) -> NDArray[np.float64]:
        """Numbers of the joints of some lanes, (lanes, joints)."""
        return parameters.shaped(name, parameters.numbers(name, values), lanes, self.simulator.dynamics.count)
