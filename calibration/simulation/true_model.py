"""Virtual machines: random error models, for the simulation of measurements and the evaluation of fits.

Error motions of linear axes are those of the virtual calibration paper, Table 1: for a position x scaled to 0..1 over
the travel a0 + a1 x + b1 sin(n1 pi x) + c1 cos(n1 pi x) + b2 sin(n2 pi x) + c2 cos(n2 pi x), each coefficient uniform
between plus and minus its half-width. For rotary axes, n counts waves per turn, and there is no slope.
"""

from __future__ import annotations

import datetime
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np

from kinematics.basis import Fourier
from kinematics.effects import COMPONENTS, Component, Cyclic, Effect, ErrorMotion, LocationError
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import Provenance, reference
from kinematics.files import read_input
from kinematics.machine import Axis, Machine
from kinematics.user_error import UserError

Row = tuple[float, ...]
"""Half-widths in um or urad: a0, a1, then n, b, c for each wave."""
HalfWidths = Mapping[str, Row]
"""Half-widths by error motion, `E_XX`."""

_ANGLES_X, _ANGLES_Y, _ANGLES_Z = (
    (10.0, 20.0, 0.5, 10.0, 10.0, 5.0, 5.0, 5.0),
    (10.0, 30.0, 0.5, 10.0, 10.0, 2.0, 5.0, 5.0),
    (10.0, 30.0, 0.5, 10.0, 10.0, 1.0, 3.0, 3.0),
)
TABLE_1: HalfWidths = {
    "E_XX": (0.0, 70.0, 0.5, 20.0, 20.0, 5.0, 10.0, 10.0),
    "E_YX": (0.0, 0.0, 0.5, 30.0, 0.0, 5.0, 3.0, 3.0),
    "E_ZX": (0.0, 0.0, 0.5, 15.0, 0.0, 5.0, 3.0, 3.0),
    "E_AX": _ANGLES_X, "E_BX": _ANGLES_X, "E_CX": _ANGLES_X,
    "E_XY": (0.0, 0.0, 0.5, 15.0, 0.0, 2.0, 5.0, 5.0),
    "E_YY": (0.0, 30.0, 0.5, 5.0, 5.0, 2.0, 3.0, 3.0),
    "E_ZY": (0.0, 0.0, 0.5, 15.0, 0.0, 2.0, 5.0, 5.0),
    "E_AY": _ANGLES_Y, "E_BY": _ANGLES_Y, "E_CY": _ANGLES_Y,
    "E_XZ": (0.0, 0.0, 0.5, 15.0, 0.0, 1.0, 5.0, 5.0),
    "E_YZ": (0.0, 0.0, 0.5, 15.0, 0.0, 1.0, 5.0, 5.0),
    "E_ZZ": (0.0, 30.0, 0.5, 30.0, 30.0, 1.0, 3.0, 3.0),
    "E_AZ": _ANGLES_Z, "E_BZ": _ANGLES_Z, "E_CZ": _ANGLES_Z,
}  # fmt: skip
"""Half-widths of the virtual calibration paper, Table 1."""

_RADIAL, _AXIAL, _TILT, _ANGLE = (
    (0.0, 0.0, 1.0, 8.0, 8.0, 2.0, 3.0, 3.0),
    (0.0, 0.0, 1.0, 4.0, 4.0, 2.0, 2.0, 2.0),
    (0.0, 0.0, 1.0, 15.0, 15.0, 2.0, 5.0, 5.0),
    (0.0, 0.0, 1.0, 30.0, 30.0, 2.0, 10.0, 10.0),
)
ROTARY: HalfWidths = {
    f"E_{component}{axis}": shifts if component in "XYZ" else turns
    for axis, line in zip("ABC", "XYZ", strict=True)
    for component in COMPONENTS
    for shifts, turns in [(_AXIAL, _ANGLE) if component in (axis, line) else (_RADIAL, _TILT)]
}
"""Half-widths for rotary axes in good condition, with one and two waves per turn; assumed, without a source."""
DEFAULT: HalfWidths = {**TABLE_1, **ROTARY}


def random_true_model(machine: Machine, rng: np.random.Generator, half_widths: HalfWidths = DEFAULT) -> ErrorModel:
    """A random machine; error motions that are not in the table are zero.

    An axis takes the rows of its own name (E_XX2), or else those of its letter, with U V W as X Y Z.
    """
    effects: list[Effect] = []
    for axis, component, row in _rows(machine, half_widths):
        drawn = rng.uniform(-1.0, 1.0, 2 + len(row[2:]) // 3 * 2)
        effects += _effects(axis, component, row, drawn)
    return model_of(machine, effects)


def largest_true_model(machine: Machine, half_widths: HalfWidths = DEFAULT) -> list[Effect]:
    """The effects of `random_true_model` with every amplitude at its half-width."""
    return [
        effect
        for axis, component, row in _rows(machine, half_widths)
        for effect in _effects(axis, component, row, np.ones(2 + len(row[2:]) // 3 * 2))
    ]


def random_location_errors(machine: Machine, rng: np.random.Generator, half_width: float) -> list[Effect]:
    """Location errors, each uniform within a half-width, um and urad, as of `location_errors`."""
    found = location_errors(machine, half_width)
    values = rng.uniform(-half_width, half_width, len(found)).tolist()
    return [msgspec.structs.replace(effect, value=value) for effect, value in zip(found, values, strict=True)]


def location_errors(machine: Machine, value: float) -> list[LocationError]:
    """Location errors of this value, um and urad: squareness, position and tilt of rotary axes.

    A rotary axis has the two shifts and the two tilts across its line (ISO 230-1); three linear axes have the
    squareness of the second to the first, and of the third to both.
    """
    found: list[tuple[str, str]] = []
    linear = [axis.name for axis in machine.axes if not axis.rotary and axis.name in ("X", "Y", "Z")]
    found += [pair for pair in (("C", "Y"), ("B", "Z"), ("A", "Z")) if pair[1] in linear]
    for axis in machine.axes:
        if axis.rotary:
            along = "ABC".index(axis.name[0])
            found += [(component, axis.name) for k, component in enumerate(COMPONENTS) if k % 3 != along]
    return [LocationError(c, name, value) for c, name in found]  # type: ignore[arg-type]


def model_of(machine: Machine, effects: Sequence[Effect], source: str = "simulated") -> ErrorModel:
    """The error model of a virtual machine, with a fixed date, so that the same seed gives the same file."""
    made = Provenance("ncomp", datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC), source)
    return ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects), demonstration=True)


def read_half_widths(path: Path) -> HalfWidths:
    """Half-widths in a TOML or JSON file, `E_XX = [a0, a1, n1, b1, c1, ...]`; UserError for other content."""
    data = read_input(path, "table of half-widths")
    try:
        content = tomllib.loads(data.decode()) if path.suffix.lower() == ".toml" else msgspec.json.decode(data)
        table = msgspec.convert(content, dict[str, tuple[float, ...]])
    except (msgspec.MsgspecError, tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise UserError(f"table of half-widths {path}: {fault}") from None
    return checked_half_widths(table, f"table of half-widths {path}")


def checked_half_widths(table: Mapping[str, Sequence[float]], where: str) -> HalfWidths:
    """The table with keys `E_XX`, also for keys given as `EXX`; UserError, naming `where`, for a bad row."""
    rows = {}
    for key, row in table.items():
        name = key.upper() if key.upper().startswith("E_") else f"E_{key.upper().removeprefix('E')}"
        if len(name) < 4 or name[2] not in COMPONENTS or name[3] not in "XYZUVWABC":
            raise UserError(f"{where}: {key!r} is no error motion such as E_XX")
        if len(row) < 2 or (len(row) - 2) % 3 or not np.all(np.isfinite(row)):
            raise UserError(f"{where}: {key} has {list(row)}, expected a0, a1, then n, b, c for each wave")
        rows[name] = tuple(map(float, row))
    return rows


def _row_of(axis: Axis, component: str, half_widths: HalfWidths) -> Row | None:
    letter = own_component(axis.name)
    return half_widths.get(f"E_{component}{axis.name}", half_widths.get(f"E_{component}{letter}"))


def _rows(machine: Machine, half_widths: HalfWidths) -> Iterator[tuple[Axis, Component, Row]]:
    """The error motions of the machine that are in the table, with their rows."""
    for axis in machine.axes:
        for component in get_args(Component):
            row = _row_of(axis, component, half_widths)
            if row is not None:
                yield axis, component, row


def _effects(axis: Axis, component: Component, row: Row, drawn: np.ndarray) -> Iterator[Effect]:
    return _rotary(axis, component, row, drawn) if axis.rotary else _linear(axis, component, row, drawn)


def _linear(axis: Axis, component: Component, row: Row, drawn: np.ndarray) -> Iterator[Effect]:
    if not np.all(np.isfinite(axis.travel)):
        raise UserError(f"axis {axis.name} has no end of travel to scale its error motions to")
    amplitudes = [*row[:2], *(value for k in range(2, len(row), 3) for value in row[k + 1 : k + 3])]
    basis = Fourier(axis.travel, tuple(row[2::3]))
    yield ErrorMotion(component, axis.name, basis, tuple((drawn * amplitudes).tolist()))


def _rotary(axis: Axis, component: Component, row: Row, drawn: np.ndarray) -> Iterator[Effect]:
    """A constant and periodic waves, which hold for any number of turns."""
    if row[1]:
        raise UserError(f"E_{component}{axis.name}: a rotary axis has no slope, which would not close after a turn")
    if row[0]:
        yield LocationError(component, axis.name, float(drawn[0] * row[0]))
    for k in range(2, len(row), 3):
        sine, cosine = (drawn[2 + (k - 2) // 3 * 2 :][:2] * row[k + 1 : k + 3]).tolist()
        yield Cyclic(component, axis.name, 360.0 / row[k], (sine,), (cosine,))
