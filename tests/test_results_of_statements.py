"""Statements that write variables: a value that the program gave before does not hold behind them, in no dialect.

Each entry sets a variable, runs the statement, and moves to the variable: refused, unless the statement leaves it.
"""

import pytest

import ncomp
from kinematics.user_error import UserError
from postproc.heidenhain.codes import SET_BY_CONTROL

HEADS = {
    "iso": ("G21 G90 G17 G54\nG0 X0. Y0. Z9.\n", "M2\n"),
    "siemens": ("G71 G90 G17 G54\nT1 D1 M6\nG0 X0 Y0 Z9\n", "M30\n"),
    "heidenhain": ("BEGIN PGM A MM\nTOOL CALL 1 Z S100\nL X+0 Y+0 Z+9 R0 FMAX\n", "END PGM A MM\n"),
}
TAKING = {
    "iso": "G0 X0. Y0. Z9.\nG1 X{} F100\n",
    "siemens": "G0 X0 Y0 Z9\nG1 X={} F100\n",
    "heidenhain": "L X+{} R0 F100\n",
}
SETTING = {"iso": "{}=3.\n", "siemens": "{}=3\n", "heidenhain": "{} = 3\n"}

# dialect, statement, variables that it writes, variables that it leaves
STATEMENTS = [
    ("heidenhain", "FN 18: SYSREAD Q5 = ID270 NR1 IDX3", "Q5", "Q6 QL5"),
    ("heidenhain", "FN 23: Q20 = CDATA Q30", "Q20 Q21 Q22", "Q23 Q30"),
    ("heidenhain", "FN 24: Q20 = CDATA Q30", "Q20 Q21 Q22", "Q23 Q30"),
    ("heidenhain", 'FN 28: TABREAD Q5 = 3 / "X,Y"', "Q5 Q6", "Q7"),
    ("heidenhain", "FN 19: PLC=+Q5/+0", "", "Q5"),
    ("heidenhain", 'FN 27: TABWRITE 5/"R" = Q5', "", "Q5"),
    ("heidenhain", "TOOL CALL 2 Z S200", "Q108 Q109 Q114", "Q110 Q111 Q5"),
    ("heidenhain", "L M3", "Q110", "Q109 Q111"),
    ("heidenhain", "L M8", "Q111", "Q110"),
    ("heidenhain", "L Z+9 M13", "Q110 Q111", "Q109"),
    ("heidenhain", "TCH PROBE 412 DATUM ~\n Q321=+0", "Q5 Q150 QR3", ""),
    ("heidenhain", "TCH PROBE 0.0 REF. PLANE Q5 X-", "Q5", ""),
    ("iso", "G65 P9811 Z0.", "#100", "#5"),
    ("iso", "G31 Z1. F50", "", "#100 #5"),
    ("siemens", "CYCLE978(0,1,1,1,10,1,0,0,1)", "R1", ""),
    ("siemens", "R2=INTERSEC(R1,1)", "R1 R2", ""),
    ("siemens", "CYCLE83(9,0,1,-5,,2,,1,1)", "", "R1"),
]
EACH = [
    (dialect, statement, name, written)
    for dialect, statement, *names in STATEMENTS
    for written, listed in zip((True, False), names, strict=True)
    for name in listed.split()
]


@pytest.mark.parametrize(("dialect", "statement", "name", "written"), EACH)
def test_a_value_behind_a_statement(dialect, statement, name, written):
    head, end = HEADS[dialect]
    text = head + SETTING[dialect].format(name) + statement + "\n" + TAKING[dialect].format(name) + end
    setup = ncomp.set_up("gantry", zero=True, probing="beside")
    if written:
        with pytest.raises(UserError, match=f"{name} is not known|{name}: "):
            ncomp.correct(text, "gantry", "none", dialect=dialect, setup=setup, travel_check=False)
    else:
        done = ncomp.correct(text, "gantry", "none", dialect=dialect, setup=setup, travel_check=False)
        assert done.moves.target[-1, 0] == 3.0


def test_every_statement_of_the_table_is_tried():
    tried = {statement.split(" Z ")[0].rstrip(" 0123456789") for _, statement, *_ in STATEMENTS}
    tried |= {word for _, statement, *_ in STATEMENTS for word in statement.split()}
    alike = {"M4": "M3", "M5": "M3", "M9": "M8", "M14": "M13"}
    assert {alike.get(name, name) for name in SET_BY_CONTROL} <= tried
