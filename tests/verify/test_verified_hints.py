"""verify: declared stiffness, damping and rates against the forces, dampers that drive, numbers at rest."""

import dataclasses
from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Actuation, CentringSpring, Effect, Force, LimitSpring, Point, State
from redundant_envs.studies.kinked_effects import SmoothFriction
from redundant_envs.verify import hints, rest, verify
from redundant_envs.verify.checks import Verdict, checks_of

FOUR_R = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
RPRP = rde.RPRP((2.3, 0.7, 1.9, 0.4), (1.1, 0.6))
CHECKS = checks_of(hints, rest)


def outcomes(scene, states=64):
    return verify(scene, states, checks=CHECKS).outcomes


def misses(scene, states=64):
    return {o.check for o in outcomes(scene, states) if o.verdict is Verdict.MISSED}


def with_hooks(*hooks, arm=FOUR_R):
    """A scene of one effect with these hooks, and a number k."""

    @dataclass(frozen=True)
    class Own(Effect):
        k: float = 8.0

        def hooks(self, arm):
            return hooks

    return rde.Scene(arm, (rde.effects.Gravity(), Own()))


@physics
def spring(x, k):
    return -k * x


@physics
def brake(rate, k):
    return -k * rate


@physics
def push(rate, k):
    return k * rate


@physics
def strength(k):
    return k


@physics
def largest(k):
    return 1.6 * k


@physics
def tiny(k):
    return 1e-9 * k


@physics
def rather_little(k):
    return k / 1.4


@physics
def too_little(k):
    return k / 1.6


@physics
def in_wind(rate, k):
    return -k * (rate - 3.0) * abs(rate - 3.0)


@physics
def steepness_in_wind(rate, k):
    return 2.0 * k * abs(rate - 3.0)


@physics
def between(rate, other, k):
    return -k * (rate - other)


@physics
def brake_at_point(vx, vy, k):
    return -k * vx + 3.0 * k * vy, -k * vy - 3.0 * k * vx


@physics
def push_at_point(vx, vy, k):
    return -k * vx, k * vy


@physics
def four_times(k):
    return 4.0 * k


@physics
def dry(rate, k):
    return -k * rate / abs(rate)


@physics
def share_of(command):
    return command * command / abs(command)


X, RATE = {"x": "phi2", "k": ".k"}, {"rate": "phid2", "k": ".k"}
AT_TIP = {"vx": "tip_vx", "vy": "vy4", "k": ".k"}
RIGHT = {
    "spring": Force(1, spring, X, stiffness=strength),
    "spring, a little more": Force(1, spring, X, stiffness=rather_little),
    "brake": Force(1, brake, RATE, damping=strength),
    "drag in the wind": Force(1, in_wind, RATE, damping=steepness_in_wind),
    "between two joints": Force(1, between, {**RATE, "other": "phid3"}, damping=strength),
    "at the tip": Force(Point(3), brake_at_point, AT_TIP, damping=four_times),
    "a force that drives and declares nothing": Force(1, push, RATE),
}
WRONG = {
    "stiffness": (Force(1, spring, X, stiffness=tiny), {"declared stiffness"}),
    "stiffness by more than a half": (Force(1, spring, X, stiffness=too_little), {"declared stiffness"}),
    "damping": (Force(1, brake, RATE, damping=tiny), {"declared damping"}),
    "sign": (Force(1, push, RATE, damping=strength), {"dampers brake"}),
    "sign at the tip": (Force(Point(3), push_at_point, AT_TIP, damping=strength), {"dampers brake"}),
    "damping at the tip": (Force(Point(3), brake_at_point, AT_TIP, damping=strength), {"declared damping"}),
    "force at rest": (Force(1, dry, RATE), {"numbers at rest"}),
    "link at rest": (Actuation(1, share_of, {"command": "command2"}), {"numbers at rest"}),
}


@pytest.mark.parametrize("hook", RIGHT.values(), ids=RIGHT)
def test_what_effects_declare_rightly_is_green(hook):
    assert misses(with_hooks(hook)) == set()


@pytest.mark.parametrize(("hook", "red"), WRONG.values(), ids=WRONG)
def test_what_effects_declare_wrongly_is_red_and_named(hook, red):
    scene = with_hooks(hook)
    assert misses(scene) == red
    (miss,) = verify(scene, 64, checks=CHECKS).misses
    assert "own" in miss


def test_friction_that_is_smooth_at_zero_is_seen_where_it_is_steepest():
    @physics
    def half_of_it(level, scale):
        return 0.5 * level / scale

    class Understated(SmoothFriction):
        def hooks(self, arm):
            return tuple(dataclasses.replace(h, damping=half_of_it) for h in super().hooks(arm))

    right, wrong = (rde.Scene(FOUR_R, (kind(0.5, 1e-3),)) for kind in (SmoothFriction, Understated))
    assert misses(right, 256) == set()
    assert misses(wrong, 256) == {"declared damping"}


@physics
def weak(stiffness):
    return 1e-9 * stiffness


@physics
def calm(position, lower, upper, damping):
    return 1e-9 * damping * abs(position - upper)


@pytest.mark.parametrize(
    ("effect", "change", "red"),
    [
        (LimitSpring("r1", 0.0, 0.3, 50.0, 900.0), {}, set()),
        (LimitSpring("r1", 0.0, 0.3, 50.0, 900.0), {"stiffness": weak}, {"declared stiffness"}),
        (LimitSpring("joint2", -4.0, 5.0, 50.0, 9.0), {"stiffness": weak}, {"declared stiffness"}),
        (LimitSpring("r2", 0.0, 0.3, 50.0, 9.0), {"damping": calm}, {"declared damping"}),
        (CentringSpring((9.0, 8.0), (0.0, 0.0), (0.3, 0.3)), {}, set()),
        (CentringSpring((9.0, 8.0), (0.0, 0.0), (0.3, 0.3)), {"stiffness": weak}, {"declared stiffness"}),
    ],
)
def test_springs_of_the_package_are_looked_at_where_they_act(effect, change, red):
    class Changed(type(effect)):
        def hooks(self, arm):
            return tuple(dataclasses.replace(hook, **change) for hook in super().hooks(arm))

    assert misses(rde.Scene(RPRP, (Changed(**dataclasses.asdict(effect)),))) == red


@physics
def follow(command, z, k):
    return k * (command - z)


@physics
def turn(other, k):
    return k * other


@physics
def turn_back(other, k):
    return -k * other


@physics
def state(z):
    return z


def lagging(rate):
    bind = {"command": "command2", "z": ".z", "k": ".k"}
    return Actuation(1, state, bind, states=(State("z", "N m", follow, bind=bind, rate=rate),))


def swinging(rate):
    """Two states, of which neither changes with itself."""
    bind = [{"other": f".{name}", "k": ".k"} for name in "ba"]
    states = (
        State("a", "1", turn, bind=bind[0], rate=rate),
        State("b", "1", turn_back, bind=bind[1], rate=rate),
    )
    return Force(1, state, {"z": ".a"}, states=states)


@pytest.mark.parametrize("hook", [lagging, swinging])
def test_rates_of_states_are_compared_with_how_they_change(hook):
    assert misses(with_hooks(hook(strength))) == set()
    assert misses(with_hooks(hook(largest))) == set()
    assert misses(with_hooks(hook(too_little))) == {"declared rates of states"}
    assert misses(with_hooks(hook(tiny))) == {"declared rates of states"}


def test_a_quantity_of_an_arm_that_is_no_number_at_rest_is_red():
    @physics(gives="Lz")
    def divided(m1, l1, w1):
        return m1 * l1 * l1 * w1 * w1 / w1

    class Divided(rde.Arm):
        joint_types = "R"
        functions = (divided,)

    found = {o.check: o for o in outcomes(rde.Scene(Divided((1.0,), (1.0,))))}
    assert found["numbers at rest"].verdict is Verdict.MISSED
    assert "at rest, without efforts, Lz is not finite" in found["numbers at rest"].finding.words
