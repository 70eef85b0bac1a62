"""Machine code for other processors gives the same bits, whatever their vectors and instructions."""

import itertools
import platform
import sys

import pytest

from redundant_envs.compiler.backends import cache, llvm
from redundant_envs.compiler.backends.processors import AVX2, Processor
from redundant_envs.model.programs import batch_simulator
from redundant_envs.verify import recorded_bits
from redundant_envs.verify.recorded_bits import SCENES
from tests.verify import aimed

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in ("x86_64", "amd64"), reason="the processors are those of x86"
)
PROCESSORS = {
    "AVX2": AVX2,
    "128 bits": Processor("x86-64-v2", "+avx,+fma"),
    "no fused multiply-add": Processor("x86-64-v2", ""),
}


def bits(name, tables):
    """A digest of the first tables of numbers of a recorded motion."""
    return recorded_bits.digest(itertools.islice(recorded_bits.motion(SCENES[name]), tables))


def key():
    return batch_simulator(SCENES["4R all rk8"], track_work=False).key()


@pytest.fixture
def made_for(monkeypatch, tmp_path):
    """Code is compiled again, for a processor."""

    def change(processor):
        if processor != "no fused multiply-add" and not llvm.processor().joins:
            pytest.skip("this machine cannot run code with fused multiply-adds")
        monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
        monkeypatch.setattr(llvm, "processor", lambda: PROCESSORS[processor])
        monkeypatch.setattr(cache, "_kept", {})

    return change


@pytest.mark.long
@pytest.mark.parametrize("processor", ["AVX2", "128 bits"])
@pytest.mark.parametrize("name", aimed.RECORDED)
def test_the_recorded_bits_are_those_of_another_processors_code(name, processor, made_for):
    made_for(processor)
    assert aimed.found(name) == aimed.recorded()[name]


@pytest.mark.quick("4R all rk8")
@pytest.mark.parametrize("name", aimed.RECORDED)
def test_the_recorded_bits_are_those_of_code_that_the_compiler_made_with_little_effort(name, monkeypatch):
    monkeypatch.setattr(llvm, "EFFORT", 0)
    assert aimed.found(name) == aimed.recorded()[name]


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="whether its C library rounds fma once is unknown")
@pytest.mark.parametrize("name", ["4R all rk8", "stops rk4, inelastic"])
def test_without_fused_multiply_add_the_bits_are_the_same_and_one_warning_says_that_it_is_slow(
    name, made_for
):
    here = bits(name, 6)
    made_for("no fused multiply-add")
    with pytest.warns(UserWarning, match=r"cannot multiply and add with one rounding.*same bits") as told:
        there = bits(name, 6)
    assert len(told) == 1
    assert there == here


def test_code_of_one_processor_or_effort_is_not_another_ones(monkeypatch):
    usual = key()
    keys = {usual}
    with monkeypatch.context() as patch:
        patch.setattr(llvm, "EFFORT", 0)
        keys.add(key())
    for processor in PROCESSORS.values():
        with llvm.target(processor):
            keys.add(key())
    assert key() == usual
    assert len(keys) == 2 + len(PROCESSORS)
