"""Words of the pages of docs/: ``python -m tests.docs.words``. A program writes the pages left out."""

from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
MOST_WORDS = 40_000
WRITTEN_BY_PROGRAMS = ("results/", "configuration.md")


def count_words() -> dict[str, int]:
    """Words of each page and notebook, code and tables included."""
    pages = {path.relative_to(DOCS).as_posix(): path for path in sorted(DOCS.rglob("*.md"))}
    return {
        name: len(path.read_text(encoding="utf-8").split())
        for name, path in pages.items()
        if not name.startswith(WRITTEN_BY_PROGRAMS)
    }


if __name__ == "__main__":
    found = count_words()
    for name, words in sorted(found.items(), key=lambda item: item[1]):
        print(f"{words:>6} {name}")
    print(f"{sum(found.values()):>6} of at most {MOST_WORDS}")
