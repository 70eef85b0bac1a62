"""Which boundaries a scene has: stops, walls, changes of laws, joints that stick; and what guards are worth.

What lanes do at them is in :mod:`boundaries` and :mod:`guards`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from redundant_envs.algebra import total, where
from redundant_envs.effects.attached import Attached
from redundant_envs.effects.hooks import SPEED, Force, Friction, Gap, Impact
from redundant_envs.events.boundary import Boundary
from redundant_envs.numerics.error_control import SHARPNESS, SHARPNESS_OF_SPRINGS
from redundant_envs.quantities import Quantities
from redundant_envs.robots.mobility import joint_rates
from redundant_envs.scene import Scene

TORN_LOOSE = 1.0 + 1e-12
"""A joint sticks until holding it takes this share of its limit: rounding must not tear it loose."""
LOST_IN_LOADS = 1e-14
"""The same of all torques at the joints, and with dry friction of gravity and of what turning takes, which
nearly cancel where a small friction decides: with none, joints would slip and stick by rounding for ever."""
SLIPS_FREELY = -1.0
"""Value of the guard of a joint with a stop and no friction that does not rest: it never gets to 0."""


@dataclass(frozen=True)
class SceneBoundaries:
    """The boundaries of a scene, which :class:`Dynamics` has."""

    scene: Scene
    track_work: bool = False  # the work of motors and of forces without a potential is a state, too
    located: bool = True
    """Whether changes of a force's law are located in time under error control; otherwise the law follows
    from the position at each evaluation."""

    @property
    def arm(self) -> Any:
        return self.scene.robot

    @property
    def count(self) -> int:
        """Joints of the arm."""
        return len(self.arm.coordinates)

    @property
    def controlled(self) -> bool:
        """Whether error control chooses the steps."""
        return self.scene.controlled

    @cached_property
    def boundaries(self) -> tuple[Boundary, ...]:
        """Boundaries at which the motion has events: stops, walls, and changes of laws; guards come last."""
        return (*self.bounded, *self.guards)

    @property
    def bounded(self) -> tuple[Boundary, ...]:
        """Those that bound a coordinate."""
        return (*self.stops, *self.laws)

    @cached_property
    def stops(self) -> tuple[Boundary, ...]:
        """Boundaries that bounce: stops of sliders, and walls, whose coordinates are any functions."""
        found = []
        for a in self.scene.attached.of(Impact):
            lower, upper, bounce = map(a.parameter, (a.hook.lower, a.hook.upper, a.hook.restitution))
            name = self.arm.joints[a.hook.joint]
            found.append(Boundary(name, lower, upper, a.key, a.hook.joint, restitution=bounce))
        for k, w in enumerate(self.scene.attached.of(Gap)):
            gap, bounce = w.functions["function"], w.parameter(w.hook.restitution)
            found.append(Boundary(f"gap{k + 1}", "", "", w.key, gap=gap, restitution=bounce))
        return tuple(found)

    @cached_property
    def sharpness(self) -> float:
        """The factor of the error estimate: the larger one with springs and stops, and with a force that
        declares where its single law bends."""
        springs = any("stiffness" in a.functions for a in self.scene.attached.of(Force))
        bends = any(
            "kink" in a.functions and "guard" not in a.functions and a.hook.switch is None
            for a in self.scene.attached.of(Force)
        )
        return SHARPNESS_OF_SPRINGS if (springs and self.stops) or bends else SHARPNESS

    @cached_property
    def holding(self) -> tuple[Boundary, ...]:
        """Stops that hold their sliders by themselves; with friction, that decides."""
        return () if self.sticking else tuple(b for b in self.stops if b.joint is not None)

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Fields of the stops at which sliders rest."""
        return tuple(b.active for b in self.holding)

    @cached_property
    def law_of(self) -> dict[Attached[Force], Boundary]:
        """Boundaries at which forces change their laws."""
        found = {}
        for a in self.scene.attached.of(Force):
            if a.hook.switch is not None and isinstance(a.hook.joint, int):
                lower, upper = map(a.parameter, a.hook.switch)
                found[a] = Boundary(a.law, lower, upper, a.key, a.hook.joint, bounces=False)
        return found

    @cached_property
    def laws(self) -> tuple[Boundary, ...]:
        """Those of these that are located."""
        return tuple(self.law_of.values()) if self.locates_laws else ()

    @cached_property
    def guarded(self) -> tuple[Attached[Any], ...]:
        """Forces and links with guards whose changes of sign are located."""
        return tuple(a for a in self.scene.attached if a.guards) if self.locates_laws else ()

    @cached_property
    def guards(self) -> tuple[Boundary, ...]:
        """Guards that are located, and joints that stick and slip, which always are."""
        names = ((name, a.key) for a in self.guarded for name in a.guards)
        own = (Boundary(name, "", "", key, bounces=False, guards=True) for name, key in names)
        return (*own, *self.sticking)

    @cached_property
    def frictions(self) -> dict[int, list[Attached[Friction]]]:
        """Dry friction by the numbers of its joints."""
        found: dict[int, list[Attached[Friction]]] = {}
        for a in self.scene.attached.of(Friction):
            found.setdefault(a.hook.joint, []).append(a)
        return found

    @cached_property
    def sticking(self) -> tuple[Boundary, ...]:
        """Joints that stick and slip, in their order: those with dry friction and, if there are any or if a
        stop is that of a revolute joint, those with stops, which hold a joint in one direction."""
        if not self.frictions and not self.angular:
            return ()
        owners = {k: b.owner for k, b in self.stop_of.items()}
        owners |= {k: some[0].key for k, some in self.frictions.items()}
        return tuple(
            Boundary(f"friction{k + 1}", "", "", owners[k], k, bounces=False, guards=True)
            for k in sorted(owners)
        )

    @cached_property
    def stop_of(self) -> dict[int, Boundary]:
        """Stops by the numbers of their joints."""
        return {b.joint: b for b in self.stops if b.joint is not None}

    @property
    def angular(self) -> tuple[Boundary, ...]:
        """Stops of revolute joints from base to tip; their angles may be differences of coordinates."""
        return tuple(b for k, b in sorted(self.stop_of.items()) if not self.arm.prismatic[k])

    def rounds(self, b: Boundary) -> bool:
        """Whether a boundary has the angle of a joint with a stop, which has to be recognised there."""
        return (b.holds or b.sticks) and b.joint in (stop.joint for stop in self.angular)

    def coordinates_of(self, b: Boundary) -> tuple[str, ...]:
        """The coordinates from which the position of a joint follows."""
        assert b.joint is not None
        shares = zip(self.arm.coordinates, self.arm.motor_map[:, b.joint], strict=True)
        return tuple(q for q, share in shares if share != 0.0)

    def along(self, b: Boundary, values: Sequence[Any]) -> Any:
        """What a joint has of values for the coordinates: of rates, accelerations or mobilities."""
        shares = zip(self.arm.motor_map[:, b.joint].tolist(), values, strict=True)
        return total(x if share == 1.0 else share * x for share, x in shares if share != 0.0)

    def own_value(self, b: Boundary, value: Any, others: Any, names: Sequence[str]) -> Any:
        """Value of the coordinate of a joint from that of the joint, a position or a rate, and those of other
        coordinates, by ``names``."""
        moved = [(share, others[names[k]]) for k, share in self.others_of_joint(b)]
        return total([value, *(x if share == 1.0 else share * x for share, x in moved)])

    @property
    def gripped(self) -> tuple[tuple[Boundary, Boundary], ...]:
        """Joints that stick and slip, and their stops, of those that have some."""
        return tuple((b, self.stop_of[b.joint]) for b in self.sticking if b.joint in self.stop_of)

    def friction_limit(self, b: Boundary, x: Quantities, speed: Any) -> Any:
        """Largest force of the friction of a joint at a speed, N m or N."""
        assert b.joint is not None
        limits = []
        for a in self.frictions.get(b.joint, ()):
            function = a.functions["limit"]
            limits.append(function.on(speed if n == SPEED else x[n] for n in function.names))
        return total(limits or [0.0])

    def others_of_joint(self, b: Boundary) -> list[tuple[int, float]]:
        """The other coordinates from which that of a joint follows while it sticks, and their shares."""
        assert b.joint is not None
        row = joint_rates(self.arm.__class__)[b.joint]
        return [(k, float(-s / row[b.joint])) for k, s in enumerate(row) if s != 0.0 and k != b.joint]

    @property
    def weighs_laws(self) -> bool:
        """Whether laws are compared where a guard has passed 0: how late that may be found depends on it."""
        return bool(self.guarded) and self.scene.tolerance is not None

    @property
    def impulses_change_laws(self) -> bool:
        """Whether an impulse may change the sign of a guard."""
        return bool(self.guarded and self.stops)

    @property
    def resolves(self) -> bool:
        """Whether a lane may have to decide which stops act and which joints stick."""
        return bool(self.stops or self.sticking)

    @property
    def compares_bounces(self) -> bool:
        """Whether an interval is compared with one that has all bounces: with another stop, or dry friction,
        an impact may come before those that are left out would be over, and find at rest what is still in the
        air."""
        equal_steps = self.controlled and self.scene.integrator != "dop853"
        return equal_steps and (len(self.stops) > 1 or bool(self.stops and self.frictions))

    @property
    def sides(self) -> tuple[str, ...]:
        """Fields that say which laws hold, where their changes are located."""
        return tuple(b.side for b in (*self.laws, *self.guards))

    @property
    def locates_laws(self) -> bool:
        """Whether changes of laws are located; otherwise each evaluation decides which one holds."""
        return self.controlled and self.located

    def guard_values(self, x: Quantities, begins: bool = False) -> dict[str, Any]:
        """Values of guards by the names of their boundaries; where an interval ``begins``, they decide about
        the sides in ``x``."""
        found: dict[str, Any] = {}
        for a in self.scene.attached.along(x, self.guarded):
            if a in self.guarded:
                if begins:
                    a.settle_law(x)
                found |= zip(a.guards, a.guard_values(x), strict=True)
        return found

    def pulls(self, x: Quantities, held: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Values of guards by the names of their boundaries, positive where the present law does not hold any
        more. Those of joints that stick follow from the forces that hold them; ``held`` has them if ``x`` has
        no forces."""
        found = {name: -(x[f"side_{name}"] * value) for name, value in self.guard_values(x).items()}
        for b in self.sticking:
            mode = x[b.side]
            if held is None:
                applied = "t" if self.scene.actuation == "joint" else "Q"
                forces = f"{applied}Gh" if self.frictions else applied
                loads = total(abs(x[f"{force}{k + 1}"]) for force in forces for k in range(self.count))
                most = TORN_LOOSE * self.friction_limit(b, x, 0.0) + LOST_IN_LOADS * loads
                hold = x[f"hold{b.number}"]
                load = abs(hold)
                if b.joint in self.stop_of:  # which holds it in one direction, whatever that takes
                    load = where(x[b.at] == 0.0, load, x[b.at] * hold)
                stuck = load - most
            else:
                stuck = held[b.name]
            # Without friction nothing changes where a rate passes 0: a stop is met as a position.
            slips = -(mode * x[f"phid{b.number}"]) if b.joint in self.frictions else SLIPS_FREELY
            found[b.name] = where(mode == 0.0, stuck, slips)
        return found
