import dataclasses
from dataclasses import dataclass

from redundant_envs.effects.hooks import Arm, Effect, Hook, Inertia
from redundant_envs.effects.numbers import Curve, Example, Numbers, checked, not_negative


@dataclass(frozen=True)
class LinkInertia(Effect):
    """Moments of inertia of the links about their point masses, which are their centres of mass.

    All that turns with a revolute joint, up to the next one, has one absolute angle and therefore one moment
    of inertia J: it adds J w^2 / 2 to the kinetic energy, w being the sum of the rates of all revolute joints
    up to this one. Accelerations then follow from the mass matrix, by L D L^T.

    Parameters
    ----------
    inertias : float or sequence of one for each revolute joint
        kg m^2, not negative, at most a million times the lightest mass on the shortest link; one number
        serves all links.
    """

    inertias: float | Numbers = dataclasses.field(metadata=checked(not_negative))

    example = Example({"inertias": 0.01}, curve=Curve("rate", "time", 0.4))

    def fitted(self, arm: Arm) -> Effect:
        links = arm.prismatic.count(False)
        if links == 0:
            raise ValueError(f"LinkInertia acts on revolute joints, and {arm.kind} has none: leave it out")
        if isinstance(self.inertias, float):
            return dataclasses.replace(self, inertias=(self.inertias,) * links)
        if len(self.inertias) != links:
            raise ValueError(
                f"LinkInertia.inertias has {len(self.inertias)} entries; give one, or {links} for {arm.kind}"
            )
        return super().fitted(arm)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        turning = [k for k, slides in enumerate(arm.prismatic) if not slides]
        return tuple(Inertia(tuple(turning[: n + 1]), f".inertias[{n}]") for n in range(len(turning)))
