"""Machine code for other processors gives the same bits, whatever their vectors and instructions."""

import platform
import sys

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.backends import cache, llvm
from redundant_envs.model.programs import batch_simulator
from redundant_envs.verify import recorded_bits
from redundant_envs.verify.recorded_bits import RECORDED

e = rde.effects
pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="the processors are those of x86"
)
ARM = rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5))
SCENES = {
    "4R rk8": rde.Scene(
        rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6)),
        (e.Gravity(), e.ViscousFriction(0.1)),
        "rk8",
    ),
    "RPRP rk4 with stops": rde.Scene(
        ARM, (e.Gravity(), e.PrismaticStop((-0.2, -0.2), (0.2, 0.2), 0.5)), "rk4"
    ),
    "RPRP 1e-6": rde.Scene(ARM, (e.Gravity(), e.LimitSpring("r1", -0.2, 0.2)), tolerance=1e-6),
}
PROCESSORS = {
    "AVX2": llvm.Processor("haswell", "+fma,+avx2"),
    "128 bits": llvm.Processor("x86-64-v2", "+avx,+fma"),
    "no fused multiply-add": llvm.Processor("x86-64-v2", ""),
}


def motion(scene, intervals=10):
    rng = np.random.default_rng(2)
    q = 0.3 * rng.random((16, 4)) - 0.15
    batch = rde.BatchSimulator(scene, 16)
    batch.set_state(q, rng.normal(size=(16, 4)))
    for _ in range(intervals):
        batch.advance(4.0 * rng.normal(size=(16, 4)))
    return np.concatenate([batch.q, batch.qd], axis=1)


@pytest.fixture
def made_for(monkeypatch, tmp_path):
    """Code is compiled again, for a processor."""

    def change(processor):
        monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
        monkeypatch.setattr(llvm, "processor", lambda: processor)
        monkeypatch.setattr(cache, "_kept", {})

    return change


@pytest.mark.parametrize("processor", ["AVX2", "128 bits"])
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_another_processors_code_gives_the_same_bits(scene, processor, made_for):
    here = motion(scene)
    if not llvm.processor().joins:
        pytest.skip("this machine cannot run code with fused multiply-adds")
    made_for(PROCESSORS[processor])
    np.testing.assert_array_equal(motion(scene), here)


@pytest.mark.long
@pytest.mark.parametrize("processor", ["AVX2", "128 bits"])
@pytest.mark.parametrize("name", RECORDED)
def test_the_recorded_bits_are_those_of_another_processors_code(name, processor, made_for):
    if not llvm.processor().joins:
        pytest.skip("this machine cannot run code with fused multiply-adds")
    made_for(PROCESSORS[processor])
    assert recorded_bits.found(name) == recorded_bits.recorded()[name]


@pytest.mark.skipif(
    sys.platform == "win32", reason="whether the C library rounds fma once is not known there"
)
@pytest.mark.parametrize(
    "name", ["4R rk8", "RPRP 1e-6", pytest.param("RPRP rk4 with stops", marks=pytest.mark.long)]
)
def test_without_fused_multiply_add_the_bits_are_the_same_and_one_warning_says_that_it_is_slow(
    name, made_for
):
    scene = SCENES[name]
    here = motion(scene)
    made_for(PROCESSORS["no fused multiply-add"])
    with pytest.warns(UserWarning, match=r"cannot multiply and add with one rounding.*same bits") as told:
        there = motion(scene)
    assert len(told) == 1
    np.testing.assert_array_equal(there, here)


def test_code_of_one_processor_is_not_another_ones(made_for):
    from redundant_envs.model.programs import batch_simulator

    keys = []
    for processor in PROCESSORS.values():
        made_for(processor)
        keys.append(batch_simulator(SCENES["4R rk8"], track_work=False).key)
    assert len(set(keys)) == len(keys)


def test_programs_are_made_for_another_processor_as_long_as_it_is_chosen():
    key = batch_simulator(SCENES["4R rk8"], False).key
    with llvm.target(llvm.AVX2):
        assert batch_simulator(SCENES["4R rk8"], False).key != key
        assert not llvm.processor().wide
        assert llvm.processor().joins
    assert batch_simulator(SCENES["4R rk8"], False).key == key
