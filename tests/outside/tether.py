"""A damped spring between a point of the arm and a post: a force at a point, with a potential."""

from dataclasses import dataclass

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force, Point


@physics
def pull(x, y, post_x, post_y, stiffness):
    return stiffness * (post_x - x), stiffness * (post_y - y)


@physics
def pull_and_damping(x, y, vx, vy, post_x, post_y, stiffness, damping):
    fx, fy = pull(x, y, post_x, post_y, stiffness)
    return fx - damping * vx, fy - damping * vy


@physics
def energy(x, y, post_x, post_y, stiffness):
    return 0.5 * stiffness * ((x - post_x) ** 2 + (y - post_y) ** 2)


@physics
def steepness(stiffness):
    return stiffness


@physics
def slope(damping):
    return damping


@dataclass(frozen=True)
class Tether(Effect):
    """Pulls a point mass to a post.

    Parameters
    ----------
    point : int
        Number of the point mass, from 1.
    post_x, post_y : floats
        m.
    stiffness : float
        N/m.
    damping : float
        N s/m.
    """

    point: int
    post_x: float
    post_y: float
    stiffness: float
    damping: float = 0.0

    static = ("point",)

    def hooks(self, arm):
        k = self.point
        own = {n: f".{n}" for n in ("post_x", "post_y", "stiffness", "damping")}
        at_point = {"x": f"x{k}", "y": f"y{k}", "vx": f"vx{k}", "vy": f"vy{k}"}
        parts = {"potential": energy, "conservative": pull, "stiffness": steepness, "damping": slope}
        return (Force(Point(k - 1), pull_and_damping, {**own, **at_point}, **parts),)


rde.register_effect(Tether)
