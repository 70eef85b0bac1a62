"""Scenes of the catalogue keep every promise of ``verify`` (equations, energy, bits, ...), also as copies."""

import pytest
from catalogue import COPIES, EACH_ID, SCENES, assert_same_bits, motion, names, on, started

from redundant_envs.verify import Mode, Subject, Verdict
from redundant_envs.verify.checks import Sample
from redundant_envs.verify.report import checks_in
from redundant_envs.verify.subjects import subject_of

STATES, SEED = 64, 11
CHECKS = [c for c in checks_in(Mode.STANDARD) if c.family != "environments"]
OF_ENVIRONMENTS = [c for c in checks_in(Mode.STANDARD) if c.family == "environments"]
LONG = names(
    "PPR every *", "RPPP every *", "PRPRP every *", "RRR every *", "RP every *",
    "RPRP every * rk8", "4R every * rk8", "4R disturbed rk8", "4R stiction rk8", "PRPRP stops *",
    "RPPP stops *",
    "stops euler", "stops rk4, *", "RP stops *", "stops 1e-6, *elastic",
    "stops rk8, half elastic", "stops on one side *", "RPRP users' [!a]* 1e-6", "RPRP users' all rk4",
    "4R users' all 1e-6", "4R users' [dlp]* 1e-6", "RPRP motors 1e-6",
)  # fmt: skip
"""Scenes that take long to compile or to judge: others hold each of their checks on each of their arms,
methods and effects."""


def missed(trial, checks):
    outcomes = [c.run(trial) for c in checks]
    return [(o.check, o.finding) for o in outcomes if o.verdict is Verdict.MISSED]


@pytest.mark.quick("RPRP users' play 1e-6")
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in SCENES]
)
def test_a_scene_keeps_every_promise(name):
    assert missed(Sample(Subject(name, SCENES[name]), STATES, SEED), CHECKS) == []


@pytest.mark.quick("redundant_envs/RPRPReach-v0")
@pytest.mark.parametrize("env_id", EACH_ID)
def test_an_environment_keeps_every_promise(env_id):
    assert missed(Sample(subject_of(env_id), STATES, SEED), OF_ENVIRONMENTS) == []


@pytest.mark.quick("copy-{}-4R free 1e-12")
@on("4R free 1e-12", "RPRP every effect 1e-6", "RPRP users' all 1e-6", "stops dop853")
@pytest.mark.parametrize("kwargs", [{}, {"threads": 2}, {"track_work": True}], ids=str)
@pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)
def test_a_copy_in_the_middle_of_a_motion_continues_to_the_same_bits(scene, copied, kwargs):
    batch = started(scene, varied=True, **kwargs)
    here, twin = batch.q, copied(batch)
    assert (twin.threads, twin.num_envs, twin.scene) == (batch.threads, batch.num_envs, scene)
    expected = motion(batch)
    assert_same_bits([twin.q], [here])  # the motion of the original has not moved it
    assert_same_bits(motion(twin), expected)
    assert (batch.q != here).any()
    if batch.track_work:
        assert_same_bits([twin.work], [batch.work])
        assert twin.events() == batch.events()


@pytest.mark.quick("4R every effect rk8")
@on("4R every effect *", "RPRP every effect 1e-6", "RPRP users' all 1e-6")
def test_the_work_that_is_tracked_changes_no_bit_of_a_motion(scene):
    assert_same_bits(motion(started(scene, track_work=True)), motion(started(scene)))
