"""Tables as CSV, Markdown and text."""

from redundant_envs.tables import markdown, table, write_rows

HEAD, ROWS = ("name", "x"), [("a", 1.5), ("a|b", None)]


def test_tables_are_aligned_and_keep_bars_and_commas_in_their_columns(tmp_path):
    assert table(HEAD, ROWS).splitlines() == ["name     x", "   a   1.5", " a|b  None"]
    assert table(HEAD, [("longest", 1)], "<").splitlines() == ["name     x", "longest  1"]
    lines = markdown(HEAD, ROWS).splitlines()
    assert lines == ["| name | x |", "| --- | --- |", "| a | 1.5 |", r"| a\|b | None |"]
    path = tmp_path / "new" / "rows.csv"
    write_rows([{"name": "a,b", "x": None}], HEAD, path)
    assert path.read_text(encoding="utf-8").splitlines() == ["name,x", '"a,b",']
