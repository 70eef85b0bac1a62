"""Numbers of every size: an environment refuses them by name, or observes finite numbers."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.effects import (
    CentringSpring,
    EffortLimits,
    Gravity,
    LimitSpring,
    PrismaticStop,
    ViscousFriction,
)
from redundant_envs.tasks.reach import ReachTask

IDS = ("redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0", "redundant_envs/FourRGoalReach-v0")
SIZES = [s * x for x in (5e-324, 1e-200, 1e-100, 1e-30, 1e30, 1e100, 1e200, 1.7e308) for s in (1.0, -1.0)]


def made(env_id, **kwargs):
    return gym.make(env_id, disable_env_checker=True, **kwargs).unwrapped


def arrays(obs):
    return list(obs.values()) if isinstance(obs, dict) else [obs]


def check_episode(env, options):
    """A refusal by name, or a few steps with finite observations and rewards, in bounded time."""
    try:
        obs, info = env.reset(seed=0, options=options)
    except ValueError:
        return
    rng = np.random.default_rng(0)
    assert all(np.isfinite(a).all() for a in arrays(obs)), options
    assert np.isfinite(info["distance"]), options
    for k in range(3):
        obs, reward, terminated, _, info = env.step(rng.uniform(-1.0, 1.0, 4).astype(np.float32))
        assert info["evaluations"] <= (k + 1) * 12 * 65537, options
        assert all(np.isfinite(a).all() for a in arrays(obs)), options
        assert np.isfinite(reward), options
        assert np.isfinite(info["distance"]), options
        if terminated:
            return


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy warns of overflows of masses
@pytest.mark.parametrize("env_id", IDS)
def test_parameters_and_starts_of_every_size(env_id):
    env = made(env_id)
    nominal = env.core.scene.parameters()
    for size in SIZES:
        for name in ("masses", "lengths"):
            check_episode(env, {"parameters": {name: size}})
        for name in (n for n in nominal if "." in n):
            root = name.split("[")[0]
            entries = [size if n == name else v for n, v in nominal.items() if n.split("[")[0] == root]
            check_episode(env, {"parameters": {root: entries if "[" in name else size}})
        for name, width in (("q", 4), ("qd", 4), ("goal", 2)):
            for k in range(width):
                check_episode(env, {name: [size if i == k else 0.05 for i in range(width)]})


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("env_id", IDS[:2])
@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(ReachTask)])
def test_task_numbers_of_every_size(env_id, name):
    for size in SIZES:
        try:
            env = made(env_id, task={name: size})
        except ValueError as error:
            assert f"ReachTask.{name} is" in str(error) or "outer is" in str(error)  # noqa: PT017
            continue
        check_episode(env, None)


RPRP, FOUR_R = rde.RPRP((1,) * 4, (0.5, 0.5)), rde.FourR((1,) * 4, (0.5,) * 4)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Gravity(1e300), ["Gravity.g is 1e+300", "-1e+100 to 1e+100"]),
        (lambda: ViscousFriction(1e300), ["ViscousFriction.coefficients is 1e+300", "1e+100"]),
        (lambda: EffortLimits((1, 1, 1e300, 1)), ["EffortLimits.limits[2] is 1e+300", "1e+100"]),
        (lambda: LimitSpring("r1", 0, 1, 1e300), ["LimitSpring.stiffness is 1e+300", "1e+100"]),
        (lambda: LimitSpring("r1", 0, 1, 1, 1e300), ["LimitSpring.damping is 1e+300", "1e+100"]),
        (lambda: LimitSpring("r1", -1e308, 1e308), ["LimitSpring.lower is -1e+308", "-1e+30 to 1e+30"]),
        (
            lambda: LimitSpring("r1", 0.0, 1e-200),
            ["lower is 0.0, upper is 1e-200", "1e-30 apart"],
        ),
        (lambda: PrismaticStop((0, 0), (1, 1e308)), ["PrismaticStop.upper[1] is 1e+308", "-1e+30 to 1e+30"]),
        (lambda: PrismaticStop((0, 0), (1, 5e-324)), ["PrismaticStop.lower[1] is 0.0", "1e-30 apart"]),
        (lambda: CentringSpring((1, 1e300), (0, 0), (1, 1)), ["CentringSpring.stiffness[1] is 1e+300"]),
        (lambda: CentringSpring((1, 1), (0, -1e308), (1, 1)), ["CentringSpring.lower[1] is -1e+308"]),
        (lambda: rde.Scene(RPRP, control_dt=1e300), ["control_dt is 1e+300 s", "1e-09 to 1000 s"]),
        (lambda: rde.Scene(RPRP, control_dt=1e-300), ["control_dt is 1e-300 s", "1e-09 to 1000 s"]),
        (lambda: made(IDS[0]).reset(options={"q": (1e30, 0.1, 0, 0.1)}), ["options['q']", "1e+30", "1e+06"]),
        (lambda: made(IDS[1]).reset(options={"qd": (0, 1e200, 0, 0)}), ["options['qd']", "1e+200", "1e+100"]),
    ],
)
def test_the_refusal_names_field_value_and_range(make, words):
    with pytest.raises(ValueError) as error:
        make()
    for word in words:
        assert word in str(error.value)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("env_id", "lengths"), [(IDS[0], 2), (IDS[1], 4)])
def test_masses_and_lengths_of_every_allowed_size_together(env_id, lengths):
    """Products of several large or small numbers are finite in every observation."""
    env, rng = made(env_id), np.random.default_rng(0)
    for _ in range(100):
        exponents = rng.uniform(-30.0, 30.0, 3)
        options = {
            "masses": np.clip(10.0 ** (exponents[0] + rng.uniform(-6.0, 6.0, 4)), 1e-30, 1e30),
            "lengths": np.clip(10.0 ** (exponents[1] + rng.uniform(-6.0, 6.0, lengths)), 1e-30, 1e30),
            "gravity.g": 10.0 ** exponents[2],
        }
        check_episode(env, {"parameters": options})
