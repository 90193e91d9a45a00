"""Siemens SINUMERIK: archive text with `$AA_ENC_COMP` and `$AN_CEC`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal

_EEC = re.compile(r"\$AA_ENC_COMP(?P<entry>_\w+)?\[(?P<index>[^\]]*)\]$")
_CEC = re.compile(r"\$AN_CEC(?P<entry>_\w+)?\[(?P<index>[^\]]*)\]$")
_NEEDED = ("_STEP", "_MIN", "_MAX")


@dataclass
class _Table:
    """The entries of a file for one table."""

    name: str
    values: dict[int, float] = field(default_factory=dict)
    entries: dict[str, float] = field(default_factory=dict)
    axes: dict[str, str] = field(default_factory=dict)

    def points(self) -> list[tuple[float, float]]:
        """Positions and values; UserError where the control would fill in or leave out some."""
        lacking = [entry for entry in _NEEDED if entry not in self.entries]
        if lacking:
            raise UserError(f"{self.name}: {', '.join(lacking)} missing")
        step, low, high = (self.entries[entry] for entry in _NEEDED)
        if step <= 0 or high <= low:
            raise UserError(
                f"{self.name}: expected MIN below MAX and STEP above 0, found {low:g}, {high:g} and {step:g}"
            )
        last = round((high - low) / step)
        if abs((high - low) / step - last) > 1e-6:
            raise UserError(f"{self.name}: MAX - MIN must be a whole number of steps and is {(high - low) / step:.6g}")
        if len(self.values) != last + 1 or sorted(self.values) != list(range(last + 1)):
            raise UserError(f"{self.name}: expected the points 0 to {last}, each once, found {len(self.values)}")
        return [(low + k * (high - low) / last, self.values[k]) for k in range(last + 1)]


def read_eec(source: Source) -> list[Effect]:
    """Encoder compensation of all axes."""
    found: list[Effect] = []
    for (system, axis), table in _tables(source, _EEC).items():
        if system != str(source.settings.system):
            raise UserError(f"{table.name}: measuring system {system}; give --set system={system}")
        name = _axis(source, axis)
        sign = source.sign("correction")
        points = table.points()
        found += source.own(name, [(x, sign * v, sign * v) for x, v in _modulo(source, name, table, points)])
    return found


def read_cec(source: Source) -> list[Effect]:
    """Cross error compensation: tables, and products of two."""
    tables = {int(key[0]): table for key, table in _tables(source, _CEC).items()}
    factors = {int(table.entries.get("_MULT_BY_TABLE", 0)) - 1 for table in tables.values()} - {-1}
    sign = source.sign("correction")
    found: list[Effect] = []
    for index, table in sorted(tables.items()):
        if index in factors:
            continue
        output, of, points = _cross(source, table)
        direction = int(table.entries.get("_DIRECTION", 0))
        if direction not in (-1, 0, 1):
            raise UserError(f"{table.name}: DIRECTION {direction}: expected -1, 0 or 1")
        nodes, values = zip(*points, strict=True)
        second = int(table.entries.get("_MULT_BY_TABLE", 0)) - 1
        if second < 0:
            found.append(source.table(output, (of,), (nodes,), [sign * v for v in values], direction))
            continue
        if second not in tables or second == index:
            raise UserError(f"{table.name}: MULT_BY_TABLE names the table {second}, which is missing")
        _, other, more = _cross(source, tables[second])
        second_nodes, shares = zip(*more, strict=True)
        products = [sign * v * share for v in values for share in shares]
        found.append(source.table(output, (of, other), (nodes, second_nodes), products, direction))
    return found


def _cross(source: Source, table: _Table) -> tuple[str, str, list[tuple[float, float]]]:
    for entry in ("_INPUT_AXIS", "_OUTPUT_AXIS"):
        if entry not in table.axes:
            raise UserError(f"{table.name}: {entry} is missing")
    of, output = (_axis(source, table.axes[entry]) for entry in ("_INPUT_AXIS", "_OUTPUT_AXIS"))
    return output, of, _modulo(source, of, table, table.points())


def _modulo(source: Source, axis: str, table: _Table, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points; UserError for a modulo table that is not one turn, or of an axis that does not turn without end."""
    if table.entries.get("_IS_MODULO", 0) == 0:
        return points
    if not source.machine.axes[source.machine.index(axis)].rotary or abs(points[-1][0] - points[0][0] - 360) > 1e-9:
        raise UserError(f"{table.name}: IS_MODULO needs a rotary axis and a turn of 360 degrees")
    if points[0][1] != points[-1][1]:
        raise UserError(f"{table.name}: with IS_MODULO the first and the last value must be equal")
    return points


def _tables(source: Source, pattern: re.Pattern[str]) -> dict[tuple[str, ...], _Table]:
    """All tables of the files by index; other assignments, comments and checksums are passed over."""
    found: dict[tuple[str, ...], _Table] = {}
    for name, text in source.files.items():
        for line, row in enumerate(text.splitlines(), 1):
            content = re.sub(r"^N\d+\s+", "", row.partition(";")[0].partition("'")[0].strip())
            left, equals, right = content.partition("=")
            match = pattern.fullmatch(left.strip())
            if match is None:
                if content.startswith(("$AA_ENC_COMP", "$AN_CEC")) and not (_EEC.match(left) or _CEC.match(left)):
                    raise refusal(name, line, row, "expected an assignment to one element")
                continue
            if not equals:
                raise refusal(name, line, row, "expected an assignment")
            index, entry = [part.strip() for part in match["index"].split(",")], match["entry"] or ""
            key = (index[0], index[-1]) if pattern is _EEC else (index[0],)
            if len(index) != (2 if pattern is _EEC else 1) + (not entry):
                raise refusal(name, line, row, "the number of indices is wrong")
            if not all(part.isdecimal() for part in (index[:-1] if pattern is _EEC else index)):
                raise refusal(name, line, row, "an index must be a whole number")
            source.used.add(name)
            table = found.setdefault(key, _Table(f"{name}, {left.strip().partition('[')[0]} {','.join(key)}"))
            if entry in ("_INPUT_AXIS", "_OUTPUT_AXIS"):
                table.axes[entry] = right.strip().strip("()").strip()
                continue
            (value,) = numbers([right], name, line, row)
            if entry:
                table.entries[entry] = value
                continue
            point = int(index[1])
            if point in table.values:
                raise refusal(name, line, row, "a second value of this point")
            table.values[point] = value
    return found


def _axis(source: Source, name: str) -> str:
    """The machine's axis by its name in the control: as given with names=X:X1, X1 for X, or AX1 for the first."""
    names: str = source.settings.names
    given = {own: letter for letter, _, own in (pair.partition(":") for pair in names.split(",")) if own}
    by_name = {name: axis for axis in source.lettered for name in (axis, f"{axis}1")} | given
    if name in by_name:
        return by_name[name]
    if name.startswith("AX") and name[2:].isdigit():
        return source.numbered(int(name[2:]), f"axis {name}")
    raise UserError(f"axis {name} is not one of {' '.join(source.lettered)}; give --set names=AXIS:{name}")
