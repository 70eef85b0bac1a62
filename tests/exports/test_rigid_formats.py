"""MJCF and URDF: MuJoCo finds our accelerations; what it cannot express is refused by name."""

import dataclasses
import re

import numpy as np
import pytest
from catalogue import SCENES, on
from foreign import largest_difference, model_of, mujoco
from refusals import refusal, short

import redundant_envs as rde
from redundant_envs.algebra import physics, where
from redundant_envs.effects.hooks import Effect, Force, Inertia
from redundant_envs.exports.files import document, write
from redundant_envs.scene import scene_names

e = rde.effects
GRAVITY = e.Gravity.on_plane(9.81, tilt=0.4, roll=0.7)


def two_arms(seed):
    """Both arms, with masses and lengths at random."""
    rng = np.random.default_rng(seed)
    return [
        rde.FourR(rng.uniform(0.1, 2.0, 4), rng.uniform(0.1, 1.0, 4)),
        rde.RPRP(rng.uniform(0.1, 2.0, 4), rng.uniform(0.1, 1.0, 2)),
    ]


def exact_effects(arm, form):
    """Everything that the format expresses exactly."""
    made = [GRAVITY, e.ViscousFriction((0.2, 0.1, 0.05, 0.3)), e.EffortLimits((20.0, 12.0, 8.0, 4.0))]
    made += [e.Payload(0.7), e.LinkInertia(0.02)]
    if form == "mjcf":
        made.append(e.Armature((0.05, 0.02, 0.01, 0.03)))
        made += [e.CentringSpring((30.0, 50.0), (0.0, 0.1), (0.3, 0.2))] if arm.sliders() else []
    return tuple(made)


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
@pytest.mark.parametrize("seed", range(3))
def test_mujoco_finds_the_accelerations_of_both_arms(form, seed):
    for arm in two_arms(seed):
        for effects in ((GRAVITY,), exact_effects(arm, form)):
            scene = rde.Scene(arm, effects)
            model = model_of(scene, form)
            if form == "urdf":
                model.opt.gravity[:] = [9.81 * x for x in (*GRAVITY.down, 0.0)]
            assert largest_difference(scene, model, form == "mjcf", seed) < 1e-10


@physics
def towards(position, middle, stiffness):
    return stiffness * (middle - position)


@physics
def dead_beyond(position, middle, stiffness):
    return where(position - middle > 1e6, 0.0, stiffness * (middle - position))


@dataclasses.dataclass(frozen=True)
class Spring(Effect):
    """A spring on the first joint; with ``law`` 1 its force ends far beyond any travel."""

    law: int
    middle: float = 0.3
    stiffness: float = 20.0

    static = ("law",)

    def hooks(self, arm):
        bind = {"position": "phi1", "middle": ".middle", "stiffness": ".stiffness"}
        return (Force(0, (towards, dead_beyond)[self.law], bind),)


@dataclasses.dataclass(frozen=True)
class Coupling(Effect):
    """An inertia of the sum of two joints' rates that belong to no link."""

    inertia: float = 0.01

    def hooks(self, arm):
        return (Inertia((1, 2), ".inertia"),)


def test_a_linear_force_of_a_users_effect_maps_exactly_and_another_one_is_refused():
    arm = two_arms(5)[0]
    scene = rde.Scene(arm, (GRAVITY, Spring(0)))
    assert largest_difference(scene, model_of(scene, "mjcf"), True) < 1e-10
    for form, effect, words in (
        ("mjcf", Spring(1), "Spring (forces are linear"),
        ("urdf", Spring(0), "Spring (URDF has no springs)"),
        ("mjcf", Coupling(), "Coupling (it is neither"),
    ):
        with pytest.raises(ValueError, match=re.escape(words)):
            document(rde.Scene(arm, (GRAVITY, effect)), form)


EXACT = {"Gravity", "ViscousFriction", "EffortLimits", "CentringSpring", "Payload", "LinkInertia", "Armature"}


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_what_has_no_exact_counterpart_is_refused_by_name_and_noted_if_it_is_allowed(form):
    exact = EXACT - ({"CentringSpring", "Armature"} if form == "urdf" else set())
    for name in scene_names():
        scene = rde.load_scene(name)
        missing = [type(x).__name__ for x in scene.effects if type(x).__name__ not in exact]
        text, notes = document(scene, form, approximate=True)
        assert [note.name for note in notes] == missing
        assert all(f"{missed}: " in text for missed in missing)
        model = mujoco.MjModel.from_xml_string(text)
        assert model.nv == len(scene.robot.joints)
        if not missing:
            assert document(scene, form).content == text
            continue
        with pytest.raises(ValueError, match="cannot express exactly") as refused:
            document(scene, form)
        assert all(missed in str(refused.value) for missed in missing)
        assert "--approximate" in str(refused.value)


def test_soft_ends_and_dry_friction_are_written_where_they_may_be_approximate():
    stops, friction = e.PrismaticStop((0.0, None), (0.25, 0.3)), e.CoulombFriction((1.0, 2.0, 3.0, 4.0))
    model = model_of(rde.Scene(two_arms(1)[1], (stops, friction)), "mjcf", approximate=True)
    np.testing.assert_array_equal(model.jnt_limited, [0, 1, 0, 0])  # one end alone is none
    np.testing.assert_array_equal(model.jnt_range[1], [0.0, 0.25])
    np.testing.assert_array_equal(model.dof_frictionloss, [1.0, 2.0, 3.0, 4.0])


def test_limits_behind_what_is_left_out_stay_limits():
    effects = (e.Lag(0.05), e.EffortLimits((4.0, 3.0, 2.0, 1.0)))
    for tolerance in (None, 1e-6):
        scene = rde.Scene(two_arms(1)[0], effects, tolerance=tolerance)
        text, notes = document(scene, "mjcf", approximate=True)
        assert [note.name for note in notes] == ["Lag"]
        model = mujoco.MjModel.from_xml_string(text)
        np.testing.assert_array_equal(model.actuator_gear[:, 0], [4.0, 3.0, 2.0, 1.0])


@on("*")
def test_every_scene_is_written_or_refused_in_one_sentence(scene):
    for form in ("mjcf", "urdf"):
        message = refusal(document, scene, form)
        assert message is None or (short(message) and re.search("cannot|actuation", message))
        if form == "urdf" and scene.actuation == "generalized":
            continue
        model = mujoco.MjModel.from_xml_string(document(scene, form, approximate=True).content)
        assert model.nv == len(scene.robot.joints)


def test_an_arm_that_is_no_chain_of_rigid_links_is_refused():
    @physics(gives="x1 y1 x2 y2")
    def points(l1, l2, s1, c1, s2, c2):  # the second mass is pulled in as the first joint turns
        return l1 * c1, l1 * s1, l1 * c1 + l2 * c1 * c2, l1 * s1 + l2 * s2

    class Pulled(rde.Arm):
        joint_types = "RR"
        functions = (points,)

    scene = rde.Scene(Pulled((1.0, 1.0), (0.5, 0.5)))
    with pytest.raises(
        ValueError, match=r"robot is a Pulled, which cannot be written as rigid links: its poi"
    ):
        document(scene, "mjcf")


def test_an_arm_whose_accelerations_the_least_inertia_changes_is_refused():
    scene = rde.Scene(rde.FourR((1e-5,) * 4, (0.01,) * 4))
    with pytest.raises(ValueError, match=r"the light arm FourR \(bodies have 2e-15 kg m\^2 there"):
        document(scene, "mjcf")
    assert "the light arm FourR: written with it" in document(scene, "mjcf", approximate=True).content


def test_a_name_of_a_file_cannot_break_a_comment(tmp_path):
    name = "a--b-->\x00<c>\ud800"
    for form in ("mjcf", "urdf"):
        write(SCENES["4R gravity rk4"], form, tmp_path / "new" / form, name=name)
        text = (tmp_path / "new" / form).read_text(encoding="utf-8")
        assert "the scene a- -b- ->?<c>?." in text
        mujoco.MjModel.from_xml_string(text)
