"""Reports in pipes and files are the text that Rich writes there, without Rich."""

from __future__ import annotations

import io

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.console import Console

from rendering.plain import PIPE_WIDTH, PlainText, is_plain, plain_table
from rendering.report import Report, Section, Table
from rendering.terminal import show

CELLS = st.text("abc 0123.-±²µ,()", max_size=30) | st.sampled_from(["", "a\nb", "x" * 40, "漢字", "e\u0301"])


@st.composite
def tables(draw):
    columns = draw(st.integers(1, 5))
    row = st.lists(CELLS, min_size=columns, max_size=columns)
    return Table(draw(row.filter(any)), draw(st.lists(row, max_size=4)))  # facts have empty headings


def in_a_pipe(report, encoding="utf-8"):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    show(report, PlainText(stream))
    return stream.buffer.getvalue()


def by_rich(report, encoding="utf-8"):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    show(report, Console(file=stream, highlight=False, markup=False, soft_wrap=True, emoji=False))
    stream.flush()
    return stream.buffer.getvalue()


LONG = "x" * 40


@given(tables())
@example(Table(["0000000", "", "", "", LONG], [["", "", LONG, "", ""], ["", "00000", "", "000000", LONG]]))
@settings(max_examples=100)
def test_reports_are_the_text_of_rich(table):
    report = Report("title", "lead", [Section("Table", "A line.\nAnother.\ta\rb", table)], "Verdict.", "Refused.")
    plain, rich = in_a_pipe(report).decode(), by_rich(report).decode()
    if max(map(len, rich.splitlines())) < PIPE_WIDTH:  # nothing is over several lines
        assert plain == rich
    assert sorted(plain.replace("─", "").split()) == sorted(rich.replace("─", "").split())


def test_wide_tables_have_cells_over_several_lines():
    rows = [["backlash of X", "word " * 30, "1.0"], ["cyclic", "another " * 20, "2.0"]]
    text = plain_table(Table(["cause", "reason", "um"], rows), PIPE_WIDTH)
    assert text is not None
    assert {len(line) for line in text.splitlines()} == {PIPE_WIDTH}
    assert text.count("word") == 30
    report = Report("title", "lead", [Section("Table", "", Table(["cause", "reason", "um"], rows))])
    assert in_a_pipe(report).decode() == by_rich(report).decode()


def test_tables_without_lines_in_ascii():
    report = Report("title", "lead", [Section("Table", "", Table(["name", "um"], [["X", "1.0"]]))])
    assert in_a_pipe(report, "ascii") == by_rich(report, "ascii")
    assert "─" in in_a_pipe(report).decode()


def test_a_table_of_too_many_columns_is_for_rich():
    assert plain_table(Table(["a" * 22] * 4, []), PIPE_WIDTH) is not None
    assert plain_table(Table(["a" * 23] * 4, []), PIPE_WIDTH) is None


@pytest.mark.parametrize("name", ["FORCE_COLOR", "TTY_COMPATIBLE"])
def test_the_environment_may_state_a_terminal(monkeypatch, name):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert is_plain(io.StringIO())
    monkeypatch.setenv(name, "1")
    assert not is_plain(io.StringIO())
