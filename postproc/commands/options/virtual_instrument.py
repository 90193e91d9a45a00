"""The options of virtual instruments, which simulations share: kind, uncertainties, faults and tracker positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from kinematics.user_error import UserError
from postproc.commands.options import strategy as options
from postproc.text.number_style import given_once

if TYPE_CHECKING:
    from calibration.measurement.instruments import Instrument
    from calibration.observation.reach import Reach

INSTRUMENT, FAULTS = "The instrument", "What goes wrong"

InstrumentKind = Annotated[
    str, typer.Option(metavar="KIND", rich_help_panel=INSTRUMENT, help="laser-tracker, interferometer or part.")
]
ErrorMotions = Annotated[
    str | None,
    typer.Option(
        metavar="all|Y,Z,B",
        rich_help_panel=INSTRUMENT,
        help="Error motions of linear axes that an interferometer observes at each position: X is E_X of each axis; "
        "default: the positioning deviation.",
    ),
]
Uncertainties = Annotated[
    list[str] | None,
    typer.Option(
        "--uncertainty",
        "-u",
        metavar="u_angle_um=10",
        rich_help_panel=INSTRUMENT,
        help="Standard uncertainties (k=1), by their keys in a measurement file; all others are zero. Repeatable.",
    ),
]
TrackerPlaces = Annotated[
    list[str] | None,
    typer.Option(
        metavar="x,y,z",
        rich_help_panel=INSTRUMENT,
        help="Where it stands, mm, in the workpiece frame (on the bed: machine frame). Repeatable: stations.",
    ),
]
StandsOn = Annotated[
    str, typer.Option(metavar="workpiece|bed", rich_help_panel=INSTRUMENT, help="On the table, or on the floor.")
]
Elevation = Annotated[
    str | None,
    typer.Option(metavar="low:high", rich_help_panel=INSTRUMENT, help="Articulation of the tracker, degrees."),
]
Incidence = Annotated[
    float | None,
    typer.Option(metavar="deg", rich_help_panel=INSTRUMENT, help="Largest angle between beam and reflector's axis."),
]
Planar = Annotated[bool, typer.Option("--planar", rich_help_panel=INSTRUMENT, help="A part measured in x and y only.")]
NoiseScale = Annotated[
    float, typer.Option(min=0.0, rich_help_panel=INSTRUMENT, help="Noise, times the uncertainties; 0 is none.")
]
Outliers = Annotated[
    float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="50 to 500 um off.")
]
Duplicates = Annotated[
    float,
    typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that stand there twice."),
]
Missing = Annotated[
    float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that are not there.")
]


def instrument_of(kind: str, uncertainties: list[str], planar: bool) -> Instrument:
    """An instrument with these uncertainties, or those of its specification; UserError for unknown ones."""
    import msgspec

    from calibration.measurement.file import KINDS, check_uncertainties, uncertainty_keys
    from calibration.simulation.measure_plan import SPECIFICATIONS

    if kind not in SPECIFICATIONS:
        raise UserError(f"--instrument {kind}: expected one of {', '.join(SPECIFICATIONS)}")
    components = {"components": 2 if planar else 3} if kind == "part" else {}
    if not uncertainties:
        return msgspec.structs.replace(SPECIFICATIONS[kind], **components)
    known = uncertainty_keys(KINDS[kind])
    given: list[tuple[str, float]] = []
    for text in uncertainties:
        name, _, value = text.partition("=")
        if name.strip() not in known:
            raise UserError(f"--uncertainty {text}: {kind} has {', '.join(known)}")
        (number,) = options.numbers(value, 1, f"--uncertainty {text}")
        if number < 0:
            raise UserError(f"--uncertainty {text}: negative")
        given.append((name.strip(), number))
    values = given_once(given, "--uncertainty ")
    check_uncertainties(kind, values, "--uncertainty", "-u {}=...")
    return KINDS[kind](**values, **components)  # type: ignore[arg-type]


def error_motions_of(text: str | None, kind: str) -> tuple[str, ...]:
    """Letters of the error motions in `all` or in a list; empty for None."""
    from kinematics.effects import COMPONENTS

    if text is None:
        return ()
    if kind != "interferometer":
        raise UserError(f"--error-motions is no option of --instrument {kind}")
    letters = tuple(COMPONENTS)
    if text != "all":
        letters = tuple(letter.strip().upper() for letter in text.split(","))
    for letter in letters:
        if letter not in COMPONENTS or letters.count(letter) > 1:
            raise UserError(f"--error-motions {text}: expected all, or some of {','.join(COMPONENTS)}, each once")
    return letters


def standing_of(text: str) -> Literal["workpiece", "bed"]:
    """The foundation of the tracker, from `workpiece` or `bed`; UserError for another text."""
    from calibration.measurement.states import STANDS_ON

    if text not in STANDS_ON:
        raise UserError(f"--stands-on {text}: expected workpiece or bed")
    return STANDS_ON[text]


def trackers_of(texts: Sequence[str]) -> list[tuple[float, float, float]]:
    """Positions of trackers, mm, from `x,y,z`."""
    found = []
    for text in texts:
        x, y, z = options.numbers(text, 3, f"--tracker {text}")
        found.append((x, y, z))
    return found


def reach_of(elevation: str | None, incidence: float | None) -> Reach | None:
    """The reach of a tracker, from `low:high` and an angle, degrees; None without limits."""
    from calibration.observation.reach import Reach

    if elevation is None and incidence is None:
        return None
    limits = None
    if elevation is not None:
        low, high = options.numbers(elevation, 2, f"--elevation {elevation}", ":")
        limits = (low, high)
    return Reach(limits, incidence)
