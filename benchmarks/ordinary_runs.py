"""Diagnoses of the measurements of `ordinary_runs`, each with a hidden effect, compared with their truth.

    python benchmarks/ordinary_runs.py ../shared/data/ordinary_runs           # all of them
    python benchmarks/ordinary_runs.py ../shared/data/ordinary_runs gantry    # those whose name contains a text

A set is right if each hidden effect is named or tied with its kind and axis, and nothing else is. An effect that is in
no library is named where its dependence is reported as unexplained. The held-out residuals of the new calibration are
printed beside those of the same rows without correction.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import ncomp

Hidden = tuple[str, frozenset[str]]
"""Kind of an effect, and the axes or directions that it may have; empty where the truth does not state them."""


def hidden(truth: dict[str, Any]) -> list[Hidden]:
    """The hidden effects of a set."""
    found = []
    for number, kind in enumerate(truth["kinds"]):
        values = truth["params"][number] if truth["params"] else {}
        moved = zip("XYZ", values.get("vec", ()), strict=False)
        # an error that depends on two axes has either of them as its own
        axes = {name for name, size in moved if size} or {values[key] for key in ("ax", "by") if key in values}
        found.append((kind, frozenset(axes)))
    return found


def is_one(cause: Any, effect: Hidden) -> bool:
    """True where a cause, or one that is tied with it, has the kind and the axis of an effect."""
    kind, axes = effect
    some = [cause, *(other for other in cause.alternatives if other.tied)]
    return any(each.kind == kind and (not axes or each.axis in axes) for each in some)


def faults(found: ncomp.Diagnosis, effects: Sequence[Hidden]) -> Iterator[str]:
    """Hidden effects that are neither named nor tied, and causes that are not there."""
    for effect in effects:
        unlisted = effect[0] == "unlisted" and found.unexplained is not None
        if not unlisted and not any(is_one(cause, effect) for cause in found.causes):
            yield f"missed: {effect[0]} {','.join(sorted(effect[1]))}"
    for cause in found.causes:
        if not any(is_one(cause, effect) for effect in effects):
            yield f"not there: {cause.kind} {cause.axis or ''} ({cause.verdict})"


def main() -> None:
    """Diagnose each set, and print its answer and the faults in it."""
    folder, name = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else ""
    right = asked = 0
    for file in sorted(folder.glob("*.truth.json")):
        truth, begin = json.loads(file.read_text(encoding="utf-8")), time.process_time()
        if name not in truth["case"]:
            continue
        found = ncomp.diagnose(ncomp.read_measurement(folder / f"{truth['case']}.csv", truth["machine"]))
        wrong, none = list(faults(found, hidden(truth))), found.acceptance.none
        asked, right = asked + 1, right + (not wrong)
        named = ", ".join(f"{cause.kind} {cause.axis or ''} ({cause.verdict})" for cause in found.causes) or "no cause"
        if found.unexplained is not None:
            named += f"; unexplained: {found.unexplained.listed}"
        held = "not held out" if none is None else f"held out {none.other_rms_um:.2f} -> {none.rms_um:.2f} um"
        verdict = "accepted" if found.accepted else f"not accepted: {found.reason}"
        print(f"{truth['case']:16} {named}; {held}; {verdict}; {time.process_time() - begin:.0f} s", flush=True)
        print(*(f"{'':16} WRONG {each}\n" for each in wrong), sep="", end="", flush=True)
    print(f"{right} of {asked} right")


if __name__ == "__main__":
    main()
