"""`ncomp verify`: two programs in, the tool point's error before and after out."""

from __future__ import annotations

from typing import Annotated

import typer

from postproc.commands.program import (
    ConditionsLog,
    Datums,
    DialectName,
    Elapsed,
    Program,
    Temperatures,
    ToolLengths,
    ToolTable,
    WorkOffsets,
    setup_of,
)
from postproc.commands.shared import (
    CalibrationName,
    JsonFile,
    MachineName,
    check_places,
    machine_of,
    model_of,
    result,
    write_json,
)

EPILOG = (
    "Examples:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --old old.json`"
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
            help="A second calibration as truth: the errors by its model, aligned at the datum touched off by it.",
        ),
    ] = None,
    dialect: DialectName = "auto",
    work_offset: WorkOffsets = None,
    datum: Datums = None,
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
    from postproc.judge import in_a_program, standing_notes
    from postproc.mark import calibration_of
    from postproc.source import open_source
    from postproc.terminal import console, output, say, show_classes, show_facts, show_verdict
    from postproc.used_datums import UsedDatums
    from postproc.verify import merged, read_motions
    from postproc.verify import verify as judged

    check_places((program, corrected, calibration, old, align, *(tool_table or ()), log), (json,))
    found = machine_of(machine)
    model = model_of(calibration, found)
    setup = setup_of(found, work_offset, tool_length, tool_table, datum)
    conditions = make_conditions(temperature or (), elapsed, log)
    earlier = model_of(old, found) if old else None
    truth = model_of(align, found) if align else model
    notes = standing_notes(truth, conditions)
    motions = []
    for name in (program, corrected):
        source = open_source(name)
        language = find_dialect(dialect, source.name, source.text_head)
        motions.append(merged(read_motions(source, language, found, setup)))
    judges = {"": (truth, "--align" if align else "")}
    judges |= {"by_calibration": (model, "--calibration")} if align else {}
    judges |= {"by_old_model": (earlier, "--old")} if earlier else {}
    verdicts = {key: judged(motions[0], motions[1], by, conditions, tolerance_um) for key, (by, _) in judges.items()}
    datums = UsedDatums(setup)
    datums.add(motions[0])
    datums.predict(found, truth.part(in_a_program), conditions)
    for note in notes:
        say("note", note)
    marked = calibration_of(source)
    if marked != model.id.upper():
        say("note", f"{corrected} bears the mark of calibration {marked or 'none'}; it is judged with {model.id}")
    table = class_table(motions[0], truth, conditions) if classes else []
    with result(json) as results:
        others = {key: verdict.json() for key, verdict in verdicts.items() if key}
        rest = {"datum": datums.json(setup.obtained), "classes": [left.json() for left in table]}
        write_json(verdicts[""].json() | others | rest, results)
    to = console if json == "-" else output
    show_facts(datums.facts(setup.obtained), to)
    for key, (by, option) in judges.items():
        title = ", ".join(filter(None, (f"by {by.id}", option))) if len(judges) > 1 else ""
        show_verdict(verdicts[key], to, title)
    if table:
        show_classes(table, to)
