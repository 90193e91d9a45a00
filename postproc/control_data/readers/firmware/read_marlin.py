"""Marlin: M852, M421 and `G29 W`, lines to be sent to it or its answer to M503."""

from __future__ import annotations

import re

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal
from postproc.control_data.readers.firmware.skew import lines_of_skew

_PROMPT = re.compile(r"^\s*(?:Recv:\s*)?(?:echo:)?\s*")
_UNREAD = re.compile(r"G29 S3|G20$")
"""Rows that change a mesh or the unit in a way that is not read."""
Where = tuple[str, int, str]


def nodes_of(x: str, y: str) -> dict[str, tuple[float, ...]]:
    """Positions of the points of the mesh along X and Y, of `10:190:5` each; none where both are empty."""
    if not x and not y:
        return {}
    return {axis: _nodes(axis, text) for axis, text in (("X", x), ("Y", y))}


def _nodes(axis: str, text: str) -> tuple[float, ...]:
    said = f"--set {axis.lower()}={text}: expected first and last position and number of the points, as 10:190:5"
    parts = text.split(":")
    if len(parts) != 3 or not parts[2].isdecimal() or not 2 <= int(parts[2]) <= 100:
        raise UserError(said)
    low, high = numbers(parts[:2], f"--set {axis.lower()}", 1, text)
    count = int(parts[2])
    if low >= high:
        raise UserError(said)
    return tuple(low + (high - low) * k / (count - 1) for k in range(count))


def read(source: Source) -> list[Effect]:
    """Skew factors, and the mesh at the points of the settings."""
    skew: dict[str, float] = {}
    heights: dict[tuple[float, float], float] = {}
    unused: list[UserError] = []
    for name, text in source.files.items():
        for line, row in enumerate(text.splitlines(), 1):
            command = _PROMPT.sub("", row).partition(";")[0].strip()
            where = name, line, row
            if _UNREAD.match(command):
                raise refusal(*where, "only mm, M852, M421 I J Z and G29 W I J Z are read")
            code, *words = command.removeprefix("G29 ").split() or [""]
            if code not in ("M852", "M421", "M420", "W"):
                continue
            values = {word[0]: numbers([word[1:]], *where)[0] for word in words}
            if code == "M852":
                _once(bool(skew), where)
                skew = {"J": 0.0, "K": 0.0, "I": values.get("S", 0.0)} | values
                source.used.add(name)
            elif code == "M420":
                unused += _unused(values, where)
            else:
                point = _point(values, where)
                _once(point in heights, where)
                heights[point] = values["Z"]
                source.used.add(name)
    if heights and unused:
        raise unused[0]
    tangents = lines_of_skew(source, skew["I"], skew["J"], skew["K"]) if skew else []
    return [*tangents, *_mesh(source, heights)]


def _once(again: bool, where: Where) -> None:
    if again:
        raise refusal(*where, "a second value")


def _unused(values: dict[str, float], where: Where) -> list[UserError]:
    """Why the control does not use its mesh, or not at every height."""
    cure = "take the rows of the mesh out to read the skew alone"
    if not values.get("S", 1.0):
        return [refusal(*where, f"levelling is off, so the mesh corrects nothing: {cure}")]
    if values.get("Z", 0.0) > 0.0:
        return [refusal(*where, f"the mesh fades out with the height: only Z0 is read; {cure}")]
    return []


def _point(values: dict[str, float], where: Where) -> tuple[float, float]:
    if not {"I", "J", "Z"} <= set(values):
        raise refusal(*where, "expected I, J and Z")
    return values["I"], values["J"]


def _mesh(source: Source, heights: dict[tuple[float, float], float]) -> list[Effect]:
    if not heights:
        return []
    nodes = nodes_of(source.settings.x, source.settings.y)
    if not nodes:
        raise UserError("the files have a mesh without its positions: give --set x= and --set y=, as 10:190:5")
    points = [(float(i), float(j)) for i in range(len(nodes["X"])) for j in range(len(nodes["Y"]))]
    if set(heights) != set(points):
        raise UserError(
            f"the mesh has {len(heights)} points, and --set x= and y= have {len(points)}: expected I 0 to "
            f"{len(nodes['X']) - 1} and J 0 to {len(nodes['Y']) - 1}"
        )
    return [source.table("Z", ("X", "Y"), (nodes["X"], nodes["Y"]), [heights[point] for point in points])]
