"""Rotation, mirror and scale of ISO coordinates (G68, G51.1, G51), and tilted planes by G68.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from postproc.iso.codes import MIRROR, ROTATION, SCALE, TILT
from postproc.motion.frames import Placement, euler, mirrored, rotated, scaled, shifted
from postproc.text.block import Block

ALL_AXES = "XYZ"


class Programmed(msgspec.Struct, frozen=True):
    """The words of a block that transforms the coordinates."""

    block: Block
    plane: str
    axes: Mapping[str, float]
    """X Y Z, mm."""
    others: Mapping[str, float]
    """I J K R P, as programmed."""

    def centre(self, names: str) -> Placement:
        """The shift to the position of the block, along these axes; Refusal where one is missing."""
        if self.axes.keys() != set(names):
            raise self.block.refuse(
                f"the centre needs {' and '.join(names)}, or it depends on the position of the tool: write them"
            )
        return shifted(**{name.lower(): value for name, value in self.axes.items()})

    def refuse_but(self, allowed: str) -> None:
        """Refuse words that are none of these."""
        strange = sorted(self.others.keys() - set(allowed))
        if strange:
            raise self.block.refuse(f"the effect of {strange[0]} in this block depends on the control: leave it out")


def _about(centre: Placement, inner: Placement) -> Placement:
    x, y, z = centre.shift
    return centre.then(inner).then(shifted(-x, -y, -z))


def _rotation(programmed: Programmed) -> Placement:
    """G68: round a point of the plane, counter-clockwise seen from its normal."""
    programmed.refuse_but("R")
    if "R" not in programmed.others:
        raise programmed.block.refuse("G68 needs R, the angle of the rotation: write it")
    return _about(programmed.centre(programmed.plane[:2]), rotated(programmed.others["R"], programmed.plane))


def _scale(programmed: Programmed) -> Placement:
    """G51: larger by P round a point, along all axes."""
    programmed.refuse_but("P")
    if "P" not in programmed.others:
        raise programmed.block.refuse(
            "G51 needs P, one scale for all axes: scales that differ by axis are not corrected"
        )
    word = next(word for word in programmed.block.words if word.address == "P")
    if word.formula is None and "." not in programmed.block.text[word.start : word.end]:
        raise programmed.block.refuse(
            "the unit of a scale without decimal point depends on the control: write the decimal point"
        )
    if programmed.others["P"] <= 0.0:
        raise programmed.block.refuse("the scale P is not positive: write a number above 0")
    return _about(programmed.centre(ALL_AXES), scaled(*[programmed.others["P"]] * 3))


def _mirror(programmed: Programmed) -> Placement:
    """G51.1: mirrored at the programmed positions, each across its axis."""
    programmed.refuse_but("")
    if not programmed.axes:
        raise programmed.block.refuse("G51.1 needs an axis word: write the position of the mirror")
    return _about(
        shifted(**{name.lower(): v for name, v in programmed.axes.items()}), mirrored("".join(programmed.axes))
    )


def _tilt(programmed: Programmed) -> Placement:
    """G68.2: origin X Y Z, turned by I about Z, by J about X as turned, by K about Z as turned."""
    programmed.refuse_but("IJKP")
    if programmed.others.get("P", 0.0) or not {"I", "J", "K"} <= programmed.others.keys():
        raise programmed.block.refuse(
            "G68.2 is corrected only with the Euler angles I J K and without P: write all three angles"
        )
    i, j, k = (programmed.others[name] for name in "IJK")
    origin = programmed.centre(ALL_AXES) if programmed.axes else Placement()
    return origin.then(euler(i, j, k))


MAKERS: dict[float, Callable[[Programmed], Placement]] = {
    ROTATION: _rotation,
    SCALE: _scale,
    MIRROR: _mirror,
    TILT: _tilt,
}
"""By the code that brings it."""
