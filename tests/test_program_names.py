"""Programs that begin as FANUC allows: by O and a number, a colon and a number, or a name in angle brackets.

A name of up to 32 characters between < and > stands for the O number on the series 30i (B-64014EN/03, 2.5); in ISO code
a colon stands for the O.
"""

from __future__ import annotations

import pytest
from support.programs import correct, load, shifted

GANTRY = load("gantry")
MODEL = shifted(GANTRY, X=100.0)
PART = "%\n{}\nG21 G90 G17 G54\nT1 M6\nG0 G43 H1 X10. Y0. Z50.\nM98 P7\nM30\n{}\nG1 X20. F100.\nM99\n%\n"


def corrected(text: str) -> str:
    return correct(text, GANTRY, MODEL, offsets=["G54=1000,1000,200"], tools=["T1=100"], datums=["G54=true"]).text


@pytest.mark.parametrize(
    "name", ["O0001", ":0001", ": 1", "<SHAFT_12>", "O<SHAFT 12>", "<Part-1.A>(FIRST SIDE)", ":1 (FIRST SIDE)"]
)
@pytest.mark.parametrize("called", ["O7", "O0007", ":7"])
def test_a_program_is_named_as_fanuc_allows(name: str, called: str) -> None:
    lines = corrected(PART.format(name, called)).splitlines()
    assert lines[:2] == ["%", name]
    assert lines[2].startswith("(NCOMP")
    assert "X9.9000" in lines[5]
    assert lines[8:10] == [called, "G1 X19.9000 F100."]


@pytest.mark.parametrize("name", ["<SHAFT", "<>", "<A><B>", "<" + 33 * "A" + ">", ":", "G0 X0 Y0 Z50.\n<OTHER>"])
def test_what_is_no_name_of_a_program_is_refused(name: str) -> None:
    with pytest.raises(Exception, match=r"test\.nc:[23]"):
        corrected(f"%\n{name}\nG21 G90 G54\nM30\n%\n")
