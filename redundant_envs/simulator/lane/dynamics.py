"""The dynamics of a scene: functions of its arm and its effects, connected by the names of quantities."""

import functools
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from redundant_envs.compiler.tracing.graph import owned
from redundant_envs.effects import hooks
from redundant_envs.effects.bound_hooks import Attached, EffectStates, field_of
from redundant_envs.effects.obstacles import clearance_functions
from redundant_envs.language.algebra import ABSENT, any_of, gives_of, numbered, physics, total, where
from redundant_envs.language.draws import KEY_WORDS, Draw, drawn
from redundant_envs.language.quantities import Quantities
from redundant_envs.robots.added_inertia import functions_with, held_functions
from redundant_envs.robots.derived import held_joint_dynamics
from redundant_envs.scenes.scene import Scene
from redundant_envs.scenes.tableaus import METHODS, Tableau
from redundant_envs.simulator.lane import fields, sensing
from redundant_envs.simulator.lane.closed_forms import Closing, varying_arguments
from redundant_envs.simulator.lane.fields import ENGINE, PARAMETER, SCRATCH, STATE, Lifetime, Variable, engine
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.simulator.lane.parameters import SceneParameters

DRAW_KEY = tuple(numbered("draw_key{}", KEY_WORDS))
INTERVALS = "draw_interval"
"""Fields with the words of the key of a lane's draws, and the control intervals since it began to draw."""
Changes = dict[str, Any]
"""Rates of change, or new values, of effects' states by their fields."""
ARGUMENTS = dict.fromkeys(("ax", "ay"), f"of {ENGINE}: minus the gravity vector, m/s^2")
"""Quantities that are no fields in every scene, and whose names they are."""


class Dynamics:
    """The equations of motion of a scene. With ``track_work`` the work of motors and of forces without a
    potential is a state, too. Laws of forces change by the position at each evaluation unless error control
    has them ``located`` in time."""

    def __init__(self, scene: Scene, track_work: bool = False, located: bool = True) -> None:
        attached, arm = scene.attached, scene.robot
        self.scene, self.track_work, self.located = scene, track_work, located
        self.arm: Any = arm
        self.count = len(arm.coordinates)
        """Joints of the arm."""
        self.method: Tableau = METHODS[scene.integrator]
        self.parameters = SceneParameters(scene)
        self.controlled = scene.controlled
        """Whether error control chooses the steps."""
        self.locates_laws = self.controlled and located
        """Whether changes of laws are located; otherwise each evaluation decides which one holds."""
        self.commands = attached.commands
        """Fields of the commanded efforts."""
        self.passed = tuple(a.passed for a in attached.instants)
        """Fields that say which instants have passed."""

        # ---- states
        self.effect_states: EffectStates = attached.states
        self.closed = () if self.controlled else self.effect_states.closed
        """States of effects that steps evaluate in closed form: none if error control chooses the steps."""
        stepped = (name for name in self.effect_states.integrated if name not in self.closed)
        work = ("work",) if track_work else ()
        self.states: tuple[str, ...] = (*arm.coordinates, *arm.rates, *stepped, *work, *self.closed)
        """Integrated states: coordinates, velocities, those of effects, and the work; then those of effects
        that steps evaluate in closed form."""
        self.draws: Mapping[str, Draw] = attached.draws
        """Draws of effects' states, by the names of their quantities."""
        self.draw_fields = (*DRAW_KEY, INTERVALS) if self.draws else ()

        # ---- laws, and joints that stick
        self.guarded = tuple(a for a in attached if a.guards) if self.locates_laws else ()
        """Forces and links with guards whose changes of sign are located."""
        self.bounds_late_switch = bool(self.guarded) and scene.tolerance is not None
        """Whether laws are compared where a guard has passed 0: how late that may be found depends on it."""
        self.frictions: dict[int, list[Attached[hooks.Friction]]] = {}
        """Dry friction by the numbers of its joints."""
        for a in attached.of(hooks.Friction):
            self.frictions.setdefault(a.hook.joint, []).append(a)
        self.locking = any(a.hook.lock is not None for a in attached.of(hooks.Friction))
        """Whether impulses may leave joints that stick at rest."""
        stopped = {a.hook.joint for a in attached.of(hooks.Impact)}
        slips = self.frictions or any(not arm.prismatic[k] for k in stopped)
        self.slipping = tuple(sorted({*self.frictions, *stopped})) if slips else ()
        """Joints that stick and slip, in their order: those with dry friction and, if there are any or if a
        stop is that of a revolute joint, those with stops, which hold a joint in one direction."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Without what follows from these: it has functions of effects, which need not be picklable."""
        return Dynamics, (self.scene, self.track_work, self.located)

    def fields(self, length: Lifetime) -> Iterator[Variable]:
        """State, parameters and what every interval has; ``length`` is the lifetime of the field "h"."""
        arm, numbers = self.arm, self.parameters
        named = f"the arm {arm.kind}"
        owners = dict.fromkeys(numbers.numbers, named) | dict.fromkeys((*ARGUMENTS, hooks.CONTROL_DT), ENGINE)
        for effect in self.scene.effects:
            names = (*effect.parameters(), *effect.states(arm))
            owners |= {f"{effect.key}.{name}": f"the effect {type(effect).__name__}" for name in names}
        yield from fields.variables(arm.coordinates, "generalized coordinate", STATE, "rad or m", owner=named)
        yield from fields.variables(arm.rates, "generalized velocity", STATE, "rad/s or m/s", owner=named)
        for name, state in self.effect_states.items():
            yield Variable(name, state.unit, f"state {state.name}", STATE, owner=owners[name])
        yield from fields.variables(self.draw_fields, "from which draws follow", STATE)
        if self.track_work:
            yield from engine("work")
        yield Variable("h", "s", "length of the common step", length)
        yield from engine("interval")
        for name in (*numbers.values, *numbers.prepared):
            doc = "parameter of the scene, or follows from these alone"
            yield Variable(name, "SI", doc, PARAMETER, owner=owners.get(name, ENGINE))
        for name, unit in zip(self.commands, self.scene.command_units(), strict=True):
            yield Variable(name, unit, "command of a motor", SCRATCH)
        yield from engine("error", "fault")

    @cached_property
    def field(self) -> tuple[Callable[..., Any], ...]:
        """The function of the field of the scene, where that does not follow from parameters alone."""
        if "ax" in self.parameters.prepared:
            return ()
        fields = (*self.scene.attached.constant_fields, *self.scene.attached.moving_fields)
        names = tuple(dict.fromkeys(name for a in fields for name in a.functions["function"].names))

        @physics(gives="ax ay", takes=names)
        def field(*values: Any) -> tuple[Any, Any]:
            ax, ay = field_of(fields, Quantities(dict(zip(names, values, strict=True)), (), {}))
            return (0.0, 0.0) if ax is ABSENT else (ax, ay)

        return (field,)

    @cached_property
    def clearances(self) -> tuple[Callable[..., Any], ...]:
        """Functions of the distances of the links from the obstacles."""
        return clearance_functions(self.scene.attached, self.arm)

    @cached_property
    def constant(self) -> frozenset[str]:
        """Quantities that are constant in a step."""
        of_effects = (*self.commands, *self.effect_states.updated, *self.passed)
        return frozenset((*self.parameters.numbers, *of_effects))

    @cached_property
    def varying(self) -> dict[str, tuple[str, ...]]:
        """Quantities that closed forms take, and that change in a step; see :mod:`closed_forms`."""
        return varying_arguments(self.scene.attached, self.arm, self.constant) if self.closed else {}

    @cached_property
    def _autonomous(self) -> tuple[Attached[Any], ...]:
        """Fields and forces with states whose rates of change follow from these and constants alone."""

        def follows(a: Attached[Any]) -> bool:
            slopes = [functions["derivative"] for functions in a.states.values() if "derivative" in functions]
            known = {*a.states, *self.constant} - {*self.closed}  # closed forms are those of a stage
            return bool(slopes) and all(known.issuperset(f.names) for f in slopes)

        return tuple(a for a in self.scene.attached.of(hooks.Field, hooks.Force) if follows(a))

    @cached_property
    def autonomous(self) -> tuple[str, ...]:
        """States of these that are integrated."""
        fields = {field for a in self._autonomous for field in a.states} - {*self.closed}
        return tuple(name for name in self.effect_states.integrated if name in fields)

    def autonomous_changes(self, known: Mapping[str, Any]) -> Changes:
        """Rates of change of such states by their names, from them and from constants."""
        x = Quantities(known, (), {})
        return {k: v for a in self._autonomous for k, v in a.changes("derivative", x).items()}

    def guard_values(self, x: Quantities, begins: bool = False) -> dict[str, Any]:
        """Values of guards by their boundaries; where an interval ``begins``, they set the sides in ``x``."""
        values: dict[str, Any] = {}
        for a in self.scene.attached.along(x, self.guarded):
            if a in self.guarded:
                if begins:
                    a.settle_law(x)
                values |= zip(a.guards, a.guard_values(x), strict=True)
        return values

    def friction_limit(self, joint: int, x: Quantities, speed: Any) -> Any:
        """Largest force of the friction of a joint at a speed, N m or N."""
        limits = []
        for a in self.frictions.get(joint, ()):
            function = a.functions["limit"]
            limits.append(function.on(speed if n == hooks.SPEED else x[n] for n in function.names))
        return total(limits or [0.0])

    def locked(self, joint: int, x: Quantities) -> Any:
        """Whether a joint, once it sticks, is held whatever that takes."""
        locks = (a.functions["lock"](x) for a in self.frictions.get(joint, ()) if "lock" in a.functions)
        return any_of(lock > 0.0 for lock in locks)

    def rests_locked(self, joint: int, x: Quantities) -> Any:
        """Whether a joint is held whatever that takes."""
        if not self.locking:
            return False
        return self.locked(joint, x) & (x[f"phid{joint + 1}"] == 0.0)

    def slips_freely(self, joint: int, x: Quantities) -> Any:
        """Whether a joint has no friction now: it has none at all, or its limit is 0, whatever the speed."""
        some = self.frictions.get(joint, ())
        if any(hooks.SPEED in a.functions["limit"].names for a in some):
            return False
        return not some or self.friction_limit(joint, x, 0.0) == 0.0

    # ---- actuation, and states of effects ----------------------------------------------------------

    def efforts(self, x: Quantities, change: str, close: Closing | None = None) -> tuple[list[Any], Changes]:
        """Efforts at the ends of all motors' chains, and what functions of a kind give for their states; with
        ``close`` states of links, and then those of forces, are in closed form."""
        given, changes = dict(zip(self.commands, x.each(self.commands), strict=True)), dict[str, Any]()
        reached: dict[str, Any] = {}
        for chains in self.scene.attached.stages:
            reached = {command: x[command] if command in given else x.get(command) for command in chains}
            for command, chain in chains.items():
                commanded = reached[command]
                for link in chain:
                    x[command] = reached[command]
                    if link.guards and not self.locates_laws:
                        link.settle_law(x)
                    if close is not None:
                        close(link, x)
                    changes |= link.changes(change, x)
                    reached[command] = link.functions["function"](x)
                x[command] = commanded
            x.update(reached if chains is not self.scene.attached.stages[-1] else given)
        efforts = [*reached.values()]
        if close is not None:
            for a in self.scene.attached.of(hooks.Force):
                if a.has_laws and not self.locates_laws:
                    a.settle_law(x)
                close(a, x)
        return efforts, changes

    def changes(self, x: Quantities, what: str, lane: Any) -> Changes:
        """New values of effects' states, by their fields: the "update" at the end of an interval, or
        :data:`INSTANT_UPDATE`."""
        x.update(self._drawn(what, lane))
        _, changes = self.efforts(x, what)
        for a in self.scene.attached:
            if not isinstance(a.hook, hooks.Actuation | hooks.Sensing):
                changes |= a.changes(what, x)
        return changes | sensing.renewed(self.scene.attached, what, x)

    def initial_states(self, x: Quantities, lane: Any) -> Changes:
        """Values of effects' states at a start, by their fields, of those that are computed then."""
        x.update(self._drawn("initial", lane))
        return self.begun(x) | sensing.renewed(self.scene.attached, "initial", x)

    def begun(self, x: Quantities) -> Changes:
        """Those of them that no sensor has, from quantities that have the draws."""
        maps = (a.changes("initial", x) for a in self.scene.attached if not isinstance(a.hook, hooks.Sensing))
        return {name: value for changes in maps for name, value in changes.items()}

    def _drawn(self, what: str, lane: Any) -> dict[str, Any]:
        """Draws that functions of states take, by the names of quantities: at a start, or in an interval."""
        functions = (state[what] for a in self.scene.attached for state in a.states.values() if what in state)
        needed = {n: self.draws[n] for f in functions for n in f.names if n in self.draws}
        if not needed:
            return {}
        interval = 0.0 if what == "initial" else lane[INTERVALS] + 1.0
        values = drawn(needed.values(), interval, lane.get(DRAW_KEY))
        return {name: values[draw] for name, draw in needed.items()}

    # ---- equations of motion -----------------------------------------------------------------------

    def quantities(self, states: Sequence[Any], numbers: Any, held: bool = False) -> Quantities:
        """Quantities of the arm, from states, and numbers and efforts by name; ``held``: with the dynamics of
        sliders that may rest at their stops."""
        functions = self.functions_held if held else self.functions
        x = Quantities(dict(zip(self.states, states, strict=False)), functions, self.arm.sincos, numbers)
        if self.scene.effort_units():  # a mode of actions knows the field
            self.set_field(x)
        return x

    @property
    def functions(self) -> tuple[Callable[..., Any], ...]:
        """Equations of the arm with the inertias that effects add."""
        added, eqs = self.scene.attached.inertias, self.arm_functions
        return (*functions_with(self.arm.__class__, added), *eqs[len(self.arm.functions) :]) if added else eqs

    @property
    def arm_functions(self) -> tuple[Callable[..., Any], ...]:
        """Equations of the arm, and sums of its masses that change."""
        carried, changing = self.scene.attached.carried, self.scene.attached.changing
        if not changing:
            return tuple(self.arm.functions)
        sums = [total_mass(mass, (self.parameters.field_of(mass), *carried[mass])) for mass in changing]
        return (*self.arm.functions, *(f for f in self.arm.prepared if f not in self.arm.functions), *sums)

    @property
    def functions_held(self) -> tuple[Callable[..., Any], ...]:
        """The same with the dynamics of sliders that may rest at their stops."""
        arm, kind = self.arm, self.arm.__class__
        added = self.scene.attached.inertias
        held = held_functions(kind) if added else (arm.held_dynamics, arm.slider_mobility)
        if self.slipping:
            held = held_joint_dynamics(kind, self.slipping), *(held[1:] if arm.sliders() else ())
        return (*(f for f in self.functions if "qdd1" not in gives_of(f)), *held)

    def close(self, x: Quantities, close: Closing) -> None:
        """Let the states that are in closed form be noted, or give quantities their values."""
        self.efforts(x, "none", close)

    def set_field(self, x: Quantities) -> None:
        """The field of the scene, where it does not follow from parameters alone."""
        if "ax" in self.parameters.prepared:
            return
        attached, steady = self.scene.attached, self.parameters.steady_field
        known = steady[0] in self.parameters.prepared
        constant = x.each(steady) if known else field_of(attached.constant_fields, x)
        x["ax"], x["ay"] = map(operator.add, constant, field_of(attached.moving_fields, x))

    def accelerations(self, x: Quantities, close: Closing | None = None) -> list[Any]:
        """Accelerations, rates of change of effects' states, and the power; ``x`` then has the forces.
        Without ``close``, which gives states their closed forms, their rates of change are the last ones."""
        joints = range(self.count)
        self.set_field(x)
        effort, changes = self.efforts(x, "derivative", close)
        at_joints = self.scene.actuation == "joint"
        acting: dict[str, Any] = {f"phid{k + 1}": effort[k] if at_joints else None for k in joints}
        working, at_points = dict(acting), dict[str, Any]()
        for moving in self.scene.attached.of(hooks.Field):
            changes |= moving.changes("derivative", x)
        for a in self.scene.attached.of(hooks.Force):
            if a.has_laws and not self.locates_laws:
                a.settle_law(x)
            force = components(a, "function", x)
            changes |= a.changes("derivative", x)
            add(acting, force)
            if isinstance(a.hook.joint, hooks.Point):
                self._add_at_coordinates(a, force, x, at_points)
            if a.hook.conservative is a.hook.function:
                continue
            add(working, force)
            if a.hook.conservative is not None and self.track_work:
                add(working, {rate: -part for rate, part in components(a, "conservative", x).items()})
        for k in sorted(self.frictions):
            rate, side = f"phid{k + 1}", x[f"side_friction{k + 1}"]
            friction = {rate: -(side * self.friction_limit(k, x, side * x[rate]))}
            add(acting, friction)
            add(working, friction)
        torques = [acting[f"phid{k + 1}"] for k in joints]
        if any(t is not None for t in torques):
            x.update({f"t{k + 1}": 0.0 if t is None else t for k, t in enumerate(torques)})
            if not at_joints:
                x.update({f"Q{k + 1}": x[f"Q{k + 1}"] + effort[k] for k in joints})
        else:
            x.update({f"Q{k + 1}": effort[k] for k in joints})
        x.update({name: x[name] + force for name, force in at_points.items()})
        results = x.each(f"qdd{k + 1}" for k in joints)
        results += [changes[name] for name in self.effect_states.integrated if name not in self.closed]
        if self.track_work:
            power = [force * x[rate] for rate, force in working.items() if force is not None]
            power += self._power_of_fields(x)
            if not at_joints:
                power += [e * x[v] for e, v in zip(effort, self.arm.rates, strict=True)]
            results.append(total(power or [0.0]))
        return results if close is not None else results + [changes[name] for name in self.closed]

    def _power_of_fields(self, x: Quantities) -> list[Any]:
        """The power of moving fields, -G qd with the weight G in these fields alone."""
        if not self.scene.attached.moving_fields:
            return []
        known = {name: x[name] for name in (*self.arm.coordinates, *self.arm.rates)}
        known |= {name: x[name] for name in self.parameters.numbers if name not in ("ax", "ay")}
        known["ax"], known["ay"] = field_of(self.scene.attached.moving_fields, x)
        alone = Quantities(known, self.functions, self.arm.sincos)
        return [-(alone[f"G{k + 1}"] * x[v]) for k, v in enumerate(self.arm.rates)]

    def _add_at_coordinates(self, a: Any, force: Any, x: Quantities, sums: dict[str, Any]) -> None:
        """Add the generalized force of a force at a point, J^T f of that point."""
        with owned(a.key):
            for j in range(self.count):
                for axis, component in zip("XY", force.values(), strict=True):
                    slope = x[f"{axis}{a.hook.joint.number + 1}{j + 1}"]
                    if not (isinstance(slope, float) and slope == 0.0):  # links beyond the point
                        add(sums, {f"Q{j + 1}": slope * component})


@functools.lru_cache(maxsize=64)
def total_mass(mass: str, parts: tuple[str, ...]) -> Any:
    """The function that gives a mass of the arm with all that it carries."""

    @physics(gives=mass, takes=parts)
    def total_mass(*masses: Any) -> Any:
        return total(masses)

    return total_mass


def components(a: Attached[Any], field: str, x: Quantities) -> dict[str, Any]:
    """A force, or an impulse, by the names of the velocities along which it acts."""
    force = a.functions[field](x)
    return dict(zip(a.hook.rates, force if isinstance(force, tuple) else (force,), strict=True))


def add(sums: dict[str, Any], more: Mapping[str, Any]) -> None:
    """Add numbers to the sums of the same names; None is a sum of nothing."""
    for name, x in more.items():
        before = sums.get(name)
        sums[name] = x if before is None else before + x


def quantities_of_arm(dynamics: Dynamics, lane: Lane, form: str = "{}", *more: Any) -> Quantities:
    """Quantities of the arm from the fields of a form, by its functions and ``more``."""
    known, functions = lane.values(dynamics.states, of=form), (*dynamics.arm_functions, *more)
    return Quantities(known, functions, dynamics.arm.sincos, numbers_of(dynamics, lane))


def tip_norms(dynamics: Dynamics, lane: Lane, form: str = "{}") -> list[Any]:
    """Metres at the tip per unit of each coordinate, from the fields of a form."""
    x = quantities_of_arm(dynamics, lane, form, dynamics.arm.column_norms)
    return x.each(f"n{k + 1}" for k in range(dynamics.count))


def tip_distance(dynamics: Dynamics, lane: Lane, form: str) -> Any:
    """Distance of the tip, m, from where it was with the coordinates in the fields of a form."""
    norms = zip(tip_norms(dynamics, lane), dynamics.arm.coordinates, strict=True)
    return total(n * abs(lane[q] - lane[form.format(q)]) for n, q in norms)


def numbers_of(dynamics: Dynamics, x: Any) -> dict[str, Any]:
    """The numbers that are constant in a step, from quantities or a lane."""
    return {name: x[name] for name in dynamics.parameters.numbers}


def response(dynamics: Dynamics, impulse: Sequence[Any], x: Quantities) -> list[Any]:
    """Change of the velocities by a generalized impulse, M^-1 n: accelerations at rest, without a field.
    Locked joints have none."""
    arm, functions = dynamics.arm, dynamics.functions
    still = {q: x[q] for q in arm.coordinates} | dict.fromkeys(arm.rates, 0.0) | {"ax": ABSENT, "ay": ABSENT}
    still |= {f"Q{k + 1}": push for k, push in enumerate(impulse)}
    if dynamics.locking:
        functions = dynamics.functions_held
        still |= {f"held{k + 1}": where(dynamics.rests_locked(k, x), 1.0, 0.0) for k in dynamics.slipping}
    quantities = Quantities({**numbers_of(dynamics, x), **still}, functions, arm.sincos)
    return quantities.each(f"qdd{k + 1}" for k in range(dynamics.count))
