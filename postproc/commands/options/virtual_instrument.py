"""The options of virtual instruments, which simulations share: what they are, and where a tracker stands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from kinematics.user_error import UserError
from postproc.commands.options import strategy as options
from postproc.text.number_style import given_once

if TYPE_CHECKING:
    import numpy as np

    from calibration.measurement.instruments import Instrument
    from calibration.measurement.measurement import Measurement
    from kinematics.effects import Effect
    from kinematics.machine import Machine
    from kinematics.transforms import Array, Pose

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

SHEETS: Mapping[str, Mapping[str, float]] = {
    "laser-tracker": {"u_range_um_per_m": 0.25, "u_angle_um": 10.0, "u_angle_um_per_m": 2.5},
    "interferometer": {"u_um": 0.2, "u_um_per_m": 0.5, "u_straightness_um": 0.5, "u_angle_urad": 1.0},
    "part": {"u_um": 1.0, "u_um_per_m": 1.5},
}
"""Standard uncertainties unless others are given: of the tracker those of the virtual calibration paper, Table 3."""
AWAY_MM = 1500.0
"""From the volume to a tracker of which nothing is said."""
NEAREST_MM = 1.0
"""A target closer to a tracker has no direction."""


def instrument_of(kind: str, uncertainties: list[str], planar: bool) -> Instrument:
    """An instrument with these uncertainties, or those of its sheet; UserError for what it does not have."""
    from calibration.measurement.file import KINDS, check_uncertainties, uncertainty_keys

    if kind not in SHEETS:
        raise UserError(f"--instrument {kind}: expected one of {', '.join(SHEETS)}")
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
    values = given_once(given, "--uncertainty ") if given else SHEETS[kind]
    check_uncertainties(kind, values, "--uncertainty", "-u {}=...")
    return KINDS[kind](**values, **({"components": 2 if planar else 3} if kind == "part" else {}))  # type: ignore[arg-type]


def error_motions_of(text: str | None, kind: str) -> tuple[str, ...]:
    """Letters of the error motions in `all` or a list; none without."""
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
    """What it stands on."""
    from calibration.measurement.states import STANDS_ON

    if text not in STANDS_ON:
        raise UserError(f"--stands-on {text}: expected workpiece or bed")
    return STANDS_ON[text]


def tracker_poses(
    machine: Machine, positions: Array, trackers: Sequence[str], rng: np.random.Generator
) -> dict[str, Pose]:
    """Poses of a tracker by station, at the places `x,y,z`, or beside the volume of the positions `(n, axes)`."""
    from calibration.simulation.simulate import tracker_pose
    from postproc.commands.show.terminal import say

    places = [options.numbers(text, 3, f"--tracker {text}") for text in trackers]
    if not places:
        places = [_beside(machine, positions)]
        said = ",".join(f"{v:g}" for v in places[0])
        say("note", f"the tracker stands 1.5 m before the volume, at its middle: --tracker {said}")
    return {f"s{k}": tracker_pose((x, y, z), rng) for k, (x, y, z) in enumerate(places, start=1)}


def check_distance(measured: Measurement) -> None:
    """UserError for a target inside the tracker."""
    import numpy as np

    far = np.linalg.norm(measured.observed, axis=1) >= NEAREST_MM
    if not far.all():
        row = int(np.argmin(far))
        assert measured.state.station is not None
        raise UserError(
            f"--tracker: observation {row + 1} is closer than {NEAREST_MM:g} mm to the tracker at "
            f"{measured.state.station[row]}; it can't stand there"
        )


def _beside(machine: Machine, positions: Array) -> tuple[float, ...]:
    from kinematics.forward import tool_point

    points = tool_point(machine, positions)
    low, high = points.min(axis=0), points.max(axis=0)
    _, y, z = ((low + high) / 2).round().tolist()
    return float(round(low[0] - AWAY_MM)), y, z


def check_names(effects: Sequence[Effect], targets: Iterable[str], stations: Iterable[str]) -> None:
    """UserError for an effect of a target or a station that the measurement does not have."""
    for effect in effects:
        for what, names in (("target", list(targets)), ("station", list(stations))):
            name = getattr(effect, what, None)
            if name is not None and name not in names:
                there = f"known are {', '.join(names)}" if names else "there is none"
                raise UserError(f"--effect {effect.name}: no {what} {name!r}; {there}")
