"""MJCF and URDF: MuJoCo finds our accelerations; what it cannot express is refused by name."""

import dataclasses
import re

import numpy as np
import pytest
from catalogue import SCENES, on
from foreign import NEEDS_MUJOCO, assert_same_tips, largest_difference, model_of, mujoco
from refusals import refusal, short

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Field, Force, Inertia
from redundant_envs.exports.files import document, write
from redundant_envs.language.algebra import physics, where
from redundant_envs.scenes.scene import scene_names

pytestmark = NEEDS_MUJOCO
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


@pytest.mark.quick("0-mjcf")
@pytest.mark.parametrize("form", ["mjcf", "urdf"])
@pytest.mark.parametrize("seed", range(3))
def test_mujoco_finds_the_accelerations_of_both_arms(form, seed):
    for arm in two_arms(seed):
        for effects in ((GRAVITY,), exact_effects(arm, form)):
            scene = rde.Scene(arm, effects)
            model = model_of(scene, form)
            if form == "urdf":
                model.opt.gravity[:] = [9.81 * x for x in (*GRAVITY.down, 0.0)]
            found = largest_difference(scene, model, form == "mjcf", seed)
            print(f"{form}, {arm.kind}: largest difference {found:.1e}")
            assert found < 1e-10


@physics
def towards(position, middle, compliance):
    return (middle - position) / compliance


@physics
def dead_beyond(position, middle, compliance):
    return where(position - middle > 1e6, 0.0, (middle - position) / compliance)


@dataclasses.dataclass(frozen=True)
class Spring(Effect):
    """A spring on the first joint; with ``law`` 1 its force ends far beyond any travel."""

    law: int
    middle: float = 0.3
    compliance: float = 0.05

    static = ("law",)

    def hooks(self, arm):
        bind = {"position": "phi1", "middle": ".middle", "compliance": ".compliance"}
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
        ("mjcf", Spring(1), "Spring (its force is not linear"),
        ("urdf", Spring(0), "Spring (URDF has no springs)"),
        ("mjcf", Coupling(), "Coupling (it is neither"),
    ):
        with pytest.raises(ValueError, match=re.escape(words)):
            document(rde.Scene(arm, (GRAVITY, effect)), form)


EXACT = {"Gravity", "ViscousFriction", "EffortLimits", "CentringSpring", "Payload", "LinkInertia", "Armature"}


@pytest.mark.quick("mjcf")
@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_what_has_no_exact_counterpart_is_refused_by_name_and_noted_if_it_is_allowed(form):
    exact = EXACT - ({"CentringSpring", "Armature"} if form == "urdf" else set())
    for name in scene_names():
        scene = rde.load_scene(name)
        missing = [type(x).__name__ for x in scene.effects if type(x).__name__ not in exact]
        text, notes = document(scene, form, approximate=True)
        assert [note.name.partition(" ")[0] for note in notes] == missing
        assert all(f"{note}" in text for note in notes)
        model = mujoco.MjModel.from_xml_string(text)
        assert model.nv == len(scene.robot.joints)
        if not missing:
            assert document(scene, form).content == text
            continue
        with pytest.raises(ValueError, match="cannot express parts of this scene exactly") as refused:
            document(scene, form)
        assert all(missed in str(refused.value) for missed in missing)
        assert "--approximate" in str(refused.value)


def test_soft_ends_and_dry_friction_are_written_where_they_may_be_approximate():
    stops, friction = e.PrismaticStop((0.0, None), (0.25, 0.3)), e.CoulombFriction((1.0, 2.0, 3.0, 4.0))
    model = model_of(rde.Scene(two_arms(1)[1], (stops, friction)), "mjcf", approximate=True)
    np.testing.assert_array_equal(model.jnt_limited, [0, 1, 0, 1])
    np.testing.assert_array_equal(model.jnt_range[[1, 3]], [[0.0, 0.25], [-1e9, 0.3]])
    np.testing.assert_array_equal(model.dof_frictionloss, [1.0, 2.0, 3.0, 4.0])


def test_limits_behind_what_is_left_out_stay_limits():
    effects = (e.Lag(0.05), e.EffortLimits((4.0, 3.0, 2.0, 1.0)))
    for tolerance in (None, 1e-6):
        scene = rde.Scene(two_arms(1)[0], effects, tolerance=tolerance)
        text, notes = document(scene, "mjcf", approximate=True)
        assert [note.name for note in notes] == ["Lag"]
        model = mujoco.MjModel.from_xml_string(text)
        np.testing.assert_array_equal(model.actuator_gear[:, 0], [4.0, 3.0, 2.0, 1.0])


@pytest.mark.quick("4R free euler")
@on("*")
def test_every_scene_is_written_or_refused_in_one_sentence(scene):
    for form in ("mjcf", "urdf"):
        message = refusal(document, scene, form)
        assert message is None or (short(message) and "cannot" in message)
        model = mujoco.MjModel.from_xml_string(document(scene, form, approximate=True).content)
        assert model.nv == len(scene.robot.joints)


@physics
def weighted(rate, m4, k):
    return -k * m4 * rate


@physics
def push(k):
    return k


@physics
def weight(g, m4):
    return 0.0, g * m4


@dataclasses.dataclass(frozen=True)
class OfTheLoad(Effect):
    """Friction and gravity that depend on the last mass of the arm, with what it carries."""

    k: float = 0.3

    def hooks(self, arm):
        at_last = Force(3, weighted, {"rate": "phid4", "k": ".k"})
        return at_last, Field(weight, {"g": ".k"})


@dataclasses.dataclass(frozen=True)
class Push(Effect):
    """A constant force on the second joint."""

    k: float = 2.0

    def hooks(self, arm):
        return (Force(1, push, {"k": ".k"}),)


@dataclasses.dataclass(frozen=True)
class ByCoordinate(Effect):
    """A spring between a slider and the base, which names the coordinate."""

    k: float = 0.3

    def hooks(self, arm):
        bind = {"position": "r1", "middle": ".k", "compliance": ".k"}
        return (Force(1, towards, bind),)


def test_laws_take_the_masses_with_their_loads():
    scene = rde.Scene(two_arms(2)[0], (OfTheLoad(), e.Payload(2.0)))
    assert largest_difference(scene, model_of(scene, "mjcf"), True) < 1e-10


def test_a_constant_force_is_part_of_a_spring_or_refused():
    arm = two_arms(3)[1]
    spring = e.CentringSpring((30.0, 50.0), (0.0, 0.1), (0.3, 0.2))
    both = rde.Scene(arm, (Push(), spring))
    assert largest_difference(both, model_of(both, "mjcf"), True) < 1e-10
    alone = rde.Scene(arm, (Push(), e.CentringSpring((0.0, 50.0), (0.0, 0.1), (0.3, 0.2))))
    with pytest.raises(ValueError, match=r"Push \(it is a constant force\)"):
        document(alone, "mjcf")


def test_a_force_may_name_the_coordinate_of_its_slider():
    scene = rde.Scene(two_arms(3)[1], (ByCoordinate(),))
    assert largest_difference(scene, model_of(scene, "mjcf"), True) < 1e-10


def test_of_two_ends_of_a_travel_the_nearer_one_is_written():
    stops, spring = e.PrismaticStop((0.0, 0.0), (0.2, 0.3)), e.LimitSpring("r1", 0.05, 1.0)
    for effects in ((stops, spring), (spring, stops)):
        model = model_of(rde.Scene(two_arms(1)[1], effects), "mjcf", approximate=True)
        np.testing.assert_array_equal(model.jnt_range[1], [0.05, 0.2])


@pytest.mark.quick("0.001")
@pytest.mark.parametrize("control_dt", [0.001, 0.02, 1.0])
def test_soft_ends_hold_a_pushed_slider(control_dt):
    effects = (e.PrismaticStop((0.0, 0.0), (0.25, 0.25)), e.ViscousFriction(0.2), e.EffortLimits(16.0))
    scene = rde.Scene(rde.load_scene("rprp_reach").robot, effects, control_dt=control_dt)
    model = model_of(scene, "mjcf", approximate=True)
    assert model.opt.timestep <= 0.002
    data, farthest = mujoco.MjData(model), 0.0
    data.ctrl[:] = [0.0, 1.0, 0.0, 1.0]
    for _ in range(int(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        farthest = max(farthest, data.qpos[1], data.qpos[3])
    assert farthest < 0.25 + 0.02


@physics(gives="x1 y1 x2 y2")
def geared(l1, l2, s1, c1, r1):
    return l1 * c1, l1 * s1, (l1 + l2 + 2.0 * r1) * c1, (l1 + l2 + 2.0 * r1) * s1


@physics(gives="x1 y1")
def rod_end(l1, s1, c1):
    return l1 * c1, l1 * s1


@physics(gives="M11")
def rod(m1, l1):
    return 4.0 / 3.0 * m1 * l1 * l1


@physics(gives="x1 y1 x2 y2")
def tip_first(l1, l2, s1, c1, s2, c2):
    return l1 * c1 + l2 * c2, l1 * s1 + l2 * s2, 0.5 * l1 * c1, 0.5 * l1 * s1


@physics(gives="Q1 Q2")
def belt(t1, t2):
    return t1 + t2, t2


@physics(gives="phi1 phi2")
def joint_positions(a, b):
    return a, b


@physics(gives="phid1 phid2")
def joint_rates(w1, w2):
    return w1, w2


@physics
def as_they_are(phi1, phi2):
    return phi1, phi2


def an_arm(name, joint_types, *functions):
    return type(name, (rde.Arm,), {"joint_types": joint_types, "functions": functions})


def test_arms_with_other_equations_than_their_links_are_refused():
    class Belt(rde.Arm):
        num_masses, num_lengths = 2, 2
        coordinates, rates = ("a", "b"), ("w1", "w2")
        joints, prismatic = ("joint1", "joint2"), (False, False)
        sincos = {"a": ("s1", "c1"), "b": ("s2", "c2")}
        functions = (tip_first, belt, joint_positions, joint_rates)
        coordinates_of_joints = as_they_are

    two = (1.0, 1.0), (0.5, 0.4)
    for arm, words in (
        (an_arm("Geared", "RP", geared)(*two), "its slider r1 moves a mass by 2 m for each metre"),
        (an_arm("Rod", "R", rod_end, rod)((1.0,), (0.5,)), "its masses and inertias are not those"),
        (Belt(*two), "its motors do not act between"),
    ):
        with pytest.raises(ValueError, match=words):
            document(rde.Scene(arm), "mjcf")


@physics(gives="x1 y1 x2 y2 x3 y3")
def three_masses(l1, l2, s1, c1, s2, c2):
    x2, y2 = l1 * c1, l1 * s1
    return 0.4 * x2 - 0.1 * y2, 0.4 * y2 + 0.1 * x2, x2, y2, x2 + l2 * c2, y2 + l2 * s2


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_link_that_carries_several_masses_has_their_inertia(form):
    arm = an_arm("ThreeMasses", "RR", three_masses)((0.8, 0.5, 0.3), (0.6, 0.4))
    scene = rde.Scene(arm)
    assert largest_difference(scene, model_of(scene, form), form == "mjcf") < 1e-10


@physics(gives="h1")
def no_bias(l1):
    return 0.0 * l1


def test_terms_that_cancel_are_compared_by_their_sizes():
    kind, rng = an_arm("Pendulum", "R", rod_end, no_bias), np.random.default_rng(0)
    for mass, length in rng.uniform(0.1, 1.0, (20, 2)):
        document(rde.Scene(kind((mass,), (length,))), "mjcf")


def test_lengths_keep_their_digits():
    lengths = (1.0 / 3.0, 0.2 / 3.0, 0.25, 0.7)
    model = model_of(rde.Scene(rde.FourR((0.5,) * 4, lengths)), "mjcf")
    # places are differences of positions, which are rounded at the size of the reach
    np.testing.assert_allclose(model.body_pos[2:, 0], lengths[:3], rtol=0, atol=2.3e-16)


def test_the_tip_is_on_the_link_that_carries_it():
    arm = an_arm("TipFirst", "RR", tip_first)((1.0, 0.7), (0.5, 0.4))
    scene = rde.Scene(arm, (GRAVITY,))
    model = model_of(scene, "mjcf")
    assert largest_difference(scene, model, True) < 1e-10
    assert_same_tips(scene, model)


def test_motors_on_coordinates_are_noted_where_a_format_has_none():
    scene = rde.Scene(two_arms(1)[0], (e.EffortLimits(3.0),), actuation="generalized")
    assert "actuation 'generalized' (URDF has motors" in refusal(document, scene, "urdf")
    text = document(scene, "urdf", approximate=True).content
    assert "actuation 'generalized': left out" in text
    assert 'effort="3.0"' not in text


def test_an_arm_that_is_no_chain_of_rigid_links_is_refused():
    @physics(gives="x1 y1 x2 y2")
    def points(l1, l2, s1, c1, s2, c2):  # the second mass is pulled in as the first joint turns
        return l1 * c1, l1 * s1, l1 * c1 + l2 * c1 * c2, l1 * s1 + l2 * s2

    class Pulled(rde.Arm):
        joint_types = "RR"
        functions = (points,)

    scene = rde.Scene(Pulled((1.0, 1.0), (0.5, 0.5)))
    with pytest.raises(ValueError, match=r"robot is a Pulled, which cannot be written as rigid links: "):
        document(scene, "mjcf")


def test_an_arm_whose_accelerations_the_least_inertia_changes_is_refused():
    scene = rde.Scene(rde.FourR((1e-5,) * 4, (0.01,) * 4))
    with pytest.raises(ValueError, match=r"the small masses of FourR \(a body has 2e-15 kg m\^2 there"):
        document(scene, "mjcf")
    assert "the small masses of FourR: written with it" in document(scene, "mjcf", approximate=True).content


def test_a_name_of_a_file_cannot_break_a_comment(tmp_path):
    name = "a--b-->\x00<c>\ud800"
    for form in ("mjcf", "urdf"):
        write(SCENES["4R gravity rk4"], form, tmp_path / "new" / form, name=name)
        text = (tmp_path / "new" / form).read_text(encoding="utf-8")
        assert "the scene a- -b- ->?<c>?." in text
        mujoco.MjModel.from_xml_string(text)
