"""A scene as URDF, which ROS, PyBullet, Pinocchio, Drake, Isaac and MuJoCo read."""

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from redundant_envs.exports.files import PYBULLET, Document, Heading, numbers, xml
from redundant_envs.exports.mechanism import FREE, Format, Mechanism, mechanism
from redundant_envs.scenes.scene import Scene

URDF = Format(
    "URDF", least=1e-14, springs=False, rotors=False, generalized=False,
    soft_ends="written as ends of travel, which a reader makes as stiff as it likes",
)  # fmt: skip
"""MuJoCo requires as large a moment of inertia of a URDF model."""


def urdf(scene: Scene, heading: Heading, approximate: bool) -> Document:
    """A scene as a URDF model. Gravity is set by the program that reads it."""
    model = mechanism(scene, URDF, approximate)
    x, y, _ = model.gravity.tolist()
    root = ET.Element("robot", name=scene.robot.kind)
    about = [
        f"URDF has no gravity: set it to ({x!r}, {y!r}, 0) m/s^2 where the model is loaded.",
        f"Bodies of point masses have {URDF.least:g} kg m^2, because programs require them to have some.",
        PYBULLET,
    ]
    ET.SubElement(root, "link", name="base")
    for k, body in enumerate(model.bodies):
        link = ET.SubElement(root, "link", name=f"link{k + 1}")
        _inertial(link, body.mass, body.centre, body.inertia)
        _draw(link, model, k)
        _joint(root, model, k)
    _inertial(ET.SubElement(root, "link", name="tip"), 0.0, (0.0, 0.0), 0.0)  # else PyBullet gives it 1 kg
    fixed = ET.SubElement(root, "joint", name="fixed_tip", type="fixed")
    ET.SubElement(fixed, "parent", link=f"link{model.tip[0] + 1}")
    ET.SubElement(fixed, "child", link="tip")
    ET.SubElement(fixed, "origin", xyz=numbers(*model.tip[1], 0.0))
    return xml(root, heading.lines(about, model.notes), model.notes)


def _inertial(link: ET.Element, mass: float, centre: Iterable[float], inertia: float) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(*centre, 0.0))
    ET.SubElement(inertial, "mass", value=numbers(mass))
    moment = numbers(inertia)
    ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")


def _draw(link: ET.Element, model: Mechanism, k: int) -> None:
    """A bar from the joint of a link to the next one, and a ball for each point mass."""
    end, radius = model.ends[k], model.thickness / 2.0
    if (length := float(np.hypot(*end))) > radius:
        visual = ET.SubElement(link, "visual")
        turn = numbers(0.0, 0.0, np.arctan2(end[1], end[0]))
        ET.SubElement(visual, "origin", xyz=numbers(*end / 2.0, 0.0), rpy=turn)
        ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=numbers(length, radius, radius))
    for offset in model.bodies[k].link.points.values():
        visual = ET.SubElement(link, "visual")
        ET.SubElement(visual, "origin", xyz=numbers(*offset, 0.0))
        ET.SubElement(ET.SubElement(visual, "geometry"), "sphere", radius=numbers(1.5 * radius))


def _joint(root: ET.Element, model: Mechanism, k: int) -> None:
    link = model.bodies[k].link
    turning = "revolute" if k in model.travel else "continuous"
    joint = ET.SubElement(root, "joint", name=link.joint, type="prismatic" if link.slides else turning)
    ET.SubElement(joint, "parent", link=f"link{k}" if k else "base")
    ET.SubElement(joint, "child", link=f"link{k + 1}")
    ET.SubElement(joint, "origin", xyz=numbers(*link.place, 0.0))
    ET.SubElement(joint, "axis", xyz=numbers(*link.axis, 0.0) if link.slides else "0 0 1")
    effort = FREE if model.limits is None else min(model.limits[k], FREE)
    limit = ET.SubElement(joint, "limit", effort=numbers(effort), velocity=numbers(FREE))
    if link.slides or k in model.travel:
        lower, upper = model.travel.get(k, (-FREE, FREE))
        limit.attrib |= {"lower": numbers(lower), "upper": numbers(upper)}
    friction = model.friction.get(k, 0.0)
    ET.SubElement(joint, "dynamics", damping=numbers(model.damping[k]), friction=numbers(friction))
