"""Episodes of a policy under one physics: outcomes, numerics flags, evaluations, time; and comparisons."""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.envs.core import Core
from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.model.batch import Numerics
from redundant_envs.scenes.scene import Scene
from redundant_envs.support.timing import by_turns, timed
from redundant_envs_train.rollout import Act, EpisodeEnds, info_names, run_episodes
from redundant_envs_train.statistics import bootstrap, middle_95, sign_test, wilson

Array = NDArray[np.float64]
TIMING_REPEATS = 5
BOOTSTRAP_SEED = 0
FEW = 10  # with fewer seeds, or this few episodes, a bootstrap interval alone is not reliable
NO_AUTORESET = 0


class Evaluation(NamedTuple):
    """Episodes of a policy under one physics; arrays have one entry per episode, as in EpisodeEnds."""

    scene: Scene  # what was simulated
    start: Array  # coordinates, (n, 4)
    goal: Array  # (n, 2)
    hold: NDArray[np.bool_]  # at the end of a whole episode
    returns: Array
    steps: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    ended: NDArray[np.bool_]  # whether numerics ended the episode early
    flags: dict[str, int]  # numerics flag -> control steps that carry it
    ns_per_step: float  # of the compiled environment step of one lane, best of some


def evaluate_under(
    env_id: str, act: Act, episodes: int, seed: int, repeats: int = TIMING_REPEATS, **kwargs: Any
) -> Evaluation:
    """Run each episode once, all side by side, and time the compiled step on what they did."""
    actions: list[NDArray[np.float32]] = []
    begun: list[tuple[Array, Array]] = []

    def recorded(obs: Any, core: Core, step: int) -> NDArray[np.float32]:
        if step == 0:
            if not (core.goal_fields and "is_success" in info_names(core)):
                what = "the study compares success at goals"
                raise ValueError(f"{what}, which {env_id} does not tell; choose another id")
            begun.append((core.memory.read(core.scene.robot.coordinates), core.goals()))
        actions.append(act(obs, core, step))
        return actions[-1]

    outcome = run_episodes(env_id, recorded, episodes, seed, **kwargs)
    core, flags, spent = _replay(env_id, actions, outcome, seed, repeats, kwargs)
    return Evaluation(
        scene=core.scene, start=begun[0][0], goal=begun[0][1], hold=held(outcome),
        returns=outcome.returns, steps=outcome.steps, evaluations=outcome.evaluations, ended=outcome.ended,
        flags=flags, ns_per_step=1e9 * spent / (len(actions) * episodes),
    )  # fmt: skip


def _replay(
    env_id: str, actions: list[NDArray[np.float32]], outcome: EpisodeEnds, seed: int, repeats: int,
    kwargs: Mapping[str, Any],
) -> tuple[Core, dict[str, int], float]:  # fmt: skip
    """The same steps without policy and autoreset: numerics flags, seconds (best of ``repeats`` of each)."""
    env = make_sb3(env_id, len(outcome.steps), **kwargs)
    core, codes = env.core, np.zeros((len(actions), len(outcome.steps)), dtype=np.int64)

    def sample() -> list[float]:
        env.seed(seed)
        env.reset()
        spent = []
        for k, action in enumerate(actions):
            time, (_, out, *_) = timed(core.step, action, NO_AUTORESET)
            codes[k] = core.columns.of(out, "numerics")
            spent.append(time)
        return spent

    best = by_turns({"steps": sample}, repeats)["steps"].best
    codes[np.arange(len(actions))[:, None] >= outcome.steps] = 0  # steps after an episode's end
    counts = {str(flag.name): int(np.count_nonzero(codes & flag)) for flag in Numerics}
    return core, {name: n for name, n in counts.items() if n}, float(best.sum())


def held(outcome: EpisodeEnds) -> NDArray[np.bool_]:
    """Episodes that went on to their end and held the goal there."""
    assert outcome.hold is not None
    return outcome.hold & ~outcome.ended


def stepping(scene: Scene) -> str:
    """The stepping of a scene, in words."""
    if scene.tolerance is not None:
        return f"{scene.integrator} to {scene.tolerance:g} m"
    if scene.integrator == "dop853":
        return "dop853, steps of its own"
    return f"{scene.integrator} {1000 * scene.control_dt / scene.substeps:g} ms"


def figures(evaluation: Evaluation) -> dict[str, Any]:
    """Numbers that follow from one evaluation alone."""
    scene, n, held = evaluation.scene, len(evaluation.hold), int(evaluation.hold.sum())
    low, high = wilson(held, n)
    return {
        "stepping": stepping(scene), "episodes": n, "hold_success": held / n, "hold_low": low,
        "hold_high": high, "mean_return": float(evaluation.returns.mean()),
        "ended": int(evaluation.ended.sum()), "control_steps": int(evaluation.steps.sum()),
        "numerics": ", ".join(f"{name} {n}" for name, n in evaluation.flags.items()),
        "evaluations_per_step": float(evaluation.evaluations.sum() / evaluation.steps.sum()),
        "ns_per_step": evaluation.ns_per_step,
    }  # fmt: skip


def compare(
    here: Evaluation, reference: Evaluation, resamples: int, seed: int = BOOTSTRAP_SEED
) -> dict[str, Any]:
    """Differences from the reference, episode by episode, with 95 % intervals of their means."""
    if not (np.array_equal(here.start, reference.start) and np.array_equal(here.goal, reference.goal)):
        raise ValueError("episodes have other starts or goals than under the reference; they are no pairs")
    pairs = np.column_stack([here.hold.astype(float) - reference.hold, here.returns - reference.returns])
    low, high = middle_95(bootstrap(pairs, resamples, seed))
    hold, gain = pairs.mean(axis=0).tolist()
    lost, won = (int(np.count_nonzero(pairs[:, 0] == flip)) for flip in (-1.0, 1.0))
    return {
        "hold_difference": hold, "hold_difference_low": low[0], "hold_difference_high": high[0],
        "lost": lost, "won": won, "sign_test_p": sign_test(lost, won),
        "return_difference": gain, "return_difference_low": low[1], "return_difference_high": high[1],
        "median_abs_return_difference": float(np.median(np.abs(pairs[:, 1]))),
        "half_from": half_from(pairs[:, 1]),
    }  # fmt: skip


def half_from(differences: Array) -> int:
    """Smallest number of differences that make up half of the sum of their sizes; 0 if all are 0."""
    sizes = np.sort(np.abs(differences))[::-1]
    return int(np.searchsorted(np.cumsum(sizes), 0.5 * sizes.sum()) + 1) if sizes[0] else 0


def permutation_test(a: Array, b: Array) -> float:
    """Two-sided p of the difference of means of few samples: the share of splits that differ as much."""
    both = np.concatenate([a, b])
    sums = both[list(itertools.combinations(range(len(both)), len(a)))].sum(axis=1)
    differences = np.abs(sums / len(a) - (both.sum() - sums) / len(b))
    return float(np.mean(differences >= differences[0] * (1.0 - 1e-9)))  # the first split is theirs


def compare_groups(a: Array, b: Array, resamples: int) -> dict[str, Any]:
    """Difference of the means of two groups, a minus b, with a 95 % bootstrap interval, and below ``FEW``
    samples in each the p of an exact permutation test."""
    means = bootstrap(a, resamples, BOOTSTRAP_SEED) - bootstrap(b, resamples, BOOTSTRAP_SEED + 1)
    low, high = middle_95(means)
    p = permutation_test(a, b) if max(len(a), len(b)) < FEW else ""
    return {"difference": float(np.mean(a) - np.mean(b)), "low": low, "high": high, "permutation_p": p}
