"""Tables as CSV, Markdown and text."""

from __future__ import annotations

from redundant_envs.tables import markdown, table, write_rows

HEAD, ROWS = ("name", "x"), [("a", 1.5), ("a|b", None)]


def test_a_table_of_text_is_aligned_without_blanks_at_the_end():
    assert table(HEAD, ROWS).splitlines() == ["name     x", "   a   1.5", " a|b  None"]
    assert table(HEAD, [("longest", 1)], "<").splitlines() == ["name     x", "longest  1"]


def test_a_bar_does_not_open_another_column_of_markdown():
    lines = markdown(HEAD, ROWS).splitlines()
    assert lines == ["| name | x |", "| --- | --- |", "| a | 1.5 |", r"| a\|b | None |"]


def test_rows_become_a_file_in_a_new_folder(tmp_path):
    path = tmp_path / "new" / "rows.csv"
    write_rows([{"name": "a,b", "x": None}], HEAD, path)
    assert path.read_text(encoding="utf-8").splitlines() == ["name,x", '"a,b",']
