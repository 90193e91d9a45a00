"""What turns, mirrors or scales ISO coordinates: G68, G51.1, G51, and tilted planes by G68.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from postproc.iso.codes import MIRROR, ROTATION, SCALE, TILT
from postproc.motion.frames import Placement, euler, mirrored, rotated, scaled, shifted
from postproc.text.block import Block

MIDDLE = "XYZ"


@dataclass(frozen=True)
class Said:
    """What a block says of a place."""

    block: Block
    plane: str
    axes: Mapping[str, float]
    """X Y Z, mm."""
    others: Mapping[str, float]
    """I J K R P, as they stand."""

    def centre(self, names: str) -> Placement:
        """The shift to the place that the block names, of these axes; Refusal where one is missing."""
        if self.axes.keys() != set(names):
            raise self.block.refuse(f"needs {' and '.join(names)}: without, the centre depends on where the tool is")
        return shifted(**{name.lower(): value for name, value in self.axes.items()})

    def refuse_but(self, allowed: str) -> None:
        """Refuse words that are none of these."""
        strange = sorted(self.others.keys() - set(allowed))
        if strange:
            raise self.block.refuse(f"{strange[0]} here: its effect depends on the control")


def _about(centre: Placement, inner: Placement) -> Placement:
    x, y, z = centre.shift
    return centre.then(inner).then(shifted(-x, -y, -z))


def _rotation(said: Said) -> Placement:
    """G68: round a point of the plane, counter-clockwise seen from its normal."""
    said.refuse_but("R")
    if "R" not in said.others:
        raise said.block.refuse("G68 without R")
    return _about(said.centre(said.plane[:2]), rotated(said.others["R"], said.plane))


def _scale(said: Said) -> Placement:
    """G51: larger by P round a point, along all axes."""
    said.refuse_but("P")
    if "P" not in said.others:
        raise said.block.refuse("G51 without P: scales that differ by axis are not corrected")
    word = next(word for word in said.block.words if word.address == "P")
    if word.formula is None and "." not in said.block.text[word.start : word.end]:
        raise said.block.refuse("a scale without decimal point: its unit depends on the control")
    if said.others["P"] <= 0.0:
        raise said.block.refuse("a scale that is not positive")
    return _about(said.centre(MIDDLE), scaled(*[said.others["P"]] * 3))


def _mirror(said: Said) -> Placement:
    """G51.1: mirrored at the places that are said, each across its axis."""
    said.refuse_but("")
    if not said.axes:
        raise said.block.refuse("G51.1 without an axis")
    return _about(shifted(**{name.lower(): v for name, v in said.axes.items()}), mirrored("".join(said.axes)))


def _tilt(said: Said) -> Placement:
    """G68.2: origin X Y Z, turned by I about Z, by J about X as turned, by K about Z as turned."""
    said.refuse_but("IJKP")
    if said.others.get("P", 0.0) or not {"I", "J", "K"} <= said.others.keys():
        raise said.block.refuse(
            "G68.2 is corrected only with the Euler angles I J K and without P: write all three angles"
        )
    i, j, k = (said.others[name] for name in "IJK")
    origin = said.centre(MIDDLE) if said.axes else Placement()
    return origin.then(euler(i, j, k))


MAKERS: dict[float, Callable[[Said], Placement]] = {ROTATION: _rotation, SCALE: _scale, MIRROR: _mirror, TILT: _tilt}
"""By the code that brings it."""
