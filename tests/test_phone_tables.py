"""Tables of pages: numbers are aligned, and a table that is too wide for a phone is shown in another form."""

import pytest

from rendering.page import page
from rendering.report import Report, Section, Table

NARROW = Table(("case", "value"), [("a", "1.25"), ("b", "-3")])
CLOSE = Table(
    ("target, mm", *["forward mean", "s", "runs"] * 2, "reversal"), [("599", *["-2.10", "0.26", "5"] * 2, "-7.95")]
)
WIDE = Table(("case", *["standard uncertainty"] * 5), [("a", *["12.5"] * 4, "see the note")])


@pytest.mark.parametrize(("table", "form"), [(NARROW, "<table>"), (CLOSE, 'class="tight"'), (WIDE, 'class="cards"')])
def test_form_by_the_width(table, form):
    assert form in page(Report("A", "", [Section("B", table=table)])).decode()


def test_cards_name_their_values_and_numbers_are_aligned():
    text = page(Report("A", "", [Section("B", table=WIDE)])).decode()
    assert text.count('class="number" data-name="standard uncertainty">12.5</td>') == 4
    assert 'data-name="standard uncertainty">see the note</td>' in text
    assert '<td data-name="case">a</td>' in text  # the first column is no number
