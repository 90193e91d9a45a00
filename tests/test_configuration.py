"""The configuration of controls: every entry of the table with every value, by programs with hand-worked ends."""

import dataclasses

import numpy as np
import pytest
from support.docs_make import MAKE, script

import machines
import ncomp
from kinematics.machine import Control
from kinematics.user_error import UserError
from postproc.code_tables.configuration import CHOICES, CONFIGURATION

page = script(MAKE / "configuration.py")
MACHINE = """
name = "round table"
chain = "w C b X Y Z t"
[axes.X]
travel = [-500, 500]
[axes.Y]
travel = [-500, 500]
[axes.Z]
travel = [-500, 500]
[axes.C]
point = [0, 0, 0]
travel = [-inf, inf]
{axis}
[control]
{control}
[tools]
1 = 50
"""
TRIALS = [
    (entry.here, entry.trial, value) for entry in CONFIGURATION if entry.trial is not None for value in entry.trial.ends
]


@pytest.mark.parametrize(("here", "trial", "value"), TRIALS, ids=lambda each: each if isinstance(each, str) else "")
def test_a_value_moves_the_axes_as_the_table_says(tmp_path, here, trial, value):
    line = f"{here} = {value}"
    text = MACHINE.format(axis=line if here == "rollover" else "", control="" if here == "rollover" else line)
    (tmp_path / "table.toml").write_text(text)
    machine = machines.load(tmp_path / "table.toml")
    setup, expected = ncomp.set_up(machine, zero=True), trial.ends[value]

    def read():
        return ncomp.correct(trial.text, machine, "none", dialect=trial.dialect, setup=setup, travel_check=False).moves

    if isinstance(expected, str):
        with pytest.raises(UserError, match=expected):
            read()
        return
    moves = read()
    ends = dict(zip(machine.names, moves.machine_target[-1] / machine.scale, strict=True))
    np.testing.assert_allclose([ends[axis] for axis in "XYZC"], expected, atol=1e-9)


def test_every_entry_of_a_machine_file_is_in_the_table() -> None:
    found = {entry.here for entry in CONFIGURATION}
    assert {field.name for field in dataclasses.fields(Control)} - CHOICES <= found
    assert not CHOICES & found


def test_values_of_one_entry_differ() -> None:
    for entry in CONFIGURATION:
        if entry.trial is not None:
            assert len(set(entry.trial.ends.values())) > 1, entry.control


def test_the_pages_are_of_the_present_tables() -> None:
    for name, text in page.pages().items():
        assert (page.DOCS / name).read_text() == text, "python docs/make/configuration.py renews the page"
