"""The machines: TOML definitions beside this module and in the user's folders, found by name; others by path."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec

from kinematics.error_model.priors import KINDS, Priors
from kinematics.files import read_input
from kinematics.files.mistaken import did_you_mean
from kinematics.files.report_head import ReportHead
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.machine import EVERY_OTHER, Control, Machine, make_axis, split_chain
from kinematics.touch_off import read_datum
from kinematics.user_error import UserError
from machines.places import folders, own

__all__ = ["default_calibration", "folders", "load", "names", "own", "parse", "path_of"]
FOLDER = Path(__file__).parent
UNUSABLE = frozenset('/\\:*?"<>|\n\r\t\0')
"""Characters that no name of a file may have: the calibration of a machine has its name."""
KEPT = 16
"""Number of machines whose texts are not parsed again: more than a run has."""


class _AxisEntry(msgspec.Struct, forbid_unknown_fields=True):
    travel: tuple[float, float]
    direction: tuple[float, float, float] | None = None
    point: tuple[float, float, float] | None = None
    resolution: float = 1e-4
    home: float | None = None
    rollover: Literal["as-written", "shortest", "signed"] | None = None


class _MachineFile(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    chain: str
    axes: dict[str, Any]
    description: str = ""
    control: dict[str, Any] = {}
    work_offsets: dict[str, Any] = {}
    tools: dict[str, Any] = {}
    datum: dict[str, str] = {}
    report: dict[str, Any] = {}
    priors: dict[str, Any] = {}
    history: str = ""


def names() -> list[str]:
    """Names of the shipped machines."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name_or_path: str) -> Machine:
    """The machine of a name or of a TOML file; UserError with the entry and the reason.

    A shipped name means the shipped machine; other names are those of the files in the user's folders.
    """
    path = path_of(name_or_path)
    return parse(utf8_text(read_input(path, "machine file"), f"machine file {path}"), str(path))


def path_of(name_or_path: str) -> Path:
    """The file of a machine; UserError for a name of none."""
    path = Path(name_or_path)
    if name_or_path in names():
        return FOLDER / f"{name_or_path}.toml"
    return path if path.suffix.lower() == ".toml" or path.is_file() else _own_file(name_or_path)


def _own_file(name: str) -> Path:
    """The file of a user's own machine; UserError for a name of none."""
    files = {path.stem: path for path in own()}
    if name in files:
        return files[name]
    meant = did_you_mean(name, [*names(), *files])
    yours = f"; yours are {', '.join(files)}" if files else ""
    raise UserError(
        f"unknown machine {name!r}{meant}: shipped are {', '.join(names())}{yours}; or give the path of a .toml file"
    )


@functools.lru_cache(maxsize=KEPT)
def parse(text: str, source: str) -> Machine:
    """The machine written in TOML; `source` names the text in error messages. The last texts are not parsed again."""
    where = f"machine file {source}"
    table = read_table(text, where)
    try:
        entries = entry(table, _MachineFile)
        return replace(_build(entries), history=_database(entries.history, Path(source).parent))
    except UserError as fault:
        raise at_line(text, where, fault) from None


def default_calibration(machine: Machine) -> Path | None:
    """The calibration of a machine: shipped, or in `calibrations` of a user's folder; None where there is none."""
    path = FOLDER / "calibrations" / f"{machine.name}.json"
    if path.is_file():
        return path
    places = (folder / "calibrations" / path.name for folder in folders())
    return next((place for place in places if place.is_file()), None)


def _build(entries: _MachineFile) -> Machine:
    if not entries.name.strip() or not UNUSABLE.isdisjoint(entries.name):
        raise UserError(f"name: {entries.name!r} cannot be the name of a file: write letters, digits, blanks, - and _")
    links = split_chain(entries.chain)
    chained = {name for name, _ in links}
    for name in entries.axes:
        if name not in chained:
            raise UserError(
                f"axes.{name} is not in the chain {entries.chain!r}: write {name} into the chain, or delete the table"
            )
    axes = []
    for name, side in links:
        if name not in entries.axes:
            raise UserError(
                f"chain {entries.chain!r}: its axis {name} has no table: write [axes.{name}] with travel = [low, high]"
            )
        axis = entry(entries.axes[name], _AxisEntry, f"axes.{name}")
        if name[0] in "ABC" and axis.point is None:
            raise UserError(
                f"axes.{name}: a rotary axis needs its point = [x, y, z]: a point on its axis of rotation, mm, in the "
                "machine frame, where the tool reference point is at X0 Y0 Z0 when all axes are at 0"
            )
        point = axis.point or (0.0, 0.0, 0.0)
        given = msgspec.structs.asdict(axis) | {"point": point, "rollover": axis.rollover or ""}
        axes.append(make_axis(name, side, **given))
    offsets, offsets_assumed = _assumed(entries.work_offsets, "work_offsets")
    tools, tools_assumed = _assumed(entries.tools, "tools")
    return Machine(
        entries.name,
        entries.description,
        tuple(axes),
        _control(entries.control, chained),
        {name: _offset(values, f"work_offsets.{name}", chained) for name, values in offsets.items()},
        _lengths(tools, "tools"),
        offsets_assumed,
        tools_assumed,
        {name: read_datum(text, chained, f"datum.{name}") for name, text in entries.datum.items()},
        ReportHead.of_table(entries.report),
        _priors(entries.priors),
    )


def _database(text: str, folder: Path) -> str:
    """The database of the history; a file is relative to the folder of the machine file."""
    return text if not text or "://" in text else str(folder / text)


def _assumed(table: dict[str, Any], where: str) -> tuple[dict[str, Any], bool]:
    """The entries of a table but `assumed`, and its value."""
    entries = {name: value for name, value in table.items() if name != "assumed"}
    assumed = entry(table.get("assumed", False), bool, f"{where}.assumed")
    if EVERY_OTHER in entries and not assumed:
        raise UserError(
            f"{where}.{EVERY_OTHER} holds for all names that are not given, which is an assumption: write "
            f"assumed = true in [{where}]"
        )
    return entries, assumed


def _offset(table: object, where: str, chained: set[str]) -> dict[str, float]:
    values = entry(table, dict[str, Any], where)
    unknown = set(values) - chained
    if unknown:
        raise UserError(
            f"{where}: no axis {', '.join(sorted(unknown))} in the chain: its axes are {', '.join(sorted(chained))}"
        )
    return _lengths(values, where)


def _priors(table: dict[str, Any]) -> Priors:
    """The `[priors]` table; its keys are `kind` and the fields of `Priors`, which differ from those of the kind."""
    own = {name: value for name, value in table.items() if name != "kind"}
    kind = entry(table.get("kind", "machining-centre"), str, "priors.kind")
    if kind not in KINDS:
        raise UserError(f"priors.kind {kind!r} is not known: write one of {', '.join(KINDS)}, or leave it out")
    entry(own, Priors, "priors")
    wrong = next((name for name, value in own.items() if not 0.0 < value < math.inf), None)
    if wrong is not None:
        raise UserError(f"priors.{wrong} {own[wrong]} must be positive")
    return replace(KINDS[kind].priors, **own)


def _control(table: dict[str, Any], chained: set[str]) -> Control:
    """The `[control]` table; the fields of `Control` are its keys."""
    control = entry(table, Control, "control")
    if not (control.increment > 0 and math.isfinite(control.increment)):
        raise UserError(f"control.increment {control.increment} must be positive")
    unknown = set(control.tool_change_moves) - chained - set(Control().tool_change_moves)
    if unknown:
        raise UserError(f"control.tool_change_moves: no axis {', '.join(sorted(unknown))} in the chain")
    both = chained & set(control.passive_axes)
    if both:
        raise UserError(f"control.passive_axes: {', '.join(sorted(both))} is in the chain")
    return control


def _lengths(table: dict[str, Any], where: str) -> dict[str, float]:
    lengths = {key: entry(value, float, f"{where}.{key}") for key, value in table.items()}
    for key, value in lengths.items():
        if not math.isfinite(value):
            raise UserError(f"{where}.{key}: {value} is not finite")
    return lengths
