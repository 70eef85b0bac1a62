"""Write docs/hard_cases.md and its pictures: ``python -m tests.hard_cases``, from the root of the repository.

``--pictures`` draws the pictures alone.
"""

import datetime
import importlib.util
import os
import sys

from . import TESTS

os.environ.setdefault("REDUNDANT_ENVS_CACHE", str(TESTS.parent / ".pytest_cache" / "kernels"))

from redundant_envs.machine import machine_name

from . import page
from .hard_case import cases_by_theme


def main() -> None:
    with_mujoco = importlib.util.find_spec("mujoco") is not None
    if not with_mujoco:
        print("mujoco is not installed: the page will have no figures of it", file=sys.stderr)
    if "--pictures" not in sys.argv[1:]:
        themes, results = cases_by_theme(), {}
        for case in (case for cases in themes.values() for case in cases if case.measure):
            print(case.name, flush=True)
            results[case.number] = page.measured_by(case, with_mujoco)
        today = datetime.date.today().isoformat()
        page.PAGE.write_text(page.text(themes, results, machine_name(), today), encoding="utf-8")
    page.draw_pictures(with_mujoco)


if __name__ == "__main__":
    main()
