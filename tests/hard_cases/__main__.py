"""Write docs/hard_cases.md and its pictures: ``python tests/hard_cases``, from the root of the repository.

``--pictures`` draws the pictures alone.
"""

import datetime
import importlib.util
import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
DOCS = HERE.parents[1] / "docs"
sys.path.insert(0, str(HERE))
os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(HERE.parents[1] / ".pytest_cache" / "kernels"))

import page  # noqa: E402
from hard_case import cases_by_theme  # noqa: E402

from redundant_envs.machine import machine_name  # noqa: E402


def main() -> None:
    with_mujoco = importlib.util.find_spec("mujoco") is not None
    if not with_mujoco:
        print("mujoco is not installed: the page will have no figures of it", file=sys.stderr)
    if "--pictures" not in sys.argv[1:]:
        write_page(with_mujoco)
    page.draw_pictures(DOCS / "hard_cases", with_mujoco)


def write_page(with_mujoco: bool) -> None:
    themes, results = cases_by_theme(), {}
    for case in (case for cases in themes.values() for case in cases):
        print(case.name, flush=True)
        results[case.number] = page.measured_by(case, with_mujoco)
    today = datetime.date.today().isoformat()
    (DOCS / "hard_cases.md").write_text(page.text(themes, results, machine_name(), today), encoding="utf-8")


if __name__ == "__main__":
    main()
