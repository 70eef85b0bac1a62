"""Sliders that are pressed onto their stops are supported when another strikes, as another account says."""

import catalogue
import numpy as np
import pytest

import redundant_envs as rde

LOWER, UPPER, SPAN = 0.0, 0.3, 1e-3
"""Stops, m, and a control interval, s."""
ARMS = {
    "RPRP": rde.RPRP((1.2, 0.8, 1.0, 0.6), (0.5, 0.4)),
    "PRPRP": rde.Chain("PRPRP", (1.2, 0.8, 1.0, 0.6, 0.7), (0.5, 0.4)),
}
STANDS, ENTERS, LEAVES, AWAY = range(4)


def scene(arm, restitution, g=9.81, **kwargs):
    count = len(arm.sliders())
    stop = rde.effects.PrismaticStop((LOWER,) * count, (UPPER,) * count, restitution)
    return rde.Scene(arm, (rde.effects.Gravity(g), stop), **{"control_dt": SPAN, "tolerance": 1e-9, **kwargs})


def starts(arm, lanes, rng):
    """q, qd, efforts (lanes, joints), and how sliders move at their stops."""
    n, sliders = len(arm.joints), arm.sliders()
    q, qd = rng.uniform(-3.0, 3.0, (lanes, n)), rng.normal(0.0, 1.0, (lanes, n))
    kinds = rng.choice(4, (lanes, len(sliders)), p=(0.45, 0.35, 0.1, 0.1))
    kinds[:, 0] = np.where((kinds == STANDS).any(axis=1), kinds[:, 0], STANDS)
    sides = np.where(kinds == AWAY, 0.0, rng.choice([-1.0, 1.0], kinds.shape))
    speed = rng.uniform(0.2, 2.0, kinds.shape) * np.where(kinds == ENTERS, sides, -sides)
    q[:, sliders] = np.where(sides > 0.0, UPPER, np.where(sides < 0.0, LOWER, 0.5 * UPPER))
    qd[:, sliders] = np.where(kinds == STANDS, rng.choice([0.0, 0.0, 1e-14, -1e-14], kinds.shape), speed)
    return q, qd, rng.uniform(-10.0, 10.0, (lanes, n)), kinds


def advanced(made, q, qd, efforts, known=None):
    """q, qd (lanes, 2, joints) after an interval; ``known``: sides at which sliders are known to rest."""
    batch, _ = catalogue.advanced(made, q, qd, intervals=0)
    if known is not None:
        names = [n for n in batch._memory.layout.rows["state"] if n.startswith("active_stop_")]
        batch._memory.write(names, known)
    status = batch.advance(efforts)
    return np.stack([batch.q, batch.qd], axis=1), status


@pytest.mark.long
@pytest.mark.parametrize(
    ("types", "count", "restitution"), [("RPRP", 8, 0.0), ("RPRP", 8, 1.0), ("PRPRP", 12, 0.5)]
)
def test_another_account_supports_them_too(types, count, restitution):
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    arm = ARMS[types]
    q, qd, efforts, kinds = (x[:count] for x in starts(arm, 100, np.random.default_rng(3)))
    assert ((kinds == STANDS).any(axis=1) & (kinds == ENTERS).any(axis=1)).sum() >= 3
    made = scene(arm, restitution)
    after, _ = advanced(made, q, qd, efforts)
    ends = catalogue.by_another_account(made, q, qd, efforts)
    assert np.abs(after - ends).max() < 1e-8


@pytest.mark.quick("0.0")
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_is_supported_when_a_stop_is_moved_to_another_that_moves_into_it(restitution):
    """Stops that were moved hold no slider: the rest of r1 is forgotten, but it is pressed onto its stop."""
    made, ends = scene(ARMS["RPRP"], restitution, control_dt=0.01), []
    for gap in (0.0, 1e-15):
        batch = rde.BatchSimulator(made)
        batch.set_state([-1.2, UPPER, -0.4, 0.2], [0.0, 0.0, 0.0, 1.0])  # r1 hangs, and r2 moves out
        batch.advance()
        assert batch.q[0, 1] == UPPER
        batch.set_parameters({"prismatic_stop.upper": [UPPER, batch.q[0, 3] + gap]})
        batch.advance()
        assert batch.q[0, 1] == UPPER
        ends.append(np.concatenate([batch.q[0], batch.qd[0]]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


@pytest.mark.quick("0.0")
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_slider_that_nothing_presses_or_pulls_is_supported_known_to_rest_or_not(restitution):
    """A straight arm without weight: r1 has no acceleration at all until r2 is struck."""
    made = scene(ARMS["RPRP"], restitution, g=0.0)
    # The impulse that sends r2 back drives r1 into its stop.
    q, qd = np.array([[0.3, 0.0, 0.3, 0.0]]), np.array([[0.0, 0.0, 0.0, -1.0]])
    later = q + 1e-15 * np.eye(4)[3]
    for start, known in ((q, None), (q, [-1.0, 0.0]), (later, None)):
        after, _ = advanced(made, start, qd, np.zeros((1, 4)), known)
        assert np.abs(after[0, :, 1]).max() == 0.0
        assert after[0, 1, 3] == pytest.approx(restitution, abs=1e-12)
