from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.disturbances import later, step
from redundant_envs.effects.hooks import Arm, Effect, Hook, Point, PointMass, State
from redundant_envs.effects.numbers import Example, not_negative, one, positive
from redundant_envs.language.algebra import physics


@physics
def taken(time, control_dt, mass, at):
    """The mass from the first interval on that starts at or after its time."""
    return step(time + control_dt, at, control_dt, mass)


@dataclass(frozen=True)
class PickUp(Effect):
    """A point mass at rest, which the tip grasps wherever it then is, and carries from there on.

    It is taken at the start of the first control interval that begins at or after its time, counted from the
    start of the motion or the episode. The grasp is inelastic: M qd, with the mass from then on, stays what
    it was without it, so the velocities jump and energy is lost. The loss, and the potential energy that the
    object brings along, count as work.

    Parameters
    ----------
    mass : float
        Mass of the object, kg, not negative.
    at : float
        Time of the grasp, s, positive; a load from the start is a :class:`Payload`.
    """

    mass: float = field(metadata=one(not_negative, "kg"))
    at: float = field(metadata=one(positive, "s"))

    example = Example({"mass": 0.3, "at": 0.1})

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        """The object before it is grasped, which the tip will find wherever it then is."""
        waits = pose.states["carried"] == 0.0
        return (shapes.Load(pose.points[-1], self.mass, held=False),) if waits else ()

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        time = State("time", "s", update=later, bind={"elapsed": ".time"})
        states = State("carried", "kg", update=taken), time
        return (PointMass(Point(arm.num_masses - 1), ".carried", states),)
