"""The programs for a GPU in all scenes: their PTX has no operation that machines may round differently, and
gives the bits of the CPU."""

import shutil

import pytest

from redundant_envs.compiler.backends import llvm, nvptx
from tests.conftest import FULL
from tests.gpu.compared import CASES, MODES, SCENES, compare
from tests.gpu.emulated import ByDriver, Emulated, driver

pytestmark = pytest.mark.long


def emulated(kind):
    return lambda id, count, kwargs: kind(id, count, "cpu", False, kwargs)


@pytest.mark.parametrize("case", CASES)
def test_scalar_programs_give_the_bits_of_the_cpu(case):
    compare(emulated(Emulated), case, MODES[[*CASES].index(case) % 2], 10_000, 200)


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc, which compiles PTX as C")
@pytest.mark.parametrize("case", SCENES)
def test_ptx_gives_the_bits_of_the_cpu(case, monkeypatch):
    monkeypatch.setattr(llvm, "EFFORT", FULL)  # as users get it
    with driver():
        compare(emulated(ByDriver), case, MODES[[*CASES].index(case) % 2 - 1], 1024, 100)


@pytest.mark.parametrize(
    ("operation", "allowed"),
    [
        ("fma.rn.f64 %rd1, %rd2, %rd3, %rd4;", True),
        ("add.f64 %rd1, %rd2, %rd3;", False),
        ("fma.rz.f64 %rd1, %rd2, %rd3, %rd4;", False),
        ("div.full.f32 %r1, %r2, %r3;", False),
        ("sqrt.approx.f64 %rd1, %rd2;", False),
        ("mul.rn.ftz.f32 %r1, %r2, %r3;", False),
        ("sin.approx.f32 %r1, %r2;", False),
        ("cvt.rn.f64.s64 %rd1, %rd2;", True),
        ("cvt.rni.f64.f64 %rd1, %rd2;", False),
        ("@!%p1 ld.global.f64 %rd1, [%rd2];", True),
        ("add.s64 %rd1, %rd2, %rd3;", True),
    ],
)
def test_operations_that_machines_may_round_differently_are_refused(operation, allowed):
    if allowed:
        nvptx.check(f"\t{operation}\n")
    else:
        with pytest.raises(RuntimeError, match=operation.split()[0]):
            nvptx.check(f"\t{operation}\n")
