"""Figures of ncomp beside references of others: as many digits agree as docs/evidence.md states."""

from __future__ import annotations

import pytest
from support.evidence.page import PAGE as FILE
from support.evidence.page import READ, SOURCES, recorded, rows_of, stated

from tests.fuzz.figures import PROGRAMS, READERS, sums
from tests.fuzz.guided import kinds

PAGE = stated()


def test_the_page_has_every_table():
    assert PAGE.keys() == SOURCES.keys()


@pytest.mark.parametrize("name", SOURCES)
def test_as_many_digits_agree_as_the_page_states(name):
    if SOURCES[name] == "gum":
        pytest.importorskip("GTC")  # in requirements.lock
    found = {row.key: row.digits for row in rows_of(name)}
    assert found.keys() == PAGE[name].keys()
    assert {key: value for key, value in found.items() if value < PAGE[name][key]} == {}


@pytest.mark.parametrize("name", ["referees", "readers"])
def test_the_page_has_the_recorded_runs(name):
    assert f"<!-- {name} -->\n\n{recorded()[name]}\n" in FILE.read_text()


def test_every_examiner_has_compared_and_every_reader_has_a_name():
    assert all(figures.compared for file in (PROGRAMS, READERS) for figures in sums(file).values())
    assert READ.keys() == set(kinds())
