"""Run by Klipper's own Python: moves over a mesh, split by its code. Request and answer are JSON (`klipper.py`)."""

import json
import sys

from klippy.extras.bed_mesh import MoveSplitter, ZMesh

WHOLE = ("x_count", "y_count", "mesh_x_pps", "mesh_y_pps")
"""Entries that are whole numbers."""


def main():
    """Answer the request on the standard input."""
    asked = json.load(sys.stdin)
    mesh = ZMesh(
        {"algo": "direct", "tension": 0.2, **asked["mesh"], **{name: int(asked["mesh"][name]) for name in WHOLE}}
    )
    mesh.build_mesh(asked["rows"])
    splitter = MoveSplitter.__new__(MoveSplitter)
    splitter.split_delta_z = asked["settings"]["split_delta_z"]
    splitter.move_check_distance = asked["settings"]["move_check_distance"]
    splitter.gcode = None
    splitter.initialize(mesh, 0.0)
    json.dump([followed(mesh, splitter, *move, asked["places"]) for move in asked["moves"]], sys.stdout)


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
