"""Does a GPU give the bits of the CPU, and how fast is it? python -m tests.gpu.check, or make gpu-check."""

import platform
import sys
import time
from datetime import date
from pathlib import Path

import torch

import redundant_envs as rde
from redundant_envs.compiler.backends.cuda import CudaError
from redundant_envs.scenes.scene import scene_at
from tests.gpu.compared import CASES, MODES, compare

FILE = Path("runs/gpu.txt")
COUNT, STEPS = 2048, 120
SIZES = (10_000, 100_000, 1_000_000)
WARM, TIMED = 10, 30
"""Steps before a measurement, when lanes are at different times of their episodes, and in it."""
FIXED = {"tolerance": None}
SPEEDS = {
    "4R, one step of rk8": (
        "redundant_envs/FourRReach-v0",
        {**scene_at("four_r_reach", None).to_dict(), **FIXED},
    ),
    "4R, standard": ("redundant_envs/FourRReach-v0", "four_r_reach"),
    "RPRP, one step of rk8": (
        "redundant_envs/RPRPReach-v0",
        {**scene_at("rprp_reach", None).to_dict(), **FIXED},
    ),
    "RPRP, standard": ("redundant_envs/RPRPReach-v0", "rprp_reach"),
}


def compared(say) -> int:
    """Compare all cases; how many differ?"""
    different = 0
    for number, case in enumerate(CASES):
        start = time.perf_counter()
        try:
            compare(
                lambda id, n, kwargs: rde.make_torch(id, n, "cuda", **kwargs),
                case,
                MODES[number % 2],
                COUNT,
                STEPS,
            )
            told = "same bits"
        except (AssertionError, CudaError) as error:
            different += 1
            told = f"DIFFERENT: {' '.join(str(error).split())[:500]}"
        say(f"{case}, {MODES[number % 2]}: {told} ({time.perf_counter() - start:.0f} s)")
    return different


def speed(id: str, scene, count: int) -> float:
    """Environment steps a second, as one CUDA graph of two steps has them."""
    env = rde.make_torch(id, count, "cuda", scene=scene, info_keys=[])
    env.reset(seed=0)
    actions = torch.rand(env.action_space.shape, device="cuda") * 2.0 - 1.0
    aside = torch.cuda.Stream()
    with torch.cuda.stream(aside):
        for _ in range(WARM):
            env.step(actions)
    torch.cuda.synchronize()
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        env.step(actions)
        env.step(actions)
    begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
    begin.record()
    for _ in range(TIMED):
        graph.replay()
    end.record()
    end.synchronize()
    return 2 * TIMED * count / (begin.elapsed_time(end) / 1000)


def main() -> int:
    if not torch.cuda.is_available():
        print(f"torch {torch.__version__} finds no GPU: nothing can be checked on this machine")
        return 2
    FILE.parent.mkdir(exist_ok=True)
    with FILE.open("w", encoding="utf-8") as file:

        def say(line: str) -> None:
            print(line, flush=True)
            file.write(f"{line}\n")

        gpu = torch.cuda.get_device_properties(0)
        say(f"{gpu.name}, {gpu.total_memory / 1e9:.0f} GB, {date.today()}, torch {torch.__version__}, CUDA "
            f"{torch.version.cuda}, redundant-envs {rde.__version__}, {platform.platform()}")  # fmt: skip
        different = compared(say)
        say(f"{different} of {len(CASES)} cases differ")
        for name, (id, scene) in SPEEDS.items():
            for count in SIZES:
                say(f"{name}, {count} environments: {speed(id, scene, count):.3g} steps/s")
    print(f"written to {FILE}: please send it in an issue")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
