"""Notebooks: executed from docs/notebooks, kept until their source or the package changes, and made pages.

python docs/site/notebooks.py SOURCE TARGET executes one, MyST Markdown to .ipynb, with one thread and in an
empty folder. It needs the extra docs, and no network.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from sources import ROOT

from redundant_envs.support import palette

PACKAGE = ("redundant_envs", "agents", "configs")
"""Folders on which the results of a notebook depend."""
LIBRARIES = ("gymnasium", "llvmlite", "matplotlib", "numpy", "stable-baselines3", "sympy", "torch")
LONGEST_CELL = 300  # s, after which a cell is given up
COMPILING = "redundant-envs: compiling"  # begins a line on standard error, where a kernel is not yet kept
DOWNLOAD = (
    '<a href="{name}.ipynb" download>Download this page as a notebook</a>, which `jupyter lab {name}.ipynb` '
    "opens after `pip install jupyterlab`."
)
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
COLOURS_OF_CURVES = palette.BLUE, palette.VERMILION, palette.GREEN, palette.PINK
FRONT_MATTER = re.compile(r"\A---\n.*?^---\n", re.S | re.M)
CODE_CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```$", re.S | re.M)
LINK = re.compile(r"\[([^]]+)\]\((?![a-z]+:)[^)]+\)")
KERNEL = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}


def written(site: Path, cache: Path, pool: Executor) -> None:
    """Write pages of executed notebooks to the site, in place of their sources, and files to download;
    processes of a pool execute them."""
    sources = sorted((site / "notebooks").glob("*.md"))
    downloads = site / "_extra" / "notebooks"
    downloads.mkdir(parents=True)
    for source, executed in zip(sources, pool.map(kept, sources, [cache] * len(sources)), strict=True):
        notebook = json.loads(executed.read_text(encoding="utf-8"))
        source.write_text(page(notebook, source), encoding="utf-8")
        for cell in notebook["cells"]:
            if cell["cell_type"] == "markdown":  # where it is read, other pages are not beside it
                cell["source"] = LINK.sub(r"\1", "".join(cell["source"]))
        (downloads / f"{source.stem}.ipynb").write_text(json.dumps(notebook, indent=1), encoding="utf-8")


def cells(text: str) -> list[tuple[str, str]]:
    """The cells of a source: "markdown" or "code", and their texts."""
    parts = CODE_CELL.split(FRONT_MATTER.sub("", text))
    kinds = ("markdown" if k % 2 == 0 else "code" for k in range(len(parts)))
    return [(kind, part.strip()) for kind, part in zip(kinds, parts, strict=True) if part.strip()]


def page(notebook: dict[str, Any], place: Path) -> str:
    """An executed notebook as Markdown; its pictures are written beside the place of the page."""
    parts: list[str] = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "code":
            parts.append(f"```python\n{text}\n```")
            for output in cell["outputs"]:
                parts.append(_shown(output, place, len(parts)))
        elif parts:
            parts.append(text)
        else:
            title, _, rest = text.partition("\n")
            parts += [title, DOWNLOAD.format(name=place.stem), rest]
    return "\n\n".join(parts) + "\n"


def _shown(output: dict[str, Any], place: Path, number: int) -> str:
    """An output as Markdown: of its forms the first that a page can show."""
    if output["output_type"] == "stream":
        return f"```text\n{''.join(output['text']).rstrip()}\n```"
    forms = {kind: "".join(data) for kind, data in output["data"].items()}
    if "text/html" in forms:
        return f"```{{raw}} html\n{forms['text/html']}\n```"
    if "image/png" in forms:
        picture = place.with_name(f"{place.stem}_{number}.png")
        picture.write_bytes(base64.b64decode(forms["image/png"]))
        return f"![Result of the code above]({picture.name})"
    return f"```text\n{forms['text/plain']}\n```"


def kept(source: Path, cache: Path) -> Path:
    """The executed notebook of a source, from the cache if it is there; RuntimeError if a cell fails."""
    target = cache / f"{source.stem}-{key(source)}.ipynb"
    if not target.exists():
        cache.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        part = target.with_suffix(".part")
        run(source, part)
        part.replace(target)
        print(f"{source.name}: {time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)
    for old in cache.glob(f"{source.stem}-*"):
        if old != target:
            old.unlink()
    return target


def key(source: Path) -> str:
    """Of a source, the files of the package and the libraries: equal ones give equal results."""
    found = hashlib.sha256(source.read_bytes())
    for folder in PACKAGE:
        for path in sorted(p for p in (ROOT / folder).rglob("*") if p.is_file()):
            if "__pycache__" not in path.parts:
                found.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    versions = [sys.version, *(f"{name} {importlib.metadata.version(name)}" for name in LIBRARIES)]
    found.update("\n".join(versions).encode())
    return found.hexdigest()[:16]


def run(source: Path, target: Path, more: Mapping[str, str] | None = None) -> None:
    """Execute a notebook by a process of its own; RuntimeError with the error of the cell that fails."""
    with tempfile.TemporaryDirectory() as own:
        threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        folders = dict.fromkeys(
            ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"), own
        )
        colours = ", ".join(repr(colour[1:]) for colour in COLOURS_OF_CURVES)
        Path(own, "matplotlibrc").write_text(f"axes.prop_cycle: cycler('color', [{colours}])\n")
        environment = {
            **os.environ, **threads, **folders, "JUPYTER_PREFER_ENV_PATH": "1", "MATPLOTLIBRC": own,
            **(more or {}),
        }  # fmt: skip
        environment.pop("MPLBACKEND", None)  # pictures are part of the page
        command = [
            sys.executable,
            str(Path(__file__).resolve()),
            str(source.resolve()),
            str(target.resolve()),
        ]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(f"{source.name} fails:\n{COLOURS.sub('', done.stderr)}")


def execute(source: Path, target: Path) -> None:
    """Execute a notebook in this process."""
    import nbformat
    from nbclient import NotebookClient
    from nbformat import v4

    made = {"code": v4.new_code_cell, "markdown": v4.new_markdown_cell}
    given = [
        made[kind](text, id=f"cell{k}") for k, (kind, text) in enumerate(cells(source.read_text("utf-8")))
    ]
    notebook = v4.new_notebook(cells=given, metadata=KERNEL)
    with tempfile.TemporaryDirectory() as folder:
        place = {"metadata": {"path": folder}}
        options = {"timeout": LONGEST_CELL, "record_timing": False, "coalesce_streams": True}
        NotebookClient(notebook, kernel_name="python3", resources=place, **options).execute()
        left = sorted(path.name for path in Path(folder).iterdir())
    if left:
        raise SystemExit(f"it leaves {', '.join(left)} behind")
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if not _is_of_compiler(output)]
    nbformat.write(notebook, target)


def _is_of_compiler(output: Any) -> bool:
    """Whether an output is what compiling says; SystemExit for anything else on standard error."""
    if output.get("name") != "stderr":
        return False
    others = [line for line in output.text.splitlines() if not line.startswith(COMPILING)]
    if others:
        raise SystemExit("it writes to standard error:\n" + "\n".join(others))
    return True


if __name__ == "__main__":
    execute(*map(Path, sys.argv[1:]))
