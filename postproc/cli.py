"""The command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from kinematics.errors import UserError
from postproc.commands import fit, iso230, plan, predict, simulate, three_points
from postproc.commands.shared import (
    CalibrationName,
    JsonFile,
    MachineName,
    check_places,
    machine_of,
    model_of,
    refuse_one_place,
    result,
    write_json,
)

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.setup import Setup

MAIN_JOB = "correct"


def _dialect_names() -> list[str]:
    from postproc.dialects import NAMES

    return list(NAMES)


class MainJobFirst(TyperGroup):
    """A first argument that is no subcommand is the main job."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the name of the main job in front of its arguments."""
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        if args and args[0] not in self.commands and args[0] not in own:
            args = [MAIN_JOB, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="ncomp",
    cls=MainJobFirst,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="""Make machine tools cut where the program says.

    **ncomp IN.nc --machine M -o OUT.nc** corrects a program for the measured errors of machine M
    (the same as *ncomp correct IN.nc ...*; see *ncomp correct --help*).
    """,
)

Program = Annotated[str, typer.Argument(metavar="IN.nc", help="NC program; - for standard input.")]
DialectName = Annotated[
    str, typer.Option("--dialect", help="auto, iso, siemens or heidenhain.", autocompletion=_dialect_names)
]
WorkOffsets = Annotated[
    list[str] | None,
    typer.Option("--work-offset", metavar="G54=x,y,z", help="Work offset, mm; rotary: G54=x,y,z,C=deg. Repeatable."),
]
ToolLengths = Annotated[
    list[str] | None, typer.Option("--tool-length", metavar="T1=mm", help="Length of a tool. Repeatable.")
]
ToolTable = Annotated[
    Path | None,
    typer.Option("--tool-table", metavar="FILE", help='Tool lengths: LinuxCNC tool.tbl or JSON {"1": 120.5}.'),
]
Temperatures = Annotated[
    list[str] | None,
    typer.Option("--temperature", metavar="NAME=degC", help="Of a sensor, while the program runs. Repeatable."),
]
Elapsed = Annotated[
    float | None,
    typer.Option("--elapsed", metavar="s", help="Since time zero of thermal effects, when the program starts."),
]
ConditionsLog = Annotated[
    Path | None,
    typer.Option("--log", metavar="FILE.csv", help="Columns time_s and temp_NAME, degC, up to the program's start."),
]


@app.command(
    MAIN_JOB,
    epilog="Examples:\n\n"
    "`ncomp part.nc --machine dmu50 -o part_c.nc`\n\n"
    "`ncomp part.h --machine mill.toml --calibration cal.json --work-offset 1=12.5,-80,210 --tool-length T5=96.3 "
    "-o part_c.h`\n\n"
    "`ncomp part.nc --machine mill.toml --calibration cal.json --temperature spindle=31.5 --elapsed 3600 "
    "-o part_c.nc`\n\n"
    "`ncomp - --machine gantry --calibration none < part.nc`  reads the program and writes it back, byte for byte",
)
def correct(
    program: Program,
    machine: MachineName,
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="OUT.nc", help="Corrected program; - for standard output.")
    ] = "-",
    calibration: CalibrationName = None,
    dialect: DialectName = "auto",
    work_offset: WorkOffsets = None,
    tool_length: ToolLengths = None,
    tool_table: ToolTable = None,
    no_travel_check: Annotated[
        bool, typer.Option("--no-travel-check", help="Only note positions outside an axis' travel.")
    ] = False,
    classes: Annotated[
        str | None,
        typer.Option("--classes", metavar="L-VOL,R-VOL,...", help="ISO/TR 16907 classes; default: all but FOR."),
    ] = None,
    tolerance_um: Annotated[
        float, typer.Option("--tolerance-um", min=0.0, help="Note feed moves that stray farther between their ends.")
    ] = 1.0,
    temperature: Temperatures = None,
    elapsed: Elapsed = None,
    log: ConditionsLog = None,
    force: Annotated[bool, typer.Option("--force", help="Correct a program that ncomp has corrected already.")] = False,
    json: JsonFile = None,
) -> None:
    """Correct a program: every block end where it should be, by the machine's error model.

    Only coordinate words change; blocks are added where play is taken up, and a comment that names machine and
    calibration. What ncomp does not fully understand is refused: exit status 2, no output.
    """
    from postproc.conditions import make_conditions
    from postproc.dialects import find_dialect
    from postproc.pipeline import Job, Pipeline
    from postproc.source import open_source
    from postproc.terminal import progress_of, show_report

    refuse_one_place(json, output, "the program")
    check_places((program, calibration, tool_table, log), (json,))
    check_places((calibration, tool_table, log), (output,))  # a program may be replaced by its corrected self
    found = machine_of(machine)
    model = model_of(calibration, found)
    chosen = _classes(classes, found)
    source = open_source(program)
    setup = _setup(found, work_offset, tool_length, tool_table)
    language = find_dialect(dialect, source.name, source.text_head)
    conditions = make_conditions(temperature or (), elapsed, log)
    job = Job(source, language, found, model, setup, not no_travel_check, force, chosen, tolerance_um, conditions)
    with result(json) as results:
        with progress_of(source.size, "correcting") as progress, result(output) as file:
            report = Pipeline(job).run(file, progress)
        report.notes += setup.unused_tools()
        write_json(report.json(), results)
    show_report(report)


@app.command(
    "verify",
    epilog="Example:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`",
)
def verify_command(
    program: Program,
    corrected: Annotated[str, typer.Argument(metavar="OUT.nc", help="The corrected program.")],
    machine: MachineName,
    calibration: CalibrationName = None,
    dialect: DialectName = "auto",
    work_offset: WorkOffsets = None,
    tool_length: ToolLengths = None,
    tool_table: ToolTable = None,
    classes: Annotated[
        bool, typer.Option("--classes", help="Also show what each ISO/TR 16907 class would leave of the errors.")
    ] = False,
    tolerance_um: Annotated[
        float, typer.Option("--tolerance-um", min=0.0, help="That of the correction: half of it is no reversal.")
    ] = 1.0,
    temperature: Temperatures = None,
    elapsed: Elapsed = None,
    log: ConditionsLog = None,
    json: JsonFile = None,
) -> None:
    """Tool point error of a program before and after correction, by the exact model, from the two texts alone."""
    from postproc.class_table import class_table
    from postproc.conditions import make_conditions
    from postproc.dialects import find_dialect
    from postproc.judge import standing_notes
    from postproc.mark import calibration_of
    from postproc.source import open_source
    from postproc.terminal import console, output, say, show_classes, show_verdict
    from postproc.verify import merged, read_motions, verify

    check_places((program, corrected, calibration, tool_table, log), (json,))
    found = machine_of(machine)
    model = model_of(calibration, found)
    setup = _setup(found, work_offset, tool_length, tool_table)
    conditions = make_conditions(temperature or (), elapsed, log)
    notes = standing_notes(model, conditions)
    motions = []
    for name in (program, corrected):
        source = open_source(name)
        language = find_dialect(dialect, source.name, source.text_head)
        motions.append(merged(read_motions(source, language, found, setup)))
    verdict = verify(motions[0], motions[1], model, conditions, tolerance_um)
    for note in notes:
        say("note", note)
    marked = calibration_of(source)
    if marked != model.id.upper():
        say("note", f"{corrected} bears the mark of calibration {marked or 'none'}; it is judged with {model.id}")
    table = class_table(motions[0], model, conditions) if classes else []
    with result(json) as results:
        write_json(verdict.json() | {"classes": [left.json() for left in table]}, results)
    to = console if json == "-" else output
    show_verdict(verdict, to)
    if table:
        show_classes(table, to)


@app.command(
    "machines", epilog="Examples:\n\n`ncomp machines`\n\n`ncomp machines dmu50`\n\n`ncomp machines my_mill.toml`"
)
def machines_command(
    name: Annotated[str | None, typer.Argument(help="A machine's name, or the path of its .toml file.")] = None,
) -> None:
    """List the shipped machines; show one; check a machine file of your own."""
    import machines as shipped
    from postproc.terminal import output, show_machine

    if name is None:
        for each in shipped.names():
            machine = shipped.load(each)
            output.print(f"{each:<12} {machine.chain:<24} {machine.description}")
        return
    machine = machine_of(name)
    path = shipped.default_calibration(machine)
    show_machine(machine, "none of its own" if path is None else path.name)


app.command("fit", epilog=fit.EPILOG)(fit.fit)
app.command("iso230", epilog=iso230.EPILOG)(iso230.iso230)
app.command("plan", epilog=plan.EPILOG)(plan.plan)
app.command("predict", epilog=predict.EPILOG)(predict.predict)
app.command("simulate", epilog=simulate.EPILOG)(simulate.simulate)
app.command("three-points", epilog=three_points.EPILOG)(three_points.three_points)


def run() -> None:
    """Entry point."""
    try:
        app(prog_name="ncomp")
    except UserError as fault:
        print(f"ncomp: {fault}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        sys.exit(1)
    except Exception as fault:
        import traceback

        traceback.print_exc()
        print(f"ncomp: internal fault: {fault!r}; please report it with the program that shows it", file=sys.stderr)
        sys.exit(1)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"ncomp {version('ncomp')}")
        raise typer.Exit


@app.callback()
def _global(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


def _classes(text: str | None, machine: Machine) -> frozenset[str] | None:
    from kinematics.classes import ORIENTATION, parse_classes

    chosen = None if text is None else parse_classes(text)
    if chosen and ORIENTATION in chosen and not machine.rotary.any():
        raise UserError(f"--classes {text}: machine {machine.name} has no rotary axis to correct the orientation with")
    return chosen


def _setup(machine: Machine, offsets: list[str] | None, lengths: list[str] | None, table: Path | None) -> Setup:
    from postproc.setup import make_setup
    from postproc.tool_table import read_tool_table

    return make_setup(machine, offsets or (), lengths or (), read_tool_table(table) if table else None)
