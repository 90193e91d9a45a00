"""Errors that repeat: held where the points of a table can follow, named where they cannot, never mistaken."""

import numpy as np
import pytest
from support.programs import load, model_of
from support.table_cases import motions
from support.tiers import quick

from kinematics.effects import Cyclic, QuantisedCompensation
from kinematics.user_error import UserError
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import FORMATS
from postproc.control_data.tables.export_tables import export


def exported(machine, *effects, format="linuxcnc", settings=()):
    form = FORMATS[format]
    chosen = parse_settings(form.settings, settings)
    return export(machine, model_of(machine, *effects), form, chosen, form.sign or "error", (0, 0, 0))


def test_a_wave_that_the_points_can_follow_is_held():
    machine = load("cframe")
    made = exported(machine, Cyclic("X", "X", 20.0, (6.0,), (3.0,)))
    point = made.errors_in_the_volume()["tool_point_um"]
    assert point["before"]["rms"] == pytest.approx(np.hypot(6.0, 3.0) / np.sqrt(2), rel=0.02)
    assert point["after_tables"]["rms"] < 0.15 * point["before"]["rms"]
    assert made.left == []


@pytest.mark.parametrize("period", quick([12.5, 10.0, 12.6], [12.5]))
def test_a_wave_too_short_for_the_places_is_left_alone(period):
    """12.5 mm is the distance of the places on 5 m: seen there, the wave would be a constant."""
    machine = load("gantry")
    pitch = motions(machine, "XX")
    made = exported(machine, *pitch, Cyclic("X", "X", period, (0.0,), (20.0,)))
    alone = exported(machine, *pitch)
    assert made.files == alone.files
    point = made.errors_in_the_volume()["tool_point_um"]
    assert point["after_tables"]["rms"] == pytest.approx(20.0 / np.sqrt(2), rel=0.02)
    assert [(left.name, left.why) for left in made.left] == [("cyclic E_XX", f"waves of {period:g} mm are too short")]


def test_a_wave_too_short_for_few_points_is_named():
    machine = load("cframe")
    made = exported(machine, *motions(machine, "XX"), Cyclic("X", "X", 20.0, (6.0,), (3.0,)), settings=["points=20"])
    assert ("cyclic E_XX", "waves of 20 mm are too short") in [(left.name, left.why) for left in made.left]
    point = made.errors_in_the_volume()["tool_point_um"]
    assert point["after_tables"]["rms"] < 1.1 * np.hypot(6.0, 3.0) / np.sqrt(2)


def test_nothing_but_short_waves_is_refused():
    machine = load("gantry")
    with pytest.raises(UserError, match="no errors that a table can hold"):
        exported(machine, Cyclic("X", "X", 2.0, (6.0,), (3.0,)), QuantisedCompensation("Y", 4.0, 1.0))
