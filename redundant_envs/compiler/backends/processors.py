"""Targets of machine code."""

from typing import NamedTuple

import llvmlite.binding as llvm

from redundant_envs.compiler.tracing.flow import LANES


class Processor(NamedTuple):
    """The target of machine code: LLVM's names of a processor, of its features, and of its kind."""

    name: str
    features: str
    triple: str = llvm.get_default_triple()
    lanes: int = LANES
    """Lanes of a block in programs for it."""

    @property
    def wide(self) -> bool:
        """Whether it has 32 vector registers, for which our order of instructions is made."""
        return "+avx512f" in self.features.split(",") and self.lanes == LANES

    @property
    def is_wasm(self) -> bool:
        """Whether it is WebAssembly's machine, which no computer of this kind is."""
        return self.triple.startswith("wasm32")

    @property
    def is_gpu(self) -> bool:
        """Whether it is a GPU, for which programs are text."""
        return self.triple.startswith("nvptx")

    @property
    def joins(self) -> bool:
        """Whether it has an instruction that multiplies and adds with one rounding."""
        old = self.triple.startswith("x86_64") and "+fma" not in self.features.split(",")
        return not (old or self.is_wasm)


AVX2 = Processor("haswell", "+fma,+avx2")
"""The target for most laptops: vectors of four doubles."""
WASM = Processor(
    name="generic",
    features="+simd128,+bulk-memory,+mutable-globals,+nontrapping-fptoint,+sign-ext",
    triple="wasm32-unknown-unknown",
    lanes=2,
)
"""WebAssembly with vectors of two doubles, as in Chrome and Firefox since 2021, in Safari since 2023."""
NVIDIA = Processor("sm_70", "+ptx63", "nvptx64-nvidia-cuda", 1)
"""NVIDIA's GPUs since 2017: their drivers make machine code for later ones of the same text."""
