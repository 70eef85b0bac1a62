"""Programs of all scenes, told by digests: a change that is meant to leave them alone shows that it does.

``python -m tests.lane.programs`` names the programs that differ from those recorded, ``--record`` records
them; say in the commit why they changed. Nothing is compiled.
"""

import dataclasses
import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import redundant_envs as rde
from redundant_envs.compiler.tracing.graph import Operation, Value, bits_of, reached
from redundant_envs.model import programs
from redundant_envs.model.programs import Simulator
from redundant_envs.scenes.scene import scene_names
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.checks import check_task
from tests import catalogue
from tests.catalogue import DELAYS, DRY_FRICTION, FOUR_R, RPRP, joint_stops, springs, stops
from tests.outside.wall import Wall

e = rde.effects
RECORD = Path(__file__).with_name("programs.json")


def together() -> Iterator[tuple[str, rde.Scene]]:
    """Effects that meet in no scene of the catalogue: walls, stops, dry friction, guards, and instants."""
    motor, at_stops = e.TorqueSpeed(4.0, 20.0), (stops(RPRP),)
    stops_and_delays = (*at_stops, *DELAYS)
    joints = (*joint_stops(RPRP), *DRY_FRICTION, motor, *DELAYS)
    many = (*catalogue.every_effect(RPRP)[:-1], Wall(), *DRY_FRICTION, *DELAYS)
    stepped = {"integrator": "rk8", "substeps": 1, "tolerance": None}
    accurate = {"tolerance": 1e-6}
    for name, arm, effects, numerics in (
        ("wall rk8", FOUR_R, (Wall(),), stepped),
        ("wall 1e-6", RPRP, (Wall(), *at_stops), accurate),
        ("wall friction 1e-6", FOUR_R, (Wall(), *DRY_FRICTION), accurate),
        ("wall dop853", RPRP, (Wall(), *at_stops), {"integrator": "dop853"}),
        ("stops delays rk8", RPRP, stops_and_delays, stepped),
        ("stops delays 1e-6", RPRP, stops_and_delays, accurate),
        ("stops delays substeps", RPRP, stops_and_delays, {"integrator": "rk4", "substeps": 3}),
        ("stops delays dop853", RPRP, stops_and_delays, {"integrator": "dop853"}),
        ("stops guards 1e-6", RPRP, (*at_stops, motor), accurate),
        ("friction delays 1e-6", FOUR_R, (*DRY_FRICTION, *DELAYS), accurate),
        ("friction dop853", FOUR_R, DRY_FRICTION, {"integrator": "dop853"}),
        ("joint stops guards dop853", RPRP, (*joint_stops(RPRP), motor), {"integrator": "dop853"}),
        ("joint stops friction guards delays 1e-6", RPRP, joints, accurate),
        ("limits stops friction 1e-6", RPRP, (*springs(RPRP), *at_stops, *DRY_FRICTION), accurate),
        ("everything stops friction wall delays 1e-6", RPRP, many, accurate),
    ):
        yield f"together: {name}", rde.Scene(arm, effects, control_dt=0.01, **numerics)


SCENES = dict(together()) | catalogue.SCENES | {f"config {n}": rde.load_scene(n) for n in scene_names()}


def simulators(scene: rde.Scene) -> Iterator[tuple[str, Simulator]]:
    """Those of a batch, of one whose work is kept, and of an environment if the scene can have one."""
    yield "batch", programs.traced_batch(scene, False)
    yield "work", programs.traced_batch(scene, True)
    task = ReachTask()
    limited = any(isinstance(effect, e.EffortLimits) for effect in scene.effects)
    if not limited and {*scene.command_units()} <= {"N", "N m"}:
        limits = e.EffortLimits((4.0,) * len(scene.robot.joints))
        scene = dataclasses.replace(scene, effects=(*scene.effects, limits))
    try:
        check_task(task, scene)
    except ValueError:
        return
    yield "environment", programs.traced_environment(scene, task)


def digests(scene: rde.Scene) -> dict[str, list[str]]:
    """By the kind of a simulator: its identity; and what is written to each field, by the names of fields,
    whatever their rows and the order of operations."""
    return {kind: [s.identity[:16], _by_names(s)] for kind, s in simulators(scene)}


def _by_names(simulator: Simulator) -> str:
    names = {place: name for name, place in simulator.blocks.layout.places().items()}

    def extra(node: Operation) -> object:
        if node.name == "stage":
            return _of_subroutine(node.extra)
        return names.get(node.extra, node.extra) if node.name == "load" else node.extra

    told = []
    for f in simulator.program.functions.values():
        of = _texts(f.results, extra, repr)
        stores = sorted(f"{names.get((space, row), row)} {of(value)}" for space, row, value in f.stores)
        outputs = sorted(f"{o.array} {o.column} {o.columns} {o.element} {of(o.value)}" for o in f.outputs)
        constants = sorted(f"{names.get(place, place)} {value}" for place, value in f.known.items())
        told += [f.name, str(f.joins), str(sorted(f.inputs.items())), *stores, *outputs, *constants]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]


def _of_subroutine(subroutine) -> str:
    """The function that all stages of a step share, by the names of its arguments."""
    results = subroutine.traced()[0]
    of = _texts(results, lambda node: node.extra, lambda constant: bits_of(constant).hex())
    return "\0".join((*map(of, results), *subroutine.names))


def _texts(results, extra: Callable[[Operation], object], constant: Callable[..., str]) -> Callable[..., str]:
    """A function from the values that some results need to texts of what they are computed by."""
    known: dict[Operation, str] = {}

    def of(value: Value) -> str:
        return known[value] if isinstance(value, Operation) else constant(value)

    for node in reached(results):
        text = "\0".join((node.name, str(extra(node)), *map(of, node.arguments)))
        known[node] = hashlib.sha1(text.encode()).hexdigest()
    return of


def recorded() -> dict[str, dict[str, list[str]]]:
    return json.loads(RECORD.read_text(encoding="utf-8"))


def main() -> None:
    found, record = {}, recorded() if RECORD.exists() else {}
    for name, scene in SCENES.items():
        found[name] = digests(scene)
        for kind, digest in found[name].items():
            before = record.get(name, {}).get(kind, ["", ""])
            if digest != before:
                print(f"{name}, {kind}:", "other rows" if digest[1] == before[1] else "another program")
    print(f"{sum(map(len, found.values()))} programs of {len(found)} scenes")
    if "--record" in sys.argv:
        rows = (f'  "{name}": {json.dumps(kinds)}' for name, kinds in found.items())
        RECORD.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
