"""The options of virtual machines, which all simulations share: their errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinematics.user_error import UserError
from postproc.text.number_style import given_once

if TYPE_CHECKING:
    import numpy as np

    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

PANEL = "The machine's errors"

TruthFile = Annotated[
    str | None, typer.Option(metavar="TRUTH.json", help="Write the errors as a calibration, to compare with.")
]
Errors = Annotated[
    str | None,
    typer.Option(
        metavar="table-1|none|WIDTHS.toml",
        rich_help_panel=PANEL,
        help="Error motions at random: half-widths as in the virtual calibration paper, or a table of "
        "E_XX = [a0, a1, n, b, c, ...]. Default: table-1, or none with --calibration.",
    ),
]
TruthCalibration = Annotated[
    Path | None,
    typer.Option("--calibration", "-c", metavar="CAL.json", rich_help_panel=PANEL, help="These errors too."),
]
Location = Annotated[
    float,
    typer.Option(
        metavar="um", min=0.0, rich_help_panel=PANEL, help="Location errors at random, up to so many um, urad."
    ),
]
EffectTexts = Annotated[
    list[str] | None,
    typer.Option(
        metavar="kind:field=value,...",
        rich_help_panel=PANEL,
        help="An effect of docs/effects.md, or a JSON file of effects. Repeatable.",
    ),
]
Temperatures = Annotated[
    list[str] | None,
    typer.Option(metavar="name=start:end", rich_help_panel=PANEL, help="Course of a temperature, degC. Repeatable."),
]


def virtual_model(
    machine: Machine,
    errors: str | None,
    calibration: Path | None,
    location: float,
    effects: list[Effect],
    rng: np.random.Generator,
) -> ErrorModel:
    """The errors of the virtual machine: from options, from a calibration, and at random."""
    from calibration.simulation.true_model import (
        DEFAULT,
        model_of,
        random_location_errors,
        random_truth,
        read_half_widths,
    )
    from kinematics.error_model.model import read_model

    found = [] if calibration is None else list(read_model(calibration, machine).effects)
    errors = errors or ("table-1" if calibration is None else "none")
    if errors != "none":
        widths = DEFAULT if errors == "table-1" else read_half_widths(Path(errors))
        found += random_truth(machine, rng, widths).effects
    if location:
        found += random_location_errors(machine, rng, location)
    return model_of(machine, [*found, *effects])


def courses_of(texts: list[str]) -> dict[str, tuple[float, float]]:
    """Start and end of temperatures by name, K from 20 degC."""
    from calibration.measurement.states import PLAIN_NAME
    from kinematics.state import REFERENCE
    from postproc.compensation.conditions import degrees

    found = []
    for text in texts:
        where = f"--temperature {text}"
        name, _, course = text.partition("=")
        ends = course.split(":")
        if not PLAIN_NAME.fullmatch(name) or len(ends) != 2:
            raise UserError(f"{where}: expected NAME=start:end, e.g. spindle=20:28.5")
        start, end = (degrees(each, where) for each in ends)
        found.append((name, (start - REFERENCE, end - REFERENCE)))
    return given_once(found, "--temperature ")
