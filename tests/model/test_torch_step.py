"""The differentiable control interval: its motions are those of the simulator, its gradients are right."""

import dataclasses

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, e

import redundant_envs as rde
from redundant_envs.compiler.backends.torch import torch

STEPS = {
    "three rk4": {"integrator": "rk4", "substeps": 3},
    "rk8": {"integrator": "rk8"},
    "1e-9": {"tolerance": 1e-9},
    "switches": {"tolerance": 1e-9},
}


def scene_of(arm, steps):
    # Always beyond its limits, whose kink has no derivative in a step; or some lanes come to them, or leave.
    limits = (-0.3, 0.3, 800.0) if steps == "switches" else (-6.0, -5.0, 2.0, 0.1)
    spring = e.LimitSpring(arm.joints[1], *limits)
    return rde.Scene(arm, (e.Gravity(), e.ViscousFriction(0.1), spring), **STEPS[steps])


def start(arm, lanes=12):
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.0, 1.0, (lanes, 4))
    q[:, np.array(arm.prismatic)] *= 0.5
    return [torch.tensor(x) for x in (q, rng.normal(size=(lanes, 4)), rng.normal(size=(lanes, 4)))]


PAIRS = {f"{arm.kind} {steps}": (arm, steps) for arm in (FOUR_R, RPRP) for steps in STEPS}
every_step = pytest.mark.parametrize(("arm", "steps"), PAIRS.values(), ids=PAIRS)


@pytest.mark.quick("FourR three rk4", "RPRP switches")
@every_step
def test_motion_is_that_of_the_simulator(arm, steps):
    scene = scene_of(arm, steps)
    q, qd, efforts = start(arm)
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q.numpy(), qd.numpy())
    step = rde.torch_step(scene)
    for _ in range(3):
        batch.advance(efforts.numpy())
        q, qd = step(q, qd, efforts)
    np.testing.assert_allclose(q.numpy(), batch.q, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(qd.numpy(), batch.qd, rtol=1e-12, atol=1e-11)


@pytest.mark.quick("RPRP three rk4")
@every_step
def test_gradients_agree_with_central_differences(arm, steps):
    step = rde.torch_step(scene_of(arm, steps))
    masses = torch.tensor(arm.masses, dtype=torch.float64)
    gravity = torch.tensor(9.81, dtype=torch.float64)
    given = [*start(arm), masses, gravity]

    def error(q, qd, efforts, masses, g):
        for _ in range(3):
            q, qd = step(q, qd, efforts, {"masses": masses, "gravity.g": g})
        return ((q - 0.3) ** 2).sum() + 0.01 * (qd**2).sum()

    leaves = [x.clone().requires_grad_() for x in given]
    error(*leaves).backward()
    for k, leaf in enumerate(leaves):  # all numbers of one move together
        ends = [error(*(x + by if j == k else x for j, x in enumerate(given))) for by in (1e-5, -1e-5)]
        difference = float(ends[0] - ends[1]) / 2e-5
        assert float(leaf.grad.sum()) == pytest.approx(difference, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (rde.Scene(RPRP, (e.PrismaticStop((0.0, 0.0), (1.0, 1.0)),)), "prismatic_stop, whose impacts"),
        (rde.Scene(FOUR_R, (e.CoulombFriction(0.1),)), "coulomb_friction, whose joints stick .* SmoothCou"),
        (rde.Scene(RPRP, (), "dop853"), "'dop853', which chooses each step while it runs; use 'rk8'"),
    ],
    ids=["stops", "stiction", "dop853"],
)
def test_what_has_no_derivative_is_refused_with_what_to_use(scene, said):
    with pytest.raises(ValueError, match=said):
        rde.torch_step(scene)


@pytest.mark.quick("1e-9")
@pytest.mark.parametrize("steps", ["three rk4", "1e-9"])
def test_how_torch_keeps_tensors_does_not_matter(steps):
    given, step = start(FOUR_R), rde.torch_step(scene_of(FOUR_R, steps))
    ends = step(*given)
    q, *rest = given
    lazy = torch.complex(q, -q).conj().imag  # torch notes the sign, and changes no number
    assert lazy.is_neg()
    assert torch.equal(step(lazy, *rest)[0], ends[0])
    with torch.device("meta"):  # as the device of new tensors
        assert torch.equal(step(*given)[0], ends[0])
    assert torch.equal(torch.compile(step, backend="eager")(*given)[0], ends[0])
    away = [x.to("meta") for x in given]
    if steps == "1e-9":
        with pytest.raises(ValueError, match=r"q is on the device meta, .* leave out scene.tolerance"):
            step(*away)
    else:
        assert step(*away)[0].shape == q.shape


@pytest.mark.parametrize("steps", ["three rk4", "1e-9"])
def test_an_empty_batch_gives_empty_tensors(steps):
    step, none = rde.torch_step(scene_of(FOUR_R, steps)), torch.zeros(3, 0, 4)
    one = torch.zeros(4)
    for given in ((none, none, none), (none, one, one), (one, one, none)):
        assert [tuple(x.shape) for x in step(*given)] == [(3, 0, 4)] * 2


@pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated")  # by jacfwd itself
@pytest.mark.parametrize("steps", ["three rk4", pytest.param("switches", marks=pytest.mark.long)])
def test_transforms_of_torch_give_what_a_batch_gives(steps):
    scene = scene_of(RPRP, steps)
    scene = dataclasses.replace(scene, effects=(*scene.effects, e.TipForce(density=0.1)))
    step, begun, heavy = rde.torch_step(scene), rde.BatchSimulator(scene, 6), torch.ones(6).double()
    given = *start(RPRP, 6), torch.tensor(begun.z), torch.tensor(begun.draws)

    def ends(q, qd, efforts, z, draws, g):
        return step(q, qd, efforts, {"gravity.g": g}, z, draws)[1]

    batch = ends(*given, heavy)
    assert torch.equal(torch.func.vmap(ends)(*given, heavy), batch)
    lanes = [x.reshape(3, 2, *x.shape[1:]) for x in given]
    inner = torch.func.vmap(ends, in_dims=(1, 1, 0, 0, 0, None))  # of lanes in the last axis, and one gravity
    nested = torch.func.vmap(inner)(lanes[0].mT, lanes[1].mT, *lanes[2:], heavy[:3])
    assert torch.equal(nested.reshape(6, 4), batch)
    for jacobian in (torch.func.jacrev, torch.func.jacfwd):
        slopes = torch.func.vmap(jacobian(ends, 5))(*given, heavy)
        moved = (ends(*given, heavy + 1e-5) - ends(*given, heavy - 1e-5)) / 2e-5
        torch.testing.assert_close(slopes, moved, rtol=1e-5, atol=1e-7)


NO_TENSORS = torch.ones(4, dtype=torch.bool), torch.ones(12, 4).to_sparse(), "1234", [[1.0], [2, 3]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"efforts": torch.ones(12, 3)}, r"efforts has shape \(12, 3\); the last axis must have 4"),
        ({"efforts": torch.ones(3, 4)}, r"q \(12,\), qd \(12,\), efforts \(3,\), do not broadcast"),
        ({"parameters": {"masses": torch.ones(2, 4)}}, r"masses \(2,\), do not broadcast"),
        *(({"qd": wrong}, "qd is .*; give a tensor of real numbers") for wrong in NO_TENSORS),
        ({"parameters": [4.0]}, r"parameters is \[4.0\]; give a mapping of names, such as masses"),
        ({"parameters": {"masses": torch.ones(3)}}, r"masses has shape \(3,\); the last axis must have 4"),
        ({"parameters": {"mass": torch.ones(4)}}, r"parameter is 'mass'; this scene has masses, lengths"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named(change, said):
    given = dict(zip(("q", "qd", "efforts"), start(FOUR_R), strict=True))
    with pytest.raises(ValueError, match=said):
        rde.torch_step(rde.Scene(FOUR_R))(**{**given, **change})


@pytest.mark.parametrize("how", [{"integrator": "rk4", "substeps": 3}, {"tolerance": 1e-6}], ids=str)
def test_states_of_effects_and_draws_are_those_of_the_simulator(how):
    motors = e.Lag(0.03), e.CommandDelay(0.013, 0.04)
    scene = rde.Scene(FOUR_R, (e.Gravity(), *motors, e.PickUp(0.7, 0.02), e.TipForce(density=0.5)), **how)
    batch, step, (q, qd, efforts) = rde.BatchSimulator(scene, 12), rde.torch_step(scene), start(FOUR_R)
    batch.set_state(q.numpy(), qd.numpy())
    z, draws = torch.tensor(batch.z), torch.tensor(batch.draws)
    for k in range(4):
        q, qd, z, draws = step(q, qd, (k + 1) * efforts, z=z, draws=draws)
        batch.advance((k + 1) * efforts.numpy())
        for found, known in ((q, batch.q), (qd, batch.qd), (z, batch.z), (draws, batch.draws)):
            np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-10)
