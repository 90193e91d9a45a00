"""`ncomp verify`: two programs in, the tool point's error before and after out."""

from __future__ import annotations

from typing import Annotated

import typer

import ncomp
from postproc.commands.options.program import (
    ConditionsOptions,
    DatumOptions,
    DialectName,
    Program,
)
from postproc.commands.options.shared import (
    CalibrationName,
    JsonFile,
    MachineName,
    check_places,
    result,
    write_json,
)
from postproc.text.source import open_source

EPILOG = (
    "Examples:\n\n`ncomp verify part.nc part_c.nc --machine dmu50 --json -`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --old old.json`\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration cal.json --align after.json`  would the machine "
    "as it was measured afterwards have cut the part right?\n\n"
    "`ncomp verify part.nc part_c.nc --machine gantry --calibration new.json --accept calibration`  corrected with "
    "another one"
)


def verify(
    *,
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
    set_up: DatumOptions,
    classes: Annotated[
        bool, typer.Option("--classes", help="Also show what each ISO/TR 16907 class would leave of the errors.")
    ] = False,
    tolerance_um: Annotated[
        float, typer.Option("--tolerance-um", min=0.0, help="That of the correction: half of it is no reversal.")
    ] = 1.0,
    at: ConditionsOptions,
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
    from postproc.correct.mark import PARTS
    from postproc.correct.plausibility import parse_accepted

    parse_accepted(accept, PARTS)
    check_places((program, corrected, calibration, old, align, *set_up.files, at.log), (json,))
    found = ncomp.load_machine(machine)
    model = ncomp.load_calibration(found, calibration)
    setup = set_up.setup(found)
    done = ncomp.verify(
        open_source(program),
        open_source(corrected),
        found,
        model,
        old=old or None,
        align=align or None,
        dialect=dialect,
        setup=setup,
        conditions=at.conditions(),
        classes=classes,
        tolerance_um=tolerance_um,
        accept=accept,
    )
    for assumption in done.assumptions:
        say_assumed(assumption)
    for note in done.notes:
        say("note", note)
    with result(json) as results:
        write_json(done.json(), results)
    to = console if json == "-" else output
    show_facts(done.datums.facts(setup.obtained), to)
    models = done.models.by_key()
    for key, (model, option) in models.items():
        title = ", ".join(filter(None, (f"by {model.id}", option))) if len(models) > 1 else ""
        show_verdict(done.verdicts[key], to, title, best_fit=align is not None)
    if done.classes:
        show_classes(done.classes, to)
