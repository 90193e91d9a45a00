"""Tables of a machine as a format writes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from kinematics.machine import TURN_DEG, Axis, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.format import Sign
from postproc.control_data.tables.motion_tables import MotionTable
from postproc.control_data.tables.terms import Curve, Term


@dataclass(frozen=True)
class Content:
    """Tables of a machine to be written, with the sign and the settings of the user."""

    machine: Machine
    settings: Any
    sign: Sign
    terms: tuple[Term, ...] = ()
    motions: tuple[MotionTable, ...] = ()
    unit: str = "mm"
    """Unit of the lengths of `terms`, `mm` or `inch`; those of the machine are in mm."""

    def in_unit(self, unit: str) -> Content:
        """The tables with their lengths in another unit than mm."""
        if unit == self.unit:
            return self
        assert not self.motions, "error motions are written in mm"
        factor = UNIT_NAMES[self.unit] / UNIT_NAMES[unit]

        def of(axis: str) -> float:
            return 1.0 if self.machine.axes[self.machine.index(axis)].rotary else factor

        return replace(self, unit=unit, terms=tuple(term.scaled(of) for term in self.terms))

    @property
    def factor(self) -> float:
        """Factor from a correction to a value of the file; its opposite is that from an error."""
        return 1.0 if self.sign == "correction" else -1.0


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


def curves_by_letters(content: Content) -> dict[str, Curve]:
    """The tables of one axis by the letters of output and source, of a control that has one axis of each letter.

    UserError where two axes of the machine have tables and one letter.
    """
    found: dict[str, Curve] = {}
    for term in content.terms:
        curve = term.factors[0]
        if not isinstance(curve, Curve):
            continue
        letters = term.output[0] + curve.axis[0]
        if letters in found:
            raise UserError(
                f"machine {content.machine.name}: two of its axes are {' or '.join(letters)}, and the control has one"
            )
        found[letters] = curve
    return found


def lettered(machine: Machine) -> list[Axis]:
    """The axes of a machine in the order X Y Z A B C U V W, in which controls number them."""
    return sorted(machine.axes, key=lambda axis: ("XYZABCUVW".index(axis.name[0]), axis.name))


def repeats(axis: Axis) -> bool:
    """True if the table of an axis repeats (modulo): a rotary axis with a travel of more than a turn."""
    return axis.rotary and not axis.travel[1] - axis.travel[0] <= TURN_DEG


def number(value: float, decimals: int) -> str:
    """Fixed decimals, no minus before zero."""
    return f"{value:z.{decimals}f}"
