"""Virtual controls with kinematic parameters, written from the manuals alone: files to joint positions.

Each takes the text of a file and gives linear positions `(n, 3)`, mm, X Y Z, for tool points `(n, 3)` in the workpiece
frame, rotary positions by name `(n,)`, deg, and tool lengths `(n,)`.
"""

import dataclasses
import re

import numpy as np

from support.programs import load


def turned(vector, degrees, points):
    """Points turned right-handed about a vector through the origin (Rodrigues)."""
    k = np.asarray(vector, float) / np.linalg.norm(vector)
    c, s = np.cos(np.radians(degrees))[:, None], np.sin(np.radians(degrees))[:, None]
    return points * c + np.cross(k, points) * s + np.outer(points @ k, k) * (1.0 - c)


def linuxcnc(text, tip, angles, length, _chain):
    """The formulas of xyzac-trt-kins and xyzbc-trt-kins; Z is the nose's, the tool length is in tool-offset."""
    pins = {name.split(".")[1]: float(value) for name, value in re.findall(r"^setp (\S+) (\S+)$", text, re.M)}
    if "pivot-length" in pins:
        return _five_axis_head(pins["pivot-length"], tip, angles, length)
    x0, y0, z0 = (pins[f"{letter}-rot-point"] for letter in "xyz")
    c = np.radians(angles["C"])
    dz = pins["z-offset"] + length
    x, y, z = (tip + np.outer(length, [0, 0, 1])).T - np.array([[x0], [y0], [z0]])
    if "A" in angles:
        a, dy = np.radians(angles["A"]), pins["y-offset"]
        jx = np.cos(c) * x - np.sin(c) * y + x0
        across = np.sin(c) * x + np.cos(c) * y - dy
        jy = np.cos(a) * across - np.sin(a) * (z - dz) + dy + y0
        jz = np.sin(a) * across + np.cos(a) * (z - dz) + dz + z0
    else:
        b, dx = np.radians(angles["B"]), pins["x-offset"]
        across = np.cos(c) * x - np.sin(c) * y - dx
        jx = np.cos(b) * across + np.sin(b) * (z - dz) + dx + x0
        jy = np.sin(c) * x + np.cos(c) * y + y0
        jz = -np.sin(b) * across + np.cos(b) * (z - dz) + dz + z0
    return np.stack([jx, jy, jz], axis=1)


def _five_axis_head(pivot, tip, angles, length):
    b, c = np.radians(angles["B"]), np.radians(angles["C"])
    r = pivot + length
    back = np.stack([np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), -np.cos(b)], axis=1) * r[:, None]
    return tip - back - np.outer(np.full(len(tip), pivot), [0, 0, 1])


def _siemens(vectors, tip, angles, length, chain):
    """Chain of vectors; a table turns about V by its position, as a head does."""
    first, second = chain["siemens"]
    v1, v2 = vectors["V1"], vectors["V2"]
    tool = np.outer(length, [0, 0, -1])
    if chain["kind"] == "P":
        moved = vectors["I3"] + turned(v2, angles[second], vectors["I4"] + tip)
        return vectors["I2"] + turned(v1, angles[first], moved) - tool
    if chain["kind"] == "T":
        moved = vectors["I2"] + turned(v2, angles[second], vectors["I3"] + tool)
        return tip - vectors["I1"] - turned(v1, angles[first], moved)
    table = vectors["I3"] + turned(v2, angles[second], vectors["I4"] + tip)
    return table - vectors["I1"] - turned(v1, angles[first], vectors["I2"] + tool)


def siemens_trafo5(text, tip, angles, length, chain):
    """Machine data of types 24 (T), 40 (P) and 56 (M)."""
    names = {
        "T": {"24500": "I1", "24560": "I2", "24550": "I3"},
        "P": {"24550": "I2", "24558": "I3", "24500": "I4"},
        "M": {"24560": "I1", "24550": "I2", "24558": "I3", "24500": "I4"},
    }[chain["kind"]] | {"24570": "V1", "24572": "V2"}
    vectors = {name: np.zeros(3) for name in names.values()}
    for number, k, value in re.findall(r"^N(\d+) \$MC_TRAFO5_\w+\[(\d)\]=(\S+)$", text, re.M):
        vectors[names[number]][int(k)] = float(value)
    return _siemens(vectors, tip, angles, length, chain)


def siemens_tcarr(text, tip, angles, length, chain):
    """$TC_CARR1-3 I1, 4-6 I2, 7-9 V1, 10-12 V2, 15-17 I3, 18-20 I4."""
    numbers = {int(n): float(value) for n, value in re.findall(r"^\$TC_CARR(\d+)\[1\]=(\S+)$", text, re.M)}
    firsts = {"I1": 1, "I2": 4, "V1": 7, "V2": 10, "I3": 15, "I4": 18}
    vectors = {name: np.array([numbers.get(n + k, 0.0) for k in range(3)]) for name, n in firsts.items()}
    return _siemens(vectors, tip, angles, length, chain)


def fanuc(text, tip, angles, length, chain):
    """Points A, B of the table, E, F of the head; axes by the nominal directions, tables turned against ISO 841."""
    values = {int(n): float(value) for n, value in re.findall(r"^(\d+),(\S+)$", text, re.M)}
    vectors = {n: np.array([values.get(n + k, 0.0) for k in range(3)]) for n in (19700, 19703, 19709, 19712)}
    lines = []
    place = np.zeros(3)
    for n, name in zip((19700, 19703), chain["table"], strict=False):
        place = place + vectors[n]
        lines.append((name, place))
    points = tip
    for name, place in reversed(lines):
        points = place + turned(-chain["directions"][name], angles[name], points - place)
    tool = np.outer(length, [0, 0, -1])
    place = np.zeros(3)
    for n, name in zip((19709, 19712), reversed(chain["head"]), strict=False):
        place = place + vectors[n]
        tool = place + turned(chain["directions"][name], angles[name], tool - place)
    return points - tool


def heidenhain(text, tip, angles, length, chain):
    """Product of the rows, from the tool to the workpiece; a table turns against ISO 841, the head with it."""
    frames = []  # of each axis: place and rotation of its frame
    place, frame = np.zeros(3), np.eye(3)
    for row in text.splitlines():
        match = re.search(r"Trans\s+([XYZABC])\s+(\S+)$", row)
        if match and match[1] in "XYZ":
            place = place + frame[:, "XYZ".index(match[1])] * float(match[2])
        elif match:
            axis = np.tile(np.eye(3)["ABC".index(match[1])], (1, 1))
            columns = [turned(axis[0], np.array([float(match[2])]), e[None])[0] for e in np.eye(3)]
            frame = frame @ np.stack(columns, axis=1)
        elif "MachAxis" in row:
            frames.append((row.split()[-1], place, frame))
    tool, points = np.outer(length, [0, 0, -1]), tip
    for name, place, frame in frames:
        line = frame[:, "ABC".index(name[0])]
        line = line * np.sign(line @ chain["directions"][name])
        if name in chain["head"]:
            tool = place + turned(line, angles[name], tool - place)
    for name, place, frame in reversed(frames):
        line = frame[:, "ABC".index(name[0])]
        line = line * np.sign(line @ chain["directions"][name])
        if name in chain["table"]:
            points = place + turned(-line, angles[name], points - place)
    return points - tool


CONTROLS = {
    "linuxcnc-kinematics": linuxcnc,
    "siemens-trafo5": siemens_trafo5,
    "siemens-tcarr": siemens_tcarr,
    "fanuc-kinematics": fanuc,
    "heidenhain-transformations": heidenhain,
}


def chain_of(machine):
    """Rotary axes of head and table from the bed on, their directions, and Siemens' kind and order."""
    rotary = [axis for axis in machine.axes if axis.rotary]
    head = [axis.name for axis in rotary if axis.side == "tool"]
    table = [axis.name for axis in rotary[::-1] if axis.side == "workpiece"]
    kind = {2: "T", 1: "M", 0: "P"}[len(head)]
    directions = {axis.name: axis.unit_direction for axis in rotary}
    return {"head": head, "table": table, "directions": directions, "kind": kind, "siemens": [*head, *table]}


def joints(format, text, machine, q, tip, length):
    """Axis positions `(n, axes)`, mm and rad, that the control with this file sends for tool points."""
    angles = {axis.name: np.degrees(q[:, i]) for i, axis in enumerate(machine.axes) if axis.rotary}
    linear = CONTROLS[format](text, tip, angles, length, chain_of(machine))
    sent = q.copy()
    for k, letter in enumerate("XYZ"):
        sent[:, machine.index(letter)] = linear[:, k]
    return sent


def trunnion(tilt):
    """The shipped trunnion, as LinuxCNC turns it: both axes against ISO 841, and off the origin."""
    machine = load(f"trunnion_{tilt.lower()}c")
    against = {"C": (0.0, 0.0, -1.0), "A": (-1.0, 0.0, 0.0), "B": (0.0, -1.0, 0.0)}
    points = {"C": (3.0, -7.0, 11.0), tilt: (5.0, -20.0, 85.0)}
    axes = [
        dataclasses.replace(axis, direction=against[axis.name], point=points[axis.name]) if axis.rotary else axis
        for axis in machine.axes
    ]
    return dataclasses.replace(machine, axes=tuple(axes))
