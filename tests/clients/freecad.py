"""FreeCAD without a window: jobs posted by its post-processors (Debian package freecad-python3)."""

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

PROGRAM = "freecadcmd"
SCRIPT = Path(__file__).with_name("freecad_posts.py")
FIVE_AXES = ("G0 X0 Y0 Z60 B0 C0", "G0 B30 C45", "G1 X20.1234 Y10 Z25 B30.125 C45.5 F600", "G0 Z60 B0 C0")


@dataclass(frozen=True)
class Post:
    """A post of the sample job: its post-processor, arguments, output file, and lines of its custom operation."""

    post: str
    arguments: str
    output: str
    gcode: tuple[str, ...] = ("G0 X0 Y0 Z60",)


def available() -> bool:
    """True if FreeCAD is installed."""
    return shutil.which(PROGRAM) is not None


def macro_folder(home: Path) -> Path:
    """FreeCAD's macro folder of the user with this home, made."""
    folder = home / ".local" / "share" / "FreeCAD" / "Macro"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def post_all(posts: Sequence[Post], home: Path) -> list[str | None]:
    """Post the sample job once for each; the fault of each, or None."""
    asked, told = home / "posts.json", home / "results.json"
    asked.write_text(json.dumps([asdict(post) for post in posts]))
    environment = {**os.environ, "HOME": str(home), "POSTS": str(asked), "RESULTS": str(told)}
    environment.pop("XDG_DATA_HOME", None)
    done = subprocess.run(
        [PROGRAM, str(SCRIPT)],
        env=environment,
        cwd=home,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert told.exists(), done.stdout + done.stderr
    found: list[str | None] = json.loads(told.read_text())
    return found
