"""Build the site of the documentation: python docs/site/make.py --out build/site

Sphinx makes it of the pages of docs/, and of pages that are written from the code. It needs the extra docs,
and no network.
"""

import argparse
import shutil
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import contents
import notebooks
import reference
import sources
from sphinx.cmd.build import build_main

from redundant_envs.web import page

HERE = Path(__file__).parent


def assembled(folder: Path, cache: Path) -> Path:
    """Write the sources of the site to a folder that is made anew; executed notebooks are kept in a cache."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    hard_cases = [sys.executable, "-m", "tests.hard_cases", "--out", str(folder.resolve())]
    with (
        subprocess.Popen(hard_cases, cwd=sources.ROOT, stdout=subprocess.DEVNULL) as cases,
        ProcessPoolExecutor(2) as pool,
    ):
        arms = pool.submit(page.write, folder / "_extra" / "page")
        sources.copied(folder)
        reference.written(folder, pool)
        notebooks.written(folder, cache, pool)
        arms.result()
        if cases.wait():
            raise RuntimeError("the page of hard cases was not written")
        contents.written(folder)
    shutil.copytree(
        sources.DOCS / "figures", folder / "_extra" / "figures", ignore=shutil.ignore_patterns("*.py")
    )
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/site"), help="default: %(default)s")
    out, start = parser.parse_args().out, time.perf_counter()
    source = assembled(out / "sources", out / "notebooks")
    shutil.rmtree(out / "html", ignore_errors=True)  # it may have pages that are gone
    print(f"sources: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    words = ["-b", "html", "-c", str(HERE), "-W", "--keep-going", "--fresh-env", "-q", "-j", "auto"]
    words += ["-D", f"html_extra_path={(source / '_extra').resolve()}"]
    status = build_main([*words, str(source), str(out / "html")])
    print(f"{out / 'html' / 'index.html'}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
