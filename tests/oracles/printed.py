"""The lines that the report prints (docs/report/lines.yaml) as numbers, right and wrong ones."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import yaml

LINES = Path(__file__).parents[2] / "docs" / "report" / "lines.yaml"
FACTOR = re.compile(r"(?<=[\w)'])(?<!sin)(?<!cos) (?=[\w(])")
"""Between two factors, which stand side by side."""


@cache
def lines(kind):
    """The lines of an arm by section and name: what is printed, and its correction or the same again."""
    parts = yaml.safe_load(LINES.read_text(encoding="utf-8"))[kind].items()
    both = {
        (s, n): x if isinstance(x, dict) else {"printed": x} for s, part in parts for n, x in part.items()
    }
    return {key: (x["printed"], x.get("corrected", x["printed"])) for key, x in both.items()}


def value(line, numbers):
    """The number that a line stands for."""
    code = FACTOR.sub("*", line).replace("^", "**").replace("'", "_dot")
    return eval(code, {"sin": np.sin, "cos": np.cos}, numbers)


def numbers_of(kind, masses, lengths, q, qd, g=0.0):
    """Numbers by the names that the report has for them, without its springs."""
    names = ("theta1", "r1", "theta2", "r2") if kind == "RPRP" else [f"theta{k}" for k in range(1, 5)]
    found = {f"m{k}": m for k, m in enumerate(masses, 1)} | {f"l{k}": x for k, x in enumerate(lengths, 1)}
    found |= dict(zip(names, q, strict=True)) | {f"{n}_dot": x for n, x in zip(names, qd, strict=True)}
    return found | {"g": g} | dict.fromkeys(("k1", "k2", "lmin1", "lmax1", "lmin2", "lmax2"), 0.0)


def misprints(kind, masses, lengths, q, qd):
    """Each as "M" or "h", the indices of its entry, and printed minus right; q and qd have a row for each
    coordinate."""
    numbers = numbers_of(kind, masses, lengths, q, qd)
    for (_, name), (printed, right) in lines(kind).items():
        if printed != right and name[0] in "MH":
            entry = tuple(int(digit) - 1 for digit in name.partition(" ")[0][1:])
            yield {"M": "M", "H": "h"}[name[0]], entry, value(printed, numbers) - value(right, numbers)
