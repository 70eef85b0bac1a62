"""What a user writes, with lists, arrays and numbers of NumPy: it runs, and type checkers agree, as
``test_users_file.py`` finds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import redundant_envs as rde
from redundant_envs import effects

masses = np.array([1.0, 0.8, 0.6, 0.4])
chain = rde.Chain("RPR", masses=[1, 1.0, 1], lengths=np.array([0.5, 0.5]))
rprp = rde.RPRP(masses=masses, lengths=[np.float64(0.5), 0.5])
four_r = rde.FourR(masses=(1, 1, 1, 1), lengths=[0.4, 0.3, 0.2, 0.1])
heaviest: float = max(rprp.masses)
first, second = rprp.lengths
total: float = sum(four_r.lengths) + rprp.masses[0] + first + second

of_rprp: list[rde.effects.Effect] = [
    effects.Gravity(9.81, down=[0.0, -1.0]),
    effects.PrismaticStop(lower=[0, 0.0], upper=np.array([0.3, 0.3])),
    effects.EffortLimits([10, 20.0, 10, 20]),
    effects.ViscousFriction(np.full(4, 0.1)),
    effects.QuadraticFriction([0.1, 0.1, 0.1, 0.1]),
    effects.CentringSpring(np.ones(2), [0.0, 0], [0.3, 1]),
    effects.Payload(np.float64(0.2)),
    effects.Disc(centre=[2.0, 2.0], radius=0.1),
]
of_four_r = [
    effects.Gravity(),
    effects.HalfPlane(point=np.zeros(2), normal=[0.0, 1.0]),
    effects.JointStop(lower=[-3.0, None, None, None], upper=[3.0, None, None, 3]),
    effects.CoulombFriction([0.1, 0.1, 0.1, 0.1]),
    effects.Lag(np.full(4, 0.01)),
    effects.Armature([0.01, 0.01, 0.01, 0.01]),
    effects.LinkInertia(np.full(4, 0.01)),
    effects.Tendon(["joint2", "joint3"], [0.05, 0.05], 100.0),
    effects.Tether(4, [0.0, 0.0], stiffness=10.0),
    effects.TipForce(step=[1.0, 0.0]),
    effects.JointTorque(step=[0.1, 0.0, 0.0, 0.0]),
    effects.SensorNoise(position=[0.01, 0.01, 0.01, 0.01]),
    effects.SensorBias(rate=np.full(4, 0.01)),
    effects.Quantisation(position=[0.01, 0.01, 0.01, 0.01]),
    effects.EffortLimits(np.full(4, 10.0)),
    effects.MovingBase(amplitude=[0.01, 0.0], frequency=1.0),
    effects.DroppedSamples(np.full(4, 0.1)),
]
scene = rde.Scene(rprp, effects=of_rprp, randomize={"payload.mass": {"uniform": [0, 0.5]}})
other = rde.Scene(four_r, effects=of_four_r)
again: rde.Scene = rde.Scene.from_dict(scene.to_dict())

trajectory = rde.simulate(scene, [0.0, 0.1, 0.0, 0.1], np.zeros(4), [0.0, 0.1], efforts=[0, 0, 0, 0])
last: np.ndarray[Any, np.dtype[np.float64]] = trajectory.q[-1]
batch = rde.BatchSimulator(scene, num_envs=3)
batch.set_state([[0.0, 0.1, 0.0, 0.1]] * 3, [0.0, 0.0, 0.0, 0.0], index=[0, 1, 2])
batch.set_parameters({"masses": [1.0, 1, 1, 1], "payload.mass": 0.1, "gravity.g": np.full(3, 9.0)})
batch.advance([[0.0] * 4] * 3)
tips = rprp.forward_kinematics([0.0, 0.1, 0.0, 0.1])

env = gym.make("redundant_envs/RPRPReach-v0", scene=scene.to_dict(), task={"goal_tolerance": 0.05})
env.reset(seed=0, options={"q": [0.0, 0.1, 0.0, 0.1]})
vector = rde.make_sb3("RPRPReach-v0", num_envs=2, scene=scene, observe_parameters=["payload.mass"])
vector.set_options({"parameters": {"payload.mass": [0.1, 0.2]}})


def lengths_of(arm: rde.Arm) -> Sequence[float]:
    """The lengths of any arm are a sequence of floats."""
    return [float(length) for length in arm.lengths]


loaded = rde.load_scene(Path("configs", "scenes", "rprp_reach.yaml")) if Path("configs").exists() else scene
