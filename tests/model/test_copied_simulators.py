"""Copies of simulators are independent; their bits are compared in ``test_properties.py``."""

import os
import pickle
import subprocess
import sys

import cloudpickle
import pytest
from catalogue import COPIES, SCENES, assert_same_bits

import redundant_envs as rde

STOPS = SCENES["stops 1e-6, inelastic"]


NOTEBOOK = """
import dataclasses, sys
import cloudpickle
import redundant_envs as rde
from redundant_envs.language.algebra import physics
from redundant_envs.effects.hooks import Effect, Force

@physics
def damping(rate, level):
    return -level * rate

@dataclasses.dataclass(frozen=True)
class Damping(Effect):
    level: float = 0.5
    def hooks(self, arm):
        return (Force(1, damping, bind={"rate": arm.rates[1], "level": ".level"}),)

scene = rde.Scene(rde.FourR((1,) * 4, (0.5,) * 4), (Damping(),))
batch = rde.BatchSimulator(scene, 3)
batch.set_state((0.1, 0.2, 0.3, 0.4), (1, 2, 3, 4))
batch.advance()
data = cloudpickle.dumps(batch)
batch.advance()
print(data.hex(), *(float(x).hex() for x in batch.q.ravel()))
"""


@pytest.mark.long
def test_a_simulator_with_an_effect_of_a_users_program_is_taken_elsewhere_by_cloudpickle(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(NOTEBOOK)
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, program], env=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    data, *numbers = done.stdout.split()
    program.unlink()  # nothing is read from its source again
    batch = cloudpickle.loads(bytes.fromhex(data))
    batch.advance()
    assert [float(x).hex() for x in batch.q.ravel()] == numbers


def test_a_pickle_is_not_much_larger_than_the_numbers():
    small, large = (rde.BatchSimulator(SCENES["4R all rk8"], n) for n in (8, 80_008))
    of_a_lane = (len(pickle.dumps(large)) - len(pickle.dumps(small))) / 80_000
    assert of_a_lane < 1.01 * 8 * (8 + 1)  # eight states and its number; the parameters are shared


@pytest.mark.parametrize("way", COPIES.values(), ids=COPIES)
def test_what_simulate_returns_is_copied(way):
    made = rde.simulate(STOPS, (0.1, 0.15, 0.2, 0.1), (1.0, 1.0, 0.0, -1.0), [0.1, 0.5])
    twin = way(made)
    assert made.events
    assert (twin.events, twin.scene, twin._repr_html_()) == (made.events, made.scene, made._repr_html_())
    assert_same_bits([twin.q, twin.tip, twin.work], [made.q, made.tip, made.work])
    assert way(rde.Numerics(5)) == rde.Numerics(5)
