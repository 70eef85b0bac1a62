"""Tables, and run folders of shipped policies, made again from their files and the table of runs."""

import csv
import json
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"


def rows(table: Path) -> list[dict[str, str]]:
    """Rows of a file of CSV."""
    with table.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def published_run(name: str, folder: Path, table: str = "runs") -> Path:
    """Make the folder of a run of a table of docs/results whose policy is in policies/."""
    from redundant_envs_train.evidence.runs import read_runs
    from redundant_envs_train.run_folder import SELECTION

    (run,) = read_runs([RESULTS / f"{table}.jsonl" / name])
    others = ignore_patterns("README.md", "policy.npz", "policy.onnx")
    copytree(ROOT / "policies" / f"{run.env.split('/')[1]}-{run.settings['algo']}", folder, ignore=others)
    (folder / "evaluation.json").write_text(json.dumps(run.evaluation))
    facts = {key: run.evaluation[key] for key in ("env_steps", "train_seconds")}
    (folder / "training.json").write_text(json.dumps({**facts, "simulator": run.simulator, "stopped": False}))
    np.savetxt(folder / "selection.csv", run.curve, delimiter=",", comments="", header=",".join(SELECTION))
    return folder
