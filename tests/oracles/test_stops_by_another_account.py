"""Impacts and rests at stops agree with an account that finds them in another way.

``python -m tests.oracles.test_stops_by_another_account 10000`` compares as many intervals of the families of
``study impacts``, some 50 ms each.
"""

import sys

import numpy as np
import pytest

from redundant_envs.verify.accuracy import judge
from studies.another_account import Account
from studies.intervals import families, tips_after

pytestmark = pytest.mark.long

FAMILIES = families("impacts", 0)


def compared(family, count, seed):
    """Intervals of a family that the account crosses, and those of them that are missed without a flag."""
    drawn = family.draw(count, np.random.default_rng(seed))
    tips, status = tips_after(family, family.scene(), drawn)
    inverse, right = np.linalg.inv(family.robot.motor_map), np.full((count, 2), np.nan)
    numbers = {name: np.array([value]) for name, value in family.scene().parameters().items()}
    for i in np.flatnonzero(status.numerics == 0):
        q, qd, efforts = (x[[i]] for x in (drawn.joints @ inverse, drawn.rates @ inverse, drawn.efforts))
        right[i] = Account(family.scene(), numbers, efforts).after(q, qd, {}, 1e-12)
    judgement = judge(tips, [right], family.tolerance, np.isfinite(right).all(axis=1))
    return int(judgement.judged.sum()), int(judgement.missed.sum())


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_no_interval_with_stops_is_missed(family):
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    judged, missed = compared(family, 8, seed=FAMILIES.index(family))
    assert judged >= 7
    assert missed == 0


def main(count):
    each = -(-count // len(FAMILIES))
    found = np.array([compared(family, each, (0, number)) for number, family in enumerate(FAMILIES)])
    judged, missed = found.sum(axis=0)
    print(f"{judged} intervals compared, {missed} missed")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
