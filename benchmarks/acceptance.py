"""Which programs ncomp accepts, and why it refuses the others: `python benchmarks/acceptance.py FOLDER [MACHINE ...]`.

Every file below the folder goes through the main job with `--calibration none`, on the first of the machines that has
its axes (default: dmu50, trunnion_ac). An accepted program must come out byte for byte. Prints a table per folder, and
one line per refusal.
"""

from __future__ import annotations

import io
import sys
from collections import defaultdict
from pathlib import Path

import machines
from kinematics.errors import UserError
from kinematics.model import no_errors
from postproc.dialects import find_dialect
from postproc.pipeline import Job, Pipeline
from postproc.setup import make_setup
from postproc.source import open_source


def refusal(path: Path, machine_names: list[str]) -> str | None:
    """Why a program is refused, None when it comes out as it went in; AssertionError when it comes out otherwise."""
    reasons = []
    for name in machine_names:
        machine = machines.load(name)
        out = io.BytesIO()
        try:
            source = open_source(str(path))
            dialect = find_dialect("auto", source.name, source.text_head)
            job = Job(source, dialect, machine, no_errors(machine), make_setup(machine), travel_check=False)
            Pipeline(job).run(out, lambda _: None)
        except UserError as fault:
            reasons.append(str(fault))
            continue
        assert out.getvalue() == path.read_bytes(), path
        return None
    return next((reason for reason in reasons if "has no axis" not in reason), reasons[0])


def main(folder: Path, machine_names: list[str]) -> None:
    """Print the table and the refusals."""
    counts: dict[Path, list[int]] = defaultdict(lambda: [0, 0])
    refusals = []
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        reason = refusal(path, machine_names)
        counts[path.parent.relative_to(folder)][reason is not None] += 1
        if reason is not None:
            refusals.append(reason.replace(f"{folder}/", ""))
    print(f"{'folder':<32}{'accepted':>10}{'refused':>10}")
    for name, (accepted, refused) in counts.items():
        print(f"{name!s:<32}{accepted:>10}{refused:>10}")
    print("\n".join(["", *refusals]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or ["dmu50", "trunnion_ac"])
