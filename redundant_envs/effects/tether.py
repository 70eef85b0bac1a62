from dataclasses import dataclass, field

from redundant_envs.effects import shapes
from redundant_envs.effects.hooks import Arm, Effect, Force, Hook, Point
from redundant_envs.effects.numbers import Example, Numbers, checked, not_negative, numbers, one, pair
from redundant_envs.language.algebra import identity, physics
from redundant_envs.support.values import shown, whole_number


@physics
def pull(x, y, post_x, post_y, stiffness):
    """Towards the post, in proportion to the distance."""
    return stiffness * (post_x - x), stiffness * (post_y - y)


@physics
def pull_and_damping(x, y, vx, vy, post_x, post_y, stiffness, damping):
    fx, fy = pull(x, y, post_x, post_y, stiffness)
    return fx - damping * vx, fy - damping * vy


@physics
def energy(x, y, post_x, post_y, stiffness):
    return 0.5 * stiffness * ((x - post_x) ** 2 + (y - post_y) ** 2)


@dataclass(frozen=True)
class Tether(Effect):
    """A spring without a length of its own, and a damper, from a point mass of the arm to a post.

    The force on the point is k (post - p) - c p': the spring has the potential k d^2 / 2 of the
    distance d from the post, and the power of the damper counts as work.

    Parameters
    ----------
    point : int
        Number of the point mass, from 1; the last one is the tip.
    post : (float, float)
        Where the spring is fixed, m.
    stiffness : float
        Stiffness k of the spring, N/m, not negative.
    damping : float
        Damping c, N s/m, not negative.
    """

    point: int = field(metadata=checked(whole_number))
    post: Numbers = field(metadata=pair(numbers, "m"))
    stiffness: float = field(metadata=one(not_negative, "N/m"))
    damping: float = field(default=0.0, metadata=one(not_negative, "N s/m"))

    static = ("point",)
    example = Example({"point": 4, "post": (0.3, 0.2), "stiffness": 100.0, "damping": 1.0})

    @property
    def key(self) -> str:
        return f"tether.point{self.point}"

    def shapes(self, pose: shapes.Pose) -> tuple[shapes.Shape, ...]:
        x, y = self.post
        line = ((x, y), pose.points[self.point - 1])
        return shapes.Circle((x, y), 0.0), shapes.Line(line, taut=self.stiffness > 0.0)

    def hooks(self, arm: Arm) -> tuple[Hook, ...]:
        k = self.point
        if k > arm.num_masses:
            raise ValueError(f"Tether.point is {shown(k)}; {arm.kind} has the points 1 to {arm.num_masses}")
        return (
            Force(
                Point(k - 1), pull_and_damping, potential=energy, conservative=pull,
                stiffness=identity("stiffness"), damping=identity("damping"),
            ),
        )  # fmt: skip
