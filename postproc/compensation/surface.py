"""The surface of a workpiece together with the errors of the machine on which it was probed.

A map of heights is probed on the machine that cuts, as the work offset is. At a node, the tip touched at the commanded
height h above the work zero W. With the machine's error e it was at W + h + e there, and the true datum is W + e(W). So
the true height is h + e - e(W), along Z. Without this, a program would be corrected twice: by the map, which contains
the machine's error, and by the calibration. Across Z nothing is added: a map is read at the commanded position, as it
was probed.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from kinematics.effects.base import own_motion
from kinematics.effects.control import WorkpieceSurface
from kinematics.error_model.joined import joined
from kinematics.error_model.model import MODEL_ROUNDING, ErrorModel
from kinematics.machine import NDArrayBool
from kinematics.touch_off import TouchOff, touch_off
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import deviations
from postproc.compensation.left_outside import EXAMINED_ARC_SHARES
from postproc.compensation.predicted_error import in_a_program
from postproc.control.setup import Setup
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known


def with_surface(model: ErrorModel, setup: Setup, conditions: Conditions) -> ErrorModel:
    """The model with the surface of the workpiece in the set-up; the model itself without one."""
    if setup.surface is None:
        return model
    found = joined(model, [_true(setup.surface, model, setup, conditions)], 1.0)
    source = "; ".join(filter(None, (model.provenance.source, f"height map {setup.surface.note}")))
    return replace(found, provenance=replace(found.provenance, source=source))


def _true(surface: WorkpieceSurface, model: ErrorModel, setup: Setup, conditions: Conditions) -> WorkpieceSurface:
    """The surface at its true heights, from the heights at which the erring machine touched it."""
    errors = model.part(in_a_program)
    if not errors.effects:
        return surface
    machine, name = setup.machine, setup.surface_offset or setup.usual_offset
    given = setup.work_offset(name)
    offset = tuple((given.value if given else {}).get(axis, 0.0) for axis in machine.names)
    datum = touch_off(name, setup.datum(name), offset, machine)
    x, y = np.meshgrid(*surface.nodes, indexing="ij")
    heights = np.array(surface.values)
    places = dict(zip((*surface.of, "Z"), (x.ravel(), y.ravel(), setup.surface_zero + heights * 1e-3), strict=True))
    positions = np.stack([places[axis] for axis in machine.names], axis=1).tolist()
    touched = [TouchOff(name, offset, tuple(position), datum.probe) for position in positions]
    found = deviations(machine, errors, [*touched, datum], conditions)[:, 2] * 1e3
    at_datum = found[-1] if setup.datum(name).probed else 0.0
    own = own_motion(machine, "Z")[2] * (found[:-1] - at_datum)
    return surface.with_parameters((heights + own).tolist(), surface.u)


def follows_surface(motions: Motions) -> NDArrayBool:
    """Feed moves and holes `(n,)` whose Z the program has given, so that the height of a surface is added to it."""
    given = motions.known[:, motions.machine.index("Z")] == Known.PROGRAM
    return np.asarray(given & np.isin(motions.kind, (Kind.LINE, Kind.ARC, Kind.CYCLE)))


def place_not_given(motions: Motions, model: ErrorModel) -> tuple[int, str] | None:
    """Block, by its index in the chunk, and axes of the first feed move or hole at an unknown place of a surface.

    None if there is none.
    """
    for effect in model.effects:
        axes = [motions.machine.index(axis) for axis in effect.area]
        assumed = (motions.known[:, axes] == Known.ASSUMED) & follows_surface(motions)[:, None]
        if assumed.any():
            row = int(np.argmax(assumed.any(axis=1)))
            names = " and ".join(motions.machine.names[i] for i, is_it in zip(axes, assumed[row], strict=True) if is_it)
            return int(motions.block[row]), names
    return None


def beyond_surface(motions: Motions, model: ErrorModel) -> tuple[int, str] | None:
    """Block, by its index in the chunk, and text on the first feed move or hole that leads beyond the map of a surface.

    None if there is none. Positions are in the coordinates of the program.
    """
    for effect in model.effects:
        axes = {motions.machine.index(axis): ends for axis, ends in effect.area.items()}
        beyond = _beyond(motions, axes)
        if beyond.any():
            row = int(np.argmax(beyond))
            offset, names = motions.frames[motions.frame[row]].offset, motions.machine.names
            known = ", ".join(f"{names[i]} {a - offset[i]:g} to {b - offset[i]:g}" for i, (a, b) in axes.items())
            return int(motions.block[row]), f"this feed move leads beyond the height map {effect.note}, {known}"
    return None


def _beyond(motions: Motions, axes: dict[int, tuple[float, float]]) -> NDArrayBool:
    """Feed moves and holes `(n,)` that begin, lead or end outside the ranges of axes, by column."""
    beyond = np.zeros(len(motions), bool)
    if not axes:
        return beyond
    for share in (0.0, *(EXAMINED_ARC_SHARES if motions.arcs else ()), 1.0):
        x = motions.in_machine(motions.along(share))
        rows = motions.evaluated & follows_surface(motions) if share == 1.0 else motions.evaluated_paths
        for i, (low, high) in axes.items():
            beyond |= rows & (np.maximum(low - x[:, i], x[:, i] - high) > MODEL_ROUNDING)
    return beyond
