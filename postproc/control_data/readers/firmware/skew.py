"""The skew that Klipper and Marlin share: y xy + z (xz - xy yz) is taken off x, and z yz off y."""

from __future__ import annotations

from kinematics.effects import Effect
from postproc.control_data.readers.control_source import Source


def lines_of_skew(source: Source, xy: float, xz: float, yz: float) -> list[Effect]:
    """The errors that the tangents remove; none for a tangent of 0."""
    added = (("X", "Y", -xy), ("X", "Z", -(xz - xy * yz)), ("Y", "Z", -yz))
    return [source.line(output, of, tangent) for output, of, tangent in added if tangent]


def skew_of(added: dict[str, float]) -> tuple[float, float, float]:
    """Tangents xy, xz and yz that add these slopes, by the letters of output and source."""
    xy, yz = -added["XY"], -added["YZ"]
    return xy, -added["XZ"] + xy * yz, yz
