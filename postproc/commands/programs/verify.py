"""`ncomp verify`: two programs in, the tool point's error before and after out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from postproc.commands.options.program import (
    ConditionsLog,
    Datums,
    DialectName,
    Elapsed,
    Program,
    SetUpZero,
    Temperatures,
    ToolLengths,
    ToolTable,
    WorkOffsets,
    setup_of,
)
from postproc.commands.options.shared import (
    CalibrationName,
    JsonFile,
    MachineName,
    check_places,
    machine_of,
    model_of,
    result,
    write_json,
)

if TYPE_CHECKING:
    from kinematics.error_model.model import ErrorModel
    from postproc.correct.mark import Mark

EPILOG = (
    "Examples:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --old old.json`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration cal.json --align after.json`  would the machine "
    "as it was measured afterwards have cut the part right?\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --accept calibration`  corrected with "
    "another one"
)


def verify(
    program: Program,
    corrected: Annotated[str, typer.Argument(metavar="OUT.nc", help="The corrected program.")],
    machine: MachineName,
    calibration: CalibrationName = None,
    old: Annotated[
        str | None,
        typer.Option("--old", metavar="CAL.json|none", help="An earlier calibration: the errors by its model as well."),
    ] = None,
    align: Annotated[
        str | None,
        typer.Option(
            "--align",
            metavar="TRUE.json",
            help="A second calibration as truth: errors by its model, aligned at its own datum, and best fit.",
        ),
    ] = None,
    dialect: DialectName = "auto",
    work_offset: WorkOffsets = None,
    datum: Datums = None,
    tool_length: ToolLengths = None,
    tool_table: ToolTable = None,
    set_up_zero: SetUpZero = False,
    classes: Annotated[
        bool, typer.Option("--classes", help="Also show what each ISO/TR 16907 class would leave of the errors.")
    ] = False,
    tolerance_um: Annotated[
        float, typer.Option("--tolerance-um", min=0.0, help="That of the correction: half of it is no reversal.")
    ] = 1.0,
    temperature: Temperatures = None,
    elapsed: Elapsed = None,
    log: ConditionsLog = None,
    accept: Annotated[
        str | None,
        typer.Option(
            "--accept",
            metavar="NAME,...",
            help="Go on although the program was corrected with another one: calibration, set-up, datum.",
        ),
    ] = None,
    json: JsonFile = None,
) -> None:
    """Tool point error of a program before and after correction, by the exact model, from the two texts alone."""
    from postproc.commands.show.terminal import (
        console,
        output,
        say,
        say_assumed,
        show_classes,
        show_facts,
        show_verdict,
    )
    from postproc.compensation.conditions import make_conditions
    from postproc.compensation.predicted_error import in_a_program, standing_notes
    from postproc.compensation.used_datums import UsedDatums
    from postproc.correct.classes import class_table
    from postproc.correct.mark import PARTS, mark_in_program, mark_of
    from postproc.correct.plausibility import parse_accepted
    from postproc.correct.verify import run_motions
    from postproc.correct.verify import verify as judged
    from postproc.dialects import find_dialect
    from postproc.motion.motions import merged
    from postproc.text.notes import Notes
    from postproc.text.source import open_source

    accepted = parse_accepted(accept, PARTS)
    check_places((program, corrected, calibration, old, align, *(tool_table or ()), log), (json,))
    found = machine_of(machine)
    model = model_of(calibration, found)
    setup = setup_of(found, work_offset, tool_length, tool_table, datum, zero=set_up_zero)
    conditions = make_conditions(temperature or (), elapsed, log)
    earlier = model_of(old, found) if old else None
    truth = model_of(align, found) if align else model
    notes = standing_notes(truth, conditions)
    motions, states = [], []
    for name in (program, corrected):
        source = open_source(name)
        language = find_dialect(dialect, source.name, source.text_head)
        interpreter = language.interpreter(found, setup, Notes())
        motions.append(merged(run_motions(source, language, interpreter)))
        states.append(interpreter.control_state)
    notes += _mark_notes(corrected, mark_in_program(source), mark_of(model, states[0]), earlier, accepted)
    judges = {"": (truth, "--align" if align else "")}
    judges |= {"by_calibration": (model, "--calibration")} if align else {}
    judges |= {"by_old_model": (earlier, "--old")} if earlier else {}
    verdicts = {key: judged(motions[0], motions[1], by, conditions, tolerance_um) for key, (by, _) in judges.items()}
    datums = UsedDatums(setup)
    datums.add(motions[0])
    datums.predict(found, truth.part(in_a_program), conditions)
    for assumption in dict.fromkeys(state.assumption() for state in states):
        say_assumed(assumption)
    for note in (*notes, *datums.notes()):
        say("note", note)
    table = class_table(motions[0], truth, conditions) if classes else []
    with result(json) as results:
        others = {key: verdict.json() for key, verdict in verdicts.items() if key}
        rest = {"datum": datums.json(setup.obtained), "classes": [left.json() for left in table]}
        write_json(verdicts[""].json() | others | rest, results)
    to = console if json == "-" else output
    show_facts(datums.facts(setup.obtained), to)
    for key, (by, option) in judges.items():
        title = ", ".join(filter(None, (f"by {by.id}", option))) if len(judges) > 1 else ""
        show_verdict(verdicts[key], to, title, best_fit=align is not None)
    if table:
        show_classes(table, to)


def _mark_notes(
    name: str, mark: Mark | None, here: Mark, earlier: ErrorModel | None, accepted: frozenset[str]
) -> list[str]:
    """Notes on the mark of a corrected program; UserError, by name, if its set-up differs from `here`."""
    from postproc.correct.mark import check_mark

    if mark is None:
        return [f"{name} has no mark of ncomp: the calibration and the set-up of its correction are not known"]
    if earlier is not None and mark.calibration == earlier.id.upper():
        here = here._replace(calibration=mark.calibration)
    return check_mark(name, mark, here, accepted)
