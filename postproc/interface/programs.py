"""The public functions on NC programs: one for each job."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO, Literal

import msgspec

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, texts
from kinematics.user_error import UserError
from rendering.shown import Shown

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.compensation.conditions import Conditions
    from postproc.control.setup import Setup
    from postproc.correct.check import Findings
    from postproc.correct.job import Job
    from postproc.correct.pipeline import CorrectedFile
    from postproc.correct.result import CorrectionResult
    from postproc.evaluation.trace import Trace
    from postproc.motion.motions import Motions
    from postproc.text.source import Source
    from postproc.verification.verify_programs import Verification

TEXT = re.compile(r"[\n\r]")
"""A line end, by which the text of a program differs from its path."""


@public
def set_up(
    machine: str | Path | Machine,
    *,
    work_offset: Texts = (),
    tool_length: Texts = (),
    tool_table: Iterable[str | Path] = (),
    table_unit: Literal["mm", "inch"] | None = None,
    datum: Texts = (),
    zero: bool = False,
    block_skip: Literal["on", "off"] | None = None,
    start: str | None = None,
    probing: Literal["beside"] | None = None,
    pass_through: Iterable[str] = (),
    subprograms: Iterable[str | Path] = (),
    definitions: Iterable[str | Path] = (),
    height_map: str | None = None,
) -> Setup:
    """The work offsets, mm and degrees, and the tool lengths, mm, of the control when a program starts.

    work_offset: `G54=x,y,z` or `{"G54": {"X": -30, "C": 90}}`; tool_length: `T1=mm` or `{"T1": 80}`; tool_table:
    tables of a control; table_unit: unit of tables and maps that state none, by default that of the machine file,
    or mm; datum: `G54=probed` (the default) or `G54=true`; zero: what is not given is zero; block_skip: `on`,
    blocks with a slash do not run, or `off`; start: place of the tool, `X0,Y0,Z5`; probing: `beside`, no coordinate
    depends on it; pass_through: unknown constructs that pass; subprograms: folders of called programs; definitions:
    files of variables (GUD); height_map: `map.probe` or `map.probe@G55`. UserError for what cannot be used.

    >>> set_up("dmu50", work_offset=["G54=-30,-20,150"]).work_offsets["G54"]["X"]
    -30.0
    """
    from machines.given import load_machine
    from postproc.control.setup import make_setup
    from postproc.control_data.tool_tables import read_tool_tables

    found = load_machine(machine)
    tables = read_tool_tables(map(Path, tool_table), table_unit or found.control.unit)
    passing = [name for text in pass_through for name in text.split(",") if name.strip()]
    stated: dict[str, Any] = {"block_skip": block_skip or "", "start": start or "", "probing": probing or ""}
    stated |= {"zero": zero, "pass_through": passing, "subprograms": subprograms, "definitions": definitions}
    made = make_setup(found, texts(work_offset), texts(tool_length), tables, texts(datum), probed=True, **stated)
    return _with_map(made, height_map, table_unit)


def _with_map(setup: Setup, height_map: str | None, unit: str | None) -> Setup:
    """The set-up with the surface of a height map, if one is given; unit: of a map that states none."""
    if height_map is None:
        return setup
    from postproc.control_data.height_maps.on_machine import with_height_map

    return with_height_map(setup, height_map, unit or setup.machine.control.unit)


def _model_of(
    machine: Machine, calibration: str | Path | ErrorModel | None, setup: Setup, conditions: Conditions
) -> ErrorModel:
    """A calibration, with the surface of the workpiece in the set-up."""
    from machines.given import load_calibration
    from postproc.compensation.surface import with_surface

    return with_surface(load_calibration(machine, calibration), setup, conditions)


@public
def conditions(
    *,
    temperature: Texts = (),
    elapsed: Annotated[float, 0, None] | None = None,
    log: str | Path | None = None,
    log_columns: str | Path | None = None,
) -> Conditions:
    """The temperatures (`spindle=31.5`, degC), and the time since the zero of thermal effects, s, or a log of both.

    log: file with the columns time_s (or time, with time stamps) and temp_NAME, degC, up to the program's start;
    log_columns: column map of a log with other names. UserError for a value that is no temperature, and for a log that
    cannot be read.

    >>> conditions(temperature=["spindle=31.5"], elapsed=3600).temperatures["spindle"]
    31.5
    """
    from postproc.compensation.conditions import make_conditions

    return make_conditions(texts(temperature), elapsed, log, log_columns)


class Corrected(Shown, msgspec.Struct, frozen=True, dict=True):
    """A corrected program."""

    text: str
    """The program, one character for each byte (latin-1); empty if it was written to `output`."""
    report: CorrectionResult
    """Number of blocks and moves, corrections and predicted errors, um, and notes."""
    job: Job
    """Program, machine, calibration and set-up of the correction."""
    trace: Trace | None = None
    """The moves and their errors before and after, for figures; None unless `traced` is set."""
    called: tuple[CorrectedFile, ...] = ()
    """The corrected files of called programs, to be written into the folder of the program: name and bytes."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.job.machine.name}, {self.report.headline}"

    @cached_property
    def moves(self) -> Motions:
        """The moves of the corrected program, read from its text: `line`, `machine_target` `(n, axes)`, mm and rad.

        UserError for a program that was written to `output`, and for one whose called files are corrected beside it.
        """
        from postproc.correct.tcp.read_back import setup_of_output
        from postproc.text.source import text_source
        from postproc.verification.verify import motions_with_lines

        job = self.job
        if not self.text and job.source.text_head:
            raise UserError("the program was written to output: correct it without output to read its moves")
        if self.called:
            raise UserError("called programs are corrected beside the program: correct it without beside for its moves")
        setup = setup_of_output(job)
        return motions_with_lines(text_source(self.text), job.dialect, setup.machine, setup)


@public
def correct(
    program: str | Path | Source,
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel | None = None,
    *,
    dialect: str = "auto",
    setup: Setup | None = None,
    conditions: Conditions | None = None,
    classes: str | None = None,
    tolerance_um: Annotated[float, 0, None] = 1.0,
    max_correction_um: Annotated[float, 0, 5000] | None = None,
    accept: str | None = None,
    travel_check: bool = True,
    rotary_feed: Literal["leave", "inverse-time", "scaled"] | None = None,
    tcp: Literal["to-axes", "to-tcp"] | None = None,
    tcp_feed: Literal["inverse-time", "scaled"] | None = None,
    outside: Literal["refuse", "leave"] = "refuse",
    unroll: bool = False,
    force: bool = False,
    output: BinaryIO | None = None,
    progress: Callable[[int], None] = lambda _: None,
    traced: bool = False,
    jobs: Annotated[int, 1, None] = 1,
    one_of_several: bool = False,
    beside: bool = False,
    shared: Iterable[str] = (),
) -> Corrected:
    """Correct a program: each block ends at its nominal position, by the machine's error model.

    classes: ISO/TR 16907 classes (`L-VOL,R-VOL`); None for all but FOR. tolerance_um: feed moves that deviate more
    between their ends are split. max_correction_um: larger corrections are refused. accept: implausible conditions
    that are accepted (`stale,outside`). rotary_feed: feed moves of rotary axes alone; None for the machine file's. tcp:
    the tool point as positions of the axes, or the reverse, with feeds by tcp_feed (docs/tcp.md). outside: moves beyond
    the range of the calibration are refused, or stay. output: file for the program instead of `text`; `progress` gets
    the number of bytes done since its last call. jobs: processes for a long program (guard a script by `if __name__ ==
    "__main__"`). one_of_several: the set-up is that of several programs. beside: called files are
    corrected as files, `called` of the result, where each call needs the same correction; otherwise they are written
    out. shared: those of them that must stay unchanged, for other programs. UserError, with file and line.

    >>> done = correct("G21 G90 G54\\nG0 X100 Y0 Z0\\nM30\\n", "gantry", "none", setup=set_up("gantry", zero=True))
    >>> print(done.text.splitlines()[1], len(done.moves))
    G0 X100 Y0 Z0 1
    """
    from kinematics.error_model.classes import ORIENTATION, parse_classes
    from machines.given import load_machine
    from postproc.compensation.correction import COLD
    from postproc.control.without_effect import refuse_without_effect
    from postproc.correct.job import Job
    from postproc.correct.pipeline import Pipeline
    from postproc.correct.plausibility import parse_accepted
    from postproc.dialects import find_dialect
    from postproc.text.source import ENCODING

    found = load_machine(machine)
    accepted, chosen = parse_accepted(accept), None if classes is None else parse_classes(classes)
    if chosen and ORIENTATION in chosen and not found.rotary.any():
        raise UserError(f"--classes {classes}: machine {found.name} has no rotary axis to correct the orientation with")
    source, setup = open_program(program), set_up_of(program, found, setup)
    language = find_dialect(dialect, source.name, source.text_head)
    model = _model_of(found, calibration, setup, conditions or COLD)
    job = Job(
        source,
        language,
        found,
        model,
        setup.for_errors(model),
        travel_check=travel_check,
        force=force,
        classes=chosen,
        tolerance_um=tolerance_um,
        conditions=conditions or COLD,
        max_correction_um=max_correction_um,
        accepted=accepted,
        rotary_feed=rotary_feed or found.control.rotary_feed,
        leave_outside=outside == "leave",
        unroll=unroll,
        beside=beside and tcp is None,
        shared=frozenset(shared),
        tcp=tcp or "",
        tcp_feed=tcp_feed or "",
    )
    pipeline = Pipeline(job, traced=traced, processes=jobs)
    file = io.BytesIO()
    report = pipeline.run(output or file, progress)
    if not one_of_several:
        refuse_without_effect(report.unused)
    return Corrected(file.getvalue().decode(ENCODING), report, job, pipeline.trace, tuple(pipeline.called))


@public
def check(
    program: str | Path | Source,
    machine: str | Path | Machine,
    *,
    dialect: str = "auto",
    setup: Setup | None = None,
    travel_check: bool = True,
    one_of_several: bool = False,
) -> Findings:
    """The lines of a program that a correction would change, leave or refuse, with the reasons; needs no calibration.

    one_of_several: as for `correct`.

    >>> findings = check("G21 G90 G54\\nG0 X100 Y0 Z0\\nG1 X=#1\\nM30\\n", "gantry", setup=set_up("gantry", zero=True))
    >>> findings.corrected, [line for line, text, reason in findings.refused]
    ([2], [3])
    """
    from machines.given import load_machine
    from postproc.control.without_effect import refuse_without_effect
    from postproc.correct.check import check
    from postproc.dialects import find_dialect

    found, source = load_machine(machine), open_program(program)
    language = find_dialect(dialect, source.name, source.text_head)
    findings = check(source, language, found, set_up_of(program, found, setup), travel_check=travel_check)
    if not one_of_several:
        refuse_without_effect(findings.unused)
    return findings


@public
def verify(
    program: str | Path | Source,
    corrected: str | Path | Source,
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel | None = None,
    *,
    old: str | Path | ErrorModel | None = None,
    align: str | Path | ErrorModel | None = None,
    dialect: str = "auto",
    setup: Setup | None = None,
    conditions: Conditions | None = None,
    classes: bool = False,
    tolerance_um: Annotated[float, 0, None] = 1.0,
    accept: str | None = None,
    traced: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> Verification:
    """Tool point error, um, of a program before and after correction, by the exact model, from the two texts alone.

    old: an earlier calibration, whose errors are computed as well; align: a calibration that is taken for the true
    errors, aligned at its own datum; classes: also the errors that each ISO/TR 16907 class would leave; accept: parts
    of the mark that may differ (`calibration,set-up,datum`); traced: keep feed moves, for the figure of a page;
    progress: called with the numbers of characters that were evaluated, of both programs.

    UserError where the second program makes other moves than the first, or was corrected for another set-up. An
    example is in the docstring of the module `ncomp`.
    """
    from machines.given import load_machine
    from postproc.compensation.correction import COLD
    from postproc.verification.verify_programs import Models, verify_programs

    found, at = load_machine(machine), conditions or COLD
    setup = set_up_of(program, found, setup)
    others = (None if each is None else _model_of(found, each, setup, at) for each in (old, align))
    models = Models(_model_of(found, calibration, setup, at), *others)
    programs = open_program(program), open_program(corrected)
    return verify_programs(
        programs,
        found,
        models,
        setup.for_errors(*(model for model, _ in models.by_key().values())),
        dialect=dialect,
        conditions=at,
        classes=classes,
        tolerance_um=tolerance_um,
        accept=accept,
        traced=traced,
        progress=progress,
    )


def open_program(program: str | Path | Source) -> Source:
    """The source of a program: the file of a path (`-` is standard input), or a text with a line end."""
    from postproc.text.source import Source, open_source, text_source

    if isinstance(program, Source):
        return program
    if isinstance(program, str) and TEXT.search(program):
        return text_source(program)
    return open_source(str(program))


def set_up_of(program: object, machine: Machine, setup: Setup | None) -> Setup:
    """The set-up that was given, or that of the machine file and of the file `NAME.toml` next to the program.

    UserError for the set-up of another machine.
    """
    if setup is None:
        path = isinstance(program, Path) or (isinstance(program, str) and not TEXT.search(program))
        return own_set_up(str(program), machine)[0] if path else set_up(machine)
    if (setup.machine.name, setup.machine.chain) != (machine.name, machine.chain):
        raise UserError(
            f"the set-up is of machine {setup.machine.name} ({setup.machine.chain}), and the program runs on "
            f"{machine.name} ({machine.chain}): make it by ncomp.set_up with the machine of the program"
        )
    return setup


def own_set_up(program: str | Path, machine: Machine) -> tuple[Setup, list[str]]:
    """The set-up of the machine file and of the file next to a program, and the names of what the latter gives."""
    from postproc.folders.own_set_up import of_program

    nothing: dict[str, Any] = {"work_offset": (), "datum": (), "tool_length": ()}
    given, names = of_program(nothing, str(program), machine)
    return set_up(machine, **given), names
