"""Which sliders are supported when another one strikes: those that are pressed onto their stops, however the
motion began, and whatever was known of it before.

``python tests/effects/test_support_at_stops.py SEED COUNT`` searches on, from other seeds.
"""

import sys

import numpy as np
import pytest
from supported_sliders import ARMS, ENTERS, SPAN, STANDS, UPPER, advanced, expected, scene, starts

import redundant_envs as rde
from tests.oracles.independent_stops import StoppedArm

HIDDEN = 1e-6
"""m/s; a slower impact may penetrate by less than four ulps of the travel, and is not found."""
METHODS = ({}, {"tolerance": None, "substeps": 4}, {"tolerance": None, "integrator": "dop853"})


def faults(seed, lanes=400):
    """Failures of random starts of an arm, a restitution and a method, and the number of judged starts."""
    rng = np.random.default_rng(seed)
    arm = list(ARMS.values())[seed % 3]
    restitution, method = (1.0, 0.5, 0.0, 0.8)[seed % 4], METHODS[seed // 3 % 3]
    made = scene(arm, restitution, **method)
    q, qd, efforts, sides, kinds = starts(arm, lanes, rng)
    after, status = advanced(made, q, qd, efforts)
    by_account, judged = expected(arm, q, qd, efforts, sides, restitution)
    judged &= status.numerics == 0
    # All sliders without velocity may be declared at rest, or some of them.
    standing = np.where((kinds == STANDS) & (rng.random(sides.shape) < rng.choice([0.5, 1.0])), sides, 0.0)
    remembered, _ = advanced(made, q, qd, efforts, standing)
    # A slider that is about to strike does so a little later, alone. If it sends two others onto their stops,
    # these strike at once only if they have not moved.
    before, rates = q.copy(), np.where(np.abs(qd) <= 1e-13, 0.0, qd)
    before[:, arm.sliders()] -= np.where(kinds == ENTERS, sides, 0.0) * 1e-15
    later, _ = advanced(made, before, rates, efforts)
    alone = judged & ((kinds == ENTERS).sum(axis=1) == 1) & ((sides.shape[1] < 3) | (status.events == 1))
    found = {
        "not as the account": judged & (np.abs(after - by_account).max(axis=(1, 2)) > 1e-8),
        "by what was known": judged & (np.abs(after - remembered).max(axis=(1, 2)) > 1e-11),
        "not as a little later": alone & (np.abs(after - later).max(axis=(1, 2)) > HIDDEN),
    }
    return {what: np.flatnonzero(bad).tolist() for what, bad in found.items() if bad.any()}, judged.sum()


MORE = [pytest.param(seed, marks=pytest.mark.long) for seed in range(12, 36)]


@pytest.mark.parametrize("seed", [*range(12), 3032, *MORE])
def test_sliders_pressed_onto_their_stops_are_supported_when_others_strike(seed):
    found, judged = faults(seed)
    assert judged > 100
    assert not found


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_the_account_of_the_study_of_impacts_supports_them_too(restitution):
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    arm = ARMS["RPRP"]
    q, qd, efforts, _, kinds = (x[:12] for x in starts(arm, 100, np.random.default_rng(3)))
    assert ((kinds == STANDS) & (kinds == ENTERS)[:, ::-1]).any(axis=1).sum() >= 3
    account = StoppedArm(arm.masses, arm.lengths, 9.81, 0.0, UPPER, restitution)
    ends = [account.after(*start, SPAN) for start in zip(q, qd, efforts, strict=True)]
    after, _ = advanced(scene(arm, restitution), q, qd, efforts)
    assert np.abs(after - np.reshape(ends, after.shape)).max() < 1e-8


HANGING = ([-1.2, UPPER, -0.4, 0.2], [0.0, 0.0, 0.0, 1.0])
"""r1 hangs onto its upper stop, and r2 moves out."""


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_is_supported_when_a_stop_is_moved_to_another_that_moves_into_it(restitution):
    """Stops that were moved hold no slider: the rest of r1 is forgotten, but it is pressed onto its stop."""
    made, ends = scene(ARMS["RPRP"], restitution, control_dt=0.01), []
    for gap in (0.0, 1e-15):
        batch = rde.BatchSimulator(made)
        batch.set_state(*HANGING)
        batch.advance()
        assert batch.q[0, 1] == UPPER
        batch.set_parameters({"prismatic_stop.upper": [UPPER, batch.q[0, 3] + gap]})
        batch.advance()
        assert batch.q[0, 1] == UPPER
        ends.append(np.concatenate([batch.q[0], batch.qd[0]]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_that_nothing_presses_or_pulls_is_supported_known_to_rest_or_not(restitution):
    """A straight arm without weight: r1 has no acceleration at all until r2 is struck."""
    stop = rde.effects.PrismaticStop((0.0, 0.0), (UPPER, UPPER), restitution)
    made = rde.Scene(ARMS["RPRP"], (stop,), tolerance=1e-9, control_dt=SPAN)
    # The impulse that sends r2 back drives r1 into its stop.
    q, qd = np.array([[0.3, 0.0, 0.3, 0.0]]), np.array([[0.0, 0.0, 0.0, -1.0]])
    starting = {
        "fresh": (q, None),
        "known": (q, [-1.0, 0.0]),
        "a little later": (q + 1e-15 * np.eye(4)[3], None),
    }
    for start, known in starting.values():
        after, _ = advanced(made, start, qd, np.zeros((1, 4)), known)
        assert np.abs(after[0, :, 1]).max() == 0.0
        assert after[0, 1, 3] == pytest.approx(restitution, abs=1e-12)


if __name__ == "__main__":
    first, count = (int(x) for x in (*sys.argv[1:], "0", "100")[:2])
    wrong = {seed: found for seed in range(first, first + count) if (found := faults(seed)[0])}
    print(f"{len(wrong)} of {count} seeds have starts that go wrong: {wrong}")
    sys.exit(bool(wrong))
