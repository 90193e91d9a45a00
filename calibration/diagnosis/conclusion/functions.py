"""Functions without a name that a calibration can correct."""

from __future__ import annotations

from calibration.diagnosis.conclusion.guard import HeldOut
from calibration.diagnosis.conclusion.verdict import Judged
from kinematics.state import TIME


def obstacle(each: Judged, held: HeldOut) -> str:
    """Why a calibration does not correct a function without a name, or a wave of an open period; empty if it can."""
    if each.periods:
        return "its period is open: between the measured positions its errors are not known"
    if not each.term.effects:
        return "it is an error of the readings of the instrument, not of the machine"
    if TIME in each.term.variables:
        return "it depends on the time of this measurement, which does not come again"
    if held.without[each.number] <= held.with_all:
        return "held-out blocks are predicted no better with it"
    return ""
