"""URDF and MJCF in PyBullet, Pinocchio and Drake, as far as these are installed: accelerations are ours."""

import numpy as np
import pytest
from foreign import ours, states

import redundant_envs as rde
from redundant_envs.exports.files import document

e = rde.effects
PROGRAMS = {"pybullet": "pybullet", "pinocchio": "pin", "pydrake": "drake"}
"""Modules of readers, and their names for pip."""
GRAVITY = e.Gravity.on_plane(9.81, tilt=0.4, roll=0.7)
FIELD = [9.81 * x for x in (*GRAVITY.down, 0.0)]


def module(name):
    reason = f"{name} is not installed: pip install {PROGRAMS[name.partition('.')[0]]}"
    return pytest.importorskip(name, reason=reason)


def in_pybullet(path, form, arm):
    """A function from positions, rates and efforts of the joints to their accelerations."""
    p = module("pybullet")
    client = p.connect(p.DIRECT)
    how = {"flags": p.URDF_USE_INERTIA_FROM_FILE, "physicsClientId": client}
    if form == "urdf":
        body = p.loadURDF(str(path), useFixedBase=True, **how)
    else:
        (body,) = p.loadMJCF(str(path), **how)
    p.setGravity(*FIELD, physicsClientId=client)
    infos = (p.getJointInfo(body, k, client) for k in range(p.getNumJoints(body, client)))
    order = [arm.joints.index(name.decode()) for _, name, kind, *_ in infos if kind != p.JOINT_FIXED]
    for k in range(p.getNumJoints(body, client)):
        p.changeDynamics(
            body, k, jointDamping=0.0, linearDamping=0.0, angularDamping=0.0, physicsClientId=client
        )

    def found(phi, phid, efforts):
        at = phi[order].tolist()
        mass = p.calculateMassMatrix(body, at, physicsClientId=client)
        bias = p.calculateInverseDynamics(
            body, at, phid[order].tolist(), [0.0] * len(order), physicsClientId=client
        )
        made = np.empty(len(order))
        made[order] = np.linalg.solve(mass, efforts[order] - bias)
        return made

    return found


def in_pinocchio(path, form, arm):
    pin = module("pinocchio")
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
    module("pydrake.all")
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


def arms(seed):
    """Both arms with numbers of single precision: PyBullet reads positions and inertias of MJCF so."""
    rng = np.random.default_rng(seed)

    def drawn(low, high, count):
        return tuple(rng.uniform(low, high, count).astype(np.float32).tolist())

    return rde.FourR(drawn(0.1, 2.0, 4), drawn(0.1, 1.0, 4)), rde.RPRP(drawn(0.1, 2.0, 4), drawn(0.1, 1.0, 2))


@pytest.mark.parametrize("reader", [in_pybullet, in_pinocchio, in_drake])
@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_other_readers_find_the_accelerations_of_both_arms(form, reader, tmp_path):
    for arm in arms(0):
        for more in ((), (e.Payload(0.75), e.LinkInertia(0.015625))):
            scene = rde.Scene(arm, (GRAVITY, *more))
            (path := tmp_path / f"arm.{'urdf' if form == 'urdf' else 'xml'}").write_text(
                document(scene, form).content
            )
            accelerations, worst = reader(path, form, arm), 0.0
            q, qd, efforts = states(scene)
            expected = ours(scene, q, qd, efforts)
            for row in zip(q @ arm.motor_map, qd @ arm.motor_map, efforts, expected, strict=True):
                worst = max(worst, np.abs(accelerations(*row[:3]) - row[3]).max() / np.abs(row[3]).max())
            print(f"{form}, {arm.kind}, {reader.__name__}: largest difference {worst:.1e}")
            assert worst < 1e-10
