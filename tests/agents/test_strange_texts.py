"""Texts of files do not command a terminal, and are no HTML, links or cells on a page."""

import html
import io
import json
import re

import pytest
from run_folders import change, write_run

from redundant_envs.__main__ import main as core
from redundant_envs.support.progress import progress_bars
from redundant_envs.support.tables import Markdown, code, escaped, markdown
from redundant_envs.support.values import printable, warn
from tests.house import ROOT

STRANGE = "<script>alert(1)</script> [a](javascript:b) ![c](http://d) `rm` | e"
HIDDEN = "\x1b]0;owned\x07 \u202egpj.exe \x9b31m \r\x08"


def raw(text):
    """What has a meaning in Markdown or on a terminal."""
    return re.findall(
        r"<script|(?<!\\)\]\(|(?<!\\)`rm`|[^\n\t -~°²³·×µαθ\u2000-\u2010\u2013-\u2027\u2190-\uffff]", text
    )


def test_a_text_of_a_file_is_a_text():
    assert raw(printable(HIDDEN)) == []
    assert printable("a\nb\tµ") == "a\nb\tµ"
    for made in (escaped(STRANGE), escaped(f"{HIDDEN}\n# {STRANGE}"), markdown(["a"], [[STRANGE]])):
        assert raw(made) == []
    assert "\n" not in escaped("a\n# b")
    assert markdown([1], [["a|b\n| c |"]]).splitlines()[-1] == r"| a\|b \| c \| |"
    assert escaped(Markdown("`a` | b")) == "`a` | b"
    assert [code("a"), code("`a``b")] == ["`a`", "``` `a``b ```"]


@pytest.mark.parametrize("linkify", [False, True])
@pytest.mark.parametrize(
    "text",
    [
        STRANGE, "**a** _b_ __c__ a*b*c x __init__ y", "~~a~~ ~b~", "https://a.example www.a.org //a.example",
        "mailto:a@b.org a.b-c+d@e-f.org", "<b>", "[a]: http://b", "![a][b]", "[^1]: a", "[a]", "# a", "- a",
        "+ a", "* a", "- [ ] a", "1. a", "12) a", "> a", "~~~", "```", "---", "===", "    a", "a\\", "\\*a*",
        "&copy; &#35; &lt;b>", "a | b", "| - |", "$a$", "redundant_envs/RPRPReach-v0", "-1.5",
    ],
)  # fmt: skip
def test_a_text_has_no_meaning_in_markdown(text, linkify):
    if linkify:
        pytest.importorskip("linkify_it")
    read = pytest.importorskip("markdown_it").MarkdownIt("gfm-like", {"linkify": linkify})
    for made, tag in ((escaped(text), "p"), (f"* {escaped(text)}", "li"), (markdown(["a"], [[text]]), "td")):
        shown = read.render(made).replace("\u200b", "")
        assert f"<{tag}>{html.escape(text.strip())}</{tag}>" in shown.replace("&#x27;", "'")


def test_a_page_of_a_run_has_the_texts_of_its_files_as_texts(run, tmp_path, call):
    change(run / "evaluation.json", machine=STRANGE, date=STRANGE, versions={STRANGE: STRANGE})
    evil = run.rename(run.with_name("a`b<script>c[d](e)"))
    call("report", evil, "--out", tmp_path / "page")
    page = (tmp_path / "page" / "report.md").read_text()
    assert "alert(1)" in page
    own = r"``.*?``|!?\[[\w.]+\]\([\w./]+\)"  # code, and the pictures of a report
    assert raw(re.sub(own, "", page)) == []
    out, _ = call("table", evil)
    assert "alert(1)" in out
    assert raw(out) == []


def test_messages_show_control_characters_of_names(tmp_path, call, capsys):
    place = tmp_path / f"a{HIDDEN}".replace("/", "")
    for words in (["table", place], ["train", "rprp_reach_ppo", f"start_from={place}"]):
        assert raw(call(*words, status=2)[1]) == []
    run = write_run(place)
    (run / "evaluation.json").write_text(json.dumps({"seed": HIDDEN}))
    assert raw(call("table", run, status=2)[1]) == []
    assert core(["scene", str(place)]) == 2
    assert raw(capsys.readouterr().err) == []
    with pytest.warns(UserWarning, match=r"\\x1b"):
        warn(HIDDEN)


def test_names_are_no_markup_of_progress(monkeypatch, tmp_path):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr("sys.stderr", screen := io.StringIO())
    monkeypatch.setattr(screen, "isatty", lambda: True, raising=False)
    with progress_bars() as bars:
        bars.update(bars.add_task(f"[/b] {HIDDEN}", total=1, note="[/i] [red]x"), completed=1)
    assert "[/b]" in screen.getvalue()
    assert "\x1b]0;" not in screen.getvalue()


def test_every_message_passes_the_filter():
    own = {"values.py", "environments.py", "base.py", "hooks.py"}
    for folder in ("redundant_envs", "agents", "studies"):
        for path in (ROOT / folder).rglob("*.py"):
            names = set(re.findall(r"(?<![\w.\"`])print\(", path.read_text(encoding="utf-8")))
            assert not names or path.name in own, path
