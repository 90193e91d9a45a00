"""`ncomp plan`: Plan a measurement: positions inside the travel, their order, the time it takes, and its NC program.

The earlier form `ncomp plan --strategy NAME` is `ncomp plan points`; with `--optimise`, with `--strategy on-the-fly` or
with `--instrument touch-probe` it is `optimised`, `path` or `spheres`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import option, output_option, refuse_given
from postproc.commands.options.shared import ResultOptions, whole_results
from postproc.commands.options.strategy import SEQUENCE

if TYPE_CHECKING:
    from calibration.measurement.plan import Plan, Timing
    from kinematics.machine import Machine
    from postproc.generate import ProgramSettings
    from rendering.report import Report

DWELL_S, FEED = 3.0, 2000.0
"""Default dwell at a point, s, by Montavon et al., 5.1; default feed, mm/min."""
EARLIER = {
    ("--instrument", "touch-probe"): "spheres",
    ("--strategy", "on-the-fly"): "path",
    ("--optimise",): "optimised",
    (): "points",
}
"""Options of the earlier form, without the name of what is planned, with that name."""
EPILOG = (
    "Examples:\n\n"
    "`ncomp plan points --machine bzt_pfu --strategy hexahedron+random --points 170+150 -o plan.csv --nc plan.nc`\n\n"
    "`ncomp plan optimised --machine gantry --minutes 120 -o plan.csv --nc plan.nc`\n\n"
    "`ncomp plan path --machine cframe --target t=0,0,-120 --length-m 21 --feed 2500 -o path.csv --nc path.nc`\n\n"
    "`ncomp plan spheres --machine dmu50 --points 34 --sphere s1=130,20,60 -o spheres.csv --nc spheres.ngc`\n\n"
    "`ncomp plan points --help`"
)
PlanFile = Annotated[
    str,
    output_option("File for the plan; `-` is standard output.", "PLAN.csv"),
]


def named(words: Sequence[str]) -> tuple[str, list[str]]:
    """The command of words of the earlier form, and its words; UserError for a name of nothing that is planned."""
    if words and not words[0].startswith("-"):
        *others, last = sorted(EARLIER.values())
        meant = did_you_mean(words[0], EARLIER.values())
        raise UserError(f"plan {words[0]}: expected {', '.join(others)} or {last}{meant}")
    for given, name in EARLIER.items():
        for form in ([*given], ["=".join(given)]):
            for i in range(len(words) + 1):
                if [*words[i : i + len(form)]] == form:
                    return f"plan {name}", [*words[:i], *words[i + len(form) :]]
    raise AssertionError("the last form has no words")


@dataclass(frozen=True, kw_only=True)
class PaceOptions:
    """Time at the points and between them."""

    dwell: float | None = option("Dwell at each point, s; default 3.", "s", min=0.0, panel=SEQUENCE)
    feed: float | None = option(
        "Feed between points, mm/min; default 2000. Without --dwell and --feed the plan counts 15 s for each point.",
        "mm/min",
        min=0.1,
        panel=SEQUENCE,
    )

    @property
    def dwell_s(self) -> float:
        """Dwell at each point, s."""
        return DWELL_S if self.dwell is None else self.dwell

    @property
    def feed_or_default(self) -> float:
        """Feed between points, mm/min."""
        return FEED if self.feed is None else self.feed

    def timing(self) -> Timing:
        """The duration of the measurement, by dwell and feed if one of them is given."""
        from calibration.measurement.plan import Timing

        timed = self.dwell is not None or self.feed is not None
        return Timing(dwell_s=self.dwell_s, feed=self.feed_or_default) if timed else Timing()


@dataclass(frozen=True, kw_only=True)
class ProgramOptions:
    """The NC program of a plan."""

    PANEL: ClassVar[str] = "NC program"

    nc: str | None = option(
        "File for the NC program of the measurement; `-` is standard output.", "PLAN.nc", writes="file"
    )
    dialect: Literal["iso", "linuxcnc", "fanuc", "heidenhain", "siemens"] | None = option(
        "Dialect of the program; iso is that of LinuxCNC (G53, G4 P in s). Default: the family of the machine file's "
        "control, or iso."
    )
    work_offset: str | None = option(
        "Work offset of the program, mm, so that ncomp can correct it. Default: machine coordinates, which ncomp does "
        "not correct.",
        "G54=x,y,z",
    )

    def refuse_without_effect(self, *used: str) -> None:
        """UserError for an option without a program; `used`: those that have an effect without one."""
        if self.nc is None:
            others = {"dialect", "work_offset", "rapid"}.difference(used)
            refuse_given("is an option of the NC program: give --nc too", self, *others)

    def control(self, machine: Machine) -> str:
        """Name of the dialect in which a measuring program is written; UserError for that of another control."""
        family = machine.control.family
        own = "fanuc" if family == "fanuc" else "iso"
        chosen = own if self.dialect is None else "iso" if self.dialect == "linuxcnc" else self.dialect
        if family != "any" and chosen in ("iso", "fanuc") and chosen != own:
            raise UserError(
                f"--dialect {self.dialect}: the machine file states family = {family} under [control], which reads "
                f"such programs otherwise: leave --dialect out, or give --dialect {family}"
            )
        return chosen

    def offset(self, machine: Machine) -> tuple[str, dict[str, float]] | None:
        """Name and values of the work offset, mm and degrees."""
        from postproc.control.setup import parse_work_offset

        return None if self.work_offset is None else parse_work_offset(self.work_offset, machine)


@dataclass(frozen=True, kw_only=True)
class MeasuringProgramOptions(ProgramOptions):
    """The NC program of a plan for a laser tracker."""

    rapid: bool = option("Move in rapid, not at the feed.", default=False)

    def settings(
        self, machine: Machine, feed: float, dwell_s: float = DWELL_S, together: bool = False
    ) -> ProgramSettings:
        """Feed, dwell, stops and coordinates of the program; together: all targets are mounted."""
        from postproc.generate import ProgramSettings

        return ProgramSettings(feed, dwell_s, self.rapid, "M1" if together else "M0", self.offset(machine))


def program_lines(made: Plan, settings: ProgramSettings, dialect: str) -> Iterable[str]:
    """The lines of the NC program of a plan with standstills."""
    from postproc.generate import MeasuringSequence, measuring_program

    scale = made.machine.scale
    before = None if made.before is None else made.before / scale
    assert made.state.target is not None
    stations = made.state.station if len(made.stations) > 1 else None
    sequence = MeasuringSequence(
        made.machine, made.positions / scale, before, made.names.tolist(), made.state.target.tolist(),
        () if stations is None else stations.tolist(),
    )  # fmt: skip
    return measuring_program(sequence, settings, dialect, f"ncomp measuring plan {made.strategy}")


def write(
    made: Plan,
    lines: Iterable[str],
    report: Report,
    program: ProgramOptions,
    output: str,
    others: ResultOptions,
    inputs: Iterable[str | None] = (),
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write a plan, the lines of its program and its results (with `more` of them), and show the report."""
    from calibration.measurement.plan_file import write_plan
    from postproc.commands.show.terminal import show

    results = {"strategy": made.strategy, "observations": len(made), "minutes": made.minutes, "notes": made.notes}
    results |= more or {}
    shown = msgspec.structs.replace(report, head=made.machine.report.filled(machine=made.machine.name))
    with whole_results(program.nc, output, *others.files) as (file, table, *files):
        write_plan(made, table)
        others.write(results, shown, tuple(files), inputs)
        if program.nc is not None:
            file.writelines(f"{line}\n".encode() for line in lines)
    show(shown, "-")
