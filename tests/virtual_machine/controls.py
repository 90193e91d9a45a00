"""Controls with compensation tables: each reads the files of an export by its manual, and moves the motors.

Nothing of ncomp is used. Commands and motors are `(n, axes)`, mm and degrees; ways `(n, axes)` are 1 or -1, the
direction in which each axis came to its command.
"""

from __future__ import annotations

import configparser
import csv
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from virtual_machine.chain import Array, Chain, applied, nominal_points, tool_points, turned_about
from virtual_machine.truth import MICRO

Motors = Callable[[Array, Array], Array]
"""Positions of the motors for commands and directions of approach (`ways`)."""
ORDER = "XYZABCUVW"
SIGN = {"error": -1.0, "correction": 1.0}
"""What makes a value of a file an amount that the control adds."""
GRBL_STEPS = {"X": 250.0, "Y": 320.0, "Z": 1600.0}
"""Steps per mm."""
MARLIN_POINTS = (21, 16)
"""Points of the mesh over the travels of X and Y."""


class Addition(NamedTuple):
    """A function of commands and directions whose values are added to the command of one axis."""

    output: str
    value: Callable[[Array, Array], Array]


def numbered(chain: Chain) -> list[str]:
    """Axes in the order in which controls number them."""
    return sorted(chain.names, key=lambda name: (ORDER.index(name[0]), name))


def summed(chain: Chain, additions: Iterable[Addition]) -> Motors:
    """A control that adds the values of all its tables to commands."""
    every = list(additions)

    def motors(commands: Array, ways: Array) -> Array:
        moved = commands.copy()
        for addition in every:
            moved[:, chain.index(addition.output)] += addition.value(commands, ways)
        return moved

    return motors


def curve(chain: Chain, axis: str, x: Sequence[float], y: Sequence[float], turn: float = 0.0) -> Callable[..., Array]:
    """Linear between points, held outside; with a turn it begins again."""
    nodes, values, i = np.array(x, float), np.array(y, float), chain.index(axis)
    assert (np.diff(nodes) > 0).all()

    def at(commands: Array, _ways: Array) -> Array:
        position = commands[:, i]
        if turn:
            position = nodes[0] + (position - nodes[0]) % turn
        return np.interp(position, nodes, values)

    return at


def by_way(chain: Chain, axis: str, up: Callable[..., Array], down: Callable[..., Array]) -> Callable[..., Array]:
    """One function for travel in the positive direction of an axis, another for the negative."""
    i = chain.index(axis)
    return lambda commands, ways: np.where(ways[:, i] > 0, up(commands, ways), down(commands, ways))


def linuxcnc(folder: Path, chain: Chain, _sign: str) -> Motors:
    """COMP_FILE of each joint: a trim by the direction of travel, which is added to the command."""
    ini = configparser.ConfigParser()
    ini.read_string((folder / "linuxcnc.ini").read_text())
    additions = []
    for section in ini.sections():
        axis = numbered(chain)[int(section.removeprefix("JOINT_"))]
        rows = np.loadtxt(folder / ini[section]["COMP_FILE"], ndmin=2)
        assert len(rows) <= 256
        x = rows[:, 0]
        trims = rows[:, 1:] if ini[section]["COMP_FILE_TYPE"] == "1" else x[:, None] - rows[:, 1:]
        ways = [curve(chain, axis, x, trims[:, k]) for k in (0, 1)]
        additions.append(Addition(axis, by_way(chain, axis, *ways)))
    return summed(chain, additions)


def _assignments(text: str) -> dict[str, str]:
    rows = (row.partition(";")[0].partition("=") for row in text.splitlines())
    return {left.strip(): right.strip() for left, equals, right in rows if equals}


def siemens_eec(folder: Path, chain: Chain, _sign: str) -> Motors:
    """$AA_ENC_COMP is added to the encoder's actual value: the axis moves against it."""
    said = _assignments((folder / "ax_eec.ini").read_text())
    additions = []
    for axis in chain.names:
        own = f"[0,{axis}1]"
        if f"$AA_ENC_COMP_STEP{own}" not in said:
            continue
        step, low, high, modulo = (float(said[f"$AA_ENC_COMP_{k}{own}"]) for k in ("STEP", "MIN", "MAX", "IS_MODULO"))
        last = round((high - low) / step)
        x = low + step * np.arange(last + 1)
        y = [-float(said[f"$AA_ENC_COMP[0,{k},{axis}1]"]) for k in range(last + 1)]
        additions.append(Addition(axis, curve(chain, axis, x, y, high - low if modulo else 0.0)))
    return summed(chain, additions)


def siemens_cec(folder: Path, chain: Chain, sign: str) -> Motors:
    """$AN_CEC: tables of an axis sum; one may be multiplied by a second; DIRECTION is that of the input axis."""
    said = _assignments((folder / "nc_cec.ini").read_text())

    def of(what: str, t: int) -> str:
        return said[f"$AN_CEC_{what}[{t}]"]

    def function(t: int) -> Callable[..., Array]:
        step, low, high = (float(of(what, t)) for what in ("STEP", "MIN", "MAX"))
        last = round((high - low) / step)
        y = [float(said[f"$AN_CEC[{t},{k}]"]) for k in range(last + 1)]
        axis = of("INPUT_AXIS", t).strip("()").removesuffix("1")
        turn = high - low if of("IS_MODULO", t) == "1" else 0.0
        return curve(chain, axis, low + step * np.arange(last + 1), y, turn)

    def table(t: int) -> Addition:
        first, direction = function(t), int(of("DIRECTION", t))
        second = int(of("MULT_BY_TABLE", t))
        times = function(second - 1) if second else lambda commands, _: np.ones(len(commands))
        i = chain.index(of("INPUT_AXIS", t).strip("()").removesuffix("1"))

        def value(commands: Array, ways: Array) -> Array:
            active = np.ones(len(commands)) if direction == 0 else ways[:, i] == direction
            return SIGN[sign] * active * first(commands, ways) * times(commands, ways)

        return Addition(of("OUTPUT_AXIS", t).strip("()").removesuffix("1"), value)

    every = sorted({int(found[1]) for found in re.finditer(r"\$AN_CEC_STEP\[(\d+)\]", "\n".join(said))})
    factors = {int(of("MULT_BY_TABLE", t)) - 1 for t in every}
    return summed(chain, [table(t) for t in every if t not in factors])


def _columns(text: str) -> tuple[str, list[dict[str, str]]]:
    """First line, and rows by column, of a table of fixed columns."""
    head, names, *rows = text.splitlines()
    assert rows[-1] == "[END]"
    starts = [(found.start(), found[0]) for found in re.finditer(r"\S+", names)]
    ends = [start for start, _ in starts[1:]] + [None]
    cells = [
        {name: row[start:end].strip() for (start, name), end in zip(starts, ends, strict=True)} for row in rows[:-1]
    ]
    return head, cells


def heidenhain(folder: Path, chain: Chain, sign: str) -> Motors:
    """The active line of the .CMA names, in the column of an axis, the file on disk that is a function of it."""
    head, (line,) = _columns((folder / "config.cma").read_text())
    assert head.split()[1] == "config.cma"
    additions = []
    for axis in set(line) & set(chain.names):
        head, rows = _columns((folder / line[axis]).read_text())
        assert head.split()[1] == line[axis]
        assert len(rows) <= 256
        x = [float(row["AXISPOS"]) for row in rows]
        turn = chain.axis(axis).turn
        for output in [name for name in chain.names if rows[0][name]]:
            up = curve(chain, axis, x, [SIGN[sign] * float(row[output]) for row in rows], turn)
            down = up
            if output == axis and rows[0]["BACKLASH"]:
                down = curve(chain, axis, x, [SIGN[sign] * float(row["BACKLASH"]) for row in rows], turn)
            additions.append(Addition(output, by_way(chain, axis, up, down)))
    return summed(chain, additions)


def _rows(path: Path) -> list[dict[str, str]]:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def fanuc(folder: Path, chain: Chain, sign: str, unit: float = 1e-3) -> Motors:
    """Points of one number space; 3620 is at the reference position, each value is added in the section up to its point.

    Negative travel has points of its own from 3626 on, and the amount 3627 at the reference position.
    """
    points = {int(row["point"]): float(row["value"]) for row in _rows(folder / "pitch.csv")}
    assert len(points) == len(_rows(folder / "pitch.csv"))
    text = re.findall(r"^N1(\d{4})P(-?\d+)$", (folder / "pitch.txt").read_text(), re.MULTILINE)
    assert {int(number): float(value) for number, value in text} == points
    by_axis: dict[str, dict[int, float]] = defaultdict(dict)
    for row in _rows(folder / "parameters.csv"):
        by_axis[row["axis"]][int(row["parameter"])] = float(row["value"])
    additions = []
    for axis, said in by_axis.items():
        reference, low, high = (int(said[k]) for k in (3620, 3621, 3622))
        x = chain.axis(axis).home + (np.arange(low, high + 1) - reference) * said[3624]
        size = SIGN[sign] * unit * said[3623]

        def amounts(first: int, at_reference: float, n: int = high - low + 1, zero: int = reference - low) -> Array:
            total = np.cumsum([points[first + k] for k in range(n)])
            return np.asarray(total - total[zero] + at_reference)

        turn = said.get(3625, 0.0)
        up = down = curve(chain, axis, x, size * amounts(low, 0.0), turn)
        if 3626 in said:
            assert not set(range(int(said[3626]), int(said[3626]) + len(x))) & set(range(low, high + 1))
            down = curve(chain, axis, x, size * amounts(int(said[3626]), said[3627]), turn)
        additions.append(Addition(axis, by_way(chain, axis, up, down)))
    return summed(chain, additions)


def mitsubishi(folder: Path, chain: Chain, _sign: str, unit: float = 0.2e-3) -> Motors:
    """Increments in half output units; 0 at the reference point."""
    points: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for row in _rows(folder / "error_data.csv"):
        points[row["axis"]].append((float(row["position"]), float(row["value"])))
    additions = []
    for row in _rows(folder / "parameters.csv"):
        axis = row["axis"]
        x, steps = np.array(points[axis]).T
        total = np.cumsum(steps)
        y = unit / 2 * float(row["scale"]) * (total - total[int(row["reference point"])])
        turn = chain.axis(axis).turn
        additions.append(Addition(axis, curve(chain, axis, x, y, turn)))
    return summed(chain, additions)


def _lists(folder: Path) -> Iterable[dict[str, str]]:
    for path in sorted(folder.glob("*.lis")):
        rows = (row.partition("#")[0].split(None, 1) for row in path.read_text().splitlines())
        yield {row[0]: row[1].strip() for row in rows if row}


def isg(folder: Path, chain: Chain, _sign: str) -> Motors:
    """kw.ssfk: error by direction at free setpoints, 0.1 um or 1e-4 degrees; the control takes it off."""
    additions = []
    for said in _lists(folder):
        axis, count = said["kopf.log_achs_name"], int(said["kw.ssfk.kw_nr_max"])

        def column(what: str, said: Mapping[str, str] = said, count: int = count) -> Array:
            return 1e-4 * np.array([float(said[f"kw.ssfk.table[{k}].{what}"]) for k in range(count)])

        turn = 360.0 if said["kw.ssfk.modulo"] == "1" else 0.0
        ways = [curve(chain, axis, column("setpoint"), -column(what), turn) for what in ("pos", "neg")]
        additions.append(Addition(axis, by_way(chain, axis, *ways)))
    return summed(chain, additions)


def isg_cross(folder: Path, chain: Chain, sign: str) -> Motors:
    """kw.crosscomp2 in the list of the slave: a plane over two masters."""
    additions = []
    for said in _lists(folder):
        masters, grids = [], []
        for k in (1, 2):
            masters.append(numbered(chain)[int(said[f"kw.crosscomp2.master{k}_ax_nr"]) - 1])
            start = float(said[f"kw.crosscomp2.start_position_master{k}"])
            count = int(said[f"kw.crosscomp2.last_index_master{k}"]) + 1
            grids.append(1e-4 * (start + float(said["kw.crosscomp2.interval"]) * np.arange(count)))
        values = [
            [float(said[f"kw.crosscomp2.table[{j}][{i}].correction"]) for j in range(len(grids[1]))]
            for i in range(len(grids[0]))
        ]
        additions.append(
            Addition(said["kopf.log_achs_name"], plane(chain, masters, grids, 1e-4 * SIGN[sign] * np.array(values)))
        )
    return summed(chain, additions)


def plane(chain: Chain, axes: Sequence[str], grids: Sequence[Array], values: Array) -> Callable[..., Array]:
    """Bilinear over two axes, `(k, m)` at the grid; held at the edge."""
    columns = [chain.index(axis) for axis in axes]

    def at(commands: Array, _ways: Array) -> Array:
        found = np.zeros(len(commands))
        for weights, row in zip(_hats(commands[:, columns[0]], grids[0]).T, values, strict=True):
            found += weights * np.interp(commands[:, columns[1]], grids[1], row)
        return found

    return at


def _hats(x: Array, nodes: Array) -> Array:
    """Share `(n, k)` of each node in a value at x, linear between them."""
    return np.stack([np.interp(x, nodes, row) for row in np.eye(len(nodes))], axis=1)


def _firmware(chain: Chain, shears: Mapping[str, float], height: Callable[..., Array] | None) -> Motors:
    additions = [
        Addition(name[0], lambda commands, _, source=name[1], t=tangent: t * commands[:, chain.index(source)])
        for name, tangent in shears.items()
    ]
    return summed(chain, [*additions, *([Addition("Z", height)] if height else [])])


def klipper(folder: Path, chain: Chain, _sign: str) -> Motors:
    """skew_correction.calc_unskew, and bed_mesh."""
    text = (folder / "ncomp.cfg").read_text()
    said = dict(re.findall(r"^(\w+) = (\S+)$", text, re.MULTILINE))
    xy, xz, yz = (float(said[f"{plane}_skew"]) for plane in ("xy", "xz", "yz"))
    height = None
    if "[bed_mesh ncomp]" in text:
        body = text.partition("points =\n")[2]
        rows = [[float(v) for v in row.split(",")] for row in body.splitlines() if row.startswith("  ")]
        ends = [[float(said[f"{end}_{letter}"]) for end in ("min", "max")] for letter in "xy"]
        grids = [np.linspace(*end, n) for end, n in zip(ends, (len(rows[0]), len(rows)), strict=True)]
        height = plane(chain, "XY", grids, np.array(rows).T)
    return _firmware(chain, {"XY": -xy, "XZ": -(xz - xy * yz), "YZ": -yz}, height)


def reprap(folder: Path, chain: Chain, _sign: str) -> Motors:
    """M556 and heightmap.csv."""
    words = {word[0]: float(word[1:]) for word in (folder / "skew.g").read_text().split()[1:]}
    height = None
    if (folder / "heightmap.csv").exists():
        _, _, limits, *rows = (folder / "heightmap.csv").read_text().splitlines()
        x0, x1, y0, y1 = map(float, limits.split(",")[2:6])
        values = np.array([[float(v) for v in row.split(",")] for row in rows])
        grids = [np.linspace(x0, x1, values.shape[1]), np.linspace(y0, y1, values.shape[0])]
        height = plane(chain, "XY", grids, values.T)
    shears = {"XY": words["X"], "YZ": words["Y"], "XZ": words["Z"]}
    return _firmware(chain, {name: value / words["S"] for name, value in shears.items()}, height)


def marlin(folder: Path, chain: Chain, _sign: str) -> Motors:
    """Planner::skew, and z_values[I][J] of M421 on the mesh of `MARLIN_POINTS`."""
    words: dict[str, list[dict[str, float]]] = defaultdict(list)
    for row in (folder / "marlin.gcode").read_text().splitlines():
        code, *values = row.split()
        words[code].append({word[0]: float(word[1:]) for word in values})
    assert list(words)[:2] == ["G21", "M852"]
    (skew,) = words["M852"]
    height = None
    if words["M421"]:
        grids = [np.linspace(*chain.axis(axis).travel, n) for axis, n in zip("XY", MARLIN_POINTS, strict=True)]
        values = np.full([len(grid) for grid in grids], np.nan)
        for point in words["M421"]:
            values[int(point["I"]), int(point["J"])] = point["Z"]
        height = plane(chain, "XY", grids, values)
    xy, xz, yz = (skew.get(letter, 0.0) for letter in "IJK")
    return _firmware(chain, {"XY": -xy, "XZ": -(xz - xy * yz), "YZ": -yz}, height)


def grbl(folder: Path, chain: Chain, _sign: str) -> Motors:
    """$100 to $102 steps per mm from the homed position on; the machine has `GRBL_STEPS` a mm."""
    rows = re.findall(r"^\$(\d+)=([\d.]+)$", (folder / "grbl.txt").read_text(), re.MULTILINE)
    steps = {"XYZ"[int(number) - 100]: float(value) for number, value in rows}

    def added(axis: str) -> Callable[..., Array]:
        i, home = chain.index(axis), chain.axis(axis).home
        return lambda commands, _: (commands[:, i] - home) * (steps[axis] / GRBL_STEPS[axis] - 1.0)

    return summed(chain, [Addition(axis, added(axis)) for axis in steps])


def _pins(path: Path) -> dict[str, float]:
    rows = (row.split() for row in path.read_text().splitlines())
    return {pin.partition(".")[2]: float(value) for setp, pin, value in rows if setp == "setp"}


def linuxcnc_matrix(folder: Path, chain: Chain, _sign: str) -> Motors:
    """kinematicsInverse of matrixkins."""
    pins = _pins(folder / "matrixkins.hal")
    matrix = np.array([[pins[f"C_{i}{j}"] for j in "xyz"] for i in "xyz"])
    return _of_three(chain, lambda axes: axes @ matrix.T)


def linuxcnc_calibrated(folder: Path, chain: Chain, _sign: str) -> Motors:
    """The search of calibxyzkins for the joints whose A j + B j^2 + c is the position."""
    pins = _pins(folder / "calibxyzkins.hal")
    a, b = (np.array([[pins[f"calib-{m}.{i}{j}"] for j in "xyz"] for i in "xyz"]) for m in "ab")
    c = np.array([pins[f"calib-c.{i}"] for i in "xyz"])

    def joints(axes: Array) -> Array:
        found = axes.copy()
        for _ in range(10):
            missed = found @ a.T + found**2 @ b.T + c - axes
            if np.linalg.norm(missed, axis=1).max() < pins["tol"]:
                break
            found -= np.linalg.solve(a + 2 * b * found[:, None, :], missed[:, :, None])[:, :, 0]
        return found

    return _of_three(chain, joints)


def _of_three(chain: Chain, joints: Callable[[Array], Array]) -> Motors:
    """A control whose X, Y and Z are a function of the three, and whose other axes pass."""
    columns = [chain.index(axis) for axis in "XYZ"]

    def motors(commands: Array, _ways: Array) -> Array:
        moved = commands.copy()
        moved[:, columns] = joints(commands[:, columns])
        return moved

    return motors


@dataclass(frozen=True)
class Motions:
    """Error motions as a control's model holds them: curves `(n,)`, mm and rad, by axis and component."""

    chain: Chain
    curves: Mapping[tuple[str, str], Callable[..., Array]]

    def errors(self, commands: Array, ways: Array) -> Array:
        """`(n, axes, 6)`."""
        found = np.zeros((*commands.shape, 6))
        for (component, axis), value in self.curves.items():
            found[:, self.chain.index(axis), "XYZABC".index(component)] = value(commands, ways)
        return found


def aimed(chain: Chain, tool: Array, actual: Callable[[Array, Array], Array]) -> Motors:
    """A control that moves its linear axes until the tool point, by its model, is where the command means it."""
    linear = [chain.index(name) for name in chain.linear]

    def motors(commands: Array, ways: Array) -> Array:
        there = nominal_points(chain, chain.to_radians(commands), np.broadcast_to(tool, (len(commands), 3)))
        slopes = []
        for i in linear:
            ahead = commands.copy()
            ahead[:, i] += 1.0
            moved = nominal_points(chain, chain.to_radians(ahead), np.broadcast_to(tool, (len(commands), 3)))
            slopes.append(moved - there)
        q = commands.copy()
        for _ in range(6):
            missed = actual(q, ways) - there
            q[:, linear] -= np.linalg.solve(np.stack(slopes, axis=2), missed[:, :, None])[:, :, 0]
        return q

    return motors


def by_motions(chain: Chain, tool: Array, motions: Motions) -> Motors:
    """By the error motions of a table in the machine's chain."""

    def actual(q: Array, ways: Array) -> Array:
        zero = np.zeros((len(q), 6))
        targets = np.broadcast_to(tool, (len(q), 3))
        return tool_points(chain, chain.to_radians(q), motions.errors(q, ways), zero, targets)

    return aimed(chain, tool, actual)


def isg_volumetric(folder: Path, chain: Chain, sign: str, tool: Array) -> Motors:
    """ISG_CSV in mm and rad, and the number of axes that carry the workpiece."""
    config = dict(row.split() for row in (folder / "volcomp.lis").read_text().splitlines())
    assert int(config["workpiece_axes"]) == sum(axis.on_workpiece_side for axis in chain.axes)
    lines = [row.partition("//")[0] for row in (folder / config["file[0]"]).read_text().splitlines()]
    curves = {}
    for block in "\n".join(lines).split("#"):
        head, *rows = [row.split() for row in block.splitlines() if row.strip()]
        table = -SIGN[sign] * np.array(rows, float)
        for k, name in enumerate(head[1:], 1):
            assert name[2:] == head[0]
            x = -SIGN[sign] * table[:, 0]
            curves[name[1], head[0]] = curve(chain, head[0], x, table[:, k], chain.axis(head[0]).turn)
    return by_motions(chain, tool, Motions(chain, curves))


def etalon(folder: Path, chain: Chain, sign: str, tool: Array) -> Motors:
    """Grid points of each error motion, mm and rad."""
    text = re.sub(r"//.*", "", (folder / "errors.etalon").read_text())
    curves = {}
    for component, axis, body in re.findall(r"\[E(\w)(\w+)\]\s*Gridpoints = \{([^}]*)\}", text):
        x, y = np.array(body.split(), float).reshape(-1, 2).T
        curves[component, axis] = curve(chain, axis, x, -SIGN[sign] * y, chain.axis(axis).turn)
    return by_motions(chain, tool, Motions(chain, curves))


def iso_csv(folder: Path, chain: Chain, _sign: str, tool: Array) -> Motors:
    """Error motions in um and urad by direction of travel."""
    points: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    for row in _rows(folder / "errors.csv"):
        component = row["error"][2]
        size = MICRO["XYZABC".index(component)]
        cells = [float(row["position"]), size * float(row["forward"]), size * float(row["backward"])]
        points[component, row["axis"]].append(cells)
    curves = {}
    for (component, axis), rows in points.items():
        x, up, down = np.array(rows).T
        turn = chain.axis(axis).turn
        ways = [curve(chain, axis, x, values, turn) for values in (up, down)]
        curves[component, axis] = by_way(chain, axis, *ways)
    return by_motions(chain, tool, Motions(chain, curves))


def heidenhain_kinematics(folder: Path, chain: Chain, sign: str, tool: Array) -> Motors:
    """The rows of the description, from the tool on: each moves the point that those before it have brought there.

    Columns of an axis' table are mm and degrees; that in the axis' own name is its axis compensation.
    """
    tables = {}
    for axis in chain.names:
        path = folder / f"AXIS_{axis}.COM"
        if path.exists():
            head, rows = _columns(path.read_text())
            assert head.split()[1] == path.name
            x = [float(row["AXISPOS"]) for row in rows]
            turn = chain.axis(axis).turn
            for name in [name for name in rows[0] if name == axis or re.fullmatch(r"C\d", name)]:
                if rows[0][name]:
                    y = [-SIGN[sign] * float(row[name]) for row in rows]
                    tables[f"{axis}..{name}" if name != axis else axis] = curve(chain, axis, x, y, turn)
    _, rows = _columns("\n" + (folder / "kinematics.txt").read_text())
    assert [row["AXIS"] for row in rows if row["KEY"] == "MachAxis"] == [axis.name for axis in reversed(chain.axes)]
    assert len([row for row in rows if row["COMPTAB"]]) <= 100 - len(chain.axes)
    belongs = _axes_of(rows)

    def actual(q: Array, ways: Array) -> Array:
        point = np.broadcast_to(tool, (len(q), 3))
        for row, axis in zip(rows, belongs, strict=True):
            at = chain.axis(axis)
            if row["KEY"] == "MachAxis":
                own = tables.get(axis, lambda commands, _: np.zeros(len(commands)))(q, ways)
                forward = np.sign(at.frame[:, at.own % 3] @ at.direction)
                amount = (q[:, [chain.index(axis)]] + forward * own[:, None]) * at.per_file_unit
                point = _displaced(point, at.direction, at.point, amount, at.rotary)
                continue
            assert row["KEY"] == "Trans"
            k = "XYZABC".index(row["AXIS"])
            value = tables[row["COMPTAB"]](q, ways) if row["COMPTAB"] else np.full(len(q), float(row["COORD"]))
            amount = value[:, None] * (1.0 if k < 3 else np.pi / 180)
            point = _displaced(point, at.frame[:, k % 3], at.point, amount, k >= 3)
        return point

    return aimed(chain, tool, actual)


def _axes_of(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """The axis that each row belongs to."""
    return [row["AXIS"] if row["KEY"] == "MachAxis" else row["COMPTAB"].partition("..")[0] for row in rows]


def _displaced(points: Array, along: Array, origin: Array, amount: Array, turns: bool) -> Array:
    if not turns:
        return np.asarray(points + amount * along)
    return applied(turned_about(origin, amount * along), points)


SIMPLE: Mapping[str, Callable[[Path, Chain, str], Motors]] = {
    "linuxcnc": linuxcnc,
    "siemens-eec": siemens_eec,
    "siemens-cec": siemens_cec,
    "heidenhain": heidenhain,
    "fanuc": fanuc,
    "mitsubishi": mitsubishi,
    "isg": isg,
    "isg-cross": isg_cross,
    "klipper": klipper,
    "reprap": reprap,
    "marlin": marlin,
    "grbl": grbl,
    "linuxcnc-matrix": linuxcnc_matrix,
    "linuxcnc-calibxyz": linuxcnc_calibrated,
}
BY_MODEL: Mapping[str, Callable[[Path, Chain, str, Array], Motors]] = {
    "isg-volumetric": isg_volumetric,
    "etalon": etalon,
    "csv": iso_csv,
    "heidenhain-kinematics": heidenhain_kinematics,
}


def control(format: str, folder: Path, chain: Chain, sign: str, tool: Array) -> Motors:
    """The control that these files were written for; sign: its meaning of the values in the files."""
    if format in SIMPLE:
        return SIMPLE[format](folder, chain, sign)
    return BY_MODEL[format](folder, chain, sign, tool)
