"""Klipper: skew and mesh profiles of its configuration. RepRapFirmware: height map and M556."""

from __future__ import annotations

import configparser
import fnmatch
import re

from kinematics.effects import ControlTable, Effect
from kinematics.user_error import UserError
from postproc.control_data.height_maps.firmware import klipper_mesh, number_of, read_reprap_map
from postproc.control_data.height_maps.height_map import HeightMap
from postproc.control_data.readers.control_source import Source, numbers, refusal
from postproc.control_data.readers.firmware.skew import lines_of_skew


def read_klipper(source: Source) -> list[Effect]:
    """One profile of each."""
    found: list[Effect] = []
    for name, text in source.files.items():
        config = klipper_config(name, re.sub(r"^#\*# ?", "", text, flags=re.M))
        _refuse_absent(source, name, config)
        for kind, read in (("skew_correction", _klipper_skew), ("bed_mesh", _klipper_mesh)):
            profiles = [section for section in config.sections() if section.startswith(f"{kind} ")]
            if len(profiles) > 1:
                raise UserError(f"{name}: {len(profiles)} profiles of {kind}; expected one")
            for profile in profiles:
                source.used.add(name)
                found += read(source, name, dict(config[profile]))
    return found


def klipper_config(name: str, text: str) -> configparser.RawConfigParser:
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


def _klipper_skew(source: Source, name: str, section: dict[str, str]) -> list[Effect]:
    xy, xz, yz = (number_of(name, section, f"{plane}_skew") for plane in ("xy", "xz", "yz"))
    return lines_of_skew(source, xy, xz, yz)


def _klipper_mesh(source: Source, name: str, section: dict[str, str]) -> list[Effect]:
    return [_table(source, klipper_mesh(name, section))]


def _table(source: Source, read: HeightMap) -> ControlTable:
    return source.table("Z", read.axes, (read.x.tolist(), read.y.tolist()), read.heights.ravel().tolist())


def read_reprap(source: Source) -> list[Effect]:
    """Height maps, and M556 of other files."""
    found: list[Effect] = []
    for name, text in source.files.items():
        if text.startswith("RepRapFirmware height map file"):
            found.append(_table(source, read_reprap_map(name, text)))
            source.used.add(name)
            continue
        for line, row in enumerate(text.splitlines(), 1):
            words = row.partition(";")[0].split()
            if words[:1] == ["M556"]:
                source.used.add(name)
                values = {word[0]: numbers([word[1:]], name, line, row)[0] for word in words[1:]}
                if not values.get("S"):
                    raise refusal(name, line, row, "the word S is missing")
                xy = ("X", "Y") if values.get("P", 0.0) <= 0.0 else ("Y", "X")
                for letter, (output, of) in zip("XYZ", (xy, ("Y", "Z"), ("X", "Z")), strict=True):
                    if values.get(letter):
                        found.append(source.line(output, of, values[letter] / values["S"]))
    return found
