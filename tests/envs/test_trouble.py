"""docs/trouble.md: every row of its tables, tried in every kind of environment."""

import itertools
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from faces import ID, begin, flat, made, with_effects
from gymnasium.error import ResetNeeded

import redundant_envs as rde
from redundant_envs.envs.face import observation_of

PAGE = (Path(__file__).parents[2] / "docs" / "trouble.md").read_text(encoding="utf-8")
ZERO = np.zeros(4, np.float32)
NAN = np.array([0.0, np.nan, 0.0, 0.0], np.float32)
COLUMNS = {"single": "Reach", "vector": "Reach", "goal": "GoalReach", "SB3": "Reach"}
"""Columns of the page, and the tasks of their environments."""
KINDS = {"single": "single", "vector": "next_step", "goal": "single", "SB3": "sb3"}


def tables():
    """Rows of the tables that have a column for each kind of environment: case -> cells."""
    rows = {}
    for block in PAGE.split("\n\n"):
        lines = [[c.strip() for c in x.strip("|").split("|")] for x in block.splitlines() if x[:1] == "|"]
        if lines and lines[0] == ["what", *COLUMNS]:
            rows |= {cells[0]: dict(zip(COLUMNS, cells[1:], strict=True)) for cells in lines[2:]}
    return rows


def trouble(make=None, options=None, actions=(ZERO,), arms=("RPRP", "FourR"), **more):
    """Inputs: keywords of make, options of a reset, actions of steps."""
    kept = {"started": True, "harmless": False, **more}
    return SimpleNamespace(make=make or {}, options=options or {}, actions=actions, arms=arms, **kept)


def each(key, *values, **kwargs):
    return [trouble(options={key: value}, **kwargs) for value in values]


def of_actions(*actions, **make):
    return [trouble(make, actions=actions)]


FOUR_R = rde.load_scene("four_r_reach").to_dict()
SPRINGS = (rde.effects.LimitSpring(joint, -1.0, 1.0, 1.0, 0.1) for joint in ("joint1", "joint3"))
SPRUNG = with_effects("FourRReach-v0", *SPRINGS)
ADAPTIVE = {**FOUR_R, "integrator": "dop853", "tolerance": None}
COARSE = {**FOUR_R, "integrator": "euler", "substeps": 1, "tolerance": None}
UPPER = {"prismatic_stop.upper": (0.05, 0.2)}
TROUBLES = {
    "an action with a NaN or an infinity": [
        trouble(actions=(np.array([0.0, bad, 0.0, 0.0], np.float32),)) for bad in (np.nan, np.inf, -np.inf)
    ],
    'the same with `on_bad_action="raise"`': of_actions(NAN, on_bad_action="raise"),
    'the same with `on_bad_action="terminate"`': of_actions(NAN, on_bad_action="terminate"),
    "a finite action outside [-1, 1]": of_actions(
        np.array([0, -1.5, 0, 0], np.float32), ZERO, ZERO, max_episode_steps=3
    ),
    "an action of 1e300": of_actions(np.array([0, 1e300, 0, 0]), ZERO, ZERO, max_episode_steps=3),
    "an action of another shape": [
        trouble(make, actions=(np.zeros(shape, np.float32),))
        for shape, make in itertools.product((3, (4, 1), ()), ({}, {"on_bad_action": "terminate"}))
    ],
    "an action of text, objects, booleans or complex numbers": [
        trouble({"on_bad_action": "terminate"}, actions=(np.zeros(4, kind),))
        for kind in (str, object, bool, complex)
    ],
    "an action of float64 or whole numbers": [
        trouble(actions=(np.zeros(4, kind),), harmless=True) for kind in (float, int, np.uint8)
    ],
    "a step before the first reset": [trouble(started=False)],
    "a step after a fault has ended the episode": of_actions(NAN, ZERO, on_bad_action="terminate"),
    "a step after the limit of steps has ended the episode": of_actions(ZERO, ZERO, max_episode_steps=1),
    'the same with `autoreset_mode="disabled"`': of_actions(
        ZERO, ZERO, max_episode_steps=1, autoreset_mode="disabled"
    ),
    "a start beyond a hard stop": each("q", (0, 0.3, 0, 0), (0, 0, 0, -1e-9), arms=("RPRP",)),
    "a start beyond a limit spring": [
        trouble({"scene": SPRUNG}, {"q": (0.0, 0.0, 1.5, 0.0)}, arms=("FourR",), harmless=True)
    ],
    "stops that leave the start outside": [
        trouble(options={"q": (0, 0.24, 0, 0), "parameters": UPPER}, arms=("RPRP",))
    ],
    "a start that is not finite": [
        *each("q", (0, np.nan, 0, 0), (0, 0, -np.inf, 0)), *each("qd", (np.inf, 0, 0, 0)),
    ],
    "an angle of more than 1e6 rad, a velocity or a goal beyond 1e100": [
        *each("q", (1.1e6, 0, 0, 0)), *each("qd", (0, 0, 1.1e100, 0)), *each("goal", (1.1e100, 0)),
    ],
    "a goal out of reach": each("goal", (1.1, 0.0)),
    "an unknown option or parameter": [*each("pose", 1), *each("parameters", {"mass": 1.0})],
    "an impossible number, such as a mass of 0": each(
        "parameters", {"masses": 0.0}, {"masses": np.nan}, {"effort_limits.limits": -1.0}
    ),
    "another length of a link": each("parameters", {"lengths": 0.3}, harmless=True),
    '`on_bad_action="ignore"`': [trouble({"on_bad_action": "ignore"})],
    "a state that is not finite": each("qd", (1e10, 0.0, 0.0, 0.0)),
    "a motion too large to be observed": [
        trouble({"scene": COARSE}, {"qd": (1e16, 0.0, 0.0, 0.0)}, arms=("FourR",))
    ],
    "a velocity beyond the speed bound": each("qd", (150.0, 0.0, 0.0, 0.0)),
    "a tolerance that is not reached": [
        trouble(
            {"accuracy": 1e-13, "task": {"speed_bound": 1e6}}, {"qd": (1e4, -1e4, 1e4, -1e4)},
            arms=("FourR",),
        )
    ],
    "more than 256 impacts in a control interval": [
        trouble(
            options={"qd": (0, 1e5, 0, 0), "parameters": {"prismatic_stop.restitution": 1.0}}, arms=("RPRP",)
        )
    ],
    "dop853 finds no accurate step": [trouble({"scene": ADAPTIVE}, {"qd": (1e30, 0, 0, 0)}, arms=("FourR",))],
    "an angle that turns beyond 1e6 rad": [
        trouble(options={"q": (1e6, 0, 0, 0), "qd": (40.0, 0, 0, 0)}, actions=(ZERO, ZERO), arms=("FourR",))
    ],
}  # fmt: skip


class Played:
    """An environment whose first lane is in trouble."""

    def __init__(self, kind, env_id, make):
        self.kind = make.get("autoreset_mode", kind)
        rest = {k: v for k, v in make.items() if k != "autoreset_mode"}
        self.env = made(self.kind, env_id, 2, **rest)
        self.core = self.env.unwrapped.core if kind == "single" else self.env.core

    def reset(self, options):
        """Reset the first lane; whether a limit is passed then."""
        if self.kind == "sb3":
            begin(self.env, [options, {}])
            infos = self.env.reset_infos[0]
        else:
            only = {} if self.kind == "single" else {"reset_mask": np.array([True, False])}
            infos = self.env.reset(options={**options, **only})[1]
        beyond = np.ravel(infos.get("beyond_limit", 0.0))[0]
        assert beyond in (0.0, 0.5)  # rad, the depth
        return beyond > 0.0

    def step(self, action):
        """Observation, whether a fault ended the episode, whether it ended at all, and info."""
        if self.kind == "single":
            obs, _, terminated, truncated, info = self.env.step(action)
            return obs, terminated, terminated or truncated, info
        obs, _, *ends, infos = self.env.step(np.stack([action, np.zeros_like(action)]))
        if self.kind == "sb3":
            ended, info = bool(ends[0][0]), infos[0]
            seen, faulty = info.get("terminal_observation", obs), not info["TimeLimit.truncated"]
            return seen, ended and faulty, ended, info
        terminated, truncated = bool(ends[0][0]), bool(ends[1][0])
        return obs, terminated, terminated or truncated, observation_of(infos, 0)


def outcome(kind, env_id, given):
    """The outcome, in the words of the page."""
    try:
        played = Played(kind, env_id, given.make)
    except ValueError as error:
        return f"`{type(error).__name__}`"
    if given.started:
        begin(played.env, seed=0)
    core, unsafe, ended, beyond = played.core, False, False, False
    for n, action in enumerate(given.actions):
        ended_before, before = ended, core.get_state()
        try:
            if n == 0 and given.options:
                beyond = played.reset(given.options)
            seen, faulty, ended, info = played.step(action)
        except (ValueError, ResetNeeded) as error:
            np.testing.assert_equal(core.memory.save(), {k: before[k] for k in ("states", "parameters")})
            np.testing.assert_equal(core.keys, before["keys"])
            return f"`{type(error).__name__}`"
        unsafe = unsafe or faulty
        assert np.isfinite(flat(seen)).all()
    steps = int(core.memory.read(("steps",))[0, 0])
    if ended_before:
        told = "truncated" if ended and not faulty else "untold"
        return "begins anew" if steps < len(given.actions) else f"goes on; {told}"
    if "max_episode_steps" in given.make:
        assert ended
        assert not unsafe
        return "goes on; counted" if info["saturated_actions"] == 1 else "untold"
    if ended:
        assert faulty
        numerics = int(info["numerics"])
        return f"episode ends; numerics = {numerics}"
    happened = int(core.memory.read(("numerics",))[0, 0])
    if happened:
        return f"goes on; numerics = {happened}" if info.get("numerics") == happened else "untold"
    if not given.harmless:
        return "untold"
    return "goes on; `beyond_limit`" if beyond else "goes on"


ROWS = tables()
CASES = [(what, name) for what, cells in ROWS.items() for name in COLUMNS if cells[name]]


def test_the_page_and_these_tests_have_the_same_rows():
    assert list(ROWS) == list(TROUBLES)
    assert len(CASES) == 4 * len(ROWS) - 3
    assert "untold" not in PAGE
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", PAGE, re.M)
    assert {name: int(bit) for bit, name in rows} == {fault.name: fault.value for fault in rde.Numerics}
    shown = re.findall(r"numerics = (\d+)", PAGE)
    assert all(any(int(numerics) & fault for numerics in shown) for fault in rde.Numerics)


@pytest.mark.parametrize(("what", "name"), CASES, ids=[f"{name}, {what}" for what, name in CASES])
def test_a_face_does_what_its_row_says(what, name):
    for given in TROUBLES[what]:
        for arm in given.arms:
            found = outcome(KINDS[name], f"redundant_envs/{arm}{COLUMNS[name]}-v0", given)
            assert found == ROWS[what][name], (arm, given)


@pytest.mark.parametrize("what", ["a velocity beyond the speed bound", "another length of a link"])
def test_vectors_of_goal_environments_do_what_single_ones_do(what):
    (given,) = TROUBLES[what]
    for kind in ("next_step", "sb3"):
        assert outcome(kind, "redundant_envs/FourRGoalReach-v0", given) == ROWS[what]["goal"]


@pytest.mark.parametrize("kind", ["single", "next_step", "sb3"])
def test_an_action_of_any_size_acts_as_the_nearest_inside(kind):
    huge, ends = np.array([1e6, -1e300, 0.5, -1.0]), []
    for action in (huge, np.clip(huge, -1.0, 1.0)):
        env = made(kind, ID, 2)
        begin(env, seed=0)
        ends.append(env.step(action if kind == "single" else np.tile(action, (2, 1)))[0])
    np.testing.assert_array_equal(*ends)


def test_same_step_tells_the_fault_in_the_final_info():
    env = made("same_step", ID, 2)
    begin(env, seed=0)
    *_, infos = env.step(np.stack([NAN, ZERO]))
    assert infos["final_info"]["numerics"][0] == rde.Numerics.BAD_ACTION
    assert infos["_final_info"].tolist() == [True, False]
    assert infos["numerics"].tolist() == [0, 0]
