"""Rotation, mirror and scale of ISO coordinates (G68, G51.1, G51), and tilted planes by G68.2."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import msgspec
import numpy as np

from postproc.control.tilted_planes import lean, normal_of
from postproc.iso.channel import Channel
from postproc.iso.codes import MIRROR, ROTATION, SCALE, TILT
from postproc.motion.frames import Placement, euler, mirrored, renamed, rotated, scaled, shifted
from postproc.motion.moves import Known
from postproc.text.block import Block

ALL_AXES = "XYZ"
PERPENDICULAR_PLANE_RAD = 1e-6
"""rad: a tool that leans no more is perpendicular to the tilted plane."""


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


# ---- the transformation in force


def turn(channel: Channel, code: float, programmed: Programmed) -> None:
    """G68, G51, G51.1, G68.2."""
    modal, refuse = channel.modal, programmed.block.refuse
    if modal.placement_code and not (code == MIRROR == modal.placement_code):
        raise refuse(f"G{code:g} while G{modal.placement_code:g} is active is not corrected: end the latter first")
    if modal.offsets.turn:
        raise refuse(
            f"G{code:g} within a work offset that rotates the coordinates is not corrected: select another first"
        )
    if code == TILT and (modal.offsets.moved or modal.tcp):
        raise refuse("a tilted plane while G52, G92 or TCP is active is not corrected: end these before it")
    if code == MIRROR:
        modal.mirrors.update(programmed.axes)
        programmed = Programmed(programmed.block, programmed.plane, modal.mirrors, programmed.others)
    _put(channel, MAKERS[code](programmed), code)
    modal.upright = False


def end_turn(channel: Channel, code: float) -> None:
    """G69, G50: of the code that it ends."""
    if channel.modal.placement_code == code:
        _put(channel, Placement(), 0.0)


def end_mirror(channel: Channel, block: Block, axes: Iterable[str]) -> None:
    """G50.1: of these axes, all for none."""
    modal = channel.modal
    if modal.placement_code != MIRROR:
        return
    named = set(axes)
    modal.mirrors = {axis: at for axis, at in modal.mirrors.items() if named and axis not in named}
    remaining = MAKERS[MIRROR](Programmed(block, "", modal.mirrors, {})) if modal.mirrors else Placement()
    _put(channel, remaining, MIRROR if modal.mirrors else 0.0)


def _put(channel: Channel, placement: Placement, code: float) -> None:
    modal = channel.modal
    was_tilted, before = modal.tilted, modal.placement
    modal.placement, modal.placement_code = placement, code
    if was_tilted != modal.tilted:
        channel.change_frame(channel.x_y_z)
    else:
        channel.change_shifted([channel.x_y_z[i] for i in renamed(before, placement)])


def check_perpendicular(channel: Channel, block: Block) -> None:
    """G53.1: the tool along the normal of the tilted plane; otherwise the control chooses how to turn it."""
    modal, machine, recorder = channel.modal, channel.machine, channel.recorder
    if not modal.tilted:
        raise block.refuse("G53.1 needs a tilted plane: write G68.2 before it")
    degrees = np.where(machine.rotary, np.add(recorder.position, recorder.frame.offset), 0.0)
    known = all(recorder.known[i] != Known.ASSUMED for i in channel.rotary_axes)
    if not known or lean(machine, degrees, normal_of(modal.placement)) > PERPENDICULAR_PLANE_RAD:
        raise block.refuse(
            "the tool is not perpendicular to the tilted plane, and the control chooses how G53.1 turns "
            "the rotary axes: turn them in a block before it"
        )
    modal.upright = True
