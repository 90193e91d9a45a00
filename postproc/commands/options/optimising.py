"""The options of `ncomp plan --optimise`, and the optimised plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from kinematics.user_error import UserError
from postproc.commands.options import strategy as options

if TYPE_CHECKING:
    from calibration.measurement.plan import Choices, Plan
    from calibration.optimal.candidates import Obstacle
    from kinematics.machine import Machine

PANEL = "Optimised"
Optimise = Annotated[
    bool,
    typer.Option(
        "--optimise",
        rich_help_panel=PANEL,
        help="Lay positions where they leave the least volumetric uncertainty, for --points or --minutes.",
    ),
]
Places = Annotated[
    list[str] | None,
    typer.Option(
        "--tracker",
        metavar="x,y,z",
        rich_help_panel=PANEL,
        help="Where the tracker may stand, mm, workpiece frame. Repeatable: the best is taken. Default: around it.",
    ),
]
Uncertainties = Annotated[
    list[str] | None,
    typer.Option(
        "--uncertainty",
        "-u",
        metavar="u_angle_um=10",
        rich_help_panel=PANEL,
        help="Standard uncertainties (k=1) of the tracker, by their keys in a measurement file. Repeatable.",
    ),
]
Elevation = Annotated[
    str | None,
    typer.Option(metavar="low:high", rich_help_panel=PANEL, help="Articulation of the tracker, degrees."),
]
Incidence = Annotated[
    float | None,
    typer.Option(metavar="deg", rich_help_panel=PANEL, help="Largest angle between beam and reflector's axis."),
]
Obstacles = Annotated[
    list[str] | None,
    typer.Option(
        "--obstacle",
        metavar="x=low:high,y=...,z=...",
        rich_help_panel=PANEL,
        help="A box, mm, workpiece frame, where no target may be and no beam may cross. Repeatable.",
    ),
]
Visible = Annotated[
    list[str] | None,
    typer.Option(
        "--visible",
        metavar="kind:field=value,...",
        rich_help_panel=PANEL,
        help="An effect of docs/effects.md that the measurement has to show, to 30 % of its typical size. Repeatable.",
    ),
]
Candidates = Annotated[
    int, typer.Option(metavar="N", min=100, max=20_000, rich_help_panel=PANEL, help="Positions to choose from.")
]


class Asked(NamedTuple):
    """Values of the options; None for those that were not given."""

    trackers: list[str] | None
    uncertainties: list[str] | None
    elevation: str | None
    incidence: float | None
    obstacles: list[str] | None
    visible: list[str] | None
    candidates: int

    def check(self, optimise: bool, **besides: object) -> None:
        """UserError for these options without `--optimise`, and for options that an optimised plan decides itself."""
        names = ("tracker", "uncertainty", "elevation", "incidence", "obstacle", "visible")
        for name, value in zip(names, self, strict=False):
            if value is not None and not optimise:
                raise UserError(f"--{name} is an option of --optimise")
        usual = {"order": "given", "approach": "any", "runs": 1, "references": 0}
        for name, given in besides.items():
            if optimise and given != usual.get(name):
                raise UserError(f"--{name} and --optimise: one or the other")
        if not optimise and besides["strategy"] is None:
            raise UserError("how are positions laid? --strategy NAME, or --optimise")


def optimised_plan(machine: Machine, choices: Choices, points: str | None, minutes: float | None, asked: Asked) -> Plan:
    """The plan; the terminal shows its predicted uncertainty."""
    from calibration.optimal.optimise import Wish, optimised
    from calibration.simulation.effect_text import read_effects
    from postproc.commands.options.virtual_instrument import instrument_of, reach_of, trackers_of
    from postproc.commands.show.terminal import console

    count = options.counts(points)
    if isinstance(count, list):
        raise UserError(f"--points {points}: --optimise takes one number")
    options.check_finite(minutes=minutes, incidence=asked.incidence)
    wish = Wish(
        choices,
        count,
        minutes,
        trackers_of(asked.trackers or ()),
        reach_of(asked.elevation, asked.incidence),
        [_obstacle(text) for text in asked.obstacles or ()],
        read_effects(asked.visible or [], machine, "--visible"),
        asked.candidates,
    )
    with console.status("optimising") as status:
        found = optimised(
            machine, instrument_of("laser-tracker", asked.uncertainties or [], False), wish, status.update
        )
    console.print(
        f"tracker      {','.join(f'{v:g}' for v in found.tracker)} (mm, workpiece frame)\n"
        f"expected     {found.expected_um:.2f} um RMS of volumetric error, where errors have their typical size"
    )
    for name, share in found.visible.items():
        console.print(f"visible      {name}: to {share:.0%} of its typical size (k = 1)")
    return found.plan


def _obstacle(text: str) -> Obstacle:
    from calibration.optimal.candidates import obstacle_of

    box: dict[str, tuple[float, float]] = {}
    for entry in text.split(","):
        letter, _, ends = entry.partition("=")
        low, high = options.numbers(ends, 2, f"--obstacle {text}", ":")
        if letter.strip() in box:
            raise UserError(f"--obstacle {text}: {letter.strip()} twice")
        box[letter.strip()] = (low, high)
    try:
        return obstacle_of(box)
    except UserError as fault:
        raise UserError(f"--obstacle {text}: {fault}") from None
