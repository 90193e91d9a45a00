"""Statements that write variables: a value that the program gave before does not hold behind them, in no dialect.

Each entry sets a variable, runs the statement, and moves to the variable: refused, unless the statement leaves it.
"""

import pytest

import ncomp
from kinematics.user_error import UserError
from postproc.code_tables.statements import STATEMENTS
from postproc.heidenhain.codes import SET_BY_CONTROL

HEADS = {
    "iso": ("G21 G90 G17 G54\nG0 X0. Y0. Z9.\n", "M2\nO1000\n#1=4.\n#5=4.\nM99\n"),
    "siemens": ("G71 G90 G17 G54\nT1 D1 M6\nG0 X0 Y0 Z9\n", "M30\n"),
    "heidenhain": ("BEGIN PGM A MM\nTOOL CALL 1 Z S100\nL X+0 Y+0 Z+9 R0 FMAX\n", "END PGM A MM\n"),
}
TAKING = {
    "iso": "G0 X0. Y0. Z9.\nG1 X{} F100\n",
    "siemens": "G0 X0 Y0 Z9\nG1 X={} F100\n",
    "heidenhain": "L X+{} R0 F100\n",
}
OF_CONTROL = 1000
"""ISO: numbers of variables from here on belong to the control; most cannot be set."""
SETTING = {"iso": "{}=3.\n", "siemens": "{}=3\n", "heidenhain": "{} = 3\n"}

FOLLOWED = {("siemens", "R[1]=SET(7,8)"): {"R1": 7, "R2": 8}, ("siemens", "R[1]=REP(9,2)"): {"R1": 9, "R2": 9}}
"""Values behind statements that are followed."""
EACH = [
    (each.dialect, example.text, name, written)
    for each in STATEMENTS
    for example in each.examples
    for written, listed in ((True, example.writes), (False, example.leaves))
    for name in listed.split()
]


@pytest.mark.parametrize(("dialect", "statement", "name", "written"), EACH)
def test_a_value_behind_a_statement(dialect, statement, name, written):
    head, end = HEADS[dialect]
    own = dialect == "iso" and int(name[1:]) >= OF_CONTROL
    text = head + ("" if own else SETTING[dialect].format(name)) + statement + "\n" + TAKING[dialect].format(name) + end
    setup = ncomp.set_up("gantry", zero=True, probing="beside", pass_through=["READ"])
    if written and (dialect, statement) not in FOLLOWED:
        with pytest.raises(UserError, match=f"{name} is not known|{name}: "):
            ncomp.correct(text, "gantry", "none", dialect=dialect, setup=setup, travel_check=False)
    else:
        done = ncomp.correct(text, "gantry", "none", dialect=dialect, setup=setup, travel_check=False)
        assert done.moves.target[-1, 0] == (FOLLOWED[dialect, statement][name] if written else 3.0)


def test_every_statement_of_the_table_is_tried():
    texts = [example.text for each in STATEMENTS for example in each.examples]
    tried = {text.split(" Z ")[0].rstrip(" 0123456789") for text in texts}
    tried |= {word for text in texts for word in text.split()}
    alike = {"M4": "M3", "M5": "M3", "M9": "M8", "M14": "M13"}
    assert {alike.get(name, name) for name in SET_BY_CONTROL} <= tried
