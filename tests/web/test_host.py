"""kernel.js: episodes, lanes and numbers of a simulator, what it refuses; and the actions of policies."""

import base64
import dataclasses
import itertools
import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.seeding import np_random

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.web import page
from redundant_envs.web.module import HOST

pytestmark = pytest.mark.long

BEGIN = """
const { Simulator } = require("./kernel.js"), fs = require("fs");
const description = JSON.parse(fs.readFileSync(`${NAME}.json`));
const code = new WebAssembly.Module(fs.readFileSync(`${NAME}.wasm`));
const made = (lanes = 1) => new Simulator(description, code, lanes);
const play = (simulator, steps, lane = 0) => {
  for (let k = 0; k < steps; k++) { simulator.actions(lane).fill(0.5); simulator.step(); }
  return String(simulator.states(lane));
};
const tell = (value) => console.log(JSON.stringify(value));
"""
REACH = rde.load_scene("four_r_reach")
RANGES = {"gravity.g": {"uniform": [8.0, 12.0]}, "masses": {"scale": {"uniform": [0.5, 2.0]}}}
GEARS = e.GearBacklash(gap=0.01, stiffness=200.0, inertia=0.01, damping=1.0)
SCENES = {
    "plain": REACH,
    "stops": rde.load_scene("rprp_reach"),
    "drawn": dataclasses.replace(REACH, randomize=RANGES),
    "gears": dataclasses.replace(REACH, effects=(*REACH.effects, GEARS)),
}


@pytest.fixture(scope="module")
def told(node, written):
    """What a program tells of the simulator of a scene."""

    def run(name, program):
        program = f"const NAME = '{name}';{BEGIN}{program}"
        return json.loads(node("-", input=program, cwd=written(name)))

    return run


MISTAKES = {
    "new Simulator({...description, format: 2}, code)": "format 2; this kernel.js reads 1",
    "new Simulator({...description, identity: 'x'}, code)": "the description is of another module",
    "made(3)": "lanes is 3; give 1 to 2",
    "made().step()": "a lane has no episode yet",
    "made().reset([1, 2])": "key is 1, 2; give 4 whole numbers from 0 to 2^32 - 1",
    "made(2).reset([1, 2, 3, 4], 2)": "lane is 2; give 0 to 1",
    "made().reset([1, 2, 3, 4], null, {q: [1, 2]})": "q is 1,2; give 4 finite numbers",
    "made().get('mass')": "field is mass; this environment has theta1, ",
    "made().set('gravity.g', '3')": "gravity.g is 3; give a number",
    "made().set('inverse_l1', 2)": "inverse_l1 follows from others",
    "made().output('rewards')": "output is rewards; this environment has ",
}


def test_mistakes_are_explained(told):
    program = "".join(
        f"try {{ {mistake}; said.push('nothing'); }} catch (error) {{ said.push(error.message); }}\n"
        for mistake in MISTAKES
    )
    said = told("plain", f"const said = [];\n{program} tell(said);")
    assert [text for text, part in zip(said, MISTAKES.values(), strict=True) if part not in text] == []


def test_lanes_begin_and_go_on_by_themselves_with_their_own_parameters(told):
    alone, beside = told("stops", """
      const light = made(), heavy = made(), two = made(2), key = [5, 6, 7, 8];
      heavy.set("m4", 1.5); heavy.prepare();
      two.set("m4", 1.5, 1); two.prepare();
      light.reset(key); heavy.reset(key);
      two.reset([9, 9, 9, 9], 0); two.reset(key, 1); two.actions(0).fill(-0.3);
      play(two, 10, 1); two.reset(key, 0); two.actions(0).fill(0.5); play(two, 20, 1);
      tell([[play(light, 20), play(heavy, 30)], [0, 1].map((lane) => String(two.states(lane)))]);
    """)  # fmt: skip
    assert alone == beside


@pytest.mark.parametrize("options", [{}, {"q": [0.3, -0.2, 0.5, 0.1], "qd": [0.1] * 4, "goal": [0.4, 0.2]}])
def test_starts_by_a_seed_and_by_options_are_those_of_python(options, told):
    env = gym.make("redundant_envs/FourRReach-v0", scene=SCENES["gears"].to_dict())
    key = np_random(3)[0].bit_generator.random_raw(2).view("<u4").tolist()
    ours = [env.reset(seed=3, options=options)[0]]
    ours += [env.step(np.full(4, 0.5, np.float32))[0] for _ in range(5)]
    theirs = told("gears", f"""
      const s = made(), seen = []; s.reset({key}, null, {json.dumps(options)});
      seen.push([...s.observation()]);
      for (let k = 0; k < 5; k++) {{ play(s, 1); seen.push([...s.observation()]); }} tell(seen);
    """)  # fmt: skip
    np.testing.assert_array_equal(np.array(theirs, np.float32), ours)  # JSON has no -0.0


def test_a_parameter_that_is_set_is_not_drawn_until_a_restart(told):
    first, other, fixed, mass, drawn = told("drawn", """
      const s = made(), g = () => s.get("gravity.g");
      s.reset([1, 2, 3, 4]); const first = g(); s.reset([2, 2, 3, 4]); const other = g();
      s.set("gravity.g", 1.62); s.set("m4", 0.7); s.prepare(); s.reset([3, 2, 3, 4]);
      const fixed = [g(), s.get("ay")], mass = s.get("m4"); s.restart(); s.reset([1, 2, 3, 4]);
      tell([first, other, fixed, mass, g()]);
    """)  # fmt: skip
    assert first != other
    assert (fixed, mass) == ([1.62, 1.62], 0.7)
    assert drawn == first


# ---- trained policies: the actions of stable-baselines3 ------------------------------------------------

ROOT = HOST.parents[2]
ACT = f"""
const {{ Policy }} = require({json.dumps(str(HOST))});
const {{ weights, observations, ...about }} = JSON.parse(require("fs").readFileSync(0));
const floats = (text) => new Float32Array(new Uint8Array(Buffer.from(text, "base64")).buffer);
const policy = new Policy({{ ...about, weights: floats(weights) }}), all = floats(observations);
const n = about.sizes[0], actions = [];
for (let k = 0; k < all.length; k += n) actions.push(Array.from(policy.act(all.subarray(k, k + n))));
console.log(JSON.stringify(actions));
"""


@pytest.mark.parametrize(
    ("pair", "learner"),
    [*itertools.product(("RPRPReach", "FourRReach"), page.LEARNERS), ("FourRReachAround", "sac")],
)
def test_policies_act_as_stable_baselines3_predicts(pair, learner, node):
    sb3, torch = pytest.importorskip("stable_baselines3"), pytest.importorskip("torch")
    from redundant_envs_train.shipping import layers

    folder = ROOT / "policies" / f"{pair}-v0-{learner}"
    envs = gym.make_vec(f"redundant_envs/{pair}-v0", num_envs=100)
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
