"""Run by Klipper's own Python: moves over a mesh, split by its code. Request and answer are JSON (`klipper.py`)."""

import configparser
import json
import sys

from klippy.extras.bed_mesh import BedMesh, MoveSplitter, ZMesh
from klippy.extras.skew_correction import PrinterSkew

WHOLE = ("x_count", "y_count", "mesh_x_pps", "mesh_y_pps")
"""Entries that are whole numbers."""


def main():
    """Answer the request on the standard input."""
    asked = json.load(sys.stdin)
    if "profiles" in asked:
        json.dump(corrected(asked["profiles"], asked["settings"], asked["positions"]), sys.stdout)
        return
    mesh = built(asked["mesh"], asked["rows"])
    splitter = splitting(mesh, asked["settings"])
    json.dump([followed(mesh, splitter, *move, asked["places"]) for move in asked["moves"]], sys.stdout)


def built(mesh, rows):
    """A mesh by the entries of its section and its heights."""
    found = ZMesh({"algo": "direct", "tension": 0.2, **mesh, **{name: int(mesh[name]) for name in WHOLE}})
    found.build_mesh(rows)
    return found


def splitting(mesh, settings):
    """The part that splits moves over a mesh."""
    splitter = MoveSplitter.__new__(MoveSplitter)
    splitter.split_delta_z = settings["split_delta_z"]
    splitter.move_check_distance = settings["move_check_distance"]
    splitter.gcode = None
    splitter.initialize(mesh, 0.0)
    return splitter


class Toolhead:
    """Where a move goes behind all transforms."""

    def __init__(self):
        self.ends = []

    def move(self, position, _speed):
        """Note the end of a part of a move."""
        self.ends.append(list(position[:3]))


def corrected(profiles, settings, positions):
    """Ends of the parts of each move from one position to the next, through skew_correction and then bed_mesh.

    This is the order of Klipper's chain: skew_correction is in front of the transform that it finds.
    """
    config = configparser.RawConfigParser()
    config.read_string(profiles)
    skew, bed = PrinterSkew.__new__(PrinterSkew), BedMesh.__new__(BedMesh)
    factors = config["skew_correction ncomp"]
    skew.xy_factor, skew.xz_factor, skew.yz_factor = (float(factors[f"{plane}_skew"]) for plane in ("xy", "xz", "yz"))
    section = dict(config["bed_mesh ncomp"])
    rows = [[float(cell) for cell in row.split(",")] for row in section.pop("points").strip().splitlines()]
    numbers = {name: float(value) for name, value in section.items() if name != "algo"}
    bed.z_mesh = built(numbers, rows)
    bed.splitter = splitting(bed.z_mesh, settings)
    bed.fade_start = bed.fade_end = BedMesh.FADE_DISABLE
    bed.last_position = [*skew.calc_skew([*positions[0], 0.0])]
    skew.next_transform = bed
    found = []
    for position in positions[1:]:
        bed.toolhead = Toolhead()
        skew.move([*position, 0.0], 100.0)
        found.append(bed.toolhead.ends)
    return found


def followed(mesh, splitter, start, end, places):
    """The ends of the parts of a move, and the heights of the mesh at even places along it."""
    splitter.build_move([*start, 0.0, 0.0], [*end, 0.0, 0.0], 1.0)
    nodes = [[*start, mesh.calc_z(*start)]]
    while not splitter.traverse_complete:
        nodes.append(list(splitter.split()[:3]))
    shares = [i / (places - 1) for i in range(places)]
    along = [[a + share * (b - a) for a, b in zip(start, end, strict=True)] for share in shares]
    return {"nodes": nodes, "heights": [mesh.calc_z(x, y) for x, y in along]}


if __name__ == "__main__":
    main()
