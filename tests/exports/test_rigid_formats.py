"""MJCF and URDF: MuJoCo finds our accelerations; what it cannot express is refused by name."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from catalogue import SCENES
from foreign import NEEDS_MUJOCO, largest_difference, model_of, mujoco, ours, states
from refusals import refusal

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.exports.files import document, write
from redundant_envs.language.algebra import maximum, minimum, physics, where
from redundant_envs.scenes.scene import scene_names

pytestmark = NEEDS_MUJOCO
e = rde.effects
GRAVITY = e.Gravity.on_plane(9.81, tilt=0.4, roll=0.7)


def two_arms(seed):
    """Both arms, with masses and lengths at random, in single precision: PyBullet reads those of MJCF so."""
    rng = np.random.default_rng(seed)

    def drawn(low, high, count):
        return tuple(rng.uniform(low, high, count).astype(np.float32).tolist())

    return rde.FourR(drawn(0.1, 2.0, 4), drawn(0.1, 1.0, 4)), rde.RPRP(drawn(0.1, 2.0, 4), drawn(0.1, 1.0, 2))


F_ARM, R_ARM = two_arms(1)


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
            assert largest_difference(scene, model, form == "mjcf", seed) < 1e-10


towards = physics(lambda position, middle, c: (middle - position) / c)
push = physics(lambda middle: middle)
cut_off = physics(lambda position, middle, c: where(position - middle > 1e6, 0.0, (middle - position) / c))
jumping = physics(lambda position, middle, c: (middle - position) / c + where(position > 0.3, 1.0, 0.0))
beyond_band = physics(
    lambda position, middle, c: -(maximum(position - middle, 1e3) + minimum(position - middle, -1e3)) / c
)
of_sizes = physics(lambda position, c: -(abs(position + 1e3) - abs(position - 1e3)) / c)


@dataclasses.dataclass(frozen=True)
class Law(Effect):
    """A law of a user's on the first joint, of its position or a push; c is a compliance."""

    law: Callable[..., Any]
    middle: float = 0.3
    c: float = 0.05

    static = ("law",)

    def hooks(self, arm):
        return (Force(0, self.law),)


def test_a_linear_force_of_a_users_effect_maps_exactly_and_another_one_is_refused():
    scene = rde.Scene(F_ARM, (GRAVITY, Law(towards)))
    assert largest_difference(scene, model_of(scene, "mjcf"), True) < 1e-10
    bent = cut_off, jumping, beyond_band, of_sizes
    for form, law, words in (
        *(("mjcf", law, "Law (its force is not linear") for law in bent),
        ("mjcf", push, "Law (it is a constant force)"),
        ("urdf", towards, "Law (URDF has no springs)"),
    ):
        assert words in refusal(document, rde.Scene(F_ARM, (GRAVITY, Law(law))), form)


EXACT = {"Gravity", "ViscousFriction", "EffortLimits", "CentringSpring", "Payload", "LinkInertia", "Armature"}
EXACT |= {"KeepOut"}  # it acts on nothing


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
        assert mujoco.MjModel.from_xml_string(text).nv == len(scene.robot.joints)
        message = refusal(document, scene, form)
        if missing:
            assert "cannot express parts of this scene exactly" in message
            assert all(missed in message for missed in (*missing, "--approximate"))
        else:
            assert message is None
            assert document(scene, form).content == text


def test_soft_ends_and_dry_friction_are_written_where_they_may_be_approximate():
    stops, friction = e.PrismaticStop((0.0, None), (0.25, 0.3)), e.CoulombFriction((1.0, 2.0, 3.0, 4.0))
    brake = e.MotorBrake(0, 0.0)  # which has no level: it closes some time
    model = model_of(rde.Scene(R_ARM, (stops, friction, brake)), "mjcf", approximate=True)
    _, notes = document(rde.Scene(R_ARM, (friction, brake)), "mjcf", approximate=True)
    assert [note.written for note in notes] == ["written with its level at rest", "left out"]
    np.testing.assert_array_equal(model.jnt_limited, [0, 1, 0, 1])
    np.testing.assert_array_equal(model.jnt_range[[1, 3]], [[0.0, 0.25], [-1e9, 0.3]])
    np.testing.assert_array_equal(model.dof_frictionloss, [1.0, 2.0, 3.0, 4.0])
    spring = e.LimitSpring("r1", 0.05, 1.0)
    for effects in ((stops, spring), (spring, stops)):  # of two ends the nearer one
        model = model_of(rde.Scene(R_ARM, effects), "mjcf", approximate=True)
        np.testing.assert_array_equal(model.jnt_range[1], [0.05, 0.25])


def test_limits_behind_what_is_left_out_stay_limits():
    scene = rde.Scene(F_ARM, (e.Lag(0.05), e.EffortLimits((4.0, 3.0, 2.0, 1.0))), tolerance=1e-6)
    text, notes = document(scene, "mjcf", approximate=True)
    assert [note.name for note in notes] == ["Lag"]
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_array_equal(model.actuator_gear[:, 0], [4.0, 3.0, 2.0, 1.0])


def test_motors_on_coordinates_are_noted_where_a_format_has_none():
    scene = rde.Scene(F_ARM, (e.EffortLimits(3.0),), actuation="generalized")
    assert "actuation 'generalized' (URDF has motors" in refusal(document, scene, "urdf")
    text = document(scene, "urdf", approximate=True).content
    assert "actuation 'generalized': left out" in text
    assert 'effort="3.0"' not in text


@physics(gives="x1 y1 x2 y2 x3 y3")
def three_masses(l1, l2, s1, c1, s2, c2):
    x2, y2 = l1 * c1, l1 * s1
    return 0.4 * x2 - 0.1 * y2, 0.4 * y2 + 0.1 * x2, x2, y2, x2 + l2 * c2, y2 + l2 * s2


@physics(gives="x1 y1 x2 y2")
def geared(l1, l2, s1, c1, r1):
    return l1 * c1, l1 * s1, (l1 + l2 + 2.0 * r1) * c1, (l1 + l2 + 2.0 * r1) * s1


@physics(gives="x1 y1 x2 y2")
def pulled(l1, l2, s1, c1, s2, c2):  # the second mass is pulled in as the first joint turns
    return l1 * c1, l1 * s1, l1 * c1 + l2 * c1 * c2, l1 * s1 + l2 * s2


def an_arm(name, joint_types, *functions):
    return type(name, (rde.Arm,), {"joint_types": joint_types, "functions": functions})


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_link_that_carries_several_masses_has_their_inertia(form):
    scene = rde.Scene(an_arm("ThreeMasses", "RR", three_masses)((0.8, 0.5, 0.3), (0.6, 0.4)))
    assert largest_difference(scene, model_of(scene, form), form == "mjcf") < 1e-10


def test_arms_with_other_equations_than_their_links_are_refused():
    two, light = ((1.0, 1.0), (0.5, 0.4)), ((1e-5,) * 4, (0.01,) * 4)
    unbounded, sliding = (type("Own", (kind,), {"mobility_bounds": None}) for kind in (rde.FourR, rde.RPRP))
    assert unbounded.mobility_bounds is sliding.mobility_bounds is None
    assert refusal(document, rde.Scene(sliding((1.0,) * 4, (0.5, 0.4))), "mjcf") is None
    for arm, words in (
        (an_arm("Geared", "RP", geared)(*two), "its slider r1 moves a mass by 2 m for each metre"),
        (an_arm("Pulled", "RR", pulled)(*two), "robot is a Pulled, which cannot be written as rigid links: "),
        (unbounded(*light), "the small masses of FourR (a body has 2e-15 kg m^2 there"),
        (sliding((1e-6,) * 4, (0.01,) * 2), "the small masses of RPRP (a body has 2e-15 kg m^2 there"),
        (rde.FourR(*light), "the small masses of FourR (a body has 2e-15 kg m^2 there"),
    ):
        assert words in refusal(document, rde.Scene(arm), "mjcf")


def test_a_name_of_a_file_cannot_break_a_comment(tmp_path):
    for form in ("mjcf", "urdf"):
        write(SCENES["4R gravity rk4"], form, tmp_path / "new" / form, name="a--b-->\x00<c>\ud800")
        text = (tmp_path / "new" / form).read_text(encoding="utf-8")
        assert "the scene a- -b- ->?<c>?." in text
        mujoco.MjModel.from_xml_string(text)


# ---- other readers -----------------------------------------------------------------------------------

FIELD = [9.81 * x for x in (*GRAVITY.down, 0.0)]


def in_pybullet(path, form, arm):
    """A function from positions, rates and efforts of the joints to their accelerations."""
    p = pytest.importorskip("pybullet", reason="PyBullet is not installed: pip install pybullet")
    client = p.connect(p.DIRECT)
    how = {"flags": p.URDF_USE_INERTIA_FROM_FILE, "physicsClientId": client}
    if form == "urdf":
        body = p.loadURDF(str(path), useFixedBase=True, **how)
    else:
        (body,) = p.loadMJCF(str(path), **how)
    p.setGravity(*FIELD, physicsClientId=client)
    infos = (p.getJointInfo(body, k, client) for k in range(p.getNumJoints(body, client)))
    order = [arm.joints.index(name.decode()) for _, name, kind, *_ in infos if kind != p.JOINT_FIXED]
    undamped = dict.fromkeys(("jointDamping", "linearDamping", "angularDamping"), 0.0)
    for k in range(p.getNumJoints(body, client)):
        p.changeDynamics(body, k, **undamped, physicsClientId=client)

    def found(phi, phid, efforts):
        at = phi[order].tolist()
        still = [0.0] * len(order)
        mass = p.calculateMassMatrix(body, at, physicsClientId=client)
        bias = p.calculateInverseDynamics(body, at, phid[order].tolist(), still, physicsClientId=client)
        made = np.empty(len(order))
        made[order] = np.linalg.solve(mass, efforts[order] - bias)
        return made

    return found


def in_pinocchio(path, form, arm):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed: pip install pin")
    model = (pin.buildModelFromUrdf if form == "urdf" else pin.buildModelFromMJCF)(str(path))
    model.gravity.linear = np.array(FIELD)
    data, joints = model.createData(), [model.joints[model.getJointId(name)] for name in arm.joints]
    rates = [joint.idx_v for joint in joints]

    def found(phi, phid, efforts):
        q, v, tau = np.empty(model.nq), np.empty(model.nv), np.empty(model.nv)
        for joint, x in zip(joints, phi, strict=True):  # a joint without ends has a cosine and a sine
            q[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(x), np.sin(x)) if joint.nq == 2 else x
        v[rates], tau[rates] = phid, efforts
        return pin.aba(model, data, q, v, tau)[rates]

    return found


def in_drake(path, form, arm):
    pytest.importorskip("pydrake.all", reason="Drake is not installed: pip install drake")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(path))
    if form == "urdf":
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.mutable_gravity_field().set_gravity_vector(FIELD)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    order = [plant.GetJointByName(name).velocity_start() for name in arm.joints]

    def found(phi, phid, efforts):
        x, v, tau = np.empty((3, len(order)))
        x[order], v[order], tau[order] = phi, phid, efforts
        plant.SetPositions(context, x)
        plant.SetVelocities(context, v)
        forces = tau + plant.CalcGravityGeneralizedForces(context) - plant.CalcBiasTerm(context)
        return np.linalg.solve(plant.CalcMassMatrix(context), forces)[order]

    return found


@pytest.mark.parametrize("reader", [in_pybullet, in_pinocchio, in_drake])
@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_other_readers_find_the_accelerations_of_both_arms(form, reader, tmp_path):
    for arm in two_arms(0):
        for more in ((), (e.Payload(0.75), e.LinkInertia(0.015625))):
            scene = rde.Scene(arm, (GRAVITY, *more))
            path = tmp_path / ("arm.urdf" if form == "urdf" else "arm.xml")
            path.write_text(document(scene, form).content)
            accelerations, worst = reader(path, form, arm), 0.0
            q, qd, efforts = states(arm)
            expected = ours(scene, q, qd, efforts)
            for row in zip(q @ arm.motor_map, qd @ arm.motor_map, efforts, expected, strict=True):
                worst = max(worst, np.abs(accelerations(*row[:3]) - row[3]).max() / np.abs(row[3]).max())
            assert worst < 1e-10
