"""`ncomp plan points`: positions of a measurement by a strategy, and their order, as a table and as an NC program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import ncomp
from postproc.commands.measurements.plan import MeasuringProgramOptions, PaceOptions, PlanFile, program_lines, write
from postproc.commands.options.declared import REQUIRED, option, refuse_given
from postproc.commands.options.shared import MachineName, ResultOptions
from postproc.commands.options.strategy import POSITIONS, SEQUENCE, StrategyOptions

if TYPE_CHECKING:
    from kinematics.machine import Machine

EPILOG = (
    "Strategies: planes, hexahedron (edges), diagonals, face-diagonals, space-diagonals, grid, random, space-filling, "
    "axes (each axis alone, in both directions: ISO 230-2), rectangles (sides and diagonals in each plane, for a "
    "ruler: two rows for each length).\n\n"
    "Examples:\n\n"
    "`ncomp plan points --machine bzt_pfu --strategy hexahedron+random --points 170+150 -o plan.csv --nc plan.nc`\n\n"
    "`ncomp plan points --machine dmu50 --strategy space-filling --rotary simultaneous --order shuffled "
    "--target t1=0,0,-120 --target t2=90,40,-180 --target-order alternating -o plan.csv`\n\n"
    "`ncomp plan points --machine gantry --strategy axes --spacing 200 --runs 5 -o plan.csv --nc plan.nc --feed 3000`"
)


@dataclass(frozen=True, kw_only=True)
class PointsOptions(StrategyOptions, PaceOptions):
    """Positions, their sequence, the approach to each, and the time at them."""

    strategy: str = option(
        "Strategy of the positions, one of those below, or several joined by +.",
        "NAME[+NAME...]",
        default=REQUIRED,
        panel=POSITIONS,
    )
    planes_at: float = option(
        "Position of planes on the axis across them: 0 is its low end, 1 its high end.", default=1.0, panel=POSITIONS
    )
    rotary_points: int = option(
        "Number of positions of a rotary axis that is swept or measured alone.", default=13, panel=POSITIONS
    )
    approach: Literal["any", "positive", "negative"] = option(
        "Direction from which all axes approach each position.", default="any", panel=SEQUENCE
    )
    overrun: float = option(
        "Distance of the approach from one direction, mm and degrees.", "mm", default=1.0, panel=SEQUENCE
    )
    references: int = option(
        "Number of positions between measurements of a reference position, also at start and end; 0: none.",
        "N",
        default=0,
        panel=SEQUENCE,
    )

    def refuse_without_effect(self, machine: Machine) -> None:
        """UserError for an option that this strategy, or this machine, does not use."""
        super().refuse_without_effect(machine)
        if "planes" not in self.parts:
            refuse_given("is an option of --strategy planes", self, "planes_at")
        if self.rotary != "swept" and "axes" not in self.parts:
            refuse_given("is an option of --rotary swept and of --strategy axes", self, "rotary_points")
        if self.approach == "any":
            refuse_given("has no effect without --approach positive or negative", self, "overrun")


def plan_points(
    *,
    machine: MachineName,
    output: PlanFile,
    positions: PointsOptions,
    program: MeasuringProgramOptions,
    others: ResultOptions,
) -> None:
    """Plan positions by a strategy: a pattern, a grid, random points, or each axis alone."""
    from calibration.reports.plan import plan_report

    program.refuse_without_effect()
    found = ncomp.load_machine(machine)
    choices = positions.choices(found, positions.timing())
    together = positions.target_order == "alternating"
    settings = program.settings(found, positions.feed_or_default, positions.dwell_s, together)
    dialect = program.control(found)
    made = positions.plan(found, choices)
    write(made, program_lines(made, settings, dialect), plan_report(made), program, output, others)
