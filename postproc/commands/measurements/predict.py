"""`ncomp predict`: the deviations that a calibration predicts at a table of states."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from postproc.commands.options.declared import argument, output_option
from postproc.commands.options.shared import CalibrationName, MachineName, ResultOptions, whole_results

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.fit.prediction import Points, Predicted
    from kinematics.error_model.model import ErrorModel

EPILOG = (
    "Examples:\n\n"
    "`ncomp predict points.csv --machine gantry --calibration gantry.json -o predicted.csv`\n\n"
    "`ncomp predict tracker.csv --machine dmu50 -c cal.json -o predicted.csv --json -`"
)


def predict(
    *,
    points: Path = argument("States, in columns of a measurement file.", "POINTS.csv", reads=True),
    machine: MachineName,
    calibration: CalibrationName,
    output: str = output_option("The table with its predictions; `-` is standard output.", "OUT.csv", "-"),
    others: ResultOptions,
) -> None:
    """Predict the deviation of the tool point, or the target, at each row of a table of states.

    New columns are dx_um, dy_um, dz_um, actual minus nominal, tool relative to workpiece, in the workpiece frame, and
    their standard uncertainties (k = 1) u_dx_um, u_dy_um, u_dz_um. All other columns stay as they are; effects of the
    measuring instrument are excluded.
    """
    from calibration.fit.prediction import read_points
    from calibration.reports.figures.prediction import prediction_figure
    from postproc.commands.show.prediction import Summary
    from postproc.commands.show.terminal import say, show

    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    read = read_points(points, found)
    prediction = ncomp.predict(read, found, model)
    notes = prediction.notes
    summary = Summary()
    with whole_results(*others.files, output) as (results, page, file):
        for line in _head(read, model):
            file.write(line)
        for block in prediction.blocks():
            summary.add(block)
            file.write("".join(_lines(read, block)).encode())
        for note in notes:
            say("note", note)
        report = summary.report(prediction, partial(prediction_figure, prediction))
        relative = prediction.relative().json()
        numbers = summary.json() | {"u_um": relative, "calibration": _identity(model), "notes": notes}
        others.write(numbers, report, (results, page), (points, calibration))
    show(report, *others.files, output)


def _identity(model: ErrorModel) -> str:
    """Id of the calibration; `none` for one without effects."""
    return model.id if model.effects else "none"


def _head(read: Points, model: ErrorModel) -> Iterator[bytes]:
    """The lines above the rows, unchanged, with the origin of the prediction and the names of its columns."""
    from calibration.fit.prediction import ADDED

    *header, names = read.table.above
    for line in header:
        yield f"{line}\n".encode()
    yield f"# predicted_with: calibration {_identity(model)}, points {read.table.fingerprint}\n".encode()
    yield f"{names},{','.join(ADDED)}\n".encode()


def _lines(read: Points, block: Predicted) -> Iterator[str]:
    """Unchanged rows, each followed by its prediction, to 0.1 nm."""
    columns = zip(read.table.rows[block.rows], block.deviation.tolist(), block.u.tolist(), strict=True)
    for row, deviation, u in columns:
        yield "%s,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f\n" % (row, *deviation, *u)  # noqa: UP031  twice as fast for long tables
