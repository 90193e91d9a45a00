"""Figures of ncomp beside references of others: as many digits agree as docs/evidence.md states."""

from __future__ import annotations

import pytest
from support.evidence.page import PAGE as FILE
from support.evidence.page import SOURCES, referees, rows_of, stated

from tests.fuzz.figures import sums

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


def test_the_page_has_the_recorded_runs_of_the_referees():
    assert f"<!-- referees -->\n\n{referees()}\n" in FILE.read_text()
    assert all(figures.compared for figures in sums().values())
