"""Trained policies in JavaScript: the actions of stable-baselines3."""

import base64
import json

import gymnasium as gym
import numpy as np
import pytest

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


@pytest.mark.parametrize("learner", page.LEARNERS)
@pytest.mark.parametrize("arm", page.ARMS)
def test_policies_act_as_stable_baselines3_predicts(arm, learner, node):
    sb3, torch = pytest.importorskip("stable_baselines3"), pytest.importorskip("torch")
    from redundant_envs_train.shipping import layers

    folder = ROOT / "policies" / f"{arm}Reach-v0-{learner}"
    envs = gym.make_vec(f"redundant_envs/{arm}Reach-v0", num_envs=100)
    envs.reset(seed=77)
    envs.action_space.seed(1)
    moving = [envs.step(envs.action_space.sample())[0] for _ in range(10)]
    seen = np.concatenate(moving).astype("<f4")
    about, weights = page.policy(folder / "policy.npz", seen.shape[1], 4)
    coded = {name: base64.b64encode(x.astype("<f4").tobytes()).decode()
             for name, x in (("weights", weights), ("observations", seen))}  # fmt: skip
    given = json.dumps({**about, **coded})
    acted = json.loads(node("-e", ACT, input=given))
    model = getattr(sb3, learner.upper()).load(folder / "policy.zip", device="cpu")
    exact = layers.Exact(model.policy)(torch.as_tensor(seen)).detach().numpy()
    assert exact.std() > 0.1
    np.testing.assert_allclose(acted, exact, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"weights_0": np.zeros((64, 17))}, "from 18 observed numbers to 4 actions"),
        ({"weights_2": np.full((4, 64), np.nan)}, "give a policy of finite numbers"),
        ({"activation": np.array("sine")}, "with silu, tanh, relu"),
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
