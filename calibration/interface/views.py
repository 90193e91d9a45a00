"""The reports of results on measurements and calibrations, as a session shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from calibration.diagnosis.conclusion.result import Diagnosis
    from calibration.environment.etve import Etve
    from calibration.evaluation.rectangle import Rectangle
    from calibration.fit.calibrate import Calibration
    from calibration.fit.together import Together
    from calibration.following.drift import Drift
    from calibration.interface.evaluations import CircularTests, ContinuousResult, ThreePointsResult
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.plan import Plan
    from calibration.measurement.tracker_tests import Fitted
    from calibration.probing.centres import Probed
    from calibration.single_axis.iso230 import AxisTest
    from calibration.study.studied import Studied
    from rendering.report import Report


def _calibration(found: Calibration) -> Report:
    from calibration.reports.fit import fit_report

    return fit_report(found, None, "ncomp.fit")


def _together(found: Together) -> Report:
    from calibration.reports.together import together_report

    return together_report(found, "ncomp.fit_together")


def _diagnosis(found: Diagnosis) -> Report:
    from calibration.reports.diagnosis.page import diagnosis_report

    return diagnosis_report(found, "ncomp.diagnose")


def _drift(found: Drift) -> Report:
    from calibration.following.report import drift_report
    from kinematics.files.report_head import ReportHead

    return drift_report(found, found.followed.measurement.source, ReportHead())


def _plan(found: Plan) -> Report:
    from calibration.reports.plan import plan_report

    return plan_report(found)


def _axis_test(found: AxisTest) -> Report:
    from calibration.reports.iso230 import iso230_report
    from kinematics.files.report_head import ReportHead

    return iso230_report([found], "", ReportHead())


def _circles(found: CircularTests) -> Report:
    from calibration.reports.ballbar import ballbar_report
    from kinematics.files.report_head import ReportHead

    return ballbar_report(found.tests, found.shares, found.measurement.source, ReportHead())


def _rectangle(found: Rectangle) -> Report:
    from calibration.reports.rectangle import rectangle_report

    return rectangle_report(found, f"rectangle in {found.plane}")


def _three_points(found: ThreePointsResult) -> Report:
    from calibration.reports.three_points import three_points_report
    from kinematics.files.report_head import ReportHead

    return three_points_report(found.found, found.check, found.measurement.source, ReportHead(), tables=False)


def _continuous(found: ContinuousResult) -> Report:
    from calibration.reports.continuous import continuous_report

    return continuous_report(found.estimate, found.data, "ncomp.continuous")


def _tracker(found: Fitted) -> Report:
    from calibration.reports.tracker import tracker_report

    return tracker_report(found, "tests of a tracker")


def _etve(found: Etve) -> Report:
    from calibration.environment.report import etve_report
    from kinematics.files.report_head import ReportHead

    return etve_report(found, found.source, ReportHead())


def _touches(found: Probed) -> Report:
    from calibration.reports.touches import touches_report
    from kinematics.files.report_head import ReportHead

    return touches_report(found, found.measurement.source, ReportHead())


def _study(found: Studied) -> Report:
    from calibration.reports.study import study_report

    return study_report(found.results, found.definition, found.draws, "ncomp.study")


REPORTS: dict[str, Callable[[Any], Report]] = {
    "Calibration": _calibration,
    "Together": _together,
    "Diagnosis": _diagnosis,
    "Drift": _drift,
    "Etve": _etve,
    "Plan": _plan,
    "AxisTest": _axis_test,
    "CircularTests": _circles,
    "Rectangle": _rectangle,
    "ThreePointsResult": _three_points,
    "ContinuousResult": _continuous,
    "Fitted": _tracker,
    "Probed": _touches,
    "Studied": _study,
}
"""The report of a result, by the name of its class."""


def _measurement(measured: Measurement) -> dict[str, np.ndarray]:
    from calibration.measurement.written_file import columns_of

    return columns_of(measured)


COLUMNS: dict[str, Callable[[Any], dict[str, Any]]] = {"Measurement": _measurement}
"""The columns of a result, by the name of its class."""
