"""Renew the tutorial: its measured data, the outputs shown in docs/tutorial.md, and its pictures.

    python docs/make/tutorial.py             outputs of the commands, in the page
    python docs/make/tutorial.py --data      the measured data first
    python docs/make/tutorial.py --pictures  the pictures too, by Chromium

A block of output in the page follows a comment `<!-- lines: A | B -->`: it holds the lines of the output of the last
command that begin with A or with B, or all of them for `*`.
"""

from __future__ import annotations

import argparse
import html
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
HERE = ROOT / "postproc" / "tutorial"
PAGE = ROOT / "docs" / "tutorial.md"
FOLDER = "mill"
"""Folder of the tutorial's files, below that in which its first command runs."""
MARK = re.compile(r"<!-- lines: (.*) -->$")
HIDDEN = "backlash:axis=X,width=14"
TRACKER = "--tracker=-1500,1500,300 -u u_range_um=0.5 -u u_range_um_per_m=0.5 -u u_angle_um=1 -u u_angle_um_per_m=1.5"
VERDICT = "verdict"
"""Name of the text in a picture."""
PICTURES = {"diagnosis": 2050, "part": 905}
"""Reports of the tutorial, and how much of each is shown, px."""


def run(command: str, folder: Path) -> str:
    """Output of a command, 100 columns wide."""
    words = [sys.executable, "-m", "ncomp", *shlex.split(command)[1:]]
    environment = {**os.environ, "COLUMNS": "100", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{command}: status {done.returncode}\n{done.stderr}")
    return done.stdout + done.stderr


def renewed(page: str, folder: Path) -> str:
    """The page with the outputs of its commands, which run in the folder."""
    return "\n".join(_lines(page.split("\n"), folder))


def _lines(lines: list[str], folder: Path) -> Iterator[str]:
    command, output, old = "", "", False
    for line in lines:
        if old and (line.startswith("    ") or not line):
            continue
        if old:
            old = False
            yield ""
        yield line
        if line.startswith("    ncomp "):
            command = line.strip().removesuffix("\\")
        elif command.endswith(" ") and line.startswith("      "):
            command += line.strip().removesuffix("\\")
        if line.startswith("    ") and command and not line.endswith("\\"):
            output = run(command, folder)
            folder, command = (folder / FOLDER if command.startswith("ncomp tutorial") else folder), ""
        if mark := MARK.match(line):
            starts, shown = tuple(mark[1].replace("*", "").split(" | ")), output.splitlines()
            for start in starts:
                if not any(each.startswith(start) for each in shown):
                    raise SystemExit(f"{PAGE}: {line}: no line of the output begins with {start!r}")
            yield ""
            yield from (f"    {each}".rstrip() for each in shown if each.startswith(starts))
            old = True


def make_data() -> None:
    """Measure the virtual mill of the tutorial, along the plan of the page, with a backlash that no file contains."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copyfile(HERE / "mill.toml", folder / "mill.toml")
        planned = next(line for line in PAGE.read_text().splitlines() if line.startswith("    ncomp plan"))
        rest = PAGE.read_text().split(planned)[1].split("\n")[1]
        run(planned.strip().removesuffix("\\") + rest, folder)
        run(
            f"ncomp simulate --machine mill.toml --strategy plan.csv {TRACKER} --effect {HIDDEN} --seed 4 "
            "-o measured.csv --truth true.json",
            folder,
        )
        for made in ("measured.csv", "true.json"):
            shutil.copyfile(folder / made, HERE / made)


def photograph(page: Path, picture: Path, height: int) -> None:
    """A picture of the head of a page in Chromium, in few colours; it contains the page's verdict as a text."""
    from PIL import Image, PngImagePlugin

    command = ["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", "--virtual-time-budget=15000"]
    command += [f"--window-size=1100,{height}", f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True)
    with Image.open(picture) as seen:
        few = seen.convert("RGB").quantize(128)
    (verdict,) = re.findall(r'<p class="verdict(?: long)?">(.*?)</p>', page.read_text(encoding="utf-8"), re.DOTALL)
    content = PngImagePlugin.PngInfo()
    content.add_itxt(VERDICT, html.unescape(re.sub(r"<[^>]*>", "", verdict)))
    few.save(picture, optimize=True, pnginfo=content)


def main() -> None:
    """Renew the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", action="store_true")
    parser.add_argument("--pictures", action="store_true")
    asked = parser.parse_args()
    if asked.data:
        make_data()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        PAGE.write_text(renewed(PAGE.read_text(), folder))
        if asked.pictures:
            run(f"ncomp machines trunnion_ac --draw {ROOT / 'docs' / 'pictures' / 'machine.svg'}", folder)
        for name, height in PICTURES.items() if asked.pictures else ():
            picture = ROOT / "docs" / "pictures" / f"{name}.png"
            photograph(folder / FOLDER / f"{name}.html", picture, height)


if __name__ == "__main__":
    main()
