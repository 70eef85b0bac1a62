"""Physical parameters of lanes: names, shapes and validity, for batches and environments alike; snapshots,
in which values that belong to a scene must be equal, and a difference is named."""

import copy
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.language.limits import ROUNDING
from redundant_envs.model.memory import Array, Memory
from redundant_envs.model.programs import Simulator
from redundant_envs.scenes.numbers import Table, check_named_once, check_values, names_of
from redundant_envs.scenes.scene import Scene
from redundant_envs.simulator.lane.fields import PARAMETER
from redundant_envs.support.values import shown
from redundant_envs.tasks.base import Task, hard_stops

KEPT_FIELDS = ("h", "interval", "control_dt", "tip_tolerance", "limit")
"""Parameters that belong to a simulator and to none of its states."""


def numbers(name: str, values: Any) -> Array:
    """Real numbers as an array; a ValueError that names them if they are anything else, truths among them."""
    try:
        array = np.asarray(values)
    except Exception:  # ragged lists, and objects whose conversion fails
        array = np.array(None)
    if array.dtype.kind not in "iuf" or (type(values) is not np.ndarray and _holds_truth(values)):
        raise ValueError(f"{name} is {shown(values)}; give real numbers, a list of them or an array")
    return array.astype(np.float64, copy=False)


def _holds_truth(values: Any) -> bool:
    """Whether True or False is among some numbers, which NumPy then takes for 1 and 0."""
    if isinstance(values, list | tuple):
        return any(map(_holds_truth, values))
    return isinstance(values, bool) or getattr(getattr(values, "dtype", None), "kind", "f") == "b"


def table(name: str, values: ArrayLike, lanes: int, width: int, absent: ArrayLike = 0.0) -> Array:
    """Finite numbers (lanes, width) from one, (width,) or (lanes, width); with a width of 1 also (lanes,).
    Infinite ones are allowed where ``absent`` (width,) has them, as an end of travel without a stop."""
    array = numbers(name, values)
    if array.ndim == 0:
        array = np.full(width, array)
    elif width == 1 and array.shape == (lanes,):
        array = array[:, None]
    array = shaped(name, array, lanes, width)
    if not (np.isfinite(array) | (array == absent)).all():
        raise ValueError(f"{name} has non-finite entries; give finite numbers")
    return array


def shaped(name: str, array: Array, lanes: int, width: int) -> Array:
    """Numbers (lanes, width) from those of one lane or of all."""
    if array.shape not in ((width,), (1, width), (lanes, width)):
        raise ValueError(f"{name} has shape {array.shape}; give ({width},) or ({lanes}, {width})")
    return array if array.shape == (lanes, width) else np.broadcast_to(array, (lanes, width))


def lanes_of(index: ArrayLike | None, count: int) -> NDArray[np.int64]:
    """Lane numbers, from an argument ``index``: one or some numbers of lanes, a mask, or None for all."""
    if index is None:
        return np.arange(count)
    lanes = np.atleast_1d(index)
    if lanes.dtype == bool and lanes.shape == (count,):
        return np.flatnonzero(lanes)
    if lanes.ndim > 1 or (lanes.size and lanes.dtype.kind not in "iu"):
        raise ValueError(f"index is {shown(index)}; give whole numbers, or a mask of ({count},) bool")
    if lanes.size and (lanes.min() < 0 or lanes.max() >= count):
        raise ValueError(f"index has {lanes.min()}..{lanes.max()}; lanes are 0..{count - 1}")
    if len(np.unique(lanes)) < lanes.size:
        raise ValueError(f"index is {lanes.tolist()}; name every lane once")
    return lanes.astype(np.int64)


def lane_values(
    scene: Scene, memory: Memory, lanes: NDArray[np.intp], parameters: Mapping[str, Any], fresh: bool,
    task: Task | None = None,
) -> Table:  # fmt: skip
    """All parameters of some lanes once the given ones are set; ValueError if one is not valid. The others
    are the present ones, or those of the scene and of the task if ``fresh``."""
    of_task = {} if task is None else task.parameters()
    nominal = {**scene.parameters(), **of_task}
    values = present(memory, lanes, nominal)
    if fresh:
        values = {name: np.full(len(lanes), number) for name, number in nominal.items()}
    changed: list[str] = []
    for name, value in parameters.items():
        names = names_of(scene, name, of_task)
        columns = table(name, value, len(lanes), len(names), [nominal[p] for p in names])
        values |= zip(names, columns.T.copy(), strict=True)
        changed += names
    check_values(scene, task, values, changed)
    return values


def check_given(scene: Scene, parameters: Any, of_task: Iterable[str] = ()) -> None:
    """ValueError if parameters that a user gives are no mapping, or if two names mean one number."""
    if not isinstance(parameters, Mapping):
        raise ValueError(f"parameters is {shown(parameters)}; give a mapping of names to numbers")
    check_named_once("parameters set", {name: names_of(scene, name, of_task) for name in parameters})


def present(memory: Memory, lanes: NDArray[np.intp], names: Iterable[str]) -> Table:
    """Parameters that some lanes have."""
    fields = {name: memory.dynamics.parameters.field_of(name) for name in names}
    return dict(zip(fields, memory.read([*fields.values()], lanes).T, strict=True))


def stops_of(memory: Memory, lanes: NDArray[np.intp]) -> Table:
    """The hard ends of travel that some lanes have."""
    return present(memory, lanes, [end for _, *ends in hard_stops(memory.dynamics.scene) for end in ends])


def check_stops(scene: Scene, q: Array, values: Table, where: str = "") -> None:
    """ValueError, which begins with ``where``, if a joint is beyond a hard end of its travel."""
    for joint, lower, upper in hard_stops(scene):
        slides = scene.robot.prismatic[joint]
        x, low, high = q[:, joint], values[lower], values[upper]
        rounding: Any = 0.0
        if not slides:  # an angle may be a difference of coordinates, which are rounded
            column = scene.robot.motor_map[:, joint]
            x, size = q @ column, np.abs(q * (column != 0.0)).max(axis=1)
            finite = [np.where(np.isfinite(end), np.abs(end), 0.0) for end in (low, high)]
            rounding = 0.5 * ROUNDING * np.maximum(size, np.maximum(*finite))
        unit = "m" if slides else "rad"
        for lane in np.flatnonzero((x < low - rounding) | (x > high + rounding)).tolist():
            raise ValueError(
                f"{where}{scene.robot.joints[joint]} is {x[lane]:.6g} {unit}; its stops are at "
                f"{low[lane]:.6g} and {high[lane]:.6g} {unit}: put it between them"
            )


def write(scene: Scene, memory: Memory, lanes: NDArray[np.intp], values: Table) -> None:
    """Set parameters of lanes, and the fields that follow from them; where episodes draw numbers, the reset
    that comes next computes these fields."""
    fields = tuple(map(memory.dynamics.parameters.field_of, values))
    if memory.write(fields, np.stack([*values.values()], axis=1), lanes) and not memory.drawn:
        memory.prepare()


def simulator_facts(simulator: Simulator, num_envs: int, **more: Any) -> str:
    """Data that must be equal for a state and the simulator that takes it, as JSON text."""
    dynamics = simulator.dynamics
    facts = {"num_envs": num_envs, **dynamics.scene.facts(), **more, "track_work": dynamics.track_work}
    return json.dumps({**facts, "program": simulator.identity[:16]}, default=_in_json, skipkeys=True)


def _in_json(value: Any) -> Any:
    """An array as a list, and the class of any other object: the program says what it does."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return f"{type(value).__module__}.{type(value).__qualname__}"


def check_keys(name: str, state: Any, keys: Iterable[str], source: str) -> None:
    """ValueError unless a state is a mapping with these keys and no other."""
    if not isinstance(state, Mapping):
        raise ValueError(f"{name} is {shown(state)}; use the mapping that {source} returned")
    if {*state} != {*keys}:
        has, needs = (", ".join(map(str, some)) for some in (state, keys))
        raise ValueError(f"{name} has the keys {has}, and needs {needs}; use what {source} returned")


def check_facts(name: str, theirs: Any, expected: str) -> None:
    """ValueError that names the difference, if a state belongs to another simulator."""
    text = str(theirs)  # np.savez makes an array of a text
    if text == expected:
        return
    try:
        differences = list(_differences("", json.loads(text), json.loads(expected)))
    except (ValueError, RecursionError):  # the latter comes from deeply nested brackets
        raise ValueError(f"{name}['simulator'] is {shown(text)}; it must be the text of a snapshot") from None
    more = f", and {len(differences) - 4} more differences" if len(differences) > 4 else ""
    raise ValueError(
        f"{name} is of another scene: {'; '.join(differences[:4])}{more}; build an equal one for this state"
    )


def _differences(name: str, there: Any, here: Any) -> Iterator[str]:
    """Differences between plain data: names, with both values."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in [*here, *(k for k in there if k not in here)]:
            yield from _differences(f"{name}.{key}" if name else key, there.get(key), here.get(key))
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for k, pair in enumerate(zip(there, here, strict=True)):
            yield from _differences(f"{name}[{k}]", *pair)
    elif there != here:
        yield f"{name} is {_short(there)} there and {_short(here)} here"


def _short(value: Any) -> str:
    if isinstance(value, list):  # of effects their names are enough
        value = [v["type"] if isinstance(v, dict) and "type" in v else v for v in value]
    return value if isinstance(value, str) else shown(value)


def check_array(name: str, key: str, value: Any, like: NDArray[Any]) -> None:
    """ValueError unless a value is an array of the same shape and dtype as another."""
    of_array = "an array of shape {0.shape} and dtype {0.dtype}".format
    if not isinstance(value, np.ndarray) or (value.shape, value.dtype) != (like.shape, like.dtype):
        text = of_array(value) if isinstance(value, np.ndarray) else shown(value)
        raise ValueError(f"{name}[{key!r}] is {text}; give {of_array(like)}")


def check_numbers(
    name: str, state: Mapping[str, Any], memory: Memory, constant: Iterable[str] = (),
    finite: Iterable[str] = (), task: Task | None = None,
) -> None:  # fmt: skip
    """ValueError unless the "states" and "parameters" of a state may replace those of a memory. The
    parameters ``constant`` are equal in all states, as are :data:`KEPT_FIELDS`; the states ``finite`` are
    never without a number; the numbers of a task are parameters, too."""
    saved, layout, scene = memory.save(), memory.layout, memory.dynamics.scene
    of_task = {} if task is None else task.parameters()
    check_array(name, "states", state["states"], saved["states"])
    parameters, width = state["parameters"], layout.size(PARAMETER) * LANES
    shared = isinstance(parameters, np.ndarray) and parameters.size == width  # by all lanes
    check_array(name, "parameters", parameters, np.empty(width if shared else memory.blocks * width))
    taken, nominal = copy.copy(memory), {**scene.parameters(), **of_task}
    taken.restore(state["states"], parameters)
    for row in (*memory.dynamics.parameters.values, *of_task):
        there, here = taken.column(row), memory.column(row)
        if not (np.isfinite(there) | (there == here[:1, :1])).all():  # a side without a stop is infinite
            raise ValueError(f"{name}['parameters'] has a {row} that is not finite; give finite ones")
    for row in finite:
        if not np.isfinite(taken.column(row)).all():
            raise ValueError(f"{name}['states'] has a {row} that is not finite; give finite numbers")
    for row in (n for n in (*KEPT_FIELDS, *constant) if n in memory):
        there, here = taken.column(row), memory.column(row)
        if not (there == here[0, 0]).all():
            raise ValueError(
                f"{name}['parameters'] has the {row} {there.flat[0]:.6g}, this one {here.flat[0]:.6g}: "
                "it belongs to the scene and not to a state"
            )
    try:
        if not np.array_equal(parameters, saved["parameters"]):
            values = present(taken, taken.index, nominal)
            changed = [p for p, number in nominal.items() if (values[p] != number).any()]
            check_values(scene, task, values, changed)
        check_stops(scene, taken.read(scene.robot.coordinates), stops_of(taken, taken.index))
    except ValueError as error:
        raise ValueError(f"{name} holds an impossible state: {error}") from None
