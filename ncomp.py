r"""The public interface of ncomp: one function for each job, which the command of that name calls as well.

Machines are shipped names, paths of TOML files or `Machine` objects; calibrations are paths of JSON files, `"none"`
for a machine without errors, or `ErrorModel` objects. A program is a path, its text (any string with a line end), or a
`Source`. Options have the names and the values of the command line. Axis positions are in mm and degrees, errors in um
and urad, tool relative to workpiece.

Every function raises `ncomp.UserError`, with one clear message, for an input that cannot be used.

>>> import ncomp
>>> mill = ncomp.load_machine("dmu50")
>>> setup = ncomp.set_up(mill, work_offset=["G54=-30,-20,150"], tool_length=["T1=80"])
>>> program = "G21 G90 G54\nT1 M6\nG0 X10 Y10 Z5 B0 C0\nG1 X60 F500\nM30\n"
>>> done = ncomp.correct(program, mill, setup=setup)
>>> done.report.changed_blocks
2
>>> checked = ncomp.verify(program, done.text, mill, setup=setup).verdict
>>> checked.after.largest < 1.0 < checked.before.largest
True
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError
from postproc.interface import (
    Corrected,
    check,
    conditions,
    correct,
    export,
    export_parameters,
    set_up,
    verify,
)

if TYPE_CHECKING:
    from calibration.diagnosis.result import Diagnosis
    from calibration.fit.calibrate import Calibration
    from calibration.fit.prediction import Points, Prediction
    from calibration.fit.together import Together
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.plan import Choices, Plan
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.simulation.measure_plan import Simulated, VirtualInstrument
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from kinematics.transforms import Array

__all__ = [
    "Corrected",
    "UserError",
    "check",
    "conditions",
    "correct",
    "diagnose",
    "export",
    "export_parameters",
    "fit",
    "fit_together",
    "load_calibration",
    "load_machine",
    "plan",
    "predict",
    "read_measurement",
    "set_up",
    "simulate",
    "verify",
]


def load_machine(machine: str | Path | Machine) -> Machine:
    """The machine of a shipped name or of a TOML file.

    >>> load_machine("dmu50").chain
    'w C B b X Y Z t'
    """
    from machines import given

    return given.load_machine(machine)


def load_calibration(machine: str | Path | Machine, calibration: str | Path | ErrorModel | None = None) -> ErrorModel:
    """The calibration in a JSON file; None is the machine's own, `"none"` a machine without errors.

    UserError for a machine without a calibration of its own, and for a calibration of another machine.

    >>> len(load_calibration("dmu50", "none").effects)
    0
    """
    from machines import given

    return given.load_calibration(machine, calibration)


def read_measurement(
    data: str | Path | Sequence[str | Path],
    machine: str | Path | Machine,
    *,
    format: str = "auto",
    header: Mapping[str, str] | None = None,
    columns: str | None = None,
    plan: str | Path | None = None,
) -> Measurement:
    """The measurement in a file, or in several as one: axis positions, mm and rad, and observed points, mm.

    header: keys that the file lacks (`{"u_um": "0.3"}`); columns: column map of a delimited export; plan: table of the
    axis positions by names of points. `notes` of the result are for the user.

    UserError with file, line and column of the first entry that cannot be used.
    """
    from calibration.measurement.joining import joined
    from calibration.measurement.readers import read_any

    found, position = load_machine(machine), None if plan is None else Path(plan)
    paths = [data] if isinstance(data, (str, Path)) else data
    each = [read_any(Path(path), found, format, header=header, columns=columns, plan=position) for path in paths]
    return each[0] if len(each) == 1 else joined(each)


def fit(
    measurement: Measurement | OnTheFly,
    *,
    basis: str = "auto",
    effects: Sequence[str | Effect] = (),
    noise: Literal["sheet", "estimate"] = "sheet",
    prior_scale: float | None = None,
    reversal: str = "none",
    hold_out: bool = True,
    valid_days: float | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Calibration:
    """Fit the errors of a machine to measured points, with uncertainties; `model` of the result is the calibration.

    basis: that of the error motions (`auto`, `legendre:5`, `X=b-spline:12,...`); effects: others of docs/effects.md
    (`backlash:axis=X,width=0`); noise: standard uncertainty of the instrument, as stated unless the residuals
    contradict it, or estimated from them; prior_scale: size of the errors, times the typical 30 um and urad; reversal:
    for data taken on the fly, `constant` or `curves` that depend on the direction of motion; force: accept the result
    although there is a reason against it.

    UserError for too few data; `calibration.fit.calibrate.NotAccepted`, a UserError with the result in `found`, where
    too many rows disagree, and where the fit does not predict held-out lines better than the nominal machine does.
    """
    from calibration.fit.calibrate import calibrate
    from calibration.on_the_fly.along_path import MARGIN, OnTheFly
    from calibration.on_the_fly.reversals import reversals
    from calibration.simulation.effect_text import read_effects

    moving = isinstance(measurement, OnTheFly)
    data = measurement.measurement if isinstance(measurement, OnTheFly) else measurement
    texts = [effect for effect in effects if isinstance(effect, str)]
    others = [effect for effect in effects if not isinstance(effect, str)]
    return calibrate(
        data,
        basis=basis,
        margin=MARGIN if moving else 0,
        effects=[*read_effects(texts, data.machine), *others, *reversals(data, reversal)],
        variance=noise,
        prior_scale=prior_scale,
        hold_out=hold_out,
        valid_days=valid_days,
        force=force,
        progress=progress,
    )


def fit_together(
    measurements: Sequence[Measurement],
    *,
    basis: str = "auto",
    effects: Sequence[str | Effect] = (),
    noise: Literal["sheet", "estimate"] = "sheet",
    prior_scale: float | None = None,
    hold_out: bool = True,
    valid_days: float | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Together:
    """Fit the errors of a machine to measurements by several instruments, each with its own registration.

    Arguments as for `fit`. `parts` of the result has each measurement alone, with the others and predicted by them.

    UserError for too few data; `calibration.fit.together.TogetherNotAccepted`, a UserError with the result in `found`,
    where the calibration is no improvement for one of the measurements.
    """
    from calibration.fit.together import calibrate_together
    from calibration.simulation.effect_text import read_effects

    texts = [effect for effect in effects if isinstance(effect, str)]
    others = [effect for effect in effects if not isinstance(effect, str)]
    return calibrate_together(
        measurements,
        basis=basis,
        effects=[*read_effects(texts, measurements[0].machine), *others],
        variance=noise,
        prior_scale=prior_scale,
        hold_out=hold_out,
        valid_days=valid_days,
        force=force,
        progress=progress,
    )


def diagnose(
    measurement: Measurement,
    model: str | Path | ErrorModel | None = None,
    *,
    noise: Literal["sheet", "estimate"] = "sheet",
    unexplained: Literal["report", "add"] = "report",
    force: bool = False,
    progress: Progress = silent,
) -> Diagnosis:
    """Find the causes of the errors that a model of the machine lacks; `model` of the result has them added.

    model: the present calibration; None begins with error motions of all axes. unexplained: residuals without a known
    cause are reported, or added to the model as a smooth function. force: accept the new model although there is a
    reason against it.
    """
    from calibration.diagnosis.diagnose import diagnose

    present = None if model is None else load_calibration(measurement.machine, model)
    return diagnose(measurement, present, variance=noise, left_over=unexplained, force=force, progress=progress)


def predict(
    points: str | Path | Points | Array, machine: str | Path | Machine, model: str | Path | ErrorModel | None = None
) -> Prediction:
    """The deviation of the tool point, or of the target, at a table of states, with its standard uncertainty.

    points: file with the columns of a measurement file, or axis positions `(n, axes)`, mm and degrees, in the order of
    the chain, with a tool of length zero. Deviations `(n, 3)`, um, are actual minus nominal, tool relative to
    workpiece, in the workpiece frame; k = 1.

    >>> import numpy as np
    >>> predict(np.zeros((2, 5)), "dmu50").deviation_um.shape
    (2, 3)
    """
    import numpy as np

    from calibration.fit.prediction import Points, Prediction, read_points
    from kinematics.state import State

    found = load_machine(machine)
    calibration = load_calibration(found, model)
    if isinstance(points, (str, Path)):
        points = read_points(Path(points), found)
    if isinstance(points, Points):
        return Prediction(found, calibration, points.states.state, points.states.tool)
    return Prediction(found, calibration, State(points * found.scale), np.zeros((len(points), 3)))


def plan(
    machine: str | Path | Machine,
    strategy: str,
    points: int | Sequence[int] | None = None,
    spacing_mm: float | None = None,
    choices: Choices | None = None,
) -> Plan:
    """The positions of a measurement, `(n, axes)`, mm and rad, their order, and the minutes that it takes.

    strategy: `grid`, `hexahedron+random`, ...; points: number of positions, of each strategy joined by `+`; choices:
    ranges, order, targets, runs and all other options of the command.

    >>> plan("gantry", "random", 25).positions.shape
    (25, 3)
    """
    from calibration.planning.strategies import plan

    return plan(load_machine(machine), strategy, points, spacing_mm, choices)


def simulate(
    plan: Plan,
    model: ErrorModel,
    instrument: VirtualInstrument | None = None,
    *,
    seed: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> Simulated:
    """The observations of a machine with known errors at the positions of a plan; `measurement` of the result.

    The machine moves by its exact kinematics. model: the true errors; instrument: a laser tracker before the volume
    unless given; seed: the same seed makes the same measurement. `progress` gets the number of observations done.

    >>> simulate(plan("gantry", "random", 25), load_calibration("gantry", "none")).measurement.observed.shape
    (25, 3)
    """
    from calibration.simulation.measure_plan import TRACKER, VirtualInstrument, measure_plan, streams

    return measure_plan(plan, model, instrument or VirtualInstrument(TRACKER), streams(seed, 4)[1:], progress)


if __name__ == "__main__":
    from postproc.cli import run

    run()
