"""Make every mistake, and print each with its message and the verdict: `python -m tests.mistakes [KIND]`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.mistakes.workshop import all_mistakes, end_of, furnish


def main(kinds: list[str]) -> int:
    """Print the table; the exit status is 1 if a message lacks a part."""
    failed, number = 0, 0
    with tempfile.TemporaryDirectory() as name:
        good = Path(name) / "good"
        good.mkdir()
        furnish(good)
        for kind, mistake in all_mistakes():
            if kinds and kind not in kinds:
                continue
            number += 1
            end = end_of(mistake, good, Path(name) / str(number))
            verdict = f"LACKS {', '.join(end.faults)}" if end.faults else "good"
            print(
                f"{number:3d}  {kind}: {mistake.made}\n     $ ncomp {mistake.command}\n     {end.message}\n     {verdict}\n"
            )
            failed += bool(end.faults)
    print(f"{number} mistakes, {number - failed} with file, place, cause and cure, exit status 2 and no output")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
