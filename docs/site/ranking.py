"""The order of what the site's search finds: by how much of a page is about a word, not one score for all.

BM25: S. Robertson and H. Zaragoza, *Foundations and Trends in Information Retrieval* 3, 2009.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import snowballstemmer
from bs4 import BeautifulSoup, SoupStrainer

SATURATION, BY_LENGTH = 1.2, 0.75  # usual parameters of BM25
WEIGHTS = {"h1": 8.0, "h2, h3, h4": 4.0, "dt": 4.0, "h1 + p": 4.0, "pre": -0.7}
"""What words of titles, headings, names, first sentences and code count beside those of the text."""
PHRASES = "h1, h2, h3, h4, h1 + p"
"""Of these, two words that follow each other count as one more word."""
ASIDE = {
    "changelog": 0.3, "contributing": 0.4, "design": 0.4, "fuzzing": 0.6, "mutation": 0.6, "gallery": 0.5,
    "results/": 0.5, "scenes/": 0.6, "hard_cases": 0.7, "genindex": 0.1, "environments/index": 0.9,
    "reference/api": 0.8, "notebooks/": 0.7, "tutorials/": 0.8,
}  # fmt: skip
"""Pages that are seldom meant, by the beginning of their names, and what is left of their weight."""
MOST_PARTS = 6  # of a compound word
STEMMER = snowballstemmer.stemmer("english")
"""The same as Sphinx has in the browser."""
NUMBER = re.compile(r"[\d.+-]*(e[\d+-]+)?")
KEPT = 12  # pages that are kept of a word: the best ones


def words(text: str) -> list[str]:
    """Words of a text as a user types them; of compound ones, all runs of their parts."""
    return [word for one in re.findall(r"[\w.+-]*\w", text) for word in runs(one)]


@functools.cache
def runs(one: str) -> tuple[str, ...]:
    """Stems of a word, of runs of its parts and of pairs of them: GoalReach, Goal, Reach, "Goal Reach"."""
    parts = re.findall(r"[A-Z]?[a-z0-9]+|[A-Z0-9]+(?![a-z])", one)
    if NUMBER.fullmatch(one):
        return ()
    several = range(len(parts)) if 1 < len(parts) <= MOST_PARTS else ()
    found = ["".join(parts[i:j]) for i in several for j in range(i + 1, len(parts) + 1)]
    stems = [STEMMER.stemWord(part.lower()) for part in parts] if several else []
    pairs = [f"{a} {b}" for a, b in itertools.pairwise(stems)]
    return tuple(dict.fromkeys([*(STEMMER.stemWord(each.lower()) for each in (one, *found)), *pairs]))


def counted(html: str) -> dict[str, float]:
    """The words of a page, each with its weight."""
    article = BeautifulSoup(html, "html.parser", parse_only=SoupStrainer("article")).article
    counts: Any = Counter()  # of floats
    if article is None:
        return counts
    for selected, weight in ((None, 1.0), *WEIGHTS.items()):
        for one in article.select(selected) if selected else (article,):
            for word in words(one.get_text(" ")):
                counts[word] += weight
    for one in article.select(PHRASES):
        found = [word for word in words(one.get_text(" ")) if " " not in word]
        counts.update(f"{a} {b}" for a, b in itertools.pairwise(found))
    return counts


def ranks(pages: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """The best pages of every word, with their scores."""
    mean = sum(sum(page.values()) for page in pages.values()) / len(pages)
    of_word: dict[str, dict[str, float]] = {}
    spread = Counter(word for page in pages.values() for word in page)
    for name, page in pages.items():
        share = next((value for start, value in ASIDE.items() if name.startswith(start)), 1.0)
        long = 1.0 - BY_LENGTH + BY_LENGTH * sum(page.values()) / mean
        for word, count in page.items():
            rare = math.log(1.0 + (len(pages) - spread[word] + 0.5) / (spread[word] + 0.5))
            score = share * rare * count * (SATURATION + 1.0) / (count + SATURATION * long)
            of_word.setdefault(word, {})[name] = round(score, 2)
    return {w: dict(sorted(of.items(), key=lambda one: -one[1])[:KEPT]) for w, of in of_word.items()}


def written(app: Any, error: Exception | None) -> None:
    """Add the ranks to the index of the search, once the pages are written."""
    out = Path(app.outdir)
    if error or not (index := out / "searchindex.js").exists():
        return
    pages = {name: counted((out / f"{name}.html").read_text(encoding="utf-8")) for name in app.env.found_docs}
    table = json.dumps(ranks(pages), separators=(",", ":"), ensure_ascii=False, sort_keys=True)
    index.write_text(f"{index.read_text(encoding='utf-8')}\nvar RANKS={table};\n", encoding="utf-8")


def setup(app: Any) -> None:
    app.connect("build-finished", written)
