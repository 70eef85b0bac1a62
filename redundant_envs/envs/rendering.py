"""Pictures of an environment in plain NumPy: anti-aliased shapes by their signed distances."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.scene import identifier

SIZE = 480
BACKGROUND = (250, 250, 248)
REACH = (228, 231, 236)
GOAL = (46, 160, 103)
TRAIL = (240, 140, 60)
LINKS = ((52, 73, 110), (86, 118, 168), (124, 157, 205), (168, 192, 226))
RAIL = (198, 204, 214)
JOINT = (28, 36, 52)
BAR_TRACK = (226, 229, 234)
BAR_PLUS = (70, 120, 190)
BAR_MINUS = (205, 92, 92)
TRAIL_LENGTH = 100


class Canvas:
    """A square picture with the base of the arm in its middle."""

    def __init__(self, half_width: float) -> None:
        self.pixels = np.empty((SIZE, SIZE, 3), dtype=np.float32)
        self.pixels[:] = BACKGROUND
        self.scale = SIZE / (2.0 * half_width)

    def _place(self, point: NDArray[np.float64]) -> tuple[float, float]:
        return SIZE / 2 + self.scale * float(point[0]), SIZE / 2 - self.scale * float(point[1])

    def _blend(
        self, low: tuple[float, float], high: tuple[float, float], color: tuple[int, int, int],
        distance: object, alpha: float,
    ) -> None:  # fmt: skip
        x0, y0 = (max(0, int(v) - 2) for v in low)
        x1, y1 = (min(SIZE, int(v) + 3) for v in high)
        if x0 >= x1 or y0 >= y1:
            return
        y, x = np.mgrid[y0:y1, x0:x1] + 0.5
        cover = np.clip(0.5 - distance(x, y), 0.0, 1.0)[..., None] * alpha  # type: ignore[operator]
        patch = self.pixels[y0:y1, x0:x1]
        patch += cover.astype(np.float32) * (np.asarray(color, dtype=np.float32) - patch)

    def capsule(
        self, a: NDArray[np.float64], b: NDArray[np.float64], width: float,
        color: tuple[int, int, int], alpha: float = 1.0,
    ) -> None:  # fmt: skip
        """A thick line with round ends; width in pixels."""
        ax, ay = self._place(a)
        bx, by = self._place(b)
        r = width / 2

        def distance(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
            dx, dy = bx - ax, by - ay
            s = np.clip(((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0, 1.0)
            return np.hypot(x - ax - s * dx, y - ay - s * dy) - r  # type: ignore[no-any-return]

        low = (min(ax, bx) - r, min(ay, by) - r)
        self._blend(low, (max(ax, bx) + r, max(ay, by) + r), color, distance, alpha)

    def disc(
        self, center: NDArray[np.float64], radius: float, color: tuple[int, int, int],
        alpha: float = 1.0, ring: float = 0.0,
    ) -> None:  # fmt: skip
        """A disc, or a ring of the given width; sizes in pixels."""
        cx, cy = self._place(center)

        def distance(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
            d = np.hypot(x - cx, y - cy) - radius
            return np.abs(d) - ring / 2 if ring else d  # type: ignore[no-any-return]

        r = radius + ring
        self._blend((cx - r, cy - r), (cx + r, cy + r), color, distance, alpha)

    def bar(self, index: int, value: float) -> None:
        """A horizontal bar in the lower left corner, from its middle, for a value in [-1, 1]."""
        left, width, height = 16, 84, 7
        top = SIZE - 16 - (4 - index) * (height + 6)
        self.pixels[top : top + height, left : left + width] = BAR_TRACK
        middle = left + width // 2
        end = middle + round(float(np.clip(value, -1.0, 1.0)) * width / 2)
        color = BAR_PLUS if value >= 0 else BAR_MINUS
        self.pixels[top : top + height, min(middle, end) : max(middle, end)] = color
        self.pixels[top - 1 : top + height + 1, middle] = JOINT


def lane_arm(core: Core, lane: NDArray[np.intp]) -> Any:
    """The arm with a lane's own masses and lengths."""
    arm = core.scene.robot
    names = tuple(arm.parameter_values())
    numbers = core.memory.read(names, lane)[0].tolist()
    return type(arm)(tuple(numbers[:4]), tuple(numbers[4:]))


class Renderer:
    """Draws one lane of a core and remembers the trail of its tip."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.trail: deque[NDArray[np.float64]] = deque(maxlen=TRAIL_LENGTH)
        self._last_step = -1.0

    def clear(self) -> None:
        """Forget the trail."""
        self.trail.clear()

    def draw(self, lane: int) -> NDArray[np.uint8]:
        """The picture of a lane, (480, 480, 3) uint8."""
        core, arm = self.core, self.core.scene.robot
        index = np.array([lane])
        q = core.memory.read(arm.coordinates, index)[0]
        goal = core.memory.read(("goal_x", "goal_y"), index)[0]
        steps, *efforts = core.memory.read(("steps", *core.assembly.actions), index)[0]
        points = lane_arm(core, index).points(q)
        if steps < self._last_step:
            self.clear()
        self._last_step = float(steps)
        self.trail.append(points[3])

        canvas = Canvas(1.12 * core.reach)
        base = np.zeros(2)
        canvas.disc(base, canvas.scale * core.reach, REACH, ring=2.0)
        radius = canvas.scale * core.reach * core.task.goal_tolerance
        canvas.disc(goal, radius + 9.0, GOAL, alpha=0.18)
        canvas.disc(goal, max(radius, 3.0), GOAL)
        trail = list(self.trail)
        for i, (a, b) in enumerate(itertools.pairwise(trail)):
            canvas.capsule(a, b, 3.0, TRAIL, alpha=0.15 + 0.75 * (i + 1) / len(trail))
        if arm.kind == "RPRP":
            self._sliders(canvas, q, points, base, index)
        else:
            joints = [base, *points]
            for k, width in enumerate((17.0, 14.0, 11.0, 9.0)):
                canvas.capsule(joints[k], joints[k + 1], width, LINKS[k])
            for joint in joints[:4]:
                canvas.disc(joint, 4.5, JOINT)
        canvas.disc(base, 9.0, JOINT)
        canvas.disc(base, 4.0, BACKGROUND)
        canvas.disc(points[3], 5.0, TRAIL)
        for k, effort in enumerate(efforts if steps > 0 else (0.0,) * 4):
            canvas.bar(k, effort)
        return canvas.pixels.round().astype(np.uint8)

    def _limits(self, lane: NDArray[np.intp]) -> dict[str, float]:
        names = [name for pair in self.core.scene.travel().values() for name in pair]
        numbers = self.core.memory.read(tuple(identifier(n) for n in names), lane)[0].tolist()
        return dict(zip(names, numbers, strict=True))

    def _sliders(
        self, canvas: Canvas, q: NDArray[np.float64], points: NDArray[np.float64],
        base: NDArray[np.float64], lane: NDArray[np.intp],
    ) -> None:  # fmt: skip
        """Both links with their rails: the rail spans the whole travel, the slider rides on it."""
        arm, values = lane_arm(self.core, lane), self._limits(lane)
        travel = self.core.scene.travel()
        for k, (root, fixed, end) in enumerate(
            ((base, points[0], points[1]), (points[1], points[2], points[3]))
        ):
            angle, length = q[2 * k], arm.lengths[k]
            direction = np.array([np.cos(angle), np.sin(angle)])
            low, high = travel[2 * k + 1]
            canvas.capsule(
                root + (length + values[low]) * direction,
                root + (length + values[high]) * direction, 7.0, RAIL,
            )  # fmt: skip
            for limit in (values[low], values[high]):
                stop = root + (length + limit) * direction
                across = 9.0 / canvas.scale * np.array([-direction[1], direction[0]])
                canvas.capsule(stop - across, stop + across, 3.0, RAIL)
            canvas.capsule(root, fixed, 17.0 - 5.0 * k, LINKS[2 * k])
            canvas.capsule(fixed, end, 8.0 - 2.0 * k, LINKS[2 * k + 1])
            across = 7.0 / canvas.scale * direction
            canvas.capsule(end - across, end + across, 13.0 - 2.0 * k, LINKS[2 * k])
        canvas.disc(points[1], 4.5, JOINT)
