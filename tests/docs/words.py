"""Words of the pages of docs/: ``python -m tests.docs.words``. Pages written by a program are left out."""

from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
MAX_WORDS = 40_000
WRITTEN_BY_PROGRAMS = ("results/", "configuration.md")


def count_words() -> dict[str, int]:
    """Words of each page and notebook. A word has a letter: bars and numbers of tables are none."""
    found = {}
    for path in sorted(DOCS.rglob("*.md")):
        name = path.relative_to(DOCS).as_posix()
        if not name.startswith(WRITTEN_BY_PROGRAMS):
            words = path.read_text(encoding="utf-8").split()
            found[name] = sum(any(c.isalpha() for c in word) for word in words)
    return found


if __name__ == "__main__":
    for name, words in count_words().items():
        print(f"{words:>6} {name}")
    print(f"{sum(count_words().values()):>6} of at most {MAX_WORDS}")
