"""docs/trouble.md: every row of its tables, tried on every kind of environment."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from trouble_faces import SB3, Single, Vector

import redundant_envs as rde

PAGE = (Path(__file__).parents[2] / "docs" / "trouble.md").read_text(encoding="utf-8")
ZERO = np.zeros(4, np.float32)
NAN = np.array([0.0, np.nan, 0.0, 0.0], np.float32)
FAST, FASTER, BEYOND_BOUND = (1e10, 0.0, 0.0, 0.0), (1e30, 0.0, 0.0, 0.0), (150.0, 0.0, 0.0, 0.0)


def tables():
    """Rows of the tables that have a column for each kind of environment: case -> cells."""
    rows = {}
    for block in re.split(r"\n\n", PAGE):
        lines = [
            [c.strip() for c in line.strip("|").split("|")] for line in block.splitlines() if line[:1] == "|"
        ]
        if lines and lines[0] == ["what", "single", "vector", "goal", "SB3"]:
            rows |= {cells[0]: cells[1:] for cells in lines[2:]}
    return rows


FACES = {
    "single": (Single, "Reach"),
    "vector": (Vector, "Reach"),
    "goal": (Single, "GoalReach"),
    "SB3": (SB3, "Reach"),
}


# ---- the cases of the rows ------------------------------------------------------------------------


@dataclass
class Trouble:
    """Inputs: keywords of make, options of a reset, actions of steps."""

    make: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    actions: tuple[Any, ...] = (ZERO,)
    arms: tuple[str, ...] = ("RPRP", "FourR")
    started: bool = True
    harmless: bool = False


def scene(name, **changes):
    data = rde.load_scene(name).to_dict()
    return {**data, **changes}


def sprung():
    spring = {
        "type": "LimitSpring",
        "coordinate": "joint2",
        "lower": -1.0,
        "upper": 1.0,
        "stiffness": 1.0,
        "damping": 0.1,
    }
    return scene("four_r_reach", effects=[*scene("four_r_reach")["effects"], spring])


def each(key, *values, **kwargs):
    return [Trouble(options={key: value}, **kwargs) for value in values]


TROUBLES = {
    "an action with a NaN or an infinity": [
        Trouble(actions=(np.array([0.0, bad, 0.0, 0.0], np.float32),)) for bad in (np.nan, np.inf, -np.inf)
    ],
    'the same, `on_bad_action="raise"`': [Trouble({"on_bad_action": "raise"}, actions=(NAN,))],
    'the same, `on_bad_action="terminate"`': [Trouble({"on_bad_action": "terminate"}, actions=(NAN,))],
    "a finite action outside [-1, 1]": [
        Trouble({"max_episode_steps": 3}, actions=(np.array([0, -1.5, 0, 0], np.float32), ZERO, ZERO))
    ],
    "an action of 1e300": [
        Trouble({"max_episode_steps": 3}, actions=(np.array([0.0, 1e300, 0.0, 0.0]), ZERO, ZERO))
    ],
    "an action of another shape": [
        Trouble(make, actions=(np.zeros(shape, np.float32),))
        for shape in ((3,), (5,), (4, 1), ())
        for make in ({}, {"on_bad_action": "terminate"})
    ],
    "an action of text, objects, booleans or complex numbers": [
        Trouble(make, actions=(np.zeros(4, kind),))
        for kind in (str, object, bool, complex)
        for make in ({}, {"on_bad_action": "terminate"})
    ],
    "an action of float64 or whole numbers": [
        Trouble(actions=(np.zeros(4, kind),), harmless=True) for kind in (float, int, np.uint8)
    ],
    "a step before the first reset": [Trouble(started=False)],
    "a step after a fault has ended the episode": [
        Trouble({"on_bad_action": "terminate"}, actions=(NAN, ZERO))
    ],
    "a step after the last one, by the limit of steps": [
        Trouble({"max_episode_steps": 1}, actions=(ZERO, ZERO))
    ],
    'the same, `autoreset_mode="disabled"`': [
        Trouble({"max_episode_steps": 1, "autoreset_mode": "disabled"}, actions=(ZERO, ZERO))
    ],
    "a start beyond a hard stop": each("q", (0, 0.3, 0, 0), (0, 0, 0, -1e-9), arms=("RPRP",)),
    "a start beyond a limit spring": [
        Trouble({"scene": sprung()}, {"q": (0.0, 1.5, 0.0, 0.0)}, arms=("FourR",), harmless=True)
    ],
    "stops that leave the start outside": [
        Trouble(
            options={"q": (0, 0.24, 0, 0), "parameters": {"prismatic_stop.upper": (0.05, 0.2)}},
            arms=("RPRP",),
        )
    ],
    "a start that is not finite": [
        *each("q", (0, np.nan, 0, 0), (0, 0, -np.inf, 0)), *each("qd", (np.inf, 0, 0, 0)),
    ],
    "an angle of more than 1e6 rad, a velocity or a goal beyond 1e100": [
        *each("q", (1.1e6, 0, 0, 0)), *each("qd", (0, 0, 1.1e100, 0)), *each("goal", (1.1e100, 0)),
    ],
    "a goal out of reach": each("goal", (1.1, 0.0)),
    "an option or a parameter that is not known": [*each("pose", 1), *each("parameters", {"mass": 1.0})],
    "a parameter that no arm or effect has": each(
        "parameters", {"masses": 0.0}, {"masses": np.nan}, {"effort_limits.limits": -1.0}
    ),
    "another length of a link": each("parameters", {"lengths": 0.3}, harmless=True),
    '`on_bad_action="ignore"`': [Trouble({"on_bad_action": "ignore"})],
    "a state that is not finite": each("qd", FAST),
    "a velocity beyond the speed bound": each("qd", BEYOND_BOUND),
    "a tolerance that is not reached": [
        Trouble(
            {"accuracy": 1e-13, "task": {"speed_bound": 1e6}}, {"qd": (1e4, -1e4, 1e4, -1e4)},
            arms=("FourR",),
        )
    ],
    "more than 256 impacts in a control interval": [
        Trouble(
            options={"qd": (0, 1e5, 0, 0), "parameters": {"prismatic_stop.restitution": 1.0}}, arms=("RPRP",)
        )
    ],
    "no step of dop853 that is accurate": [
        Trouble(
            {"scene": scene("four_r_reach", integrator="dop853", tolerance=None)}, {"qd": FASTER},
            arms=("FourR",),
        )
    ],
    "an angle that turns beyond 1e6 rad": [
        Trouble(options={"q": (1e6, 0, 0, 0), "qd": (40.0, 0, 0, 0)}, actions=(ZERO, ZERO), arms=("FourR",))
    ],
}  # fmt: skip


def bits(numerics):
    return " + ".join(str(int(fault)) for fault in rde.Numerics if fault & int(numerics))


def outcome(face, env_id, trouble):
    """The outcome, in the words of the page."""
    try:
        made = face(env_id, **trouble.make)
    except ValueError as error:
        return f"`{type(error).__name__}`"
    if trouble.started:
        made.start()
    counted = unsafe = ended_before = seen = None
    for n, action in enumerate(trouble.actions):
        ended_before = n > 0 and seen.ended
        before = made.core.get_state()
        try:
            if n == 0 and trouble.options:
                made.reset(trouble.options)
            seen = made.step(action)
        except (ValueError, ResetNeeded) as error:
            np.testing.assert_equal(made.core.memory.save(), {k: before[k] for k in ("states", "parameters")})
            np.testing.assert_equal(made.core.keys, before["keys"])
            return f"`{type(error).__name__}`"
        unsafe = unsafe or seen.terminated
        arrays = seen.observation.values() if isinstance(seen.observation, dict) else [seen.observation]
        assert all(np.isfinite(a).all() for a in arrays)
    steps = int(made.core.memory.read(("steps",))[0, 0])
    if ended_before:
        told = "truncated" if seen.ended and not seen.terminated else "untold"
        return "begins anew" if steps < len(trouble.actions) else f"goes on, {told}"
    if "max_episode_steps" in trouble.make:
        assert not unsafe
        counted = seen.info["saturated_actions"]
        assert seen.ended
        return "goes on, counted" if counted == 1 else "goes on, untold"
    if seen.ended:
        assert seen.terminated
        return f"ends, {bits(seen.info['numerics'])}"
    happened = int(made.core.memory.read(("numerics",))[0, 0])
    if happened:
        return f"goes on, {bits(happened)}" if seen.info.get("numerics") == happened else "goes on, untold"
    if not trouble.harmless:
        return "goes on, untold"
    beyond = made.reset_info.get("beyond_limit", 0.0) if trouble.options else 0.0
    return "goes on, `beyond_limit`" if beyond > 0.0 else "goes on"


ROWS = tables()
CASES = [
    (what, name) for what, cells in ROWS.items() for name, cell in zip(FACES, cells, strict=True) if cell
]


def test_the_page_and_these_tests_have_the_same_rows():
    assert list(ROWS) == list(TROUBLES)
    assert len(CASES) == 4 * len(ROWS) - 3


@pytest.mark.parametrize(("what", "name"), CASES, ids=[f"{name}, {what}" for what, name in CASES])
def test_a_face_does_what_its_row_says(what, name):
    face, task = FACES[name]
    for trouble in TROUBLES[what]:
        for arm in trouble.arms:
            found = outcome(face, f"redundant_envs/{arm}{task}-v0", trouble)
            assert found == ROWS[what][list(FACES).index(name)], (arm, trouble)


def of_goals(what, column):
    """Response of a goal environment of a vector or SB3: the same, but beyond the speed bound it
    continues."""
    single, vector, goal, sb3 = ROWS[what]
    if single.startswith("ends") and goal.startswith("goes on"):
        return goal
    if goal == "`ValueError`" and single == "goes on":
        return goal
    return vector if column == "vector" else sb3


@pytest.mark.parametrize("column", ["vector", "SB3"])
def test_goal_environments_of_a_vector_and_of_sb3_do_the_same(column):
    face = FACES[column][0]
    for what, troubles in TROUBLES.items():
        if not ROWS[what][list(FACES).index(column)]:
            continue
        for trouble in troubles:
            for arm in trouble.arms:
                found = outcome(face, f"redundant_envs/{arm}GoalReach-v0", trouble)
                assert found == of_goals(what, column), (what, arm, trouble)


LIVING = [
    what
    for what, cells in ROWS.items()
    if cells[1].startswith(("ends", "goes on")) and not TROUBLES[what][0].make.get("max_episode_steps")
]


@pytest.mark.parametrize("name", ["vector", "SB3"])
@pytest.mark.parametrize("what", LIVING)
def test_a_neighbour_of_trouble_goes_on_with_the_same_bits(what, name):
    face, task = FACES[name]
    for trouble in TROUBLES[what]:
        for arm in trouble.arms:
            shown = []
            for options, actions in ((trouble.options, trouble.actions), ({}, [ZERO] * len(trouble.actions))):
                made = face(f"redundant_envs/{arm}{task}-v0", **trouble.make)
                made.start()
                if trouble.options:
                    made.reset(options)
                for action in actions:
                    made.step(action)
                shown.append(made.neighbour())
            for one, other in zip(*shown, strict=True):
                np.testing.assert_array_equal(one, other)


def test_the_table_of_numbers_has_every_fault():
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", PAGE, re.M)
    assert {name: int(bit) for bit, name in rows} == {fault.name: fault.value for fault in rde.Numerics}
    for fault in rde.Numerics:
        assert any(re.search(rf"\b{int(fault)}\b", cell) for cells in ROWS.values() for cell in cells)


def test_same_step_tells_the_fault_in_the_final_info():
    env = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=2, autoreset_mode="same_step")
    env.reset(seed=0)
    *_, infos = env.step(np.stack([NAN, ZERO]))
    assert infos["final_info"]["numerics"][0] == rde.Numerics.BAD_ACTION
    assert infos["_final_info"].tolist() == [True, False]
    assert infos["numerics"].tolist() == [0, 0]


def test_a_picture_can_be_drawn_of_the_end_and_a_reset_begins_anew():
    env = gym.make("redundant_envs/RPRPReach-v0", on_bad_action="terminate", render_mode="rgb_array")
    env.reset(seed=0)
    assert env.step(NAN)[2]
    assert env.render().shape[2] == 3
    ended = env.unwrapped.get_state()
    with pytest.raises(ResetNeeded, match="step was called after the end of the episode"):
        env.step(ZERO)
    env.reset()
    assert not env.step(ZERO)[2]
    env.unwrapped.set_state(ended)
    with pytest.raises(ResetNeeded, match="step was called after the end of the episode"):
        env.step(ZERO)


def test_nothing_is_untold():
    assert "untold" not in PAGE
