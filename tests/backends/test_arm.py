"""Machine code for ARM, run by an emulator, gives the bits that this machine gives.

It needs qemu-aarch64 and a cross compiler, for the program around the kernels (Debian: qemu-user,
gcc-aarch64-linux-gnu).
"""

import shutil
import subprocess
from collections import OrderedDict
from pathlib import Path

import llvmlite.binding
import numpy as np
import pytest

from redundant_envs.compiler.backends import cache, llvm
from redundant_envs.compiler.backends.processors import Processor
from redundant_envs.model import programs
from tests.verify import aimed

EMULATOR, COMPILER = "qemu-aarch64", "aarch64-linux-gnu-gcc"
CORTEX = Processor("cortex-a72", "", "aarch64-unknown-linux-gnu")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (shutil.which(EMULATOR) and shutil.which(COMPILER)),
        reason=f"{EMULATOR} or {COMPILER} is not installed",
    ),
]


class Emulator:
    """A process that runs the kernels of an object file."""

    def __init__(self, code, names, folder):
        (folder / "kernels.o").write_bytes(code)
        declared = "".join(f"void {n}(int64_t *); " for n in names)
        table = f"void (*const kernels[])(int64_t *) = {{{', '.join(names)}}};"
        (folder / "table.c").write_text(f"#include <stdint.h>\n{declared}\n{table}\n")
        around = Path(__file__).parent / "arm" / "run_kernels.c"
        files = [around, folder / "table.c", folder / "kernels.o"]
        subprocess.run([COMPILER, "-static", "-O1", *files, "-lm", "-o", folder / "run"], check=True)
        self.process = subprocess.Popen(
            [EMULATOR, folder / "run"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def run(self, number, arguments):
        """Call a kernel; it modifies the arrays."""
        to, back = self.process.stdin, self.process.stdout
        to.write(np.array([number, len(arguments)]).tobytes())
        arrays = {}  # address -> number of the argument, and the array
        for k, value in enumerate(arguments):
            if not isinstance(value, np.ndarray):
                to.write(np.array([-1, value]).tobytes())
            elif value.ctypes.data in arrays:
                to.write(np.array([-2, arrays[value.ctypes.data][0]]).tobytes())
            else:
                assert value.flags.c_contiguous
                to.write(np.int64(value.nbytes).tobytes() + value.tobytes())
                arrays[value.ctypes.data] = k, value
        to.flush()
        for _, array in arrays.values():
            array[...] = np.frombuffer(back.read(array.nbytes), array.dtype).reshape(array.shape)

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        assert self.process.wait(10) == 0


@pytest.fixture
def on_arm(monkeypatch, tmp_path):
    """From now on kernels are compiled for ARM and run by the emulator."""
    llvmlite.binding.initialize_all_targets()
    llvmlite.binding.initialize_all_asmprinters()
    running, calls = [], []

    def load(code, names):
        folder = tmp_path / str(len(running))
        folder.mkdir()
        running.append(Emulator(code, names, folder))
        return {name: (running[-1], number) for number, name in enumerate(names)}

    def call(self):
        emulator, number = self.entry
        calls.append(number)
        emulator.run(number, [self._alive[name] for name in self._places])

    def change():
        monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path / "cache"))
        monkeypatch.setattr(llvm, "processor", lambda: CORTEX)
        monkeypatch.setattr(llvm, "load", load)
        monkeypatch.setattr(cache, "_kept", {})
        monkeypatch.setattr(programs, "_kept", OrderedDict())
        monkeypatch.setattr(programs.Call, "__call__", call)

    yield change
    for emulator in running:
        emulator.close()
    assert calls


@pytest.mark.parametrize("name", aimed.RECORDED)
def test_the_recorded_bits_are_those_of_arm(name, on_arm):
    on_arm()
    assert aimed.found(name) == aimed.recorded()[name]
