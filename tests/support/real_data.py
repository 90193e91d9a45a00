"""Folders of real data: beside this repository, and in it."""

from pathlib import Path

REAL_DATA = Path(__file__).parents[3] / "shared" / "data"
NC_DATA = REAL_DATA / "nc"
FREECAD = Path(__file__).parents[1] / "data" / "freecad"
"""Programs that FreeCAD's post-processors wrote for one part."""
