"""Cases of a study with a touch probe: plans of spheres, calibrated distances, and errors that they cannot show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.instruments import TouchProbe
from calibration.measurement.measurement import Distance
from calibration.measurement.plan import Plan
from calibration.measurement.plan_file import read_plan
from calibration.probing.bodies import Artefact, Probe
from calibration.probing.plan import DEFAULT_CONTACTS, ProbeRequest, default_spheres, probe_plan
from calibration.probing.predicted import predicted
from calibration.study.definition import SPHERES_BY_DEFAULT, CaseEntry
from kinematics.machine import Machine, Vector
from kinematics.user_error import UserError

PROBE_TIP = (0.0, 0.0, -150.0)
"""Tip of the probe from the spindle nose, mm, where the case has none."""
NOT_SPHERES = ("spacing_mm", "minutes", "obstacles", "visible", "tracker", "runs", "elevation", "incidence_deg")
"""Keys of a case that a plan of spheres does not have."""


def sphere_plan(
    entry: CaseEntry, machine: Machine, instrument: TouchProbe, folder: Path
) -> tuple[Plan, tuple[Distance, ...]]:
    """The plan of a case and its calibrated distances; a note of the plan has the errors that it cannot show.

    UserError for keys that a plan of spheres does not have, and for spheres out of reach.
    """
    plain = CaseEntry(entry.name, entry.strategy)
    for key in NOT_SPHERES:
        if getattr(entry, key) != getattr(plain, key):
            raise UserError(f"{key}: a case with a touch probe does not have this key")
    in_file = entry.strategy.lower().endswith(".csv")
    plan = _read(entry, machine, folder) if in_file else _made(entry, machine, instrument)
    uncertainties = {_pair(names, plan): u_um * 1e-3 for names, u_um in entry.distances.items()}
    hidden = predicted(plan, instrument.u_um, uncertainties).unidentifiable
    if hidden:
        names = "; ".join(" and ".join(each.effects) for each in hidden)
        plan = replace(plan, notes=(*plan.notes, f"cannot show {names}"))
    apart = {pair: np.subtract(plan.spheres[pair[0]], plan.spheres[pair[1]]) for pair in uncertainties}
    return plan, tuple(Distance(*pair, float(np.linalg.norm(apart[pair])), u) for pair, u in uncertainties.items())


def _read(entry: CaseEntry, machine: Machine, folder: Path) -> Plan:
    if entry.points is not None or entry.tools or entry.spheres != SPHERES_BY_DEFAULT:
        raise UserError(f"{entry.strategy} has its own positions and spheres: delete points, spheres and tools")
    plan = read_plan(folder / entry.strategy, machine)
    if not plan.spheres:
        raise UserError(f"{entry.strategy}: it is no plan of spheres, which a touch probe needs")
    return plan


def _made(entry: CaseEntry, machine: Machine, instrument: TouchProbe) -> Plan:
    tools = tuple(entry.tools.values()) if isinstance(entry.tools, dict) else entry.tools
    if len(tools) > 1:
        raise UserError("tools: a touch probe has one target, its tip from the spindle nose")
    if isinstance(entry.points, tuple):
        raise UserError("points: expected one number of rotary positions")
    request = ProbeRequest(
        Probe(tools[0] if tools else PROBE_TIP),
        Artefact(_spheres(entry, machine)),
        entry.strategy,
        DEFAULT_CONTACTS if entry.points is None else entry.points,
        entry.ranges,
        entry.references,
        u_um=instrument.u_um,
    )
    found = probe_plan(machine, request)
    return replace(found.plan, notes=(*found.plan.notes, *found.notes))


def _spheres(entry: CaseEntry, machine: Machine) -> Mapping[str, Vector]:
    if isinstance(entry.spheres, dict):
        return entry.spheres
    return default_spheres(machine, entry.spheres, machine.work_offsets.get("default", {}))


def _pair(names: str, plan: Plan) -> tuple[str, str]:
    """The two spheres of a distance, from `s1.s2`."""
    one, _, other = names.partition(".")
    if one == other or not {one, other} <= plan.spheres.keys():
        raise UserError(f"distances: {names!r} is no pair such as s1.s2 of the spheres {', '.join(plan.spheres)}")
    return one, other
