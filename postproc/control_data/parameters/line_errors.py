"""Moved lines as the errors of the nominal machine that they correct."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import msgspec
import numpy as np

from kinematics.basis import Harmonics, Polynomial
from kinematics.effects import COMPONENTS, Component, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.control_data.parameters.rotary_lines import positions_with

POSES = 60
LINE_SEED = 10791
TOOLS = (0.0, 100.0, 250.0)
"""Tool lengths, mm, at which the errors must be the same."""
INDEPENDENT = 1e-6
"""Share of its signal by which an error must differ from those before it."""
SECOND_ORDER_UM = 2e-3
"""um and urad: smaller errors are left out; they are of second order."""


def errors_of_lines(machine: Machine, moved: Machine, frame: Array | None = None) -> list[Effect]:
    """Errors that moved lines correct: location errors of rotary axes, and a constant displacement at either end.

    frame: with them, the displacement `(6,)` of programmed points, mm and rad, by a changed work offset.

    A location error of a table carries the workpiece with it, and one of a head the tool; moved lines do not. The
    constant displacement is a first harmonic of the rotary axis at that end.
    """
    q, tools = _poses(machine)
    sent = positions_with(machine, moved, q, tools, frame)
    corrected = (tool_point(machine, q, tools) - tool_point(machine, sent, tools)).ravel()
    if not np.abs(corrected).any():
        return []
    candidates = list(_candidates(machine))
    signals = _signals(machine, candidates, q, tools)
    kept = _independent(signals)
    sizes = np.linalg.lstsq(signals[:, kept], corrected)[0]
    return _joined(
        [(candidates[k], float(size)) for k, size in zip(kept, sizes, strict=True) if abs(size) > SECOND_ORDER_UM]
    )


def _poses(machine: Machine) -> tuple[Array, Array]:
    rng = np.random.default_rng(LINE_SEED)
    low, high = np.array([(-180.0, 180.0) if axis.rotary else (-300.0, 300.0) for axis in machine.axes]).T
    q = rng.uniform(low, high, (POSES * len(TOOLS), len(low))) * machine.scale
    return q, np.outer(np.tile(TOOLS, POSES), [0.0, 0.0, -1.0])


def _candidates(machine: Machine) -> Iterator[Effect]:
    """Unit errors, um and urad, in the order in which they are preferred."""
    rotary = [axis for axis in machine.axes if axis.rotary]
    ends = [axis for axis in dict.fromkeys((rotary[0], rotary[-1])) if axis in (machine.axes[0], machine.axes[-1])]
    for axis in rotary:
        yield from (LocationError(c, axis.name, 1.0) for c in _across(axis))
    for axis in ends:
        for component in _across(axis):
            for part in (1, 2):
                yield _harmonic(component, axis, part)
    for axis in rotary:
        yield from (LocationError(cast(Component, c), axis.name, 1.0) for c in COMPONENTS if c not in _across(axis))
    first = machine.axes[0]
    if not first.rotary:  # a workpiece that does not turn: its displacement is one of the first linear axis
        for letter in COMPONENTS:
            component = cast(Component, letter)
            yield ErrorMotion(component, first.name, Polynomial(_interval(first), 0), (1.0,), u=(0.0,))
        yield from (LocationError(c, first.name, 1.0) for c in ("A", "B", "C") if c != _own_rotation(first))


def _across(axis: Axis) -> list[Component]:
    """Components across the line of an axis, in its error frame."""
    own = axis.name[0]
    along = "XYZ"["ABC".index(own)]
    return [cast(Component, c) for c in COMPONENTS if c not in (own, along)]


def _own_rotation(axis: Axis) -> str:
    """The rotation about a linear axis by its letter, which does not tilt its line."""
    return "ABC"["XYZUVW".index(axis.name[0]) % 3]


def _interval(axis: Axis) -> tuple[float, float]:
    low, high = axis.travel
    return (low, high) if high - low < float("inf") else (-1.0, 1.0)


def _harmonic(component: Component, axis: Axis, part: int) -> ErrorMotion:
    low, high = axis.travel
    interval = (low, high) if high - low < TURN_DEG else (0.0, TURN_DEG)
    values = tuple(1.0 if k == part else 0.0 for k in range(3))
    return ErrorMotion(component, axis.name, Harmonics(interval, 1), values, u=(0.0,) * 3)


def _signals(machine: Machine, candidates: list[Effect], q: Array, tools: Array) -> Array:
    """Deviations `(3n, candidates)`, mm per um and urad."""
    state = State(q, np.zeros_like(q))
    transform = error_transform_with_tool(machine, q, tools)[:, :3]
    columns = []
    for effect in candidates:
        errors = msgspec.structs.replace(no_errors(machine), effects=(effect,)).errors(machine, state)
        columns.append(np.einsum("nrc,nc->nr", transform, errors.reshape(len(q), -1)).ravel())
    return np.stack(columns, axis=1)


def _independent(signals: Array) -> list[int]:
    """Numbers of the signals that are no combination of those kept before them."""
    kept: list[int] = []
    basis = np.zeros((len(signals), 0))
    for k, signal in enumerate(signals.T):
        rest = signal - basis @ (basis.T @ signal)
        rest = rest - basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > INDEPENDENT * np.linalg.norm(signal):
            kept.append(k)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return kept


def _joined(parts: list[tuple[Effect, float]]) -> list[Effect]:
    """Unit errors times their sizes; the parts of one error motion in one effect."""
    found: dict[str, Effect] = {}
    for effect, size in parts:
        values = np.asarray(effect.parameters) * size
        if effect.name in found:
            values = values + np.asarray(found[effect.name].parameters)
        found[effect.name] = effect.with_parameters(values.tolist(), (0.0,) * len(values))
    return list(found.values())
