"""Arms from outside: their equations, their stops, and what they must declare."""

import numpy as np
import pytest
import rrp
from arms import ADDED, ARMS, states
from three_r_by_hand import ThreeRByHand, points

import redundant_envs as rde

e = rde.effects


def mujoco_model(mujoco, arm, g):
    """A chain of bodies with a mass point each, a motor on every joint."""
    text, before = "", 0.0
    lengths = iter(arm.lengths)
    for k, slides in enumerate(arm.prismatic):
        kind = 'type="slide" axis="1 0 0"' if slides else 'type="hinge" axis="0 0 1"'
        where = 0.0 if slides else next(lengths)
        text += (
            f'<body pos="{before!r} 0 0"><joint name="j{k}" {kind}/><inertial pos="{where!r} 0 0" '
            f'mass="{arm.masses[k]!r}" diaginertia="1e-14 1e-14 1e-14"/>'
        )
        before = where
    text += f'<site name="tip" pos="{before!r} 0 0"/>' + "</body>" * len(arm.joints)
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(arm.joints)))
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        f'<option gravity="0 {-g!r} 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


@pytest.mark.parametrize("name", ADDED)
def test_dynamics_and_kinematics_agree_with_mujoco(name):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")
    arm = ARMS[name]
    model = mujoco_model(mujoco, arm, 9.81)
    data, B = mujoco.MjData(model), arm.motor_map
    q, qd, efforts = states(arm, 100, spread=6.0)
    qdd = arm.forward_dynamics(q, qd, efforts @ B.T)
    tips, jacobians = arm.forward_kinematics(q), arm.jacobian(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q[k] @ B, qd[k] @ B, efforts[k]
        mujoco.mj_forward(model, data)
        assert np.abs(data.qacc - qdd[k] @ B).max() <= 1e-10 * (1.0 + np.abs(data.qacc).max())
        assert np.abs(data.site_xpos[0, :2] - tips[k]).max() <= 1e-13
        found = np.zeros((3, len(arm.joints)))
        mujoco.mj_jacSite(model, data, found, None, 0)
        assert np.abs(found[:2] @ B.T - jacobians[k]).max() <= 1e-13


@pytest.mark.parametrize("name", ADDED)
def test_what_follows_from_the_equations_is_consistent(name):
    arm = ARMS[name]
    q, qd, Q = states(arm, 50)
    qdd = arm.forward_dynamics(q, qd, Q)
    assert np.abs(arm.inverse_dynamics(q, qd, qdd) - Q).max() < 1e-11
    M, J = arm.mass_matrix(q), arm.jacobian(q)
    assert np.allclose(arm.kinetic_energy(q, qd), 0.5 * np.einsum("ni,nij,nj->n", qd, M, qd), rtol=1e-14)
    assert np.allclose(arm.manipulability(q), np.sqrt(np.linalg.det(J @ J.transpose(0, 2, 1))), rtol=1e-10)
    phi = arm.evaluate([f"phi{k + 1}" for k in range(3)], dict(zip(arm.coordinates, q.T, strict=True)))
    assert np.allclose(np.stack(phi, axis=-1), q @ arm.motor_map, atol=1e-15)
    for k in range(3):
        step = np.eye(3)[k] * 1e-6
        slope = (arm.potential_energy(q + step) - arm.potential_energy(q - step)) / 2e-6
        assert np.allclose(slope, arm.gravity_forces(q)[:, k], atol=1e-7)
    assert set(arm.symbols()) >= {"M", "h", "G", "J", "T", "U"}


def test_a_slider_added_from_outside_never_is_beyond_its_stops_and_keeps_its_energy():
    scene = rde.Scene(ARMS["RRP"], (e.Gravity(), e.PrismaticStop((0.0,), (0.2,), 1.0)), tolerance=1e-9)
    times = np.linspace(0.0, 3.0, 151)
    motion = rde.simulate(scene, [0.3, -0.4, 0.1], [1.0, 2.0, 0.5], times)
    assert len(motion.events) > 5
    assert motion.q[:, 2].min() >= 0.0
    assert motion.q[:, 2].max() <= 0.2
    total = motion.kinetic_energy + motion.potential_energy
    assert np.abs(total - total[0]).max() < 1e-7 * np.abs(total).max()


def test_a_slider_added_from_outside_comes_to_rest_and_leaves_its_stop():
    scene = rde.Scene(ARMS["RRP"], (e.Gravity(), e.PrismaticStop((0.0,), (0.2,), 0.0)), tolerance=1e-9)
    motion = rde.simulate(scene, [-1.5, 0.0, 0.1], [0.0, 0.0, 0.0], np.linspace(0.0, 4.0, 201))
    kinds = {event.kind for event in motion.events}
    assert {"upper impact", "rest"} <= kinds
    balance = motion.kinetic_energy + motion.potential_energy - motion.work
    assert np.abs(balance - balance[0]).max() < 1e-6 * np.abs(balance).max()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rates": ("w1", "w2")}, "rates has 2 entries; its coordinates are 3"),
        ({"prismatic": (False,)}, "prismatic has 1 entries"),
        (
            {"functions": tuple(f for f in ThreeRByHand.functions if f is not points)},
            "gives no x1",
        ),
        (
            {"functions": (*ThreeRByHand.functions, points, rrp.points)},
            "is given by both",
        ),
    ],
)
def test_an_arm_that_lacks_something_is_refused_when_its_class_is_made(change, said):
    body = {k: v for k, v in vars(ThreeRByHand).items() if k in rde.Arm.__annotations__}
    with pytest.raises(ValueError, match=said):
        type("Half", (rde.Arm,), {**body, **change})


def test_an_arm_with_positions_of_its_own_needs_the_way_back():
    body = {k: v for k, v in vars(ThreeRByHand).items() if k in rde.Arm.__annotations__}
    del body["coordinates_of_joints"]
    with pytest.raises(ValueError, match="no coordinates_of_joints"):
        type("Half", (rde.Arm,), body)
