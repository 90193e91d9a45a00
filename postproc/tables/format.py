"""A format of controller tables: its settings, limits, writer, and the certainty of its description."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from kinematics.machine import TURN, Axis, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.tables.build import Capabilities
from postproc.tables.limits import Limits
from postproc.tables.motion_tables import MotionTable
from postproc.tables.terms import Curve, Term

Sign = Literal["error", "correction"]
"""Meaning of the values of a file: actual minus commanded, or the correction of the command."""


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the control that a user gives with `--set NAME=VALUE`."""


@dataclass(frozen=True)
class Content:
    """Tables of a machine to be written, with the sign and the settings of the user."""

    machine: Machine
    settings: Any
    sign: Sign
    terms: tuple[Term, ...] = ()
    motions: tuple[MotionTable, ...] = ()

    @property
    def factor(self) -> float:
        """Factor from a correction to a value of the file; its opposite is that from an error."""
        return 1.0 if self.sign == "correction" else -1.0


@dataclass(frozen=True)
class Format:
    """One format of one control."""

    name: str
    title: str
    settings: type[Settings]
    limits: Callable[[Any], Limits]
    """By the user's settings."""
    write: Callable[[Content], dict[str, str]]
    """Files by name; UserError if the format cannot hold them."""
    meaning: str
    """For sheet.md: meaning of a value of the file, units, direction, interpolation, outside the table."""
    loading: str
    """For sheet.md: how the files are loaded into the control."""
    certainty: str
    """For sheet.md: certainty of this description."""
    capabilities: Callable[[Any], Capabilities] | None = None
    """None of a format that holds error motions by ISO 230-1, which the control makes corrections of."""
    sign: Sign | None = None
    """Meaning of its values; None if no source states it."""
    parameters: str = ""
    """The family of controls for the names of parameters in sheet.md."""
    probe: Callable[[Content], dict[str, str]] | None = None


def parse_settings(kind: type[Settings], texts: Iterable[str]) -> Settings:
    """Settings from `NAME=VALUE`; UserError for one that the format has not, or that is out of its bounds."""
    values: dict[str, str] = {}
    names = [field.name for field in msgspec.structs.fields(kind)]
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or name not in names:
            raise UserError(f"--set {text}: expected NAME=VALUE with a name of {', '.join(names) or 'none'}")
        if name in values:
            raise UserError(f"--set {text}: {name} is given twice: give it once")
        values[name] = value
    try:
        return msgspec.convert(values, kind, strict=False)
    except msgspec.ValidationError as fault:
        raise UserError(f"--set: {fault}") from None


@dataclass(frozen=True)
class Own:
    """The table of an axis over itself; forward and backward are one where it does not depend on the direction."""

    nodes: Array
    forward: Array
    backward: Array

    @property
    def bidirectional(self) -> bool:
        """True when the direction matters."""
        return bool((self.forward != self.backward).any())


def own_tables(content: Content) -> Iterator[tuple[Axis, Own]]:
    """The axes with a table over their own position, in the order of `lettered`; directions share their nodes."""
    for axis in lettered(content.machine):
        own = [term for term in content.terms if term.output == axis.name and term.inputs == (axis.name,)]
        curves = {term.direction: term.factors[0] for term in own}
        forward, backward = curves.get(0, curves.get(1)), curves.get(0, curves.get(-1))
        if isinstance(forward, Curve) and isinstance(backward, Curve):
            yield axis, Own(forward.nodes, forward.values, backward.values)


def lettered(machine: Machine) -> list[Axis]:
    """The axes of a machine in the order X Y Z A B C U V W, in which controls number them."""
    return sorted(machine.axes, key=lambda axis: ("XYZABCUVW".index(axis.name[0]), axis.name))


def repeats(axis: Axis) -> bool:
    """True if the table of an axis repeats (modulo): a rotary axis with a travel of more than a turn."""
    return axis.rotary and not axis.travel[1] - axis.travel[0] <= TURN


def number(value: float, decimals: int) -> str:
    """Fixed decimals, no minus before zero."""
    return f"{value:z.{decimals}f}"
