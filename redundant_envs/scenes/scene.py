"""A scene: an arm and only the effects it needs, with how it is stepped. Plain, frozen data."""

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from redundant_envs.effects import REGISTRY as EFFECTS
from redundant_envs.effects.bound_hooks import Attachments, identifier
from redundant_envs.effects.hooks import MAX_INSTANTS, Actuation, Effect, Impact, State
from redundant_envs.effects.numbers import COMMAND
from redundant_envs.effects.validate_hooks import check_attached
from redundant_envs.robots import REGISTRY as ARMS
from redundant_envs.robots import drawn
from redundant_envs.robots.added_inertia import WithAddedInertia
from redundant_envs.robots.arm import Arm
from redundant_envs.robots.checks import check_own
from redundant_envs.robots.parameters import between, number
from redundant_envs.scenes import config_folder
from redundant_envs.scenes.files import exists, explained, read_yaml, shipped_data
from redundant_envs.scenes.numbers import check_ranges, entries_of, is_of_task
from redundant_envs.scenes.ranges import plain_ranges, ranges
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.support.notebook import as_html, table
from redundant_envs.support.values import (
    check_between,
    check_keys,
    check_registered,
    plain,
    shown,
    typed,
    warn,
    whole_number,
)

MAX_SUBSTEPS = 1_000_000
"""Steps per control interval: with more a single interval takes a second or longer."""
SHORTEST_INTERVAL, LONGEST_INTERVAL = 1e-9, 1e3
"""Allowed control intervals, s."""
LONG_INTERVAL = 0.5
"""s: a longer one may be meant in milliseconds. Motors of arms get a command every 1 to 50 ms."""
_told: dict[int, float] = {}
"""Long control intervals of scenes that were told, by their identity: scenes that are made from another one
have the number itself, and are silent."""
ACTUATIONS = ("joint", "generalized")
SMALLEST_TOLERANCE, LARGEST_TOLERANCE = 1e-13, 1e-2
"""Allowed tip errors per control interval, m."""
ACCURACIES = {"standard": 1e-6, "exact": 1e-12}
"""Named tolerances: tip error per control interval, m."""
STEPPING = ("integrator", "substeps", "tolerance")
"""Fields that say how accurate a scene is."""


@dataclass(frozen=True)
class Scene:
    """An arm, its effects, and how it is stepped.

    Parameters
    ----------
    robot : Arm
    effects : sequence of effects
        Only these are simulated. Two effects may not have the same key.
    integrator : {"euler", "rk4", "rk8", "dop853"}
        Or a registered one. "dop853" takes steps of any length, whose error stays near rounding.
    control_dt : float
        Control interval [s], 1e-9 to 1000; efforts are constant over it. One above 0.5 s is warned about.
    substeps : int
        Equal steps per control interval, at most a million.
    tolerance : float, optional
        Largest estimated tip error of a control interval [m]: every lane takes as many rk8 steps
        as that needs, 1, 2, 4, ... 16384. None means fixed steps.
    actuation : {"joint", "generalized"}
        "joint": efforts act at the joints, Q = B t. "generalized": the report's convention,
        efforts conjugate to the absolute angles.
    randomize : mapping of str to mapping, optional
        Numbers of the arm, of effects or of the task that every episode of an environment draws anew, by
        their names, such as {"gravity.g": {"uniform": [9, 10]}}; docs/scenes.md has all forms. Simulations
        and batches, which have no episodes, use the numbers of arm and effects. It is kept as a tuple of
        :class:`~redundant_envs.scenes.ranges.Range`.
    """

    robot: Arm
    effects: Sequence[Effect] = ()
    integrator: str = "rk8"
    control_dt: float = 0.02
    substeps: int = 1
    tolerance: float | None = None
    actuation: str = "joint"
    randomize: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Arm):
            raise ValueError(f"robot is {shown(self.robot)}; give an arm: {', '.join(sorted(ARMS))}")
        check_own(self.robot)
        object.__setattr__(self, "control_dt", self._checked_interval())
        object.__setattr__(self, "effects", self._fitted_effects())
        impacts = self.attached.of(Impact)
        for slides, joints in ((True, "sliders"), (False, "revolute joints")):
            alike = [a for a in impacts if self.robot.prismatic[a.hook.joint] == slides]
            if len({a.parameter(a.hook.restitution) for a in alike}) > 1:
                raise ValueError(
                    f"effects has stops with several restitutions; give one number for all stops of {joints}"
                )
        if len({a.hook.joint for a in impacts}) < len(impacts):
            raise ValueError("effects has two stops for one joint; combine them into one")
        taken: dict[str, str] = {}  # every parameter is a row of its own in the compiled core
        for name in (*self._parameters, *self.states()):
            if (other := taken.setdefault(identifier(name), name)) != name:
                raise ValueError(f"effects have {other!r} and {name!r}, too much alike; rename one")
        if isinstance(self.robot, WithAddedInertia):
            raise ValueError(f"robot is a {self.robot.kind} with added inertias; give the scene's own robot")
        for joint in range(len(self.robot.joints)):
            self.attached.units_along(joint, self.robot)  # refuses chains whose units do not meet
        _ = self.loaded_robot  # refuses impossible masses and inertias
        _ = self.attached.draws  # refuses states whose draws would be those of others
        if len(owners := [a.key for a in self.attached.instants]) > MAX_INSTANTS:
            raise ValueError(f"effects has instants of {', '.join(owners)}; give at most {MAX_INSTANTS}")
        if not isinstance(self.integrator, str) or self.integrator not in METHODS:
            raise ValueError(f"integrator is {shown(self.integrator)}; choose {', '.join(METHODS)}")
        object.__setattr__(self, "substeps", whole_number("substeps", self.substeps))
        check_between("substeps", self.substeps, 1, MAX_SUBSTEPS)
        if self.integrator == "dop853" and self.substeps != 1:
            raise ValueError(f"substeps is {self.substeps}; dop853 chooses its steps itself: leave it at 1")
        if self.tolerance is not None:
            tolerance = between("tolerance", self.tolerance, SMALLEST_TOLERANCE, LARGEST_TOLERANCE, " m")
            object.__setattr__(self, "tolerance", tolerance)
            if self.integrator != "rk8" or self.substeps != 1:
                text = f"integrator {self.integrator!r} and substeps {self.substeps}"
                fix = "give it with integrator 'rk8' and 1 substep alone"
                raise ValueError(f"tolerance is {tolerance} m with {text}; {fix}")
        if not isinstance(self.actuation, str) or self.actuation not in ACTUATIONS:
            raise ValueError(f"actuation is {shown(self.actuation)}; choose {', '.join(ACTUATIONS)}")
        object.__setattr__(self, "randomize", ranges({} if self.randomize is None else self.randomize))
        check_ranges(self, entries_of(self, [one for one in self.randomize if not is_of_task(one.name)]))

    def _fitted_effects(self) -> tuple[Effect, ...]:
        """The effects with a number for each joint of this arm; ValueError if they cannot act on it."""
        if isinstance(self.effects, Effect):
            one = shown(self.effects)
            raise ValueError(f"effects is the effect {one}; give a sequence, effects=({one},)")
        if isinstance(self.effects, str | bytes | Mapping) or not isinstance(self.effects, Iterable):
            what = shown(self.effects)
            raise ValueError(f"effects is {what}; give a sequence of effects, such as effects=(Gravity(),)")
        fitted: dict[str, Effect] = {}
        for i, item in enumerate(self.effects):
            if not isinstance(item, Effect):
                known = ", ".join(sorted(EFFECTS))
                raise ValueError(f"effects[{i}] is {shown(item)}; give an effect: {known}")
            effect = item.fitted(self.robot).at_interval(self.control_dt)
            check_attached(f"effects[{i}]", effect, self.robot)
            other = fitted.setdefault(effect.key, effect)
            if other is not effect:
                fix = "combine the two, or give one of them another 'name' or 'key'"
                raise ValueError(f"effects[{i}] is a second {effect.key!r}; {fix}")
        return tuple(fitted.values())

    def _checked_interval(self) -> float:
        dt = between("control_dt", self.control_dt, SHORTEST_INTERVAL, LONGEST_INTERVAL, " s")
        if dt > LONG_INTERVAL and id(dt) not in _told:
            dt += 0.0  # a number of its own, which no other scene has
            _told[id(dt)] = dt
            warn(
                f"control_dt is {dt:g}, in seconds, so that efforts are constant for {dt:g} s, and simulated "
                f"so; for {dt:g} ms give {dt / 1000.0:g}"
            )
        return dt

    def parameters(self) -> dict[str, float]:
        """All numbers of the scene by parameter name: "m1", "gravity.g", "limit_spring.r1.upper"."""
        return dict(self._parameters)

    def states(self) -> dict[str, State]:
        """States of the effects by name: "lag.effort[0]"."""
        return dict(self.attached.states)

    @functools.cached_property
    def _parameters(self) -> dict[str, float]:
        values = dict(self.robot.parameter_values())
        for effect in self.effects:
            values.update({f"{effect.key}.{k}": v for k, v in effect.parameters().items()})
        return values

    @functools.cached_property
    def loaded_robot(self) -> Arm:
        """The arm with the masses and inertias that effects add to its own."""
        return self.attached.loaded(self.robot, self._parameters)

    @functools.cached_property
    def attached(self) -> Attachments:
        """The hooks of the effects, bound to names of quantities."""
        return Attachments.to(self.robot, self.effects, self.controlled)

    def bound_anew(self) -> Self:
        """The same scene, whose effects are asked for their hooks again: their functions may be replaced."""
        copy = object.__new__(type(self))
        copy.__dict__.update({f.name: getattr(self, f.name) for f in dataclasses.fields(self)})
        return copy

    @property
    def controlled(self) -> bool:
        """Whether error control chooses the steps."""
        return self.tolerance is not None or self.integrator == "dop853"

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "attached"}

    def _repr_html_(self) -> str:
        """The arm, the numbers of the effects and how the scene is stepped, for a notebook."""

        def schematic() -> str:
            values = self.parameters()
            travel = {k: (values[low], values[high]) for k, (low, high) in self.travel().items()}
            return drawn.schematic(self.robot, travel)

        def stepping() -> str:
            rows = [("integrator", self.integrator), ("control interval", f"{self.control_dt:g} s")]
            if self.tolerance is not None:
                rows.append(("tolerance", f"{self.tolerance:g} m at the tip"))
            elif not self.controlled:
                rows.append(("steps", f"{self.substeps}"))
            rows.append(("efforts", self.actuation))
            drawn_numbers = plain_ranges(self.randomize).items() if self.randomize else ()
            rows += [(f"{name} of an episode", distribution) for name, distribution in drawn_numbers]
            return table(("stepped by", ""), rows)

        titles = ("effect", "number", "value", "unit")
        numbers = (lambda: drawn.numbers(self.robot)), (lambda: table(titles, self._effect_rows()))
        return as_html(self, schematic, *numbers, stepping)

    def _effect_rows(self) -> list[tuple[str, str, str, str]]:
        """A row for each number of each effect, with one value for each joint where they differ."""
        units, rows = self.units(), []
        for effect in self.effects:
            numbers, named = effect.parameters(), dict[str, list[str]]()
            for entry in numbers:
                named.setdefault(entry.partition("[")[0], []).append(entry)
            for name, entries in named.items():
                values = [f"{numbers[entry]:.6g}" for entry in entries]
                value = ", ".join(values) if len({*values}) > 1 or len(values) == 1 else f"{values[0]} each"
                of = (units.get(f"{effect.key}.{x}", units.get(f"{effect.key}.{name}", "")) for x in entries)
                rows.append((effect.key, name, value, ", ".join(dict.fromkeys(of))))
            if not named:
                rows.append((effect.key, "", "", ""))
        return rows

    def travel(self) -> dict[int, tuple[str, str]]:
        """Limited joints: joint index -> parameter names of its lower and upper limit."""
        limits: dict[int, tuple[str, str]] = {}
        hard = self.attached.keys_of(Impact)  # A hard stop is the limit, whatever else acts near it.
        for effect in sorted(self.effects, key=lambda e: e.key in hard):
            for joint, (low, high) in effect.travel(self.robot).items():
                limits[joint] = (f"{effect.key}.{low}", f"{effect.key}.{high}")
        return limits

    def action_units(self) -> tuple[str, ...]:
        """Parameters in units of which an environment takes its actions, one for each command; () if none."""
        links = sorted(self.attached.of(Actuation), key=lambda link: link.hook.link)
        units = ((e.key, e.action_units(self.robot)) for e in (*(a.effect for a in links), *self.effects))
        return next((tuple(f"{key}.{name}" for name in names) for key, names in units if names), ())

    def effort_units(self) -> tuple[str, ...]:
        """Parameters in units of which the efforts of a mode of actions are counted, one for each joint; ()
        of a scene without a mode, whose actions are efforts themselves."""
        units = ((e.key, e.effort_units(self.robot)) for e in self.effects)
        return next((tuple(f"{key}.{name}" for name in names) for key, names in units if names), ())

    def command_units(self) -> tuple[str, ...]:
        """Units of the commands: those of the motors' efforts, N m and N, unless an effect takes others."""
        if self.attached.sharing is not None:
            return self.attached.sharing[1]
        return tuple(self.attached.units_along(k, self.robot)[0][1] for k in range(len(self.robot.joints)))

    def units(self) -> dict[str, str]:
        """Known units of the effects' numbers: "gravity.g" -> "m/s^2"."""
        units = {}
        for effect in self.effects:
            for name, unit in effect.units(self.robot).items():
                if unit == COMMAND:
                    along = self.attached.units_along(int(name.partition("[")[2][:-1]), self.robot)
                    unit = next(unit for owner, unit in along if owner is effect)
                units[f"{effect.key}.{name}"] = unit
        return units

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data that :meth:`from_dict` turns back into an equal scene."""
        check_registered("robot", self.robot.kind, self.robot, ARMS)
        for i, effect in enumerate(self.effects):
            check_registered(f"effects[{i}]", type(effect).__name__, effect, EFFECTS)
        return self.facts()

    def facts(self) -> dict[str, Any]:
        """The same for any scene; for comparisons, not for :meth:`from_dict`."""
        effects = [plain(type(e).__name__, e) for e in self.effects]
        numbers = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        drawn = numbers.pop("randomize")
        facts = {**numbers, "robot": plain(self.robot.kind, self.robot), "effects": effects}
        return {**facts, "randomize": plain_ranges(drawn)} if drawn else facts

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """A scene from plain data; unknown names are errors that list the valid ones. Data with neither a
        tolerance nor an integrator nor substeps have the tolerance of "standard"."""
        if not isinstance(data, Mapping):
            raise ValueError(f"scene is {shown(data)}; give a mapping")
        check_keys("scene", data, [f.name for f in dataclasses.fields(cls)])
        if "robot" not in data:
            raise ValueError("scene has no 'robot'; give its type, masses and lengths")
        robot = typed("robot", data["robot"], ARMS)
        effects = data.get("effects", ())
        if not isinstance(effects, list | tuple):
            raise ValueError(f"effects is {shown(effects)}; give a list of mappings with a 'type'")
        built = tuple(typed(f"effects[{i}]", e, EFFECTS) for i, e in enumerate(effects))
        rest = {k: v for k, v in data.items() if k not in ("robot", "effects")}
        if rest.keys().isdisjoint(STEPPING):
            rest["tolerance"] = ACCURACIES["standard"]
        return cls(robot, built, **rest)


def check_scene(scene: Any) -> None:
    """ValueError unless it is a scene; names and files are loaded by :func:`load_scene`."""
    if not isinstance(scene, Scene):
        raise ValueError(f"scene is {shown(scene)}; give a Scene, such as rde.load_scene makes")


def scene_names() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(p.stem for p in config_folder("scenes").glob("*.yaml"))


def load_scene(scene: str | Path | Mapping[str, Any] | Scene) -> Scene:
    """A scene by its name, the path of a YAML file, or as plain data; a ValueError has the file and, where it
    is known, the line of the mistake."""
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, Mapping):
        return Scene.from_dict(scene)
    data = scene_data(scene)
    with explained(scene_path(scene)):
        return Scene.from_dict(data)


def scene_path(scene: str | Path) -> Path:
    """The file of a scene; a name refers to a scene of the package."""
    if isinstance(scene, Path) or scene.endswith((".yaml", ".yml")):
        return Path(scene)
    return config_folder("scenes") / f"{scene}.yaml"


def scene_data(scene: str | Path) -> Any:
    """What the file of a scene holds."""
    if not isinstance(scene, str | Path):
        raise ValueError(f"scene is {type(scene).__name__}; give a name, a path or a mapping")
    path = scene_path(scene)
    if not exists(path):
        raise ValueError(
            f"scene is {shown(str(scene))}; there is no such file and no such name: "
            f"{', '.join(scene_names())}"
        )
    return read_yaml(path, "scene") if path == Path(scene) else shipped_data(path, "scene")


def scene_at(scene: str | Path | Mapping[str, Any] | Scene, accuracy: str | float | None) -> Scene:
    """A scene at an accuracy of :data:`ACCURACIES`, or at a tip error per control interval [m].

    With None a scene keeps its own integrator, substeps and tolerance.
    """
    built = load_scene(scene)
    if accuracy is None:
        return built
    keys: list[str] = []  # of what accuracy sets, that which the data of a scene of a user gives
    if not (isinstance(scene, Scene) or (isinstance(scene, str) and not scene.endswith((".yaml", ".yml")))):
        data = scene if isinstance(scene, Mapping) else scene_data(scene)
        keys = [k for k in STEPPING if k in data]
    if keys:
        raise ValueError(
            f"accuracy is {shown(accuracy)}, as well as {', '.join(keys)}; give one or the other"
        )
    if isinstance(accuracy, str):
        if accuracy not in ACCURACIES:
            raise ValueError(f"accuracy is {shown(accuracy)}; give {', '.join(ACCURACIES)} or metres")
        accuracy = ACCURACIES[accuracy]
    return dataclasses.replace(built, integrator="rk8", substeps=1, tolerance=number("accuracy", accuracy))
