"""The programs for a GPU in all scenes: their PTX has no operation that machines may round differently, and
gives the bits of the CPU."""

import shutil
import struct
import subprocess

import pytest

from redundant_envs.compiler.backends import llvm, nvptx
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.scenes.scene import scene_at
from redundant_envs.simulator.batch.threads import programs
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.simulator.lane.fields import PARAMETER
from redundant_envs.tasks import make_task
from tests.conftest import FULL
from tests.gpu.compared import CASES, MODES, SCENES, compare
from tests.gpu.emulated import ByDriver, Emulated, driver

pytestmark = pytest.mark.long


def emulated(kind):
    return lambda id, count, kwargs: kind(id, count, "cpu", False, kwargs)


@pytest.mark.parametrize("case", CASES)
def test_scalar_programs_give_the_bits_of_the_cpu(case):
    count = 10_000 if case in SCENES else 1_000
    compare(emulated(Emulated), case, MODES[[*CASES].index(case) % 2], count, 200)


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc, which compiles PTX as C")
@pytest.mark.parametrize("case", SCENES)
def test_ptx_gives_the_bits_of_the_cpu(case, monkeypatch):
    monkeypatch.setattr(llvm, "EFFORT", FULL)  # as users get it
    with driver():
        compare(emulated(ByDriver), case, MODES[[*CASES].index(case) % 2 - 1], 1024, 100)


@pytest.mark.skipif(not shutil.which("ptxas"), reason="needs ptxas, NVIDIA's assembler")
@pytest.mark.parametrize("scene", ["four_r_reach", "rprp_reach", "cheap_sensors", "everything"])
def test_an_assembler_joins_no_product_with_its_sum(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(llvm, "EFFORT", FULL)
    episode = Episode(Dynamics(scene_at(scene, None)), make_task(None, "Reach"))
    kernels, layout = programs(episode, shares=True)
    (tmp_path / "k.ptx").write_text(nvptx.ptx(Program(kernels), layout.size(PARAMETER)))
    codes = []
    for joins in ("true", "false"):
        options = "-arch=sm_90", f"-fmad={joins}", "-o", tmp_path / joins, tmp_path / "k.ptx"
        subprocess.run(["ptxas", *options], check=True)
        codes.append({name: x for name, x in sections(tmp_path / joins).items() if name.startswith(".text.")})
    assert codes[0].keys() == {f".text.{kernel.name}" for kernel in kernels}
    assert codes[0] == codes[1]


def sections(path):
    """Contents of the sections of an ELF file of 64 bits by their names."""
    data = path.read_bytes()
    (start,), (count, of_names) = struct.unpack_from("<Q", data, 40), struct.unpack_from("<HH", data, 60)
    heads = [struct.unpack_from("<II4Q", data, start + 64 * k) for k in range(count)]
    contents = [data[offset : offset + size] for *_, offset, size in heads]
    names = [contents[of_names][head[0] :].partition(b"\0")[0].decode() for head in heads]
    return dict(zip(names, contents, strict=True))


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
