"""The height map in a file, by whichever program it was written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from kinematics.files import read_input
from kinematics.user_error import UserError
from postproc.control.codes import UNIT_NAMES
from postproc.control_data.height_maps.firmware import klipper_mesh, read_marlin, read_reprap_map
from postproc.control_data.height_maps.height_map import HeightMap
from postproc.control_data.height_maps.lists import read_list
from postproc.control_data.height_maps.senders import read_bcnc, read_candle, read_gsender, read_opencncpilot
from postproc.control_data.imported import decoded
from postproc.control_data.readers.firmware.read_klipper_and_reprap import klipper_config


def _read_klipper(name: str, text: str) -> HeightMap:
    """The only mesh of a configuration."""
    config = klipper_config(name, re.sub(r"^#\*# ?", "", text, flags=re.M))
    profiles = [section for section in config.sections() if section.startswith("bed_mesh ")]
    if len(profiles) != 1:
        raise UserError(f"height map {name}: {len(profiles)} profiles of bed_mesh; expected one: delete the others")
    return klipper_mesh(f"height map {name}", dict(config[profiles[0]]))


FORMS: tuple[tuple[Callable[[str, str], object], Callable[[str, str], HeightMap]], ...] = (
    (lambda _, text: text.startswith("RepRapFirmware height map file"), read_reprap_map),
    (lambda _, text: re.search(r"^(#\*# ?)?\[bed_mesh \S", text, re.M), _read_klipper),
    (lambda _, text: "Bed Topography Report" in text or re.search(r"Bed X:|Leveling Grid:", text), read_marlin),
    (lambda _, text: "<heightmap" in text, read_opencncpilot),
    (lambda _, text: text.lstrip().startswith("{"), read_gsender),
    (lambda name, text: name.lower().endswith(".map") or text.partition("\n")[0].count(";") == 3, read_candle),
    (lambda name, _: name.lower().endswith(".probe"), read_bcnc),
    (lambda *_: True, read_list),
)
"""How a file is recognised, by its name and its text, and its reader."""


def read_map(path: Path, unit: str) -> HeightMap:
    """The height map in a file, mm; UserError, with file and row, for one that cannot be used.

    unit: `mm` or `inch`, of a file that states none; empty for mm.
    """
    data = read_input(path, "height map")
    text = decoded(data, f"height map {path}").lstrip("\r\n")
    found = next(read for is_it, read in FORMS if is_it(path.name, text))(str(path), text)
    mm = UNIT_NAMES[found.unit or ("" if found.of_machine else unit) or "mm"]
    return found._replace(x=found.x * mm, y=found.y * mm, heights=found.heights * mm)
