"""The order of the site: its tables of contents."""

from __future__ import annotations

from pathlib import Path

SECTIONS = {
    "Start": ["Install, and ten lines that run <install>"],
    "Tutorials": [
        "notebooks/equations_to_environment", "notebooks/accuracy_and_chaos", "notebooks/redundancy",
        "notebooks/learn_and_race", "tutorials/third_arm", "tutorials/moving_target", "tutorials/obstacle",
    ],
    "How to": [
        "scenes", "example_scenes", "action_modes", "extending", "other_libraries", "gpu", "learners",
        "policies", "handed_to_me", "datasets", "gradients", "models", "control", "browser", "other_programs",
        "trouble",
    ],
    "Reference": [
        "environments/index", "tasks/*", "effects/README", "reference/integrators", "scenes/index",
        "reference/api", "reference/report", "command_line", "configuration", "how_it_works", "design",
        "errata", "changelog", "contributing",
    ],
    "Results": [
        "accuracy", "results/accuracy/accuracy", "speed", "redundancy", "results/tried", "strength",
        "results/README", "results/policy/report", "hard_cases", "energy", "fuzzing", "mutation", "gallery",
    ],
}  # fmt: skip
"""Sections of the site, and their pages in order."""
BELOW = {"environments/index": "environments/*", "effects/README": "effects/*", "scenes/index": "scenes/*"}
"""Pages with further ones below them."""


INDEX = {
    "learners": "hyperparameters, Optuna", "control": "null space, iLQR, computed torque",
    "gpu": "GPU, CUDA, JAX, DLPack, PyTorch tensors",
    "accuracy": "tolerance, round-off, convergence", "gradients": "autodiff, differentiable simulation",
    "energy": "energy balance, energy drift", "scenes": "domain randomization",
    "trouble": "error messages, compile cache, slow import, render_mode, speed bound",
    "models": "SymPy, Lagrangian",
    "browser": "WebAssembly", "tutorials/moving_target": "moving target",
    "action_modes": "decide_every, frame skip, singular pose",
    "reference/report": "mass matrix, Lagrange's equations", "install": "pip install, requirements",
    "effects/command_delay": "latency", "effects/keep_out": "obstacle avoidance",
    "effects/tip_force": "wind, disturbance", "effects/joint_stop": "joint limits",
    "effects/limit_spring": "soft limits",
    "extending": "plugins, custom effect, custom task", "policies": "pretrained policies, model zoo",
    "redundancy": "benefit of redundancy", "speed": "benchmark, throughput",
}  # fmt: skip
"""Entries of the index and of the search: words that a page does not use, or several pages do."""


def written(site: Path) -> None:
    """Add the tables of contents to the first page, and to those with others below them."""
    tables = [_table(_found(site, pages), caption) for caption, pages in SECTIONS.items()]
    index = site / "index.md"
    index.write_text("\n".join([index.read_text(encoding="utf-8"), *tables]), encoding="utf-8")
    for name, entries in INDEX.items():
        page = site / f"{name}.md"
        main = ", ".join(f"! {entry}" for entry in entries.split(", "))  # which the search shows first
        page.write_text(f"```{{index}} {main}\n```\n\n" + page.read_text(encoding="utf-8"), encoding="utf-8")
    for name, pattern in BELOW.items():
        file = site / f"{name}.md"
        own = name.rpartition("/")[2]
        pages = [page.rpartition("/")[2] for page in _found(site, [pattern])]
        table = _table([page for page in pages if page != own])
        file.write_text(f"{file.read_text(encoding='utf-8')}\n{table}", encoding="utf-8")


def _found(site: Path, pages: list[str]) -> list[str]:
    """Names of pages, patterns replaced by the pages that they fit."""
    found = []
    for page in pages:
        if "*" in page:
            found += [p.relative_to(site).with_suffix("").as_posix() for p in sorted(site.glob(f"{page}.md"))]
        else:
            found.append(page)
    return found


def _table(pages: list[str], caption: str = "") -> str:
    about = f":caption: {caption}\n" if caption else ""
    return "\n".join(["```{toctree}", f"{about}:hidden:", "", *pages, "```", ""])
