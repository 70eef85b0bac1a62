"""A page is followed literally: the helper fails where a reader would fail."""

from pathlib import Path

import pytest
from tutorial import blocks_of, run_tutorial

FOLDER = Path(__file__).parents[2] / "docs" / "tutorials"

PAGE = """\
Save this as `numbers_of.py`:

```python
# numbers_of.py
three = 3
```

```python
from numbers_of import three
print("python", three)
```

```console
$ python -c "import numbers_of; print('console', numbers_of.three)"
console 3
$ ls *.py
```

```text
not run
```

```shell
echo shell
```
"""


@pytest.mark.parametrize(("page", "most"), [("third_arm.md", 25), ("moving_target.md", 40)])
def test_what_a_reader_saves_is_short(page, most):
    files = [block.text for block in blocks_of(FOLDER / page) if block.file is not None]
    lines = [line for text in files for line in text.splitlines() if line.strip() and line[0] != "#"]
    assert 0 < len(lines) <= most
    said = (FOLDER / page).read_text(encoding="utf-8")
    assert f" {len(lines)} lines" in said


def written(tmp_path, text):
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    folder = tmp_path / "empty"
    folder.mkdir()
    return page, folder


def test_blocks_run_in_order_in_one_folder(tmp_path):
    page, folder = written(tmp_path, PAGE)
    assert [b.file for b in blocks_of(page)] == ["numbers_of.py", None, None, None, None]
    outputs = run_tutorial(page, folder)
    assert outputs == ["python 3\n", "console 3\nnumbers_of.py\n", "shell\n"]


@pytest.mark.parametrize(
    "block",
    [
        "```python\nprint('before')\nraise SystemExit(2)\n```\n",
        "```console\n$ echo before\n$ false\n$ echo after\n```\n",
        "```shell\necho before\nfalse | cat\necho after\n```\n",
    ],
)
def test_a_block_that_fails_is_shown_with_its_output(tmp_path, block):
    page, folder = written(tmp_path, block)
    with pytest.raises(AssertionError, match=r"(?s)page.md, line 2: status.*\nbefore\n$"):
        run_tutorial(page, folder)


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ("```yaml\na: 1\n```\n", "nothing runs a yaml block"),
        ("```console\nredundant-envs list\n```\n", "without a command"),
        ("```shell\nsleep 9\n```\n", "more than 0.2 s"),
    ],
)
def test_a_block_that_nothing_runs_is_refused(tmp_path, block, words):
    page, folder = written(tmp_path, block)
    with pytest.raises(AssertionError, match=words):
        run_tutorial(page, folder, seconds=0.2)
