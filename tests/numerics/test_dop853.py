"""dop853: near rounding, at any requested time, and no slower than SciPy in evaluations."""

import json
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde

e = rde.effects
ORACLES = Path(__file__).parents[1] / "oracles"
ARMS = {"four_r": rde.FourR, "rprp": rde.RPRP}
RUNS = [
    (kind, run)
    for kind in ARMS
    for run in json.loads((ORACLES / f"traj_{kind}.json").read_text(encoding="utf-8"))["trajectories"]
]


def scene_of(kind, run, control_dt=0.1):
    arm = ARMS[kind](run["m"], run["l"])
    return rde.Scene(arm, (e.Gravity(run["g"]),), "dop853", control_dt, actuation="generalized")


@pytest.mark.parametrize(("kind", "run"), RUNS, ids=[f"{k}-{r['id']}" for k, r in RUNS])
def test_oracle_trajectories(kind, run):
    """Within 100 units of the last given digit, at all five times."""
    times = [s["t"] for s in run["states"]]
    got = rde.simulate(scene_of(kind, run), run["q0"], run["qd0"], times, run["Q"])
    assert got.t.tolist() == times
    for k, state in enumerate(run["states"]):
        unit = 10.0 ** -state["decimals"]
        difference = np.abs(np.r_[got.q[k], got.qd[k]] - np.r_[state["q"], state["qd"]]).max()
        assert difference <= 100 * unit


@pytest.mark.parametrize(("kind", "run"), [RUNS[0], RUNS[6]], ids=["four_r", "rprp"])
def test_scipy_agrees(kind, run):
    integrate = pytest.importorskip("scipy.integrate", reason="SciPy is in the extra verify")
    arm = ARMS[kind](run["m"], run["l"])

    def slope(t, y):
        return np.r_[y[4:], arm.forward_dynamics(y[:4], y[4:], run["Q"], run["g"])]

    peer = integrate.solve_ivp(
        slope, (0, 1), [*run["q0"], *run["qd0"]], "DOP853", rtol=1e-13, atol=1e-14, t_eval=[0.3, 1.0]
    )
    got = rde.simulate(scene_of(kind, run, 1.0), run["q0"], run["qd0"], [0.3, 1.0], run["Q"])
    np.testing.assert_allclose(np.c_[got.q, got.qd], peer.y.T, rtol=0, atol=1e-10)
    batch = rde.BatchSimulator(scene_of(kind, run, 1.0), 1)
    batch.set_state(run["q0"], run["qd0"])
    status = batch.advance([run["Q"]])
    assert status.evaluations[0] <= 1.2 * peer.nfev


def test_more_times_do_not_change_the_motion():
    kind, run = RUNS[0]
    made = scene_of(kind, run)
    few = rde.simulate(made, run["q0"], run["qd0"], [1.0])
    many = rde.simulate(made, run["q0"], run["qd0"], np.linspace(0.037, 1.0, 28))
    np.testing.assert_array_equal(few.q[-1], many.q[-1])


def test_a_rough_force_takes_shorter_steps():
    arm = rde.FourR((1.0,) * 4, (0.5,) * 4)
    made = rde.Scene(arm, (e.LimitSpring("joint2", -0.5, 0.5, 2e4),), integrator="dop853")
    reference = rde.Scene(arm, made.effects, integrator="rk8", substeps=40000)
    q, qd = [0.0, 0.45, 0.0, 0.0], [0.0, 5.0, 0.0, 0.0]
    ends = [rde.simulate(s, q, qd, [0.04]).q[0] for s in (made, reference)]
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-9)


def test_a_motion_that_overflows_ends():
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(),), integrator="dop853"), 2)
    batch.set_state([0.3, 0.1, -0.4, 0.2], [[0, 1e200, 0, 0], [0, 0, 0, 0]])
    before = np.c_[batch.q, batch.qd]
    status = batch.advance()
    assert status.numerics[0] & rde.Numerics.TOLERANCE_NOT_REACHED
    assert status.numerics[0] & rde.Numerics.NO_STEP_FOUND
    assert status.numerics[1] == 0
    np.testing.assert_array_equal(np.c_[batch.q, batch.qd][0], before[0])
    with pytest.raises(ValueError, match=r"dop853 finds no step .* at t = 0 s"):
        rde.simulate(batch.scene, [0.3, 0.1, -0.4, 0.2], [0, 1e200, 0, 0], [1.0])


@pytest.mark.parametrize(
    "stops",
    [
        pytest.param((), id="free"),
        pytest.param((e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5),), id="stops", marks=pytest.mark.long),
    ],
)
def test_a_lane_that_needs_more_than_a_million_steps_goes_back_and_its_neighbour_does_not(stops):
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    stiff = e.ViscousFriction((1e12, 0.0, 0.0, 0.0))
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(), stiff, *stops), integrator="dop853"), 2)
    batch.set_parameters({"viscous_friction.coefficients": (0.0,) * 4}, index=[1])
    batch.set_state([0.3, 0.1, -0.4, 0.2], [1.0, 0.2, -0.3, 0.1])
    before = np.c_[batch.q, batch.qd]
    status = batch.advance()
    assert status.numerics.tolist() == [rde.Numerics.NO_STEP_FOUND | rde.Numerics.TOLERANCE_NOT_REACHED, 0]
    np.testing.assert_array_equal(np.c_[batch.q, batch.qd][0], before[0])
    assert (batch.q[1] != before[1, :4]).any()


@pytest.mark.parametrize(
    ("kwargs", "said"), [({"substeps": 3}, "substeps is 3"), ({"tolerance": 1e-6}, "tolerance is 1e-06")]
)
def test_substeps_and_tolerance_are_not_for_it(kwargs, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(rde.FourR((1,) * 4, (1,) * 4), integrator="dop853", **kwargs)
