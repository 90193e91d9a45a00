"""Programs that ncomp accepts, and reasons for the refusal of the others: `python benchmarks/acceptance.py FOLDER
[MACHINE ...]`.

Every file below the folder, but those whose suffix is that of another kind of file, goes through the main job, on the
first of the machines that accepts it (default: dmu50, trunnion_ac; each also as for a control that reads arc centres as
absolute, with an extruder's axes E and ELX that move no part of it, as one on which a tool change moves nothing, as a
FANUC, as one whose called programs do not change the state, as one that cuts off the fraction of a number of repeats,
as a LinuxCNC, with the tool at X0 Y0 Z0 at the start, with probing beside the contour, and with the block-skip switch
off): with `--calibration none`, where an accepted program must come out byte for byte, for a machine that is out of
square by 20 urad, and for that with `--unroll` where it is refused without. One that asks for the radius of a tool is
given a tool table, in which all tools are alike. Prints a table per folder and one per dialect, and one line per
program that the first, or only the second, refuses. Broken are accepted programs that do not come back byte for byte.
"""

from __future__ import annotations

import dataclasses
import datetime
import io
import sys
from collections import Counter
from pathlib import Path

import machines
from kinematics.effects import LocationError
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_model.provenance import Provenance, reference
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.setup import Setup, make_setup
from postproc.control_data.tool_tables import ToolTable
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import open_source

SQUARENESS_URAD = 20.0
TOOLS = ToolTable(tools={str(n): 0.0 for n in range(1000)}, radii={str(n): 3.0 for n in range(1000)})
"""mm."""
NO_PROGRAMS = frozenset((".md", ".py", ".sh", ".toml", ".json", ".csv", ".ini", ".rtl"))
"""Suffixes of notes, scripts, machine files, calibrations, measurements and tool tables."""
COUNTED = "programs", "accepted", "corrected", "or unrolled", "broken"


def out_of_square(machine: Machine) -> ErrorModel:
    """Y to X, Z to X and Z to Y."""
    effects = tuple(LocationError(turn, axis, SQUARENESS_URAD) for turn, axis in ("CY", "BZ", "AZ"))
    made = Provenance("benchmark", datetime.datetime.now(datetime.UTC))
    return ErrorModel(machine=reference(machine), effects=effects, provenance=made)


def variants(names: list[str]) -> list[Machine]:
    """The machines, each with its own control and with others."""
    found = []
    for machine in map(machines.load, names):
        others = (
            {},
            {"arc_centres": "absolute"},
            {"passive_axes": ("E", "ELX")},
            {"tool_change_moves": ()},
            {"family": "fanuc"},
            {"calls_leave_state": True},
            {"repeats": "truncate"},
            {"family": "linuxcnc"},
            {"start": "X0,Y0,Z0"},
            {"probing": "beside"},
            {"block_skip": "off"},
        )
        controls = [dataclasses.replace(machine.control, **other) for other in others]
        found += [dataclasses.replace(machine, control=control) for control in controls]
    return found


def correct(path: Path, machine: Machine, model: ErrorModel, *, unroll: bool = False) -> bytes:
    """The program as it comes out; UserError when it is refused."""
    try:
        return run(path, machine, model, make_setup(machine, zero=True), unroll)
    except UserError as fault:
        if "--tool-table" not in str(fault):
            raise
        return run(path, machine, model, make_setup(machine, table=TOOLS, zero=True), unroll)


def run(path: Path, machine: Machine, model: ErrorModel, setup: Setup, unroll: bool) -> bytes:
    """One run of the main job."""
    source, out = open_source(str(path)), io.BytesIO()
    dialect = find_dialect("auto", source.name, source.text_head)
    job = Job(source, dialect, machine, model, setup, travel_check=False, unroll=unroll)
    Pipeline(job).run(out, lambda _: None)
    return out.getvalue()


def refusals(path: Path, candidates: list[Machine]) -> tuple[str | None, str | None, str | None]:
    """Why a program is refused without errors, with errors, and with errors and `--unroll`; None where it is not.

    AssertionError for one that is accepted and does not come back as it was.
    """
    reasons = []
    for machine in candidates:
        try:
            assert correct(path, machine, no_errors(machine)) == path.read_bytes(), path
        except UserError as fault:
            reasons.append(str(fault))
            continue
        straight = refusal(path, machine, unroll=False)
        return None, straight, straight and refusal(path, machine, unroll=True)
    reason = next((reason for reason in reasons if "has no axis" not in reason), reasons[0])
    return reason, reason, reason


def refusal(path: Path, machine: Machine, *, unroll: bool) -> str | None:
    """Why a program is refused with errors, None where it is not."""
    try:
        correct(path, machine, out_of_square(machine), unroll=unroll)
    except UserError as fault:
        return str(fault)
    return None


def main(folder: Path, machine_names: list[str]) -> None:
    """Print the tables and the refusals."""
    candidates = variants(machine_names)
    folders, dialects = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    lines = []
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix.lower() not in NO_PROGRAMS):
        source = open_source(str(path))
        names = str(path.parent.relative_to(folder)), find_dialect("auto", source.name, source.text_head).name
        try:
            read, corrected, written_out = refusals(path, candidates)
            states = {"accepted": read is None, "corrected": corrected is None, "or unrolled": written_out is None}
        except AssertionError:
            read = corrected = written_out = f"BROKEN {path}"
            states = {"broken": True}
        for counts, name in zip((folders, dialects), names, strict=True):
            counts.update((name, column) for column, holds in {"programs": True, **states}.items() if holds)
        if corrected is not None:
            kind = "" if read else "(read, not corrected) " if written_out else "(only with --unroll) "
            lines.append(kind + corrected.replace(f"{folder}/", ""))
    for title, counts in {"folder": folders, "dialect": dialects}.items():
        print(f"{title:<32}{''.join(f'{column:>13}' for column in COUNTED)}")
        for name in dict.fromkeys(name for name, _ in counts):
            print(f"{name:<32}{''.join(f'{counts[name, column]:>13}' for column in COUNTED)}")
    print("\n".join(["", *lines]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or ["dmu50", "trunnion_ac"])
