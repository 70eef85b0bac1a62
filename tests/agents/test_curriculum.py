"""A curriculum: numbers of the environments move to their own, which those of evaluations always have."""

import numpy as np
import pytest
from run_folders import says
from short_trainings import CASES, small_config

from redundant_envs.control.holding import effort_limits
from redundant_envs.scenes.scene import load_scene, scene_data
from redundant_envs_train.training import watch
from redundant_envs_train.training.train import train

FIRST, OWN = [10.0, 16.0, 4.0, 8.0], [20.0, 32.0, 8.0, 16.0]


def test_an_episode_keeps_the_numbers_of_its_start_and_the_curve_is_of_the_environments_own(
    tmp_path, monkeypatch
):
    seen, judged = {}, []
    plain, episodes = watch.Watch._on_step, watch.run_episodes

    def on_step(self):
        seen[self.num_timesteps] = self.monitor.get_attr("parameters")[0]["effort_limits.limits"].value
        return plain(self)

    def run_episodes(*given, **env_kwargs):
        judged.append(effort_limits(load_scene(env_kwargs["scene"])).tolist())
        return episodes(*given, **env_kwargs)

    monkeypatch.setattr(watch.Watch, "_on_step", on_step)
    monkeypatch.setattr(watch, "run_episodes", run_episodes)
    train(small_config("moved"), tmp_path / "run")
    steps = 16 * 40  # of the first episodes
    for begun in range(0, 2400, steps):
        at = min(begun // 24 / 100 / 0.5, 1.0)
        for step in range(begun + 16, min(begun + steps, 2400), 16):
            np.testing.assert_allclose(seen[step], (1 - at) * np.array(FIRST) + at * np.array(OWN))
    assert at == 1.0
    assert judged == [OWN] * len(judged) != []


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"effort_limit": 3.0}, ["parameter is 'effort_limit'; this scene has", "effort_limits.limits"]),
        ({"effort_limits.limits": FIRST[:3]}, ["effort_limits.limits has shape (3,); give (4,)"]),
        ({"effort_limits.limits": [FIRST] * 16}, ["give the same to all environments"]),
        ({"effort_limits.limits[0]": 3.0}, ["[0] is a part; give effort_limits.limits with all its entries"]),
        ({"hold_steps": 2}, ["hold_steps is 4.66", "give a whole number"]),
        ({"masses": 0.4}, ["masses is drawn for each episode; leave it out, or out of randomize"]),
    ],
)
def test_numbers_that_cannot_move_are_refused_before_there_is_a_folder(parameters, words, tmp_path):
    drawn = {"masses[1]": {"scale": {"log_uniform": [0.8, 1.25]}}}
    scene = {**scene_data("rprp_reach"), "randomize": drawn}
    kwargs = CASES["moved"].get("env_kwargs", {}) | {"scene": scene}
    config = small_config("moved", curriculum={"parameters": parameters}, env_kwargs=kwargs)
    with says("curriculum.parameters: ", *words):
        train(config, tmp_path / "run")
    assert not [*tmp_path.iterdir()]
