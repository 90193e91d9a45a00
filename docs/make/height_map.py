"""Renew the picture of docs/height_maps.md: the report of its first command, by Chromium.

python docs/make/height_map.py
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from tutorial import ROOT, photograph, run

PAGE = ROOT / "docs" / "height_maps.md"
SHOWN = 1060
"""How much of the report is shown, px."""


def main() -> None:
    """Run the command, and take the picture."""
    text = PAGE.read_text()
    start = text.index("    ncomp ")
    command = text[start : text.index("\n\n", start)].replace("\\\n", " ").strip()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "examples"
        shutil.copytree(ROOT / "examples", folder)
        run(command, Path(made))
        photograph(Path(made) / "board.html", ROOT / "docs" / "pictures" / "height_map.png", SHOWN)


if __name__ == "__main__":
    main()
