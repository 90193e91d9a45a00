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

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Literal

import msgspec

from kinematics.running.progress import Progress, silent
from kinematics.user_error import UserError

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
    from postproc.compensation.conditions import Conditions
    from postproc.control.setup import Setup
    from postproc.correct.check import Findings
    from postproc.correct.pipeline import Job
    from postproc.correct.result import CorrectionResult
    from postproc.evaluation.trace import Trace
    from postproc.kinematic_parameters.export import ExportedParameters
    from postproc.motion.motions import Motions
    from postproc.tables.export import Exported
    from postproc.text.source import Source
    from postproc.verification.verify_programs import Verification

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
    import machines

    return machines.load(str(machine)) if isinstance(machine, (str, Path)) else machine


def load_calibration(machine: str | Path | Machine, calibration: str | Path | ErrorModel | None = None) -> ErrorModel:
    """The calibration in a JSON file; None is the machine's own, `"none"` a machine without errors.

    UserError for a machine without a calibration of its own, and for a calibration of another machine.

    >>> len(load_calibration("dmu50", "none").effects)
    0
    """
    import machines
    from kinematics.error_model.model import no_errors, read_model

    found = load_machine(machine)
    if calibration == "none":
        return no_errors(found)
    if calibration is not None and not isinstance(calibration, (str, Path)):
        return calibration
    path = Path(calibration) if calibration else machines.default_calibration(found)
    if path is None:
        raise UserError(
            f"machine {found.name} has no calibration of its own: give one with --calibration CAL.json "
            "('ncomp fit' makes one from measurements), "
            "or --calibration none"
        )
    return read_model(path, found)


def set_up(
    machine: str | Path | Machine,
    *,
    work_offset: Iterable[str] = (),
    tool_length: Iterable[str] = (),
    tool_table: Iterable[str | Path] = (),
    table_unit: str | None = None,
    datum: Iterable[str] = (),
    zero: bool = False,
    pass_through: Iterable[str] = (),
) -> Setup:
    """The work offsets, mm and degrees, and the tool lengths, mm, of the control when a program starts.

    work_offset: `G54=x,y,z`; tool_length: `T1=mm`; tool_table: tables of a control; table_unit: `mm` or `inch`, of
    tables that contain none, before that of the machine file; datum: `G54=probed` (the default) or `G54=true`; zero:
    offsets and lengths that are not given are zero; pass_through: constructs unknown to ncomp that pass unchanged
    (`G234`).

    >>> set_up("dmu50", work_offset=["G54=-30,-20,150"]).work_offsets["G54"]["X"]
    -30.0
    """
    from postproc.control.setup import make_setup
    from postproc.tool_tables import read_tool_tables

    found = load_machine(machine)
    tables = read_tool_tables([Path(path) for path in tool_table], table_unit or found.control.unit)
    return make_setup(found, work_offset, tool_length, tables, datum, probed=True, zero=zero, pass_through=pass_through)


def conditions(
    *, temperature: Iterable[str] = (), elapsed: float | None = None, log: str | Path | None = None
) -> Conditions:
    """The temperatures (`spindle=31.5`, degC), and the time since the zero of thermal effects, s, or a log of both.

    >>> conditions(temperature=["spindle=31.5"], elapsed=3600).temperatures["spindle"]
    31.5
    """
    from postproc.compensation.conditions import make_conditions

    return make_conditions(temperature, elapsed, None if log is None else Path(log))


class Corrected(msgspec.Struct, frozen=True, dict=True):
    """A corrected program."""

    text: str
    """The program, one character for each byte (latin-1); empty if it was written to `output`."""
    report: CorrectionResult
    """Number of blocks and moves, corrections and predicted errors, um, and notes."""
    job: Job
    trace: Trace | None = None
    """The moves and their errors before and after, for figures; None unless `traced` is set."""

    @cached_property
    def moves(self) -> Motions:
        """The moves of the corrected program: axis positions `(n, axes)`, mm and rad, read from its text."""
        from postproc.motion.motions import merged
        from postproc.verification.verify import read_motions

        job = self.job
        return merged(read_motions(open_program(self.text), job.dialect, job.machine, job.setup))


def correct(
    program: str | Path | Source,
    machine: str | Path | Machine,
    model: str | Path | ErrorModel | None = None,
    *,
    dialect: str = "auto",
    setup: Setup | None = None,
    conditions: Conditions | None = None,
    classes: str | None = None,
    tolerance_um: float = 1.0,
    max_correction_um: float | None = None,
    accept: str | None = None,
    travel_check: bool = True,
    unroll: bool = False,
    force: bool = False,
    output: BinaryIO | None = None,
    progress: Callable[[int], None] = lambda _: None,
    traced: bool = False,
    jobs: int = 1,
) -> Corrected:
    """Correct a program: each block ends at its nominal position, by the machine's error model.

    classes: ISO/TR 16907 classes (`L-VOL,R-VOL`); None for all but FOR. tolerance_um: feed moves that deviate more
    between their ends are split. max_correction_um: larger corrections are refused. accept: implausible conditions
    that are accepted (`stale,outside`). output: file for the program instead of `text`; `progress` gets the number
    of bytes done since its last call. jobs: number of cores that a long program may use, by further processes; a
    script that sets it must guard its main part by `if __name__ == "__main__"`, because a new process reads the
    script.

    UserError, with file and line, for a construct that is not fully understood; discard `output` then.

    >>> done = correct("G21 G90 G54\\nG0 X100 Y0 Z0\\nM30\\n", "gantry", "none", setup=set_up("gantry", zero=True))
    >>> print(done.text.splitlines()[1], len(done.moves))
    G0 X100 Y0 Z0 1
    """
    from kinematics.error_model.classes import ORIENTATION, parse_classes
    from postproc.compensation.correction import COLD
    from postproc.correct.pipeline import Job, Pipeline
    from postproc.correct.plausibility import parse_accepted
    from postproc.dialects import find_dialect
    from postproc.text.source import ENCODING

    found = load_machine(machine)
    accepted, chosen = parse_accepted(accept), None if classes is None else parse_classes(classes)
    if chosen and ORIENTATION in chosen and not found.rotary.any():
        raise UserError(f"--classes {classes}: machine {found.name} has no rotary axis to correct the orientation with")
    source, setup = open_program(program), setup or set_up(found)
    language = find_dialect(dialect, source.name, source.text_head)
    job = Job(
        source,
        language,
        found,
        load_calibration(found, model),
        setup,
        travel_check=travel_check,
        force=force,
        classes=chosen,
        tolerance_um=tolerance_um,
        conditions=conditions or COLD,
        max_correction_um=max_correction_um,
        accepted=accepted,
        unroll=unroll,
    )
    pipeline = Pipeline(job, traced=traced, processes=jobs)
    file = io.BytesIO()
    report = pipeline.run(output or file, progress)
    return Corrected(file.getvalue().decode(ENCODING), report, job, pipeline.trace)


def check(
    program: str | Path | Source,
    machine: str | Path | Machine,
    *,
    dialect: str = "auto",
    setup: Setup | None = None,
    travel_check: bool = True,
) -> Findings:
    """The lines of a program that a correction would change, leave or refuse, with the reasons; needs no calibration.

    >>> findings = check("G21 G90 G54\\nG0 X100 Y0 Z0\\nG1 X=#1\\nM30\\n", "gantry", setup=set_up("gantry", zero=True))
    >>> findings.corrected, [line for line, text, reason in findings.refused]
    ([2], [3])
    """
    from postproc.correct.check import check
    from postproc.dialects import find_dialect

    found, source = load_machine(machine), open_program(program)
    language = find_dialect(dialect, source.name, source.text_head)
    return check(source, language, found, setup or set_up(found), travel_check=travel_check)


def verify(
    program: str | Path | Source,
    corrected: str | Path | Source,
    machine: str | Path | Machine,
    model: str | Path | ErrorModel | None = None,
    *,
    old: str | Path | ErrorModel | None = None,
    align: str | Path | ErrorModel | None = None,
    dialect: str = "auto",
    setup: Setup | None = None,
    conditions: Conditions | None = None,
    classes: bool = False,
    tolerance_um: float = 1.0,
    accept: str | None = None,
    traced: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> Verification:
    """Tool point error, um, of a program before and after correction, by the exact model, from the two texts alone.

    old: an earlier calibration, whose errors are computed as well; align: a calibration that is taken for the true
    errors, aligned at its own datum; classes: also the errors that each ISO/TR 16907 class would leave; accept: parts
    of the mark that may differ (`calibration,set-up,datum`); traced: keep feed moves, for the figure of a page;
    progress: called with the numbers of characters that were evaluated, of both programs.

    UserError where the second program makes other moves than the first, or was corrected for another set-up. The
    example is that of this module.
    """
    from postproc.compensation.correction import COLD
    from postproc.verification.verify_programs import Models, verify_programs

    found = load_machine(machine)
    models = Models(
        load_calibration(found, model),
        None if old is None else load_calibration(found, old),
        None if align is None else load_calibration(found, align),
    )
    programs = open_program(program), open_program(corrected)
    return verify_programs(
        programs,
        found,
        models,
        setup or set_up(found),
        dialect=dialect,
        conditions=conditions or COLD,
        classes=classes,
        tolerance_um=tolerance_um,
        accept=accept,
        traced=traced,
        progress=progress,
    )


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


def export(
    machine: str | Path | Machine,
    format: str,
    model: str | Path | ErrorModel | None = None,
    *,
    sign: str | None = None,
    settings: Iterable[str] = (),
    tool_mm: float = 0.0,
) -> Exported:
    """A calibration as the compensation tables of a control: `files` by name, and `rest`, the calibration without them.

    format: one of docs/tables.md; settings: `NAME=VALUE`, those of the format; sign: `error` or `correction`, for
    formats whose sign no source states; tool_mm: length of the tool, mm, for which the tables are made.

    >>> sorted(export("dmu50", "csv").files)[:1]
    ['errors.csv']
    """
    from postproc.tables.export import export, sign_of
    from postproc.tables.format import parse_settings
    from postproc.tables.formats import find_format

    found, form = load_machine(machine), find_format(format)
    chosen, meaning = parse_settings(form.settings, settings), sign_of(form, sign)
    return export(found, load_calibration(found, model), form, chosen, meaning, (0.0, 0.0, -tool_mm))


def export_parameters(
    machine: str | Path | Machine,
    format: str,
    model: str | Path | ErrorModel | None = None,
    *,
    sign: str | None = None,
    settings: Iterable[str] = (),
    tool_mm: float = 0.0,
) -> ExportedParameters:
    """Location errors of rotary axes as the kinematic parameters of a control: `files` by name, `rest`, `changes`.

    format: one of docs/kinematic_parameters.md; the other arguments as in `export`.

    >>> sorted(export_parameters("dmu50", "fanuc-kinematics").files)
    ['parameters.csv', 'parameters_before.csv']
    """
    from postproc.kinematic_parameters.export import export_parameters
    from postproc.kinematic_parameters.formats import FORMATS
    from postproc.tables.export import sign_of
    from postproc.tables.format import parse_settings

    if format not in FORMATS:
        raise UserError(f"format {format}: expected one of {', '.join(FORMATS)}")
    found, form = load_machine(machine), FORMATS[format]
    chosen, meaning = parse_settings(form.settings, settings), sign_of(form, sign)
    return export_parameters(found, load_calibration(found, model), form, chosen, meaning, (0.0, 0.0, -tool_mm))


def open_program(program: str | Path | Source) -> Source:
    """The source of a program: the file of a path (`-` is standard input), or a text with a line end."""
    from postproc.text.source import Source, open_source, text_source

    if isinstance(program, Source):
        return program
    if isinstance(program, str) and ("\n" in program or "\r" in program):
        return text_source(program)
    return open_source(str(program))


if __name__ == "__main__":
    from postproc.cli import run

    run()
