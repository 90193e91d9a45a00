"""Tilted working planes of Klartext: PLANE and cycle 19.

In a tilted plane X Y Z count along its axes, from the present datum, and the plane turns with the workpiece: a frame
as under TCP, with a turn. The tool must be perpendicular to it before X Y Z have a meaning; the positions of the
rotary axes follow from the kinematics of the machine, and the block is refused where the control could choose others.
Angles as HEIDENHAIN documents them (TNC manuals, "The PLANE function"): spatial angles turn about the fixed X, then
Y, then Z; Euler angles about Z, the turned X, the tilted Z.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from kinematics.forward import forward
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control.tilted_planes import normal_of, perpendicular
from postproc.control.words import value_of
from postproc.heidenhain.channel import Channel
from postproc.motion.frames import Placement, euler, rotated_in_turn, spatial
from postproc.motion.moves import AxisWord
from postproc.text.block import Block
from postproc.text.expressions import NotKnown

ROTARY_Q = {"A": 120.0, "B": 121.0, "C": 122.0}
"""Q parameters that the control sets to the angles of the rotary axes."""
_FLAGS = re.compile(r"(STAY|TURN|MOVE|FMAX|F AUTO|(COORD|TABLE) ROT|SEQ ?[+-]|MB ?MAX)( |$)", re.IGNORECASE)
_SPATIAL, _EULER = ("SPA", "SPB", "SPC"), ("EULPR", "EULNU", "EULROT")
_VECTOR = ("BX", "BY", "BZ", "NX", "NY", "NZ")
_POINTS = tuple(f"P{i}{axis}" for i in "123" for axis in "XYZ")
_ASIDE = frozenset(("F", "DIST", "MB"))


@dataclass
class _Choice:
    """The words of a block on the positioning of the rotary axes."""

    positioning: str
    """STAY, TURN or MOVE."""
    sequence: str = ""
    """+ or -, of SEQ."""
    table: bool = False
    """TABLE ROT: a free table axis turns instead of the coordinates."""
    flat: bool = False
    """TABLE ROT of a plane that is not turned at all: a free table axis goes to 0."""


@dataclass
class Planes:
    """The tilted planes of one control."""

    channel: Channel

    def define(self, index: int, block: Block) -> None:
        """PLANE."""
        match = re.fullmatch(r"PLANE ([A-Z]+) ?(.*)", block.detail.upper())
        if match is None:
            raise block.refuse(f"{block.detail} is not known to ncomp")
        form, flags = match.groups()
        rest = _FLAGS.sub("", flags)
        if rest:
            raise block.refuse(f"{rest.strip()} in PLANE {form} is not known to ncomp")
        found = re.findall(r"STAY|TURN|MOVE", flags)
        if len(found) > 1 or (not found and form != "RESET"):
            raise block.refuse("PLANE has none or several of STAY, TURN and MOVE: write one of them")
        positioning = found[0] if found else "STAY"
        if form == "RESET":
            self._reset(index, block, positioning)
            return
        words = {word.address: value_of(block, word) for word in block.words if word.address not in _ASIDE}
        turn = self._turn(block, form, words)
        angles = self._given(block, words) if form == "AXIAL" else None
        sequence = re.search(r"SEQ ?([+-])", flags)
        table = "TABLE ROT" in flags
        flat = table and form == "SPATIAL" and not any(words.values()) and not self._turned_before
        choice = _Choice(positioning, sequence[1] if sequence else "", table, flat)
        self._tilt(index, block, turn, choice, angles)

    @property
    def _turned_before(self) -> bool:
        """A basic rotation, or a shift of a rotary axis: TABLE ROT takes a free axis there instead of to 0."""
        channel = self.channel
        shifts = np.array(channel.modal.frame().offset)[channel.machine.rotary]
        return any(channel.modal.basic_rotation) or bool(shifts.any())

    # ---- how planes are given

    def _turn(self, block: Block, form: str, words: dict[str, float]) -> Placement:
        """The axes of a plane in the untilted frame."""
        if form in ("RELATIV", "RELATIVE"):
            return self._relative(block, words)
        forms: dict[str, tuple[Iterable[str], Callable[[dict[str, float]], Placement]]] = {
            "SPATIAL": (_SPATIAL, lambda w: spatial(*(w[name] for name in _SPATIAL))),
            "EULER": (_EULER, lambda w: euler(*(w[name] for name in _EULER))),
            "VECTOR": (_VECTOR, lambda w: by_axes(_three(w, "B"), _three(w, "N"))),
            "POINTS": (_POINTS, _through_points),
            "AXIAL": (words.keys() & {"A", "B", "C"}, lambda w: self._axial(block, w)),
        }
        if form == "PROJECTED":
            raise block.refuse("the signs of PLANE PROJECTED are not documented: write PLANE SPATIAL or PLANE VECTOR")
        if form not in forms:
            raise block.refuse(f"PLANE {form} is not known to ncomp: write PLANE SPATIAL")
        required, made = forms[form]
        if set(required) != words.keys() or not words:
            expected = " ".join(sorted(required)) or "the angles of the rotary axes"
            raise block.refuse(f"PLANE {form} has missing or additional words: write {expected}")
        try:
            return made(words)
        except ZeroDivisionError:
            raise block.refuse(f"the directions or points of PLANE {form} span no plane: write others") from None

    def _relative(self, block: Block, words: dict[str, float]) -> Placement:
        if len(words) != 1 or not words.keys() <= set(_SPATIAL):
            raise block.refuse("PLANE RELATIV takes one angle: write SPA, SPB or SPC")
        ((name, angle),) = words.items()
        return (self.channel.modal.tilt or Placement()).then(rotated_in_turn("XYZ"["ABC".index(name[2])], [angle]))

    def _axial(self, block: Block, words: dict[str, float]) -> Placement:
        q = self._positions(self._given(block, words))
        turn = forward(self.channel.machine, q[None]).rotation[0]
        return Placement(turn=tuple(turn.ravel().tolist()))

    def _given(self, block: Block, words: dict[str, float]) -> dict[int, float]:
        """Machine positions of rotary axes, degrees, by column."""
        channel = self.channel
        recorder, frame = channel.recorder, channel.modal.frame()
        given = {recorder.axis(block, name): value for name, value in words.items()}
        missing = [axis.name for i, axis in enumerate(channel.machine.axes) if axis.rotary and i not in given]
        if missing:
            raise block.refuse(f"PLANE AXIAL has no angle of {missing[0]}: write the angles of all rotary axes")
        return {axis: value + frame.offset[axis] for axis, value in given.items()}

    def _positions(self, angles: dict[int, float]) -> Array:
        """Axis positions `(axes,)`, mm and rad, with rotary axes at angles, degrees, and linear ones at zero."""
        q = np.zeros(len(self.channel.machine.axes))
        for axis, angle in angles.items():
            q[axis] = np.deg2rad(angle)
        return q

    # ---- tilting

    def tilt_by_cycle(self, block: Block) -> None:
        """Cycle 19: its angles are spatial or those of axes, as the control is set; followed where both are one."""
        words = {word.address: value_of(block, word) for word in block.words if word.address in ("A", "B", "C")}
        if len(words) < len(block.words):
            raise block.refuse("cycle 19 with other words than A, B and C is not followed: write PLANE SPATIAL")
        turn = spatial(*(words.get(name, 0.0) for name in "ABC"))
        names = [axis.name for axis in self.channel.machine.axes if axis.rotary]
        if not words.keys() <= set(names):
            raise block.refuse("cycle 19 tilts about an axis that the machine does not have: write PLANE SPATIAL")
        given = {name: words.get(name, 0.0) for name in names}
        axial = self._axial(block, given)
        if not np.allclose(turn.turn, axial.turn, rtol=0.0, atol=1e-9):
            raise block.refuse(
                "the angles of cycle 19 are spatial angles or axis angles by a setting of the control, and these "
                "differ here: write PLANE SPATIAL or PLANE AXIAL"
            )
        self._tilt(-1, block, turn, _Choice("STAY"), self._given(block, given))

    def level(self, block: Block, on: bool) -> None:
        """Cycle 19 with angles of zero, or without any: not tilted."""
        if self.channel.modal.tilt is not None:
            self._untilt(block)
        self.channel.modal.levelled = on

    def _tilt(
        self, index: int, block: Block, turn: Placement, choice: _Choice, angles: dict[int, float] | None
    ) -> None:
        channel = self.channel
        if channel.modal.tcp:
            raise block.refuse("the working plane is tilted while M128 is on: write M129 before it")
        if channel.modal.tilted_transformations.active or channel.modal.transformations.active.keys() - {7}:
            raise block.refuse(
                "a rotation, mirror or scale, or a shift within another plane, is active before PLANE: reset it first"
            )
        channel.modal.levelled = False
        normal = self._normal(turn)
        if angles is None:
            angles = self._solve(block, normal, choice)
        self._set_rotary_parameters(angles)
        if choice.positioning != "STAY":
            assert angles is not None
            self._turn_axes(index, angles, choice.positioning)
        channel.modal.tilt, channel.modal.normal = turn, normal
        channel.change_frame(channel.x_y_z)
        text = "tilted plane: X Y Z are taken along its axes, from the datum, which turns with the workpiece"
        channel.notes.add(text, block.line)

    def _normal(self, turn: Placement) -> tuple[float, float, float]:
        """Z of the plane in the workpiece frame."""
        return normal_of(self.channel.modal.placed(turn))

    def _reset(self, index: int, block: Block, positioning: str) -> None:
        channel = self.channel
        channel.modal.levelled = False
        self._untilt(block)
        if positioning != "STAY":
            rotary = [i for i, axis in enumerate(channel.machine.axes) if axis.rotary]
            if any(channel.modal.frame().offset[i] for i in rotary):
                raise block.refuse(
                    "PLANE RESET turns rotary axes to 0, of the machine or of the preset: write STAY, then the angles"
                )
            self._turn_axes(index, dict.fromkeys(rotary, 0.0), positioning)

    def _untilt(self, block: Block) -> None:
        channel = self.channel
        if channel.modal.tilt is None:
            return
        if channel.modal.tilted_transformations.active:
            raise block.refuse(
                "a shift, rotation, mirror or scale is active within the tilted plane: reset it before the plane ends"
            )
        channel.modal.tilt = None
        channel.change_frame(channel.x_y_z)

    # ---- rotary axes

    def _turn_axes(self, index: int, angles: dict[int, float], positioning: str) -> None:
        """The control turns rotary axes to machine positions, degrees; with MOVE the others go along."""
        channel = self.channel
        channel.recorder.move_to_machine_position(index, angles, tuple(AxisWord(axis, -1, False) for axis in angles))
        if positioning == "MOVE":
            channel.mark_unknown("XYZ")

    def _set_rotary_parameters(self, angles: dict[int, float] | None) -> None:
        channel = self.channel
        names, offset = channel.machine.names, channel.modal.frame().offset
        for name, number in ROTARY_Q.items():
            axis = names.index(name) if name in names else None
            known = axis is not None and angles is not None and axis in angles
            unknown = NotKnown("the control chooses between several positions of the rotary axes")
            value = angles[axis] - offset[axis] if known and angles is not None and axis is not None else unknown
            channel.scope.set("Q", (number,), value if axis is not None else 0.0)

    def _solve(self, block: Block, normal: tuple[float, float, float], choice: _Choice) -> dict[int, float] | None:
        """Machine positions of the rotary axes, degrees, with the tool perpendicular to the plane.

        Where the control could choose others: Refusal if the block turns them, otherwise None.
        """
        try:
            return self._chosen(normal, choice)
        except UserError as fault:
            if choice.positioning != "STAY":
                raise block.refuse(str(fault)) from None
            return None

    def _chosen(self, normal: tuple[float, float, float], choice: _Choice) -> dict[int, float]:
        machine, sequence = self.channel.machine, choice.sequence
        rotary = [i for i, axis in enumerate(machine.axes) if axis.rotary]
        found = self._solutions(normal, rotary, choice)
        if not found:
            raise UserError(
                "no position of the rotary axes within their travel makes the tool perpendicular to this "
                "plane: check the angles and the travel in the machine file"
            )
        if sequence:
            main = [i for i in rotary if abs(machine.axes[i].unit_direction[2]) < 0.99]
            if len(main) != 1:
                raise UserError("the rotary axis of SEQ depends on the control: write no SEQ, or PLANE AXIAL")
            found = [q for q in found if q[main[0]] == 0.0 or (q[main[0]] > 0.0) == (sequence == "+")]
            if not found:
                raise UserError(f"SEQ{sequence}: no solution has this sign: write the other sign, or no SEQ")
        if len(found) == 1:
            return found[0]
        return self._nearest(found, rotary)

    def _nearest(self, found: list[dict[int, float]], rotary: list[int]) -> dict[int, float]:
        """The solution to which no rotary axis turns farther than to another."""
        recorder = self.channel.recorder
        if not all(recorder.known[i] for i in rotary):
            raise UserError(
                "the control chooses by the positions of the rotary axes, which the program has not given: move them "
                "before the plane, or write SEQ+ or SEQ-"
            )
        offset = recorder.frame.offset
        distances = [[abs(q[i] - recorder.position[i] - offset[i]) for i in rotary] for q in found]
        best = min(range(len(found)), key=lambda k: sum(distances[k]))
        if any(a > b + 1e-9 for other in distances for a, b in zip(distances[best], other, strict=True)):
            raise UserError("the plane has several positions of the rotary axes: write SEQ+ or SEQ-")
        return found[best]

    def _solutions(
        self, normal: tuple[float, float, float], rotary: list[int], choice: _Choice
    ) -> list[dict[int, float]]:
        """All positions, degrees, that differ and lie inside travel; UserError where an axis is free."""
        recorder = self.channel.recorder
        here = {i: recorder.position[i] + recorder.frame.offset[i] for i in rotary}
        found, free = perpendicular(self.channel.machine, normal, here)
        if free and not choice.flat and (choice.table or here[rotary[0]] != 0.0):
            raise UserError("the tool is parallel to a rotary axis, whose angle the control chooses: write PLANE AXIAL")
        return found


def by_axes(x: Array, normal: Array) -> Placement:
    """The plane across `normal`, its X as near to `x` as it can be; ZeroDivisionError where the two are parallel."""
    z = _unit(normal)
    x = _unit(x - (x @ z) * z)
    return Placement(turn=tuple(np.column_stack([x, np.cross(z, x), z]).ravel().tolist()))


def _through_points(words: dict[str, float]) -> Placement:
    first, second, third = (_three(words, f"P{i}") for i in "123")
    return by_axes(second - first, np.cross(second - first, third - first))


def _three(words: dict[str, float], name: str) -> Array:
    return np.array([words[name + axis] for axis in "XYZ"])


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise ZeroDivisionError
    return vector / length
