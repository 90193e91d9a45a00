"""Real programs on every road through the whole job: `python benchmarks/same_bytes.py FOLDER [--lines N]`.

Each program is corrected line by line, and then in pieces of 1 line, 7 lines, 4 KiB and 1 MiB, with one and with two
processes. Texts, results (JSON) and refusals must be the same; exit status 1 where they differ.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from plain_share import errors_of, machine_of

import machines

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.every_road import PIECES, differing


def main() -> int:
    """Correct and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--lines", type=int, help="first lines of each program; without it whole programs")
    given = parser.parse_args()
    corrected = refused = lines = 0
    found: list[str] = []
    with tempfile.TemporaryDirectory(prefix="ncomp-same-bytes-") as made:
        for path in sorted(path for path in given.folder.rglob("*") if path.is_file()):
            machine, text = machines.load(machine_of(path)), path.read_bytes().splitlines(keepends=True)
            part = path
            if given.lines is not None and len(text) > given.lines:
                part = Path(made) / path.name
                part.write_bytes(b"".join(text[: given.lines]))
            (refusal, _, _), differences = differing(part, machine, errors_of(machine))
            corrected, refused = corrected + (not refusal), refused + bool(refusal)
            lines += len(text[: given.lines])
            found += differences
            print("\n".join(differences) or f"{path.name}: {refusal[:90] or 'the same'}", flush=True)
    roads = f"pieces of {', '.join(PIECES)}; 1 and 2 processes"
    print(f"{corrected} programs corrected, {refused} refused, {lines} lines; {roads}: {len(found)} differences")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
