"""The public functions on measurements and calibrations: one for each job, `ncomp` has them under their names."""

from calibration.fit.calibrate import NotAccepted
from calibration.fit.together import TogetherNotAccepted
from calibration.instruments import Ballbar, Interferometer, LaserTracker, Lengths, Level, Part, TouchProbe
from calibration.interface.calibrations import diagnose, drift, fit, fit_together
from calibration.interface.evaluations import ballbar, compare, continuous, etve, iso230, square, three_points, tracker
from calibration.interface.measurements import (
    plan,
    predict,
    read_measurement,
    read_on_the_fly,
    save,
    simulate,
    touches,
    virtual_machine,
)
from calibration.interface.views import COLUMNS, REPORTS
from calibration.interface.virtual_laser import simulate_continuous
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices
from calibration.simulation.measure_plan import VirtualInstrument
from rendering import shown

__all__ = [
    "Ballbar",
    "Choices",
    "Interferometer",
    "LaserTracker",
    "Lengths",
    "Level",
    "NotAccepted",
    "Part",
    "Target",
    "TogetherNotAccepted",
    "TouchProbe",
    "VirtualInstrument",
    "ballbar",
    "compare",
    "continuous",
    "diagnose",
    "drift",
    "etve",
    "fit",
    "fit_together",
    "iso230",
    "plan",
    "predict",
    "read_measurement",
    "read_on_the_fly",
    "save",
    "simulate",
    "simulate_continuous",
    "square",
    "three_points",
    "touches",
    "tracker",
    "virtual_machine",
]

shown.VIEWS.update(REPORTS)
shown.COLUMNS.update(COLUMNS)
