"""Klipper: skew and mesh profiles of its configuration. RepRapFirmware: height map and M556."""

from __future__ import annotations

import configparser
import fnmatch
import re

from kinematics.effects import ControlTable, Effect
from kinematics.user_error import UserError
from postproc.control_data.readers.control_source import Source, numbers, refusal


def read_klipper(source: Source) -> list[Effect]:
    """One profile of each."""
    found: list[Effect] = []
    for name, text in source.files.items():
        config = _klipper_config(name, re.sub(r"^#\*# ?", "", text, flags=re.M))
        _refuse_absent(source, name, config)
        for kind, read in (("skew_correction", _klipper_skew), ("bed_mesh", _klipper_mesh)):
            profiles = [section for section in config.sections() if section.startswith(f"{kind} ")]
            if len(profiles) > 1:
                raise UserError(f"{name}: {len(profiles)} profiles of {kind}; expected one")
            for profile in profiles:
                source.used.add(name)
                found += read(source, name, dict(config[profile]))
    return found


def _klipper_config(name: str, text: str) -> configparser.RawConfigParser:
    """The sections of a configuration, by the module that Klipper itself reads it with."""
    config = configparser.RawConfigParser(strict=False, inline_comment_prefixes=(";", "#"))
    try:
        config.read_string(text)
    except configparser.Error as fault:
        raise UserError(f"{name}: {fault}") from None
    return config


def _refuse_absent(source: Source, name: str, config: configparser.RawConfigParser) -> None:
    """UserError for a section `[include FILE]` whose file is not among the files: its profiles would be lost."""
    others = [other for other in source.files if other != name]
    for section in config.sections():
        path = section.removeprefix("include ").strip().rsplit("/", 1)[-1]
        if section.startswith("include ") and not fnmatch.filter(others, path):
            raise UserError(f"{name}: [{section}]: the file is not among the files: give it as well")


def _value(name: str, section: dict[str, str], key: str) -> float:
    if key not in section:
        raise UserError(f"{name}: {key} is missing")
    return numbers([section[key]], name, 1, f"{key} = {section[key]}")[0]


def _klipper_skew(source: Source, name: str, section: dict[str, str]) -> list[Effect]:
    xy, xz, yz = (_value(name, section, f"{plane}_skew") for plane in ("xy", "xz", "yz"))
    added = {("X", "Y"): -xy, ("X", "Z"): -(xz - xy * yz), ("Y", "Z"): -yz}
    return [_line(source, output, of, tangent) for (output, of), tangent in added.items() if tangent]


def _line(source: Source, output: str, of: str, tangent: float) -> ControlTable:
    """Correction in proportion to another axis' position, over thrice its travel."""
    low, high = source.machine.axes[source.machine.index(of)].travel
    ends = (2 * low - high, 2 * high - low)
    return source.table(output, (of,), (ends,), [tangent * end for end in ends])


def _klipper_mesh(source: Source, name: str, section: dict[str, str]) -> list[Effect]:
    if _value(name, section, "mesh_x_pps") or _value(name, section, "mesh_y_pps"):
        raise UserError(f"{name}: mesh_x_pps and mesh_y_pps must be 0: interpolated points are not read")
    rows = [row for row in section.get("points", "").splitlines() if row.strip()]
    heights = [numbers(row.split(","), name, 1, row) for row in rows]
    nodes = []
    for axis in "xy":
        low, high = _value(name, section, f"min_{axis}"), _value(name, section, f"max_{axis}")
        count = int(_value(name, section, f"{axis}_count"))
        if not 2 <= count <= max(len(heights), *map(len, heights), 2) or low >= high:
            raise UserError(f"{name}: {axis}_count {count} from {low:g} to {high:g} does not fit the points")
        nodes.append([low + (high - low) * k / (count - 1) for k in range(count)])
    if [len(row) for row in heights] != [len(nodes[0])] * len(nodes[1]):
        raise UserError(f"{name}: expected {len(nodes[1])} rows of {len(nodes[0])} points")
    return [source.table("Z", ("X", "Y"), nodes, [row[i] for i in range(len(nodes[0])) for row in heights])]


def read_reprap(source: Source) -> list[Effect]:
    """Height maps, and M556 of other files."""
    found: list[Effect] = []
    for name, text in source.files.items():
        if text.startswith("RepRapFirmware height map file v2"):
            found.append(_height_map(source, name, text))
            source.used.add(name)
            continue
        for line, row in enumerate(text.splitlines(), 1):
            words = row.partition(";")[0].split()
            if words[:1] == ["M556"]:
                source.used.add(name)
                values = {word[0]: numbers([word[1:]], name, line, row)[0] for word in words[1:]}
                if not values.get("S"):
                    raise refusal(name, line, row, "the word S is missing")
                for letter, (output, of) in zip("XYZ", (("X", "Y"), ("Y", "Z"), ("X", "Z")), strict=True):
                    if values.get(letter):
                        found.append(_line(source, output, of, values[letter] / values["S"]))
    return found


def _height_map(source: Source, name: str, text: str) -> ControlTable:
    lines = text.rstrip().splitlines()
    if len(lines) < 4:
        raise UserError(f"{name}: the height map ends before its heights")
    labels, values = lines[1].split(","), lines[2].split(",")
    named = dict(zip(labels, values, strict=False))
    if len(labels) != len(values) or not {
        f"{key}{k}" for key in ("axis", "min", "spacing", "num") for k in "01"
    } <= set(named):
        raise refusal(
            name, 3, lines[2], "expected a value for each label of the line above: axis, min, spacing, num, ..."
        )
    nodes = []
    for k in "01":
        low, spacing, count = numbers([named[f"{key}{k}"] for key in ("min", "spacing", "num")], name, 3, lines[2])
        if count > 41:
            raise refusal(name, 3, lines[2], "expected at most 41 points in a row")
        nodes.append([low + spacing * i for i in range(int(count))])
    rows = lines[3:]
    if len(rows) != len(nodes[1]):
        raise UserError(f"{name}: {len(rows)} rows of heights; expected {len(nodes[1])}")
    heights = []
    for line, row in enumerate(rows, 4):
        cells = [cell.strip() for cell in row.split(",")]
        if "0" in cells:
            raise refusal(name, line, row, "0 without a decimal point: the position was not probed")
        if len(cells) != len(nodes[0]):
            raise refusal(name, line, row, f"{len(cells)} heights; expected {len(nodes[0])}")
        heights.append(numbers(cells, name, line, row))
    corrections = [row[i] for i in range(len(nodes[0])) for row in heights]
    return source.table("Z", (named["axis0"], named["axis1"]), nodes, corrections)
