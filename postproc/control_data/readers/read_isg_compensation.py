"""ISG kernel and Beckhoff TwinCAT CNC: axis compensation lists of `name value`; the volumetric data file."""

from __future__ import annotations

import re
from collections.abc import Iterator

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, increasing, numbers, refusal

_UNIT = 1e-4
LAST_PLANE_INDEX = 10_200
"""Last index of a plane along one of its axes."""
_ENTRY = re.compile(r"([\w.]+(?:\[\s*\d+\s*\][\w.]*)*)\s+(\S+)$")

List = dict[str, float]


def _lists(source: Source) -> Iterator[tuple[str, str, List]]:
    """File, axis and entries of each list; comments are passed over."""
    for name, text in source.files.items():
        entries: List = {}
        axis = ""
        for line, row in enumerate(text.splitlines(), 1):
            content = re.sub(r"/\*.*?\*/", "", row.partition("#")[0]).strip()
            if not content:
                continue
            match = _ENTRY.match(content)
            if match is None:
                raise refusal(name, line, row, "expected a name and a value")
            key = re.sub(r"\s", "", match[1])
            if key == "kopf.log_achs_name":
                axis = match[2]
                continue
            if key in entries:
                raise refusal(name, line, row, "the entry has a value already")
            (entries[key],) = numbers([match[2]], name, line, row)
        if axis not in source.machine.names:
            raise UserError(
                f"{name}: kopf.log_achs_name {axis or 'is missing'}: expected one of {' '.join(source.lettered)}"
            )
        for structure in ("kw.ssfk", "kw.crosscomp", "kw.crosscomp2"):
            if any(key.startswith(f"{structure}.") for key in entries) and entries.get(f"{structure}.unit") != 1:
                raise UserError(f"{name}: {structure}.unit must be 1: the size of encoder increments is unknown")
        yield name, axis, entries


def _entry(name: str, entries: List, key: str) -> float:
    if key not in entries:
        raise UserError(f"{name}: {key} is missing")
    return entries[key]


def read_ssfk(source: Source) -> list[Effect]:
    """Leadscrew error compensation of all axes."""
    sign = _UNIT * source.sign("correction")
    found: list[Effect] = []
    for name, axis, entries in _lists(source):
        if "kw.ssfk.kw_nr_max" not in entries:
            continue
        source.used.add(name)
        count, interval = int(entries["kw.ssfk.kw_nr_max"]), entries.get("kw.ssfk.interval", 0.0)
        bilateral = entries.get("kw.ssfk.bilateral", 0.0) == 1
        rows = []
        for k in range(count):
            key = f"kw.ssfk.table[{k}]."
            x = _entry(name, entries, "kw.ssfk.kw_startpos" if interval else key + "setpoint") + k * interval
            up = _entry(name, entries, key + "pos")
            down = _entry(name, entries, key + "neg") if bilateral else up
            rows.append((k + 1, (x * _UNIT, sign * up, sign * down)))
        if f"kw.ssfk.table[{count}].pos" in entries:
            raise UserError(f"{name}: there are entries beyond kw.ssfk.kw_nr_max {count}")
        increasing(rows, name)
        found += source.own(axis, [row for _, row in rows])
    return found


def read_cross(source: Source) -> list[Effect]:
    """Cross and plane compensation."""
    sign = _UNIT * source.sign("correction")

    def named(name: str, entries: List, key: str) -> str:
        k = int(_entry(name, entries, key))
        return source.numbered(k, f"{name}: {key} {k}")

    found: list[Effect] = []
    for name, axis, entries in _lists(source):
        if {"kw.crosscomp.last_index", "kw.crosscomp2.interval"} & entries.keys():
            source.used.add(name)
        if "kw.crosscomp.last_index" in entries:
            slave = named(name, entries, "kw.crosscomp.slave_ax_nr")
            count = int(entries["kw.crosscomp.last_index"]) + 1
            nodes = [_UNIT * _entry(name, entries, f"kw.crosscomp.table[{k}].setpoint") for k in range(count)]
            values = [sign * _entry(name, entries, f"kw.crosscomp.table[{k}].correction") for k in range(count)]
            found.append(source.table(slave, (axis,), (nodes,), values))
        if "kw.crosscomp2.interval" in entries:
            interval = entries["kw.crosscomp2.interval"] * _UNIT
            if interval <= 0:
                raise UserError(f"{name}: kw.crosscomp2.interval must be above 0")
            masters, grids = [], []
            for k in (1, 2):
                masters.append(named(name, entries, f"kw.crosscomp2.master{k}_ax_nr"))
                start = _UNIT * _entry(name, entries, f"kw.crosscomp2.start_position_master{k}")
                last = int(_entry(name, entries, f"kw.crosscomp2.last_index_master{k}"))
                if last > LAST_PLANE_INDEX:
                    raise UserError(
                        f"{name}: kw.crosscomp2.last_index_master{k} {last} exceeds the most, {LAST_PLANE_INDEX}"
                    )
                grids.append([start + interval * i for i in range(last + 1)])
            values = [
                sign * _entry(name, entries, f"kw.crosscomp2.table[{j}][{i}].correction")
                for i in range(len(grids[0]))
                for j in range(len(grids[1]))
            ]
            found.append(source.table(axis, masters, grids, values))
    return found


def read_volumetric(source: Source) -> list[Effect]:
    """Error motions over the position of their own axis; other arguments are refused."""
    turn = 1e6 if source.settings.angle == "rad" else 1e6 * 3.141592653589793 / 180.0
    sign = source.sign("error")
    found: list[Effect] = []
    for name, text in source.files.items():
        source.used.add(name)
        if name.endswith(".lis"):
            continue
        for start, block in _blocks(text):
            head = block[0].split()
            axis = head[0]
            if axis not in source.machine.names:
                raise refusal(name, start, block[0], "the first column must be an axis of the machine")
            rows = [
                (start + k, numbers(row.split(), name, start + k, row))
                for k, row in enumerate(block[1:], 1)
                if row.strip()
            ]
            for line, row in rows:
                if len(row) != len(head):
                    raise refusal(name, line, " ".join(map(str, row)), f"expected {len(head)} columns")
            increasing(rows, name)
            nodes = tuple(row[0] for _, row in rows)
            for k, error in enumerate(head[1:], 1):
                component = error[1:2]
                if error != f"E{component}{axis}" or component not in tuple("XYZABC"):
                    raise refusal(name, start, block[0], f"{error} over {axis} is not read: expected E{{X...C}}{axis}")
                size = sign * (turn if component in "ABC" else 1e3)
                values = tuple(size * row[k] for _, row in rows)
                found.append(source.motion(component, axis, nodes, values))
    return found


def _blocks(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and lines of each block, from its header on."""
    block: list[str] = []
    start = 1
    for line, row in enumerate([*text.splitlines(), "#"], 1):
        content = row.partition("//")[0].rstrip()
        if content.strip() == "#":
            if any(part.strip() for part in block):
                yield start, block
            block = []
        elif block or content.strip():
            start = start if block else line
            block.append(content)
