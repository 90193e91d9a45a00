"""Ballbar on the C-frame machine: are causes named, and no others? 20 draws of each of 8 causes, and of none.

Circles in the plane XY about the middle of the table, 150 mm, at 1000 and 3000 mm/min in both directions, a row for
each half degree, noise 0.3 um (k = 1), the table ball up to 0.03 mm off, the length not calibrated. A cause is named
where it is in the list, or tied with a cause in the list; any cause in the list that is not tied with the true one is
false.

With `--others`, each machine has all other error motions as well (random, as in `ncomp simulate`): the causes of drives
are asked for, and false are only causes of drives: the others may be there.

With `--diagnose`, `ncomp diagnose` is examined in place of `ncomp ballbar`, for the causes of drives: squareness, scale
and straightness are in the error motions that it fits. A row for each degree.

    python benchmarks/ballbar_exam.py [DRAWS] [--others] [--diagnose]
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.ballbar_cases import CFRAME
from support.ballbar_cases import circles_of as simulated

from calibration.circles.circles import circles_of
from calibration.circles.shares import shares
from calibration.diagnosis.diagnose import diagnose
from calibration.simulation.true_model import random_true_model
from kinematics.basis import Legendre
from kinematics.effects import (
    Backlash,
    Cyclic,
    ErrorMotion,
    LateralPlay,
    LocationError,
    ReversalSpike,
    Scale,
    ServoMismatch,
)


def drawn(kind, rng):
    """An effect of a kind with a random axis, size and sign, and its name in the list of shares."""
    axis, other = rng.permutation(["X", "Y"]).tolist()
    size = rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 12.0)
    length, period = np.exp(rng.uniform(np.log(0.1), np.log(1.0))), rng.uniform(6.0, 25.0)
    phase, amplitude = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.5, 3.0)
    interval = (150.0, 450.0) if axis == "X" else (75.0, 375.0)
    sine, cosine = (amplitude * np.sin(phase),), (amplitude * np.cos(phase),)
    across = f"E_{other}{axis}"
    effect, where = {
        "backlash": (Backlash(axis, size), axis),
        "reversal-spike": (ReversalSpike(axis, size, float(length)), axis),
        "lateral-play": (LateralPlay(other, axis, size), across),
        "cyclic": (Cyclic(axis, axis, float(period), sine, cosine), axis),
        "squareness": (LocationError("C", "Y", 5.0 * size), "X Y"),
        "scale-mismatch": (Scale(axis, 5.0 * size), "X Y"),
        "straightness": (ErrorMotion(other, axis, Legendre(interval, 2), (0.0, 0.0, size)), across),
        "servo-mismatch": (ServoMismatch("X", "Y", 0.05 * size), "X Y"),
    }[kind]
    return effect, f"{kind} {where}"


KINDS = (
    "backlash", "reversal-spike", "lateral-play", "cyclic", "squareness", "scale-mismatch", "straightness",
    "servo-mismatch",
)  # fmt: skip


DRIVES = ("backlash", "reversal-spike", "lateral-play", "cyclic", "servo-mismatch")
"""Kinds of causes that the random error motions of a machine do not have."""


def diagnosed(effects, names, seed):
    """As `examined`, by the diagnosis."""
    measured, _ = simulated(*effects, seed=seed, step=1.0)
    asked = {f"cyclic E_{name[-1]}{name[-1]}" if name.startswith("cyclic") else name for name in names}
    causes = diagnose(measured).causes
    listed = [{cause.effect.name, *(other.name for other in cause.alternatives)} for cause in causes]
    named = sum(any(name in own for own in listed) for name in asked)
    return named, [cause.effect.name for cause, own in zip(causes, listed, strict=True) if not own & asked]


def examined(effects, names, seed, **circles):
    """How many of the names are found, and the false causes, for a machine with these effects."""
    measured, _ = simulated(*effects, seed=seed, step=0.5, **circles)
    found = shares(measured, circles_of(measured))
    listed = [{cause.name, *cause.tied_with} for cause in found.causes]
    named = sum(any(name in own for own in listed) for name in names)
    false = [cause.name for cause, own in zip(found.causes, listed, strict=True) if not own & set(names)]
    return named, false


def main():
    """Print the share of named causes and of draws with a false cause, by kind."""
    numbers = [int(text) for text in sys.argv[1:] if text.isdigit()]
    draws, others = (numbers or [20])[0], "--others" in sys.argv
    started = time.process_time()
    total, all_named, all_false = 0, 0, 0
    by_diagnosis = "--diagnose" in sys.argv
    asked_for = (*DRIVES, "none") if others or by_diagnosis else (*KINDS, "two", "none")
    for kind in asked_for:
        rng, named, asked, wrong = np.random.default_rng(len(kind) * 1000 + draws), 0, 0, []
        for k in range(draws):
            kinds = [] if kind == "none" else rng.permutation(KINDS)[:2].tolist() if kind == "two" else [kind]
            effects, names = zip(*(drawn(each, rng) for each in kinds), strict=True) if kinds else ((), ())
            beside = random_true_model(CFRAME, np.random.default_rng(k)).effects if others else ()
            own, false = (diagnosed if by_diagnosis else examined)((*effects, *beside), names, 1000 + k)
            false = [name for name in false if name.startswith(DRIVES) or not others]
            named, asked = named + own, asked + len(names)
            wrong += [false] if false else []
        print(f"{kind:15} named {named:3d} of {asked:3d}   false in {len(wrong):2d} of {draws}  {wrong}", flush=True)
        total, all_named, all_false = total + asked, all_named + named, all_false + len(wrong)
    count = draws * len(asked_for)
    print(f"all: named {100 * all_named / total:.1f} %, false in {100 * all_false / count:.1f} % of the draws")
    print(f"{(time.process_time() - started) / count:.2f} s of processor time each")


if __name__ == "__main__":
    main()
