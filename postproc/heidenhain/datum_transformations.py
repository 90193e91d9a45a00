"""Datum shift, mirror, rotation and scaling of Klartext: cycles 7, 8, 10, 11 and 26."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from postproc.control.codes import AXES
from postproc.motion.frames import Placement, mirrored, rotated, scaled, shifted
from postproc.text.block import Block

SHIFT_CYCLE, ROTATION_CYCLE, SCALING_CYCLE, AXIS_SCALING_CYCLE = 7, 10, 11, 26
_ORDER = (
    "cycle {} together with another coordinate transformation is not followed in this order: reset the other one first"
)


@dataclass
class DatumTransformations:
    """The transformations of the coordinates in force: a shift, and one of the others inside it."""

    active: dict[int, Placement] = field(default_factory=dict)
    """By the number of its cycle."""
    angle: float = 0.0
    """Angle of cycle 10, degrees."""
    factors: dict[str, float] = field(default_factory=lambda: dict.fromkeys("XYZ", 1.0))
    """Factors of cycle 26, by axis."""
    unfinished: bool = False
    """A datum shift has been taken back under another cycle, but not along all axes."""

    @property
    def placement(self) -> Placement:
        """All of them, the shift outermost."""
        result = Placement()
        for number in sorted(self.active):
            result = result.then(self.active[number])
        return result

    def set(self, block: Block, number: int, words: Mapping[str, float], unit: float, scaled_axes: str = "") -> bool:
        """Take over a block of a cycle with its words; False when that changes nothing.

        `scaled_axes`: those that cycle 11 scales on this control; empty where that is not known.
        Refusal for effects on other axes, and for an order of cycles that is not followed.
        """
        before = self.active.get(number, Placement())
        made = (
            _shift(block, before, words, unit)
            if number == SHIFT_CYCLE
            else self._made(block, number, words, scaled_axes)
        )
        if made == before:
            return False
        self.active = {n: p for n, p in {**self.active, number: made}.items() if p != Placement()}
        others = self.active.keys() - {SHIFT_CYCLE}
        if len(others) > 1 or (number == SHIFT_CYCLE and others and any(words.values())):
            raise block.refuse(_ORDER.format(number))
        self.unfinished = number == SHIFT_CYCLE and bool(others) and SHIFT_CYCLE in self.active
        return True

    def _made(self, block: Block, number: int, words: Mapping[str, float], scaled_axes: str) -> Placement:
        if number == SCALING_CYCLE:
            return _scale(block, words, scaled_axes)
        if number == AXIS_SCALING_CYCLE:
            self.factors |= _factors(block, words)
            return scaled(*(self.factors[axis] for axis in "XYZ"))
        if number != ROTATION_CYCLE:
            return _mirror(block, words)
        if words.keys() not in ({"ROT"}, {"IROT"}):
            raise block.refuse("cycle 10 has no angle: write ROT and the angle")
        self.angle = words["ROT"] if "ROT" in words else self.angle + words["IROT"]
        return rotated(self.angle)

    def check(self, block: Block) -> None:
        """Refusal for a move where a datum shift is taken back in part within a rotation."""
        if self.unfinished:
            raise block.refuse(_ORDER.format(SHIFT_CYCLE))


def _shift(block: Block, before: Placement, words: Mapping[str, float], unit: float) -> Placement:
    others = {name: value for name, value in words.items() if name.removeprefix("I") not in tuple("XYZ")}
    if any(value or name.removeprefix("I") not in AXES for name, value in others.items()):
        raise block.refuse(
            f"cycle 7 shifts the datum by {' '.join(others)}, which is not followed: write X, Y and Z only"
        )
    x, y, z = (
        (words[name] * unit if name in words else old) + words.get(f"I{name}", 0.0) * unit
        for name, old in zip("XYZ", before.shift, strict=True)
    )
    return shifted(x, y, z)


def _mirror(block: Block, words: Mapping[str, float]) -> Placement:
    if not words.keys() <= set("XYZ"):
        raise block.refuse("cycle 8 mirrors a rotary or auxiliary axis, which is not followed: write X, Y and Z only")
    return mirrored("".join(words))


def _scale(block: Block, words: Mapping[str, float], scaled_axes: str) -> Placement:
    if words.keys() != {"SCL"} or words["SCL"] <= 0.0:
        raise block.refuse("cycle 11 has no factor above 0: write SCL and the factor")
    factor = words["SCL"]
    if factor != 1.0 and not scaled_axes:
        raise block.refuse(
            "cycle 11 scales Z on some controls only (machine parameter 7410): write "
            'scaled_axes = "XYZ" or "XY" under [control] in the machine file'
        )
    return scaled(*(factor if axis in scaled_axes else 1.0 for axis in "XYZ"))


def _factors(block: Block, words: Mapping[str, float]) -> Mapping[str, float]:
    if not words.keys() <= set("XYZ") or any(factor <= 0.0 for factor in words.values()):
        raise block.refuse(
            "cycle 26 takes factors above 0 for X, Y and Z; a centre is not followed: write factors only"
        )
    return words
