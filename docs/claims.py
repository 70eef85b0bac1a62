"""Measure again what the README and the manual state: make claims, or python docs/claims.py [GROUP ...]

A claim of claims.yaml is a sentence of a page whose numbers, ``{}``, are measured here; a group of claims is
a function that measures. A row of the output has the number stated, the number found, and whether it is off
by more than the claim's tolerance. Times are those of one core of the machine that the pages name, or what a
user waits.
"""

import contextlib
import gzip
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
NUMBER = r"([\d.]+(?:e-?\d+)?)"
Found = dict[str, float]
LANES, TURNS = 4096, 8
STARTED = """
import time
start = time.process_time()
import gymnasium as gym
imported = time.process_time()
import redundant_envs
{make}
print(imported - start, time.process_time() - start)
"""
MAKE = "env = gym.make('redundant_envs/RPRPReach-v0'); env.reset(seed=0); env.step(env.action_space.sample())"


def claims() -> dict[str, list[dict[str, Any]]]:
    """The claims of each group: page, sentence, names of its numbers, tolerance."""
    found: dict[str, list[dict[str, Any]]] = yaml.safe_load((ROOT / "docs" / "claims.yaml").read_text())
    for card in sorted((ROOT / "policies").glob("*/README.md")):
        page, said = card.relative_to(ROOT).as_posix(), "name: hold success [%] value: {}"
        found["policies"].append({"page": page, "says": said, "is": card.parent.name, "plus": 0.3})
    return found


def page_of(name: str, tables: bool = True) -> str:
    """The text of a page, with a space for each line break; without its tables, if asked for."""
    path = ROOT / name if name.endswith("README.md") and "effects" not in name else ROOT / "docs" / name
    lines = path.read_text(encoding="utf-8").splitlines()
    return re.sub(r"\s+", " ", " ".join(line for line in lines if tables or not line.startswith("|")))


def stated(claim: dict[str, Any]) -> list[float]:
    """The numbers of a claim, whose sentence must be on its page once."""
    pattern = re.escape(claim["says"]).replace(r"\{\}", NUMBER)
    found = re.findall(pattern, page_of(claim["page"]))
    if len(found) != 1:
        raise ValueError(f"{claim['page']} has {len(found)} times the sentence {claim['says']!r}")
    if "stated" in claim:
        return [float(claim["stated"])]
    return [float(number) for number in ([found[0]] if isinstance(found[0], str) else found[0])]


# ---- measurements ----------------------------------------------------------------------------------


def installing() -> Found:
    """Size and time of each kind of installation, in an environment of its own."""
    found: Found = {}
    with tempfile.TemporaryDirectory() as place:
        subprocess.run([sys.executable, "-m", "venv", place], check=True)
        pip = [f"{place}/bin/python", "-m", "pip", "install", "--quiet", "-c", "constraints.txt"]
        torch = [*pip, "torch==2.13.0", "--index-url", "https://download.pytorch.org/whl/cpu"]
        whole = 0.0
        for name, words in (("core", "."), ("train", ".[train]"), ("dev", ".[train,plot,verify,dev]")):
            start = time.perf_counter()
            if name == "train":
                subprocess.run(torch, cwd=ROOT, check=False)  # where its index cannot be reached, any torch
            subprocess.run([*pip, words], cwd=ROOT, check=True)
            whole += time.perf_counter() - start
            size = sum(p.lstat().st_size for p in Path(place).rglob("*") if p.is_file())
            found |= {f"{name} seconds": whole, f"{name} GB": size / 1e9}
    return found


def starting() -> Found:
    """From a new process to a first step: with kernels on disk, and without any."""

    def run(make: str, **environment: str) -> tuple[float, float]:
        command = [sys.executable, "-c", STARTED.format(make=make)]
        environment |= {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | environment
        out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
        imported, whole = map(float, out.split())
        return imported, whole

    run(MAKE)
    found = {"first step s": min(run(MAKE)[1] for _ in range(5))}
    alone = [run("") for _ in range(5)]
    found["import over gymnasium"] = min(w for _, w in alone) / min(i for i, _ in alone)
    with tempfile.TemporaryDirectory() as cache:
        found["compile s"] = run(MAKE, REDUNDANT_ENVS_CACHE=cache)[1] - found["first step s"]
    return found


def throughput() -> Found:
    """The core's steps."""
    from redundant_envs.scenes import config_folder
    from studies import throughput as study

    found: Found = {}
    for row in study.run(study.load_study(config_folder("studies") / "throughput.yaml")):
        name = f"{row['arm']} {row['integrator']}{' ' * bool(row['tolerance'])}{row['tolerance']}"
        found[f"{name} ns"] = row["ns_per_step_best"]
        found["least avx2"] = min(found.get("least avx2", np.inf), row["avx2_over_avx512"] or np.nan)
        found["most avx2"] = max(found.get("most avx2", 0.0), row["avx2_over_avx512"] or np.nan)
        found["GFLOP/s"] = max(found.get("GFLOP/s", 0.0), row["dgemm_gflops"])
    for arm in ("FourR", "RPRP"):
        found[f"{arm} rk8 over rk4"] = found[f"{arm} rk8 ns"] / found[f"{arm} rk4 ns"]
    return found


def environments() -> Found:
    """Vectors of environments, and single ones beside CartPole."""
    from studies import environments as study

    found: Found = {}
    for row in study.run(LANES, TURNS):
        name = row["env"].rpartition("/")[2].removesuffix("-v0")
        found |= {f"{name} {column}": row[column] for column in study.COLUMNS[study.COLUMNS.index("lanes") :]}
        for column in study.COLUMNS:
            if column.startswith("vector_"):
                found[f"{name} {column}"] /= 1e6
    return found


def effects() -> Found:
    """Costs of all effects and scenes, times bare, and their evaluations; and what is beyond its ceiling."""
    from redundant_envs.scenes import config_folder
    from studies import effects as study

    rows = study.run(study.load_study(config_folder("studies") / "effects.yaml"))
    print(study.verdict(rows))
    found: Found = {"beyond ceilings": sum(row["held"] is False for row in rows)}
    for row in rows:
        name = f"{row['of']} {row['at']}"
        found |= {name: row["times_bare"], f"{name} evaluations": row["evaluations"], f"{name} ns": row["ns"]}
    bare = found["bare FourR 1e-6 m evaluations"]
    for name in ("CoulombFriction", "JointStop"):
        found[f"{name} evaluations over bare"] = found[f"{name} 1e-6 m evaluations"] / bare
    found["SensorNoise ns"] = found["SensorNoise one rk8 step ns"] - found["bare FourR one rk8 step ns"]
    return found


def evaluations() -> Found:
    """What the program of docs/accuracy.md prints."""
    text = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    rprp, four_r = re.findall(r": ([\d.]+) evaluations per control step", out.getvalue())
    return {"RPRP": float(rprp), "4R": float(four_r)}


def energies() -> Found:
    """The report's motions: largest kinetic energy, J, and relative drift."""
    from redundant_envs import load_scene
    from redundant_envs.model import trajectory

    found: Found = {}
    for name in trajectory.STARTS:
        scene = load_scene(name)
        run = trajectory.energy_run(scene, 5.0, trajectory.default_start(name, scene), None)
        found |= {f"{name} J": float(run.kinetic_energy.max()), f"{name} drift": run.drift}
    return found


def policies() -> Found:
    """Hold success of every policy in policies/ on the evaluation goals, %."""
    from redundant_envs_train.report import evaluate

    found: Found = {}
    for card in sorted((ROOT / "policies").glob("*/README.md")):
        result = evaluate(card.parent).result
        found[card.parent.name] = 100.0 * result["hold_success"]
    return found


def training() -> Found:
    """The time of make train, s, and how the time of short trainings divides, %."""
    found: Found = {}
    short = {"rprp_reach_ppo": 700_000, "rprp_reach_sac": 200_000, "rprp_goal_reach_her": 200_000}
    with tempfile.TemporaryDirectory() as place:

        def train(name: str, *words: str) -> Path:
            folder = Path(place) / f"{name}{len(words)}"
            command = [sys.executable, "-m", "agents", "train", name, *words, "--out", str(folder)]
            subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
            return folder

        start = time.perf_counter()
        train("rprp_reach_sac", "total_steps=2000000")
        found["seconds"] = time.perf_counter() - start
        for name, steps in short.items():
            folder = train(name, f"total_steps={steps}", "seed=200", "checkpoint_seconds=0")
            for part, share in json.loads((folder / "training.json").read_text())["split"].items():
                found[f"{name} {part}"] = 100.0 * share
    return found


def datasets() -> Found:
    """The size of a dataset of 1000 episodes, MB."""
    from redundant_envs_train.shipping import dataset

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "expert-v0"
        dataset.write_dataset("expert", "FourRReach-v0", 1000, 0, folder)
        return {"MB": sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6}


def pages() -> Found:
    """Sizes of the page and of modules for a browser, kB, and the time that the page takes to write, s."""
    from redundant_envs import ReachTask, load_scene
    from redundant_envs.web import module, page

    with tempfile.TemporaryDirectory() as place:
        start = time.perf_counter()
        written, _ = page.write(Path(place))
        found = {"seconds": time.perf_counter() - start}
        found["kB"] = sum(path.stat().st_size for path in written) / 1e3
    for name in ("rprp_reach", "four_r_reach"):
        code = module.environment_module(load_scene(name), ReachTask()).code
        found |= {f"{name} kB": len(code) / 1e3, f"{name} packed kB": len(gzip.compress(code)) / 1e3}
    return found


def testing() -> Found:
    """The tests of make test, s."""
    start = time.perf_counter()
    words = ["--numprocesses", "auto", "--maxprocesses", "4", "--dist", "worksteal", "-m", "not long", "-q"]
    subprocess.run([sys.executable, "-m", "pytest", *words], cwd=ROOT, check=True)
    return {"seconds": time.perf_counter() - start}


GROUPS: dict[str, Callable[[], Found]] = {
    f.__name__: f
    for f in (
        evaluations, energies, policies, starting, throughput, environments, effects, pages, datasets,
        training, installing, testing,
    )
}  # fmt: skip


def compared(group: str, found: Found) -> list[tuple[str, str, str, str, str]]:
    """Rows of the output: page, name, number stated, number found, and "" or "off"."""
    rows = []
    for claim in claims()[group]:
        names = [claim["is"]] if isinstance(claim["is"], str) else claim["is"]
        for name, number in zip(names, stated(claim), strict=True):
            room = claim["plus"] if "plus" in claim else claim["within"] * number
            low = -np.inf if claim.get("at_most") else number - room
            off = "" if low <= found[name] <= number + room else "off"
            rows.append((claim["page"], f"{group}: {name}", f"{number:g}", f"{found[name]:.4g}", off))
    return rows


def main(words: list[str]) -> int:
    """Measure groups, or all; 1 if a number is off."""
    from redundant_envs.support.machine import machine_name
    from redundant_envs.support.tables import table

    for word in words:
        if word not in GROUPS:
            raise SystemExit(f"group is {word}; choose {', '.join(GROUPS)}")
    begun, rows = time.perf_counter(), list[tuple[str, ...]]()
    for name in words or GROUPS:
        start = time.perf_counter()
        print(f"{name} ...", file=sys.stderr)
        rows += compared(name, GROUPS[name]())
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    print(table(("page", "number", "stated", "found", ""), rows, "<"))
    off = sum(row[-1] == "off" for row in rows)
    print(f"{off} of {len(rows)} numbers are off; {time.perf_counter() - begun:.0f} s on {machine_name()}")
    return int(off > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
