"""The pages of the controls are those of the present tables, and every code on them does as they state."""

from __future__ import annotations

import pytest
from support.docs_make import MAKE, script

from postproc.code_tables.entries import ENTRIES, ONLY_DEFINED
from postproc.code_tables.trials import CALLS, TRIALS, families_of, refusal
from postproc.control import codes as shared
from postproc.heidenhain import codes as heidenhain
from postproc.iso import codes as iso
from postproc.siemens import codes as siemens

controls = script(MAKE / "controls.py")

REFUSED = [
    *(("iso", f"G{code:g}", reason) for code, reason in iso.REFUSED_G.items() if f"G{code:g}" not in CALLS),
    *(
        ("iso", f"M{code:g}", reason)
        for code, reason in iso.REFUSED_M.items()
        if f"M{code:g}" not in CALLS | TRIALS.keys()
    ),
    *(("siemens", f"G{code:g}", reason) for code, reason in siemens.REFUSED_G.items()),
    *(
        ("siemens", f"{name}", reason)
        for name, reason in siemens.REFUSED_NAMES.items()
        if name not in ("DO", "ID", "PROC")
    ),
    *(("heidenhain", f"M{code:g}", reason) for code, reason in heidenhain.REFUSED_M.items()),
    *(("heidenhain", f"FN {code}: 1", reason) for code, reason in heidenhain.REFUSED_FN.items()),
]
SIEMENS_NEED_MORE = {"PAROTOF", "TOROTOF", "TOFRAMEOF", "OVRA", "EXTERN", "LIFTFAST", "AXCTSWED", "SCPARA", "BLSYNC"}
"""Words that need arguments, or a plane before them."""
PASSING = [
    *(("iso", f"G{code:g} P1" if code in (4.0, 5.0) else f"G{code:g} Q1" if code == 5.1 else f"G{code:g}")
      for code in sorted(iso.HARMLESS_G)),
    *(("iso", f"M{code:g}") for code in sorted(shared.HARMLESS_M)),
    *(("siemens", f"G{code:g}") for code in sorted(siemens.HARMLESS_G)),
    *(("siemens", name) for name in sorted(siemens.HARMLESS_NAMES - SIEMENS_NEED_MORE)),
    *(("siemens", f"M{code:g}") for code in sorted(shared.HARMLESS_M)),
    *(("heidenhain", f"M{code:g}") for code in sorted(heidenhain.HARMLESS_M)),
]  # fmt: skip


@pytest.mark.parametrize("name", ENTRIES)
def test_pages_are_of_the_present_tables(name: str) -> None:
    text = (controls.FOLDER / f"{name}.md").read_text()
    assert text == controls.written(controls.page(name)), "python docs/make/controls.py renews the page"


def test_refused_codes_are_refused_for_their_reason() -> None:
    wrong = []
    for dialect, block, reason in REFUSED:
        if (found := refusal(dialect, block)) == "" or reason not in found:
            wrong.append((dialect, block, found))
    assert wrong == []


def test_passing_codes_pass() -> None:
    assert [(*each, found) for each in PASSING if (found := refusal(*each))] == []


@pytest.mark.parametrize("block", ["G999", "G27.5", "G20.1", "G200"])
def test_other_iso_codes_are_not_known(block: str) -> None:
    assert "is not known" in refusal("iso", block)


def test_every_followed_iso_code_is_accepted_with_some_family() -> None:
    assert [entry.code for entry in ENTRIES["iso"]() if families_of(entry) == ()] == []


def test_cycles_that_may_only_be_defined() -> None:
    for number in sorted(ONLY_DEFINED):
        assert refusal("heidenhain", f"CYCL DEF {number}.0 TEXT") == ""
        assert refusal("heidenhain", f"CYCL DEF {number}.0 TEXT\nCYCL CALL") != ""
