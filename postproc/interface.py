"""The public functions on NC programs and tables of controls: one for each job."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import msgspec

from kinematics.user_error import UserError

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
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
    from machines.given import load_machine
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
    from machines.given import load_calibration, load_machine
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
    from machines.given import load_machine
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
    from machines.given import load_calibration, load_machine
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
    from machines.given import load_calibration, load_machine
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
    from machines.given import load_calibration, load_machine
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
