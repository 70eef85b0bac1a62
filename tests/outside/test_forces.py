"""Forces from outside move as their laws say: at points, with states, with laws that change, and at stops."""

import copy
import dataclasses
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
import three_r
from actuator_lag import ActuatorLag
from arms import ARMS, advanced, e, on_arms, states
from held_command import HeldCommand
from tether import Tether
from two_stage_spring import TwoStageSpring, energy, pull_back

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.control.statics import static_efforts
from redundant_envs.effects import Effect, Force, Impact, Point
from redundant_envs.lane.direct import fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.verify import Mode, verify

AT_POINTS = [(name, k + 1) for name, arm in ARMS.items() for k in range(arm.num_masses)]


# ---- at points -----------------------------------------------------------------------------------------


def slopes(arm, q, step=1e-5):
    """Derivatives of the points' positions by the coordinates, (lanes, points, 2, joints), by differences."""

    def difference(move):
        return (arm.points(q + move) - arm.points(q - move)) / (2.0 * step)

    moves = step * np.eye(q.shape[1])
    return np.stack([(8.0 * difference(m) - difference(2.0 * m)) / 6.0 for m in moves], axis=-1)


@pytest.mark.parametrize(("name", "k"), AT_POINTS)
def test_velocities_and_derivatives_of_points_are_those_of_their_positions(name, k):
    arm = ARMS[name]
    q, qd, _ = states(arm, 30, 2.0)
    known = arm.parameter_values() | dict(zip((*arm.coordinates, *arm.rates), (*q.T, *qd.T), strict=True))
    names = [f"{axis}{k}{j + 1}" for axis in "XY" for j in range(len(arm.joints))]
    found, velocity = (
        np.transpose([np.broadcast_to(x, len(q)) for x in arm.evaluate(n, known)])
        for n in (names, [f"vx{k}", f"vy{k}"])
    )
    at_point = slopes(arm, q)[:, k - 1]
    np.testing.assert_allclose(found.reshape(at_point.shape), at_point, atol=1e-9)
    np.testing.assert_allclose(velocity, np.einsum("nij,nj->ni", at_point, qd), atol=1e-8)


def test_an_arm_with_other_points_has_their_velocities():
    @physics(gives="x1 y1 x2 y2 x3 y3")
    def other_points(l1, l2, l3, s1, c1, s2, c2, s3, c3):
        return 2.0 * l1 * c1, 0.0 * s1, l2 * c2, l2 * s2, l3 * c3, l3 * s3

    functions = tuple(other_points if f is three_r.points else f for f in three_r.ThreeR.functions)
    turned = type("OtherPoints", (three_r.ThreeR,), {"functions": functions})((1.0,) * 3, (1.0,) * 3)
    q = states(turned, 5)[0]
    known = {**turned.parameter_values(), **dict(zip(turned.coordinates, q.T, strict=True))}
    np.testing.assert_allclose(turned.evaluate(["X11"], known)[0], slopes(turned, q)[:, 0, 0, 0], atol=1e-9)


@pytest.mark.parametrize("actuation", ["joint", "generalized"])
@pytest.mark.parametrize(("name", "k"), AT_POINTS)
def test_a_force_at_a_point_accelerates_as_virtual_work_says(name, k, actuation):
    arm, tether = ARMS[name], Tether(k, 0.3, -0.2, 50.0, 2.0)
    q, qd, efforts = states(arm, 30, 2.0)
    dynamics = Dynamics(rde.Scene(arm, (e.Gravity(9.81), tether), "rk4", actuation=actuation))
    numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, efforts.T, strict=True))}
    x = dynamics.quantities([*q.T, *qd.T], numbers)
    found = np.array([np.broadcast_to(a, len(q)) for a in dynamics.accelerations(x)]).T
    at_point = slopes(arm, q)[:, k - 1]
    force = 50.0 * (np.array([0.3, -0.2]) - arm.points(q)[:, k - 1])
    force -= 2.0 * np.einsum("nij,nj->ni", at_point, qd)
    driven = efforts @ arm.motor_map.T if actuation == "joint" else efforts
    expected = arm.forward_dynamics(q, qd, driven + np.einsum("nij,ni->nj", at_point, force))
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


@physics
def backwards(x, y, post_x, post_y, stiffness):
    return stiffness * (x - post_x), stiffness * (y - post_y)


@physics
def doubled(position, lower, upper, side, soft, harder):
    return 2.0 * energy(position, lower, upper, side, soft, harder)


@on_arms("RPRP")
def test_books_close_and_wrong_potentials_are_found(name):
    arm = ARMS[name]
    tether, knees = Tether(2, 0.1, -0.4, 80.0), TwoStageSpring(len(arm.joints) - 1, -0.1, 0.05, 20.0, 4e3)
    for right, change in ((tether, {"conservative": backwards}), (knees, {"potential": doubled})):
        damped = dataclasses.replace(right, damping=3.0) if right is tether else right
        assert verify(rde.Scene(arm, (e.Gravity(), damped), "rk8", 0.01), 64, Mode.QUICK).misses == ()
        wrong = rde.Scene(arm, (e.Gravity(), changed(right, **change)), "rk8", 0.01)
        misses = verify(wrong, 64, Mode.QUICK).misses
        assert any("wrong: at" in miss and "derivative of the potential" in miss for miss in misses)


def changed(effect, **change):
    """An effect with the key "wrong" whose only hook is changed."""
    kind = type(effect)

    def hooks(self, arm):
        (hook,) = kind.hooks(self, arm)
        return (dataclasses.replace(hook, **change),)

    wrong = dataclass(frozen=True)(type("Wrong", (kind,), {"hooks": hooks, "key": "wrong"}))
    return wrong(**{f.name: getattr(effect, f.name) for f in dataclasses.fields(effect)})


def test_a_stiff_tether_makes_error_control_take_steps_that_are_short_enough():
    arm = ARMS["4R"]
    scene = rde.Scene(arm, (Tether(4, 0.5, 0.5, 4e4),), tolerance=1e-6)
    assert Dynamics(scene).prepare(Dynamics(scene).parameters)["least_step_rate"] == 0.5 * np.sqrt(4e4 / 0.5)
    q, qd, _ = states(arm, 8)
    batch, status = advanced(scene, q, qd, 0.0 * q)
    fine, _ = advanced(dataclasses.replace(scene, tolerance=None, substeps=400), q, qd, 0.0 * q)
    assert np.abs(arm.forward_kinematics(batch.q) - arm.forward_kinematics(fine.q)).max() < 1e-6
    assert (status.numerics == 0).all()


@pytest.mark.parametrize("name", ARMS)
def test_static_efforts_balance_forces_at_points(name):
    scene = rde.Scene(ARMS[name], (e.Gravity(), Tether(2, 0.3, -0.2, 60.0)), "rk8", 1e-3)
    q = states(ARMS[name], 30, 2.0)[0]
    assert np.abs(advanced(scene, q, 0.0 * q, static_efforts(scene, q))[0].qd).max() < 1e-10


def test_a_scene_with_a_force_at_a_point_lists_it_and_counts_its_operations():
    scene = rde.load_scene("rprp_reach")
    tethered = dataclasses.replace(scene, effects=(*scene.effects, Tether(4, 1.0, 1.0, 10.0)))
    assert "tether" not in {*rde.bill(scene), *rde.listing(scene).split()}
    assert rde.bill(tethered)["tether"].products > 0
    assert "pull_and_damping" in rde.listing(tethered)


# ---- laws that change ----------------------------------------------------------------------------------


def near_knees(arm):
    rng, shape = np.random.default_rng(3), (24, len(arm.joints))
    inverse = np.linalg.inv(arm.motor_map)
    joints, rates = rng.uniform(-0.2, 0.2, shape), rng.normal(0.0, 2.0, shape)
    return joints @ inverse, rates @ inverse, rng.normal(0.0, 3.0, shape)


@pytest.mark.parametrize("name", ARMS)
def test_the_tolerance_of_a_law_that_changes_is_kept(name):
    arm = ARMS[name]
    scene = rde.Scene(arm, (e.Gravity(), TwoStageSpring(len(arm.joints) - 1, -0.1, 0.05, 20.0, 4e3)))
    found, status = advanced(dataclasses.replace(scene, tolerance=1e-8), *near_knees(arm))
    fine, _ = advanced(dataclasses.replace(scene, integrator="rk4", substeps=20000), *near_knees(arm))
    off = np.linalg.norm(arm.forward_kinematics(found.q) - arm.forward_kinematics(fine.q), axis=1)
    assert off.max() <= 1e-8
    assert (status.numerics == 0).all()
    assert status.evaluations.mean() <= 400


def test_equal_steps_have_the_law_of_the_place_in_torch_too():
    """Without error control the position selects the law at each evaluation."""
    torch = pytest.importorskip("torch", reason="torch is in the extra 'train'")
    scene = rde.Scene(
        ARMS["4R"], (e.Gravity(), TwoStageSpring(3, -0.1, 0.05, 20.0, 4e3)), integrator="rk4", substeps=3
    )
    found, _ = advanced(scene, *near_knees(ARMS["4R"]))
    moved, _ = rde.torch_step(scene)(*map(torch.as_tensor, near_knees(ARMS["4R"])))
    np.testing.assert_allclose(moved.numpy(), found.q, rtol=0, atol=1e-13)
    assert pull_back(0.1, -0.1, 0.05, 1.0, 20.0, 4e3) == -20.0 * 0.1 - 4e3 * (0.1 - 0.05)  # plain Python
    assert pull_back(0.02, -0.1, 0.05, 0.0, 20.0, 4e3) == -20.0 * 0.02


@pytest.mark.parametrize(("lower", "upper"), [(0.3, 0.1), (0.1, 0.1)])
def test_positions_of_a_switch_in_the_wrong_order_are_refused_of_a_scene_and_a_lane(lower, upper):
    said = "the first must be below the second"
    with pytest.raises(ValueError, match=said):
        rde.Scene(ARMS["RPRP"], (TwoStageSpring(1, lower, upper, 20.0, 2e3),))
    batch = rde.BatchSimulator(rde.Scene(ARMS["RPRP"], (TwoStageSpring(1, 0.1, 0.2, 20.0, 2e3),)), 3)
    before = batch.save()["parameters"]
    change = {"two_stage_spring.lower": [0.0, lower], "two_stage_spring.upper": upper}
    with pytest.raises(ValueError, match=said):
        batch.set_parameters(change, [0, 2])
    np.testing.assert_array_equal(batch.save()["parameters"], before)
    batch.set_parameters({"two_stage_spring.lower": 0.15}, [2])


# ---- states --------------------------------------------------------------------------------------------


def test_a_lag_follows_its_equation_and_its_work_closes_the_energy_balance():
    scene = rde.Scene(ARMS["4R"], (e.Gravity(), ActuatorLag(0.05)), tolerance=1e-9)
    batch, command = rde.BatchSimulator(scene, 3, track_work=True), np.array([5.0, -3.0, 2.0, 1.0])

    def total():
        return scene.robot.kinetic_energy(batch.q, batch.qd) + scene.robot.potential_energy(batch.q)

    before = total()
    for _ in range(10):
        batch.advance(np.tile(command, (3, 1)))
    assert np.abs(batch.z - command * (1.0 - np.exp(-0.2 / 0.05))).max() < 1e-9
    assert np.abs(total() - batch.work - before).max() < 1e-8


def test_a_short_lag_makes_error_control_take_more_steps():
    counts = []
    for constant in (1.0, 1e-4):
        scene, zero = rde.Scene(ARMS["4R"], (ActuatorLag(constant),), tolerance=1e-6), np.zeros((8, 4))
        batch, status = advanced(scene, zero, zero, zero + 1.0)
        assert not status.numerics.any()
        counts.append(status.evaluations.max())
    assert counts[1] > 20 * counts[0]
    assert np.abs(batch.z - 1.0).max() < 1e-9


def test_lanes_have_time_constants_of_their_own():
    constants, zero = np.array([0.06, 0.1, 1.0]), np.zeros((3, 3))
    scene = rde.Scene(ARMS["3R"], (ActuatorLag(0.1),), tolerance=1e-8)
    batch, _ = advanced(scene, zero, zero, zero + 1.0, {"actuator_lag.time_constant": constants})
    assert np.abs(batch.z - (1.0 - np.exp(-0.02 / constants))[:, None]).max() < 1e-9


def test_commands_of_the_interval_before_act_to_the_bit():
    free = rde.Scene(ARMS["RPRP"], (e.Gravity(),), tolerance=1e-6)
    late = dataclasses.replace(free, effects=(*free.effects, HeldCommand()))
    commands = np.random.default_rng(0).normal(size=(6, 5, 4))
    a, b = rde.BatchSimulator(free, 5), rde.BatchSimulator(late, 5)
    for k in range(6):
        a.advance(commands[k - 1] if k else None)
        b.advance(commands[k])
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(b.z, commands[k])


def test_links_act_in_their_stated_order_whatever_the_order_of_effects():
    chain, zero = (HeldCommand(), ActuatorLag(0.03), e.EffortLimits(1.5)), np.zeros((4, 3))
    own, turned, free = (
        advanced(
            rde.Scene(ARMS["3R"], effects, integrator="rk4", substeps=4), zero, zero, zero + 4.0, intervals=5
        )[0]
        for effects in (chain, chain[::-1], chain[:2])
    )
    lagged = own.z[0, 3:]  # the first interval has no command
    assert np.abs(lagged - 4.0 * (1.0 - np.exp(-0.08 / 0.03))).max() < 1e-4
    assert lagged.min() > 1.5  # what acts is less: limits come last
    assert np.array_equal(own.q, turned.q)
    assert np.abs(free.qd - own.qd).max() > 0.1


def test_states_of_effects_are_saved_restored_copied_and_begin_anew():
    scene = rde.Scene(ARMS["RRP"], (ActuatorLag(0.1), HeldCommand()), tolerance=1e-6)
    efforts = np.random.default_rng(1).normal(size=(9, 3))
    batch, _ = advanced(scene, *np.zeros((2, 9, 3)), efforts, intervals=2)
    saved, twin = batch.save(), pickle.loads(pickle.dumps(copy.deepcopy(batch)))
    for one in (batch, twin):
        one.advance(efforts)
    after = batch.z
    assert np.array_equal(twin.z, after)
    batch.restore(saved)
    batch.advance(efforts)
    assert np.array_equal(batch.z, after)
    batch.set_state(np.zeros((1, 3)), np.zeros((1, 3)), index=[4])
    assert not batch.z[4].any()
    assert np.array_equal(np.delete(batch.z, 4, 0), np.delete(after, 4, 0))
    alone, _ = advanced(scene, *np.zeros((2, 1, 3)), efforts[6:7], intervals=3)
    assert np.array_equal(alone.z[0], after[6])


# ---- stops ---------------------------------------------------------------------------------------------

SLIDERS = rde.RPRP((1.0,) * 4, (0.3, 0.3))


@dataclass(frozen=True)
class Bumper(Effect):
    """Stops of one slider with its own restitution."""

    joint: int = 1
    upper: float = 0.2
    lower: float = 0.0
    restitution: float = 0.0

    static = ("joint",)

    @property
    def key(self):
        return f"bumper{self.joint}"

    def hooks(self, arm):
        return (Impact(self.joint, ".lower", ".upper", ".restitution"),)


def test_stops_on_one_of_two_sliders_work_and_let_go_when_they_are_moved():
    batch = rde.BatchSimulator(rde.Scene(SLIDERS, (Bumper(),), tolerance=1e-8))
    batch.set_state([0.0, 0.1, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0])
    for _ in range(20):
        batch.advance([0.0, 30.0, 0.0, 0.0])
    assert batch.q[0, 1] == 0.2
    batch.set_parameters({"bumper1.upper": 0.5})
    for _ in range(3):
        batch.advance([0.0, 30.0, 0.0, 0.0])
    assert batch.q[0, 1] > 0.21
    assert Bumper().travel(SLIDERS) == {1: ("lower", "upper")}
    assert Bumper(upper=np.inf).travel(SLIDERS) == {}


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"restitution": 1.5}, r"Bumper\).restitution is 1.5; it must lie in 0 to 1"),
        ({"restitution": -0.1}, r"Bumper\).restitution is -0.1; it must lie in 0 to 1"),
        ({"lower": 0.3}, r"travel is .lower to .upper, which are 0.3 and 0.2; the first must be below"),
    ],
)
def test_impacts_that_cannot_be_are_refused_of_a_scene_and_of_a_lane(numbers, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(SLIDERS, (Bumper(**numbers),))
    batch = rde.BatchSimulator(rde.Scene(SLIDERS, (Bumper(),)), 3)
    before = batch.save()["parameters"]
    with pytest.raises(ValueError, match=said.replace(r"Bumper\)", "bumper1")):
        batch.set_parameters({f"bumper1.{name}": value for name, value in numbers.items()}, [1])
    np.testing.assert_array_equal(batch.save()["parameters"], before)


@pytest.mark.parametrize(("restitution", "rests"), [(1.0, False), (0.0, True)])
def test_a_slider_from_outside_stays_between_its_stops_and_its_energy_book_closes(restitution, rests):
    stop = e.PrismaticStop((0.0,), (0.2,), restitution)
    scene = rde.Scene(ARMS["RRP"], (e.Gravity(), stop), tolerance=1e-9)
    start = ([-1.5, 0.0, 0.1], [0.0] * 3) if rests else ([0.3, -0.4, 0.1], [1.0, 2.0, 0.5])
    motion = rde.simulate(scene, *start, np.linspace(0.0, 3.5, 176))
    assert motion.q[:, 2].min() >= 0.0
    assert motion.q[:, 2].max() <= 0.2
    kinds = [event.kind for event in motion.events]
    assert {"upper impact", "rest"} <= {*kinds} if rests else len(kinds) > 5
    balance = motion.kinetic_energy + motion.potential_energy - motion.work
    assert np.abs(balance - balance[0]).max() < 1e-6 * np.abs(balance).max()


# ---- what is refused -----------------------------------------------------------------------------------


@physics
def one(x4):
    return x4


@physics
def on_side(side):
    return 0.0 * side


def given(*hooks, **numbers):
    kind = dataclasses.make_dataclass(
        "Odd", [(n, float) for n in numbers], bases=(Effect,), frozen=True,
        namespace={"hooks": lambda self, arm: hooks},
    )  # fmt: skip
    return kind(**numbers)


SWITCHED = dict.fromkeys(("x", "y", "post_x", "post_y", "stiffness"), "x1")


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((given(Force(Point(4), one)),), r"Point is 4; give Point\(0\) to Point\(3\), the tip"),
        ((given(Force(Point(True), one)),), "number of the Point is True"),
        ((given(Force(Point(3), one)),), "returns 1 values; a Force at a point needs 2"),
        ((given(Force(1, backwards, SWITCHED)),), "returns 2 values; a Force needs 1"),
        ((given(Force("tip", one)),), "joint is 'tip'; give 0 to 3"),
        ((given(Force(1, on_side, switch=(".a", ".b"))),), r"switch: '\.a' is not a number of this effect"),
        ((given(Force(1, on_side, switch=".a")),), r"switch is '\.a'; give the names of two numbers"),
        ((given(Force(1, on_side, switch=(".a",))),), "give the names of two numbers"),
        ((given(Force(Point(3), on_side, switch=(".a", ".b"))),), "the force acts at a Point"),
        ((given(Force(1, on_side)),), "argument 'side': no quantity of RPRP is called 'side'"),
        ((Bumper(), Bumper(3, restitution=0.5)), "stops with several restitutions"),
        ((Bumper(), e.PrismaticStop((0, 0), (1, 1))), "several restitutions"),
        ((Bumper(0),), "'joint1' is not a slider"),
    ],
)
def test_forces_that_cannot_be_are_refused(effects, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(SLIDERS, effects)
