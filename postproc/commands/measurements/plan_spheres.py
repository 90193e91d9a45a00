"""`ncomp plan spheres`: rotary positions at which spheres are measured, and the probing program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.running.progress import Progress
from kinematics.user_error import UserError
from postproc.commands.measurements.plan import FEED, PlanFile, ProgramOptions
from postproc.commands.options.declared import option
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results
from postproc.commands.options.strategy import POSITIONS, SEQUENCE, VolumeOptions
from postproc.commands.options.virtual_instrument import Distance, UncertaintyOptions, spheres_of
from rendering.report import Report, Section, Table, facts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibration.fit.identifiability import Unidentifiable
    from calibration.measurement.plan import Choices
    from calibration.probing.bodies import Artefact, Probe
    from calibration.probing.plan import ProbePlan
    from calibration.probing.predicted import Predicted
    from kinematics.machine import Machine
    from postproc.probing.sequence import ProbingSettings

EPILOG = (
    "Examples:\n\n"
    "`ncomp plan spheres --machine dmu50 --points 34 --sphere s1=130,20,60 --sphere s2=-110,60,50 -o spheres.csv "
    "--nc spheres.ngc --dialect linuxcnc`\n\n"
    "`ncomp plan spheres --machine trunnion_ac --strategy bk --points 32 --range A=-90:0 -o bk.csv`"
)
TIP = (0.0, 0.0, -150.0)
"""Tip of the probe from the spindle nose if none is stated, mm."""
DEFAULT_SPHERES = 3
RETRACT_SHARE = 0.2
"""Way back between both touches, as a share of the clearance."""


@dataclass(frozen=True, kw_only=True)
class RotaryPositionOptions(VolumeOptions):
    """Rotary positions at which the spheres are measured."""

    strategy: str = option(
        "Strategy of the rotary positions: optimised, grid, bk, samba, random.",
        "NAME",
        default="optimised",
        panel=POSITIONS,
    )
    points: int = option("Number of rotary positions.", default=34, panel=POSITIONS)
    references: int = option(
        "Number of positions between measurements of the first one, also at the end; 0: at the end only.",
        "N",
        default=0,
        panel=SEQUENCE,
    )
    feed: float = option("Feed between spheres, mm/min.", "mm/min", default=FEED, min=0.1, panel=SEQUENCE)


@dataclass(frozen=True, kw_only=True)
class SphereOptions(UncertaintyOptions):
    """A touch probe and spheres on the table."""

    PANEL: ClassVar[str] = "Touch probe and spheres"

    sphere: tuple[str, ...] = option(
        "Sphere on the table, mm, in the workpiece frame with all axes at 0, to 2 mm. Default: three spheres about the "
        "middle of the table.",
        "s1=x,y,z",
    )
    distance: Distance
    dimensions: str | None = option(
        "Diameters and lengths, mm, of sphere (ball=25), its stem (stem=8, stem_length=60), the probe's tip (tip=6), "
        "stylus (stylus=4, free_length=40) and body (body=50).",
        "ball=25,tip=6,...",
    )
    clearance: float = option("Gap at which the approach to a touch begins, mm.", "mm", default=5.0, min=2.5, max=50.0)
    probing_feed: float = option("Feed of the first touch, mm/min.", "mm/min", default=200.0, min=1.0)
    measuring_feed: float = option("Feed of the second touch, which counts, mm/min.", "mm/min", default=30.0, min=0.1)

    def planned(
        self, machine: Machine, positions: RotaryPositionOptions, choices: Choices, progress: Progress
    ) -> ProbePlan:
        """The plan of these spheres at positions of the rotary axes."""
        from calibration.probing.plan import Feeds, ProbeRequest, probe_plan
        from calibration.probing.touches import Approach

        probe, artefact = self._bodies(machine, choices)
        u_um = self.instrument_of("touch-probe").u_um  # type: ignore[union-attr]
        request = ProbeRequest(
            probe, artefact, positions.strategy, positions.points, choices.ranges, positions.references,
            Approach(self.clearance, min(3.0, self.clearance)),
            Feeds(positions.feed, self.probing_feed, self.measuring_feed), u_um, choices.seed,
        )  # fmt: skip
        return probe_plan(machine, request, progress)

    def predicted(self, found: ProbePlan) -> Predicted:
        """Errors that the plan cannot show, and the uncertainties of location errors."""
        from calibration.probing.predicted import predicted

        return predicted(found.plan, found.request.u_um, self._distances(found))

    def settings(self, feed: float, offset: tuple[str, Mapping[str, float]] | None) -> ProbingSettings:
        """Feeds and work offset of the program."""
        from postproc.probing.sequence import ProbingSettings

        return ProbingSettings(feed, self.probing_feed, self.measuring_feed, RETRACT_SHARE * self.clearance, offset)

    def _distances(self, found: ProbePlan) -> Mapping[tuple[str, str], float]:
        stated = spheres_of((), self.distance).distances
        for pair in stated:
            for name in pair:
                if name not in found.plan.spheres:
                    raise UserError(f"--distance {'.'.join(pair)}: there is no sphere {name!r}")
        return stated

    def _bodies(self, machine: Machine, choices: Choices) -> tuple[Probe, Artefact]:
        from calibration.measurement.measurement import SPINDLE_NOSE
        from calibration.probing.bodies import Artefact, Probe
        from calibration.probing.plan import default_spheres

        targets = list(choices.targets.values())
        if len(targets) > 1 or targets[0].carrier != "tool":
            raise UserError("--target: a touch probe has one target, its tip from the spindle nose (probe=0,0,-150)")
        tip = TIP if targets == [SPINDLE_NOSE] else targets[0].position
        stated = spheres_of(self.sphere, ()).centres
        offset = machine.work_offsets.get("default", {})
        centres = stated or default_spheres(machine, DEFAULT_SPHERES, offset)
        sizes = self._sizes()
        artefact = {name: sizes[name] for name in ("ball", "stem", "stem_length") if name in sizes}
        probe: dict[str, float] = {name: sizes[name] for name in ("stylus", "free_length", "body") if name in sizes}
        if "tip" in sizes:
            probe["ball"] = sizes["tip"]
        return Probe(tip, **probe), Artefact(centres, **artefact)

    def _sizes(self) -> dict[str, float]:
        known = {"ball", "stem", "stem_length", "tip", "stylus", "free_length", "body"}
        found: dict[str, float] = {}
        for entry in self.dimensions.split(",") if self.dimensions else ():
            name, _, value = (part.strip() for part in entry.partition("="))
            if name not in known or name in found:
                raise UserError(f"--dimensions {entry}: expected each of {', '.join(sorted(known))} once, as ball=25")
            (found[name],) = numbers(value, 1, f"--dimensions {entry}")
            if found[name] <= 0.0:
                raise UserError(f"--dimensions {entry}: expected a size above zero, mm")
        return found


def plan_spheres(
    *,
    machine: MachineName,
    output: PlanFile,
    positions: RotaryPositionOptions,
    spheres: SphereOptions,
    program: ProgramOptions,
    others: ResultOptions,
) -> None:
    """Plan the centres of spheres that a touch probe measures at positions of the rotary axes, and their program."""
    from calibration.measurement.plan_file import write_plan
    from postproc.commands.show.terminal import console, say, show
    from postproc.probing.program import mask_of

    program.refuse_without_effect()
    of = ncomp.load_machine(machine)
    choices, dialect = positions.choices(of), program.control(of)
    control = "linuxcnc" if dialect == "iso" else dialect
    settings = spheres.settings(positions.feed, program.offset(of))
    with console.status("positions within reach") as status:
        found = spheres.planned(of, positions, choices, status.update)
        predicted = spheres.predicted(found)
    nc, mask = program.nc, mask_of(control, of)
    lines = probing_lines(found, settings, control) if nc is not None else iter(())
    beside = str(Path(nc).with_name("ncomp.a")) if mask and nc not in (None, "-") else None
    report = msgspec.structs.replace(spheres_report(found, predicted), head=of.report.filled(machine=of.name))
    for note in found.notes:
        say("note", note)
    if nc == "-" and mask:
        say("note", "the mask of FN 16, ncomp.a, is written beside a program in a file only")
    with whole_results(nc, output, beside, *others.files) as (file, rows, form, *files):
        write_plan(found.plan, rows)
        others.write(spheres_json(found, predicted), report, tuple(files), ())
        file.writelines(f"{line}\n".encode() for line in lines)
        form.write((mask or "").encode())
    show(report, "-")


def probing_lines(found: ProbePlan, settings: ProbingSettings, control: str) -> Iterator[str]:
    """The lines of the probing program of a plan."""
    from calibration.measurement.plan_file import plan_id
    from postproc.probing.program import probing_program
    from postproc.probing.sequence import ProbingSequence

    plan, moves = found.plan, found.moves
    assert plan.state.station is not None
    rows = [f"{point} {sphere}" for point, sphere in zip(plan.names, plan.state.station, strict=True)]
    sequence = ProbingSequence(
        plan.machine, moves.positions / plan.machine.scale, moves.touch, moves.row + 1, rows, plan_id(plan)
    )
    return probing_program(sequence, settings, control, f"ncomp probing program {plan.strategy}")


def spheres_json(found: ProbePlan, predicted: Predicted) -> dict[str, Any]:
    """The plan for programs."""
    from calibration.measurement.plan_file import plan_id

    machine, park = found.plan.machine, found.park / found.plan.machine.scale
    return {
        "strategy": found.plan.strategy,
        "plan_id": plan_id(found.plan),
        "rotary_positions": found.plan.position_count,
        "centres": len(found.plan),
        "touches": int((found.moves.touch > 0).sum()),
        "minutes": found.plan.minutes,
        "spheres": {name: list(centre) for name, centre in found.plan.spheres.items()},
        "parking_position": {a.name: float(p) for a, p in zip(machine.axes, park, strict=True) if not a.rotary},
        "expected_um": found.expected_um,
        "location_errors_U": dict(predicted.uncertainty),
        "location_errors_U_good_linear_axes": dict(predicted.uncertainty_small),
        "parameters": predicted.parameters,
        "rank": predicted.rank,
        "not_visible": [
            {"effects": list(each.effects), "reason": each.reason, "remedy": each.remedy}
            for each in predicted.unidentifiable
        ],
        "notes": list(found.notes),
    }


def spheres_report(found: ProbePlan, predicted: Predicted) -> Report:
    """The plan for people."""
    machine = found.plan.machine
    park = zip(machine.axes, (found.park / machine.scale).tolist(), strict=True)
    rows = [
        *((f"sphere {name}", ", ".join(f"{v:g}" for v in c) + " mm") for name, c in found.plan.spheres.items()),
        ("parking position", " ".join(f"{axis.name}{value:.3f}" for axis, value in park if not axis.rotary)),
        ("touches", f"{int((found.moves.touch > 0).sum())}, all moves are clear of spheres, stems and table"),
    ]
    if found.expected_um is not None:
        text = f"{found.expected_um:.2f} um RMS at other rotary positions, for errors of typical size (30 um, 30 urad)"
        rows.append(("expected error", text))
    uncertainty = [
        (name, f"{u:.2f}", f"{predicted.uncertainty_small[name]:.2f}", "um" if name[2] in "XYZ" else "urad")
        for name, u in predicted.uncertainty.items()
    ]
    sections = [
        facts("Spheres and moves", rows),
        Section(
            "Location errors",
            "Expected expanded uncertainty (k = 2), with all error motions of all axes unknown (30 um and urad), and "
            "with good linear axes (3 um and urad).",
            Table(("error", "U (k=2)", "U, good linear axes", "unit"), uncertainty),
        ),
        Section(
            "Not visible in this plan",
            "These errors, or combinations of them, leave no trace in the planned centres; a fit does not change them.",
            Table(("errors", "reason; remedy"), [_short(each) for each in predicted.unidentifiable]),
        ),
    ]
    return Report("Plan of spheres", "", sections, str(found.plan.summary))


def _short(each: Unidentifiable) -> tuple[str, str]:
    names = each.effects
    listed = " and ".join(names) if len(names) < 4 else f"{', '.join(names[:3])} and {len(names) - 3} others"
    return listed, f"{each.reason}; {each.remedy}"
