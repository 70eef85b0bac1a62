"""A scene as MJCF, the format of MuJoCo."""

import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from redundant_envs.exports.files import PYBULLET, Document, Heading, numbers, xml
from redundant_envs.exports.mechanism import Format, Mechanism, mechanism
from redundant_envs.scenes.scene import Scene

MJCF = Format(
    "MJCF", least=2e-15, springs=True, rotors=True, generalized=True,
    soft_ends="written as soft ends of travel, as stiff as a step allows",
)  # fmt: skip
"""MuJoCo requires masses and moments of inertia of more than 1e-15."""
LONGEST_STEP = 0.002  # of MuJoCo, s; also, a control interval has at least ten steps
COLOURS = "0.17 0.37 0.62 1", "0.85 0.55 0.10 1"  # of links and of point masses


def mjcf(scene: Scene, heading: Heading, approximate: bool) -> Document:
    """A scene as an MJCF model.

    Joint positions are those of the scene's arm, B^T q: the angle between a link and the one before it, the
    travel of a slider. A control is a share of the motor's limit from -1 to 1, or the effort [N m or N] of a
    motor without one.
    """
    model = mechanism(scene, MJCF, approximate)
    steps = max(10, math.ceil(scene.control_dt / LONGEST_STEP - 1e-9))
    step = scene.control_dt / steps
    root = ET.Element("mujoco", model=scene.robot.kind)
    about = [
        "Positions are those of the joints: a link's angle to the one before it, the travel of a slider.",
        "Controls are shares of the limits of motors, -1 to 1; without a limit they are efforts [N m, N].",
        f"A control interval of {scene.control_dt:g} s takes {steps} steps.",
        f"Bodies of point masses have {MJCF.least:g} kg m^2, because MuJoCo requires them to have some.",
        PYBULLET,
    ]
    exact: dict[str, Any] = dict.fromkeys(("boundmass", "boundinertia"), "0")
    exact |= dict.fromkeys(("inertiafromgeom", "balanceinertia"), "false")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", **exact)
    ET.SubElement(root, "option", timestep=numbers(step), integrator="RK4", gravity=numbers(*model.gravity))
    world = ET.SubElement(root, "worldbody")
    above = numbers(0.0, 0.0, 3.0 * model.reach)
    ET.SubElement(world, "light", pos=above, dir="0 0 -1")
    ET.SubElement(world, "camera", name="above", pos=above, xyaxes="1 0 0 0 1 0")
    _chain(world, model, step)
    _motors(root, model)
    return xml(root, heading.lines(about, model.notes), model.notes)


def _chain(world: ET.Element, model: Mechanism, step: float) -> None:
    parent, radius = world, model.thickness / 2.0
    for k, (body, end) in enumerate(zip(model.bodies, model.ends, strict=True)):
        link = body.link
        parent = ET.SubElement(parent, "body", name=f"link{k + 1}", pos=numbers(*link.place, 0.0))
        kind, axis = ("slide", numbers(*link.axis, 0.0)) if link.slides else ("hinge", "0 0 1")
        joint = ET.SubElement(parent, "joint", name=link.joint, type=kind, axis=axis)
        for name in ("damping", "armature", "stiffness"):
            if (value := getattr(model, name)[k]) != 0.0:
                joint.set(name, numbers(value))
        if model.stiffness[k] != 0.0:
            joint.set("springref", numbers(model.rest[k]))
        if k in model.travel:
            joint.set("range", numbers(*model.travel[k]))
            joint.set("solreflimit", numbers(2.0 * step, 1.0))  # as stiff as MuJoCo allows
        if k in model.friction:
            joint.set("frictionloss", numbers(model.friction[k]))
        mass, inertia = numbers(body.mass), numbers(*[body.inertia] * 3)
        ET.SubElement(parent, "inertial", pos=numbers(*body.centre, 0.0), mass=mass, diaginertia=inertia)
        drawn: dict[str, Any] = {"contype": "0", "conaffinity": "0"}
        size, ball = numbers(radius), numbers(1.5 * radius)
        if np.hypot(*end) > radius:
            along = numbers(0.0, 0.0, 0.0, *end, 0.0)
            ET.SubElement(parent, "geom", type="capsule", fromto=along, size=size, rgba=COLOURS[0], **drawn)
        if k == model.tip[0]:
            ET.SubElement(parent, "site", name="tip", pos=numbers(*model.tip[1], 0.0), size=size)
        for offset in link.points.values():
            at = numbers(*offset, 0.0)
            ET.SubElement(parent, "geom", type="sphere", pos=at, size=ball, rgba=COLOURS[1], **drawn)


def _motors(root: ET.Element, model: Mechanism) -> None:
    """Motors at the joints, or on coordinates, which are sums of joint positions."""
    joints = [body.link.joint for body in model.bodies]
    places: Sequence[tuple[str, str]] = [("joint", name) for name in joints]
    if model.coordinates is not None:
        tendons = ET.SubElement(root, "tendon")
        places = [("tendon", f"coordinate{k + 1}") for k in range(len(joints))]
        for (_, name), shares in zip(places, model.coordinates, strict=True):
            tendon = ET.SubElement(tendons, "fixed", name=name)
            for joint, share in zip(joints, shares, strict=True):
                if share != 0.0:
                    ET.SubElement(tendon, "joint", joint=joint, coef=numbers(share))
    motors = ET.SubElement(root, "actuator")
    for k, (kind, name) in enumerate(places):
        motor = ET.SubElement(motors, "motor", {"name": f"motor{k + 1}", kind: name})
        if model.limits is not None and np.isfinite(model.limits[k]):
            motor.set("gear", numbers(model.limits[k]))
            motor.set("ctrlrange", "-1 1")
