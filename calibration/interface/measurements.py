"""The public functions that plan, read, predict and simulate measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, header_of
from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError
from machines.given import load_calibration, load_machine, machine_of

if TYPE_CHECKING:
    from calibration.fit.prediction import Points, Prediction
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.plan import Choices, Plan
    from calibration.on_the_fly.along_path import OnTheFly
    from calibration.on_the_fly.nominal_path import NominalPath
    from calibration.probing.centres import Probed
    from calibration.simulation.measure_plan import Simulated, VirtualInstrument
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from kinematics.transforms import Array

SIMULATED = ", simulated"
"""Origin of simulated data, for the header of their file."""


@public
def read_measurement(
    data: str | Path | Sequence[str | Path],
    machine: str | Path | Machine,
    *,
    format: str = "auto",
    header: Texts | None = None,
    columns: str | None = None,
    plan: str | Path | None = None,
    log: str | Path | None = None,
    log_columns: str | Path | None = None,
) -> Measurement:
    """The measurement in a file, or in several as one: axis positions, mm and rad, and observed points, mm.

    header: keys that the file lacks (`{"u_um": "0.3"}`); columns: column map of a delimited export; plan: table of the
    axis positions by names of points; log: temperatures by time, joined to the rows of each file, and log_columns its
    column map. `notes` of the result are for the user.

    UserError with file, line and column of the first entry that cannot be used.
    """
    from calibration.measurement.joining import joined
    from calibration.measurement.readers import read_any
    from kinematics.files.temperature_log import read_given_log

    found, position = load_machine(machine), None if plan is None else Path(plan)
    entries = header_of(header or ())
    paths = [data] if isinstance(data, (str, Path)) else data
    temperatures = read_given_log(log, log_columns)
    each = [
        read_any(Path(path), found, format, header=entries, columns=columns, plan=position, log=temperatures)
        for path in paths
    ]
    return each[0] if len(each) == 1 else joined(each)


@public
def predict(
    points: str | Path | Points | Array,
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel | None = None,
    *,
    approach: Array | None = None,
    time: Array | None = None,
    temperatures: Mapping[str, Any] | None = None,
    feed: Array | None = None,
    tool: Array | None = None,
) -> Prediction:
    """The deviation of the tool point, or of the target, at a table of states, with its standard uncertainty.

    points: file with the columns of a measurement file, or axis positions `(n, axes)`, mm and degrees, in the order of
    the chain. To such an array belong: approach, the direction -1, 0 or 1 of the last move of each axis, `(n, axes)` or
    `(axes,)`, by default that between the rows; time, s; temperatures by sensor, degC; feed, mm/min; tool, the position
    of the tool point, or the target, from the spindle nose, mm, `(3,)` or `(n, 3)`, by default zero. Deviations
    `(n, 3)`, um, are actual minus nominal, tool relative to workpiece, in the workpiece frame; their uncertainties have
    k = 1.

    UserError for an array of another shape, and for a state that an effect of the calibration needs and that is not
    given.

    >>> import numpy as np
    >>> predict(np.zeros((2, 5)), "dmu50").deviation_um.shape
    (2, 3)
    """
    from calibration.fit.given_states import column, states_of
    from calibration.fit.prediction import Points, Prediction, read_points
    from calibration.measurement.states import note_travel

    found = load_machine(machine)
    model = load_calibration(found, calibration)
    given = {"approach": approach, "time": time, "temperatures": temperatures, "feed": feed}
    if isinstance(points, (str, Path)):
        points = read_points(Path(points), found)
    if isinstance(points, Points):
        if own := [name for name, value in {**given, "tool": tool}.items() if value is not None]:
            raise UserError(f"{own[0]}: the points are in a file: give it the columns of these states")
        return Prediction(found, model, points.states.state, points.states.tool, points.notes)
    state, notes = states_of(found, points, **given), list[str]()  # type: ignore[arg-type]
    try:
        model.errors(found, state.rows(slice(0, 1)))
    except UserError as fault:
        raise UserError(f"{fault}: state it by approach=, time=, temperatures= or feed=") from None
    note_travel(found, state.positions, notes)
    vectors = column((0.0, 0.0, 0.0) if tool is None else tool, len(points), "tool", 3)
    return Prediction(found, model, state, vectors, tuple(notes))


@public
def plan(
    machine: str | Path | Machine,
    strategy: str,
    points: Annotated[int, 1, None] | Sequence[Annotated[int, 1, None]] | None = None,
    spacing_mm: Annotated[float, 0, None] | None = None,
    choices: Choices | None = None,
) -> Plan:
    """The positions of a measurement, `(n, axes)`, mm and rad, their order, and the minutes that it takes.

    strategy: one of docs/planning.md, or several joined by `+` (`hexahedron+random`); points: number of positions, in
    all or of each strategy; spacing_mm: distance of the positions instead of their number, mm; choices: ranges, order,
    targets, runs and all other options of the command.

    UserError for an unknown strategy, and for one that this machine cannot measure.

    >>> plan("gantry", "random", 25).positions.shape
    (25, 3)
    """
    from calibration.planning.strategies import plan

    return plan(load_machine(machine), strategy, points, spacing_mm, choices)


@public
def simulate(
    plan: Plan,
    calibration: str | Path | ErrorModel,
    instrument: VirtualInstrument | None = None,
    *,
    seed: Annotated[int, 0, None] = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> Simulated:
    """The observations of a machine with known errors at the positions of a plan; `measurement` of the result.

    The machine moves by its exact kinematics. calibration: the true errors, of `virtual_machine` or of a file;
    instrument: by default a laser tracker in front of the volume; seed: the same seed makes the same measurement;
    progress: called with the number of observations that are done.

    UserError where no observation is left, as for a tracker that reaches no position.

    >>> simulate(plan("gantry", "random", 25), load_calibration("gantry", "none")).measurement.observed.shape
    (25, 3)
    """
    from calibration.instruments import LaserTracker
    from calibration.simulation.measure_plan import VirtualInstrument, measure_plan, streams

    model = load_calibration(plan.machine, calibration)
    instrument = instrument or VirtualInstrument(LaserTracker.typical())
    return measure_plan(plan, model, instrument, streams(seed, 4)[1:], progress)


@public
def touches(log: str | Path, machine: str | Path | Machine, plan: str | Path) -> Probed:
    """The centres of spheres in the log of a probing program; `measurement` of the result is for `fit`.

    plan: file of the plan whose program wrote the log. The scatter of the contacts gives the uncertainty of a centre,
    um; `repeats` has the shifts of the first centre when it was measured again, um, with U (k = 2).

    UserError for the plan of another measurement, and for a log that is not of this plan.
    """
    from calibration.measurement.plan_file import read_plan, stated_plan_id
    from calibration.probing.centres import centres_of
    from calibration.probing.log import log_text, read_contacts
    from kinematics.files import read_input

    log, plan = Path(log), Path(plan)
    planned = read_plan(plan, load_machine(machine))
    if not planned.spheres:
        raise UserError(
            f"{plan}: this is no plan of spheres: give the plan whose program wrote the log (ncomp plan spheres)"
        )
    contacts = read_contacts(log_text(read_input(log, "log"), log.name), log.name, planned, stated_plan_id(plan))
    return centres_of(contacts, planned, log.name)


@public
def virtual_machine(
    machine: str | Path | Machine,
    *,
    errors: str | Path = "table-1",
    calibration: str | Path | ErrorModel = "none",
    effects: Sequence[str | Effect] = (),
    location_um: Annotated[float, 0, None] = 0.0,
    seed: Annotated[int, 0, None] = 0,
) -> ErrorModel:
    """The true errors of a virtual machine, for `simulate`: random ones, those of a calibration, and effects.

    errors: random error motions within the half-widths of the virtual calibration paper (`table-1`) or of a file, or
    `none`; effects: of docs/effects.md (`backlash:axis=X,width=12`); location_um: largest random location error, um
    and urad; seed: the same seed draws the same errors, with other random numbers than those of `simulate`.

    >>> len(virtual_machine("gantry", errors="none", effects=["backlash:axis=X,width=12"]).effects)
    1
    """
    from calibration.simulation.effect_text import given_effects
    from calibration.simulation.measure_plan import streams
    from calibration.simulation.true_model import (
        DEFAULT,
        model_of,
        random_location_errors,
        random_true_model,
        read_half_widths,
    )

    found, rng = load_machine(machine), streams(seed, 1)[0]
    stated = given_effects(effects, found)
    drawn = list(load_calibration(found, calibration).effects)
    if errors != "none":
        widths = DEFAULT if errors == "table-1" else read_half_widths(Path(errors))
        drawn += random_true_model(found, rng, widths).effects
    if location_um:
        drawn += random_location_errors(found, rng, location_um)
    return model_of(found, [*drawn, *stated])


@public
def read_on_the_fly(
    data: str | Path,
    path: NominalPath,
    *,
    format: str = "auto",
    header: Texts | None = None,
    columns: str | None = None,
    log: str | Path | None = None,
    log_columns: str | Path | None = None,
    cell_mm: Annotated[float, 0.1, None] | None = None,
    corner_mm: Annotated[float, 0, None] = 5.0,
    progress: Progress = silent,
) -> OnTheFly:
    """The readings of a tracker that followed a program, along its path (of `read_path`), for `fit`.

    cell_mm: length of the cells of the path in which readings are averaged, mm, 4 by default; corner_mm: length of path
    before and after a corner whose readings are left out, mm; format, header, columns and log: as for
    `read_measurement`; progress: called with the text of each step.

    UserError with file and line of the first reading that cannot be used, and for readings that do not follow the path.
    """
    from calibration.measurement.readers import table_in
    from calibration.on_the_fly.along_path import on_path
    from calibration.on_the_fly.corrected_positions import with_corrected_positions
    from calibration.on_the_fly.readings import read_readings
    from kinematics.files.temperature_log import read_given_log

    temperatures, entries = read_given_log(log, log_columns), header_of(header or ())
    table, notes = table_in(Path(data), path.machine, format, header=entries, columns=columns, log=temperatures)
    read = read_readings(table, path.machine)
    taken = on_path(read, path, cell_mm=cell_mm, corner_mm=corner_mm, progress=progress)
    progress("positions of the readings on the path")
    measurement = with_corrected_positions(taken)
    return replace(taken, measurement=measurement, notes=(*notes, *read.notes))


@public
def save(
    content: ErrorModel | Measurement | Plan, path: str | Path, machine: str | Path | Machine | None = None
) -> None:
    """Write a calibration to a JSON file, or a measurement or plan to a CSV file, whole or not at all.

    machine: that of a calibration, by which its errors outside the measured range are checked; the shipped machine of
    its name by default. UserError where an error motion grows outside the measured range.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(load_calibration("dmu50", "none"), f"{folder}/none.json")
    ...     load_calibration("dmu50", f"{folder}/none.json").effects
    ()
    """
    from calibration.fit.beyond_measured import calibration_file
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.plan import Plan
    from calibration.measurement.plan_file import write_plan
    from calibration.measurement.written_file import write_measurement
    from kinematics.files import whole_file, write_whole

    if isinstance(content, Measurement):
        with whole_file(Path(path)) as file:
            write_measurement(content, file, SIMULATED if content.simulated else "")
    elif isinstance(content, Plan):
        with whole_file(Path(path)) as file:
            write_plan(content, file)
    else:
        write_whole(Path(path), calibration_file(content, machine_of(content, machine, f"calibration {content.id}")))
