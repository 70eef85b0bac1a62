"""Trained policies in JavaScript: the actions of stable-baselines3, and of computed torque."""

import base64
import json
import subprocess

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import computed_torque
from redundant_envs.web import module, page

pytestmark = pytest.mark.long

ROOT = module.HOST.parents[2]
ACT = f"""
const {{ Policy }} = require({json.dumps(str(module.HOST))});
const {{ weights, observations, ...about }} = JSON.parse(require("fs").readFileSync(0));
const floats = (text) => new Float32Array(new Uint8Array(Buffer.from(text, "base64")).buffer);
const policy = new Policy({{ ...about, weights: floats(weights) }}), all = floats(observations);
const n = about.sizes[0], actions = [];
for (let k = 0; k < all.length; k += n) actions.push(Array.from(policy.act(all.subarray(k, k + n))));
console.log(JSON.stringify(actions));
"""
PLAN = """
const { Simulator, ComputedTorque } = require("./kernel.js"), fs = require("fs");
const description = JSON.parse(fs.readFileSync("arm.json"));
const code = new WebAssembly.Module(fs.readFileSync("arm.wasm"));
const controller = new ComputedTorque(new Simulator(description, code));
const actions = JSON.parse(fs.readFileSync(0)).map(({ q, goal, motion }) => {
  controller.begin(q, goal);
  return motion.map(([place, rate]) => controller.act(place, rate));
});
console.log(JSON.stringify(actions));
"""


def in_node(node, program, given, folder=None):
    text = json.dumps(given)
    done = subprocess.run(
        [node, "-e", program], input=text, capture_output=True, text=True, check=True, cwd=folder
    )
    return np.array(json.loads(done.stdout))


@pytest.mark.parametrize("learner", page.LEARNERS)
@pytest.mark.parametrize("arm", page.ARMS)
def test_policies_act_as_stable_baselines3_predicts(arm, learner, node):
    sb3, torch = pytest.importorskip("stable_baselines3"), pytest.importorskip("torch")
    from redundant_envs_train.shipping import layers

    folder = ROOT / "policies" / f"{arm}Reach-v0-{learner}"
    envs = gym.make_vec(f"redundant_envs/{arm}Reach-v0", num_envs=100)
    seen = envs.reset(seed=77)[0].astype("<f4")
    about, weights = page.policy(folder / "policy.npz", seen.shape[1], 4)
    coded = {name: base64.b64encode(x.astype("<f4").tobytes()).decode()
             for name, x in (("weights", weights), ("observations", seen))}  # fmt: skip
    found = in_node(node, ACT, {**about, **coded})
    model = getattr(sb3, learner.upper()).load(folder / "policy.zip", device="cpu")
    exact = layers.Exact(model.policy)(torch.as_tensor(seen)).detach().numpy()
    assert exact.std() > 0.1
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_computed_torque_acts_as_in_python(name, node, tmp_path):
    scene, rng = rde.load_scene(name), np.random.default_rng(5)
    module.write(scene, rde.ReachTask(), "arm", tmp_path)
    count, steps = 20, 30
    phi = rng.uniform(-2.0, 2.0, (count, 4))
    phi[:, list(scene.robot.sliders())] = rng.uniform(0.02, 0.23, (count, len(scene.robot.sliders())))
    q = phi @ np.linalg.inv(scene.robot.motor_map)
    angle, radius = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.2, 0.9, count)
    goals = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    motion = rng.uniform(-0.05, 0.05, (count, steps, 2, 4))
    motion[:, :, 0] += q[:, None]
    given = [
        {"q": a.tolist(), "goal": b.tolist(), "motion": c.tolist()}
        for a, b, c in zip(q, goals, motion, strict=True)
    ]
    found = in_node(node, PLAN, given, tmp_path)
    expert = computed_torque.ComputedTorque(scene)
    expert.begin(q, goals)
    expected = [expert.action(k * scene.control_dt, motion[:, k, 0], motion[:, k, 1]) for k in range(steps)]
    np.testing.assert_allclose(found, np.stack(expected, axis=1), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"weights_0": np.zeros((64, 17))}, "give a policy from 18 observed numbers to 4 actions"),
        ({"weights_2": np.full((4, 64), np.nan)}, "not finite"),
        ({"activation": np.array("sine")}, "known are silu, tanh, relu"),
        ({"weights_0": np.array([object()])}, "is no policy as agents export writes it"),
    ],
)
def test_a_file_that_is_no_such_policy_is_refused(changed, message, tmp_path):
    with np.load(ROOT / "policies" / "RPRPReach-v0-sac" / "policy.npz") as file:
        np.savez(tmp_path / "policy.npz", **{**file, **changed})
    with pytest.raises(ValueError, match=message):
        page.policy(tmp_path / "policy.npz", 18, 4)
    (tmp_path / "policy.npz").write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"policy.npz is no policy"):
        page.policy(tmp_path / "policy.npz", 18, 4)
