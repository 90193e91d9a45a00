"""Small Klartext and Siemens programs through ncomp: the positions of the machine axes after every move."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from postproc.control.setup import make_setup
from postproc.control.tool_table import ToolTable
from postproc.dialects import find_dialect
from postproc.execution import execution
from postproc.text.notes import Notes
from support.programs import load, source_of

SUFFIXES = {"iso": "nc", "siemens": "mpf", "heidenhain": "h"}


def positions(
    text: str,
    dialect: str,
    machine: str = "gantry",
    axes: str = "XYZ",
    *,
    offsets: Sequence[str] = (),
    tools: Sequence[str] = ("T1=100",),
    table: ToolTable | None = None,
    control: Mapping[str, object] | None = None,
    notes: Notes | None = None,
) -> list[tuple[float, ...]]:
    """Machine positions, mm and degrees, after all moves; UserError where the program is refused."""
    made = load(machine)
    made = dataclasses.replace(made, control=dataclasses.replace(made.control, **(control or {})))
    source = source_of(text, f"test.{SUFFIXES[dialect]}")
    setup = make_setup(made, offsets, tools, table, zero=True)
    reader = find_dialect(dialect, "", "")
    interpreter = reader.interpreter(made, setup, notes or Notes())
    parts = [part.motions.machine_target for part in execution(source, reader, interpreter).parts()]
    columns = [made.index(axis) for axis in axes]
    q = np.vstack(parts) / made.scale
    return [tuple(round(float(v), 6) + 0.0 for v in row) for row in q[:, columns]]
