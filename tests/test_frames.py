"""Nothing depends on where a frame has its origin: the same holes, the same decisions.

One drilled plate is written down in several frames. Fit, deviations relative to the datum with their uncertainties,
diagnosis, and the decision of the main job must be the same.
"""

import csv
import json
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.tiers import quick

import machines
from calibration.fit.datum import about_own_points
from calibration.observation.mean_lines import centred
from kinematics.basis import BSpline, Legendre
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.forward import tool_point
from kinematics.state import State

MACHINES = Path(__file__).parents[1] / "machines"
ORIGIN = (2500.0, 1500.0, 200.0)
"""Zero of the plate on the gantry, mm."""
TOOL = 100.0
"""Length of the drill, mm."""


@dataclass(frozen=True)
class Frame:
    """The same plate in other coordinates."""

    part: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the plate on the machine, beside ORIGIN, mm."""
    turn: float = 0.0
    """Rotation of the measuring machine's coordinates, rad."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Shift of them, mm."""
    tool: float = TOOL
    """Length of the drill, mm, from the tool reference point."""
    machine: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Position of the zeros of all axes, mm."""

    @property
    def origin(self):
        return np.add(ORIGIN, self.part) - self.machine


FRAMES = {
    "low": Frame(part=(0.0, 0.0, -200.0)),
    "high": Frame(part=(0.0, 0.0, 400.0)),
    "aside": Frame(part=(900.0, -700.0, 0.0)),
    "measured elsewhere": Frame(turn=2.0, shift=(350.0, -120.0)),
    "long tool": Frame(tool=340.0),
    "machine's zero": Frame(machine=(2000.0, -900.0, 700.0)),
}


def holes():
    x, y = np.meshgrid(np.linspace(-270.0, 270.0, 10), np.linspace(-260.0, 260.0, 9))
    return np.random.default_rng(5).permutation(np.stack([x.ravel(), y.ravel()], axis=1))


def drilled(where):
    """Holes of a machine with a wavy X, a curved Y, a squareness, and a scale of Y that changes along X; mm."""
    x, y = where.T
    off = np.stack([12.0 * np.sin(x / 90.0) - 0.06 * y, 9.0 * (y / 260.0) ** 2 + 12.0 * x * y / 7e4], axis=1)
    return where + 1e-3 * (off + np.random.default_rng(6).normal(0.0, 2.0, where.shape))


def written(frame):
    """The machine file, the measurement and the drilling program in a frame."""
    low, high = -np.array(frame.machine), np.array([5000.0, 3000.0, 1500.0]) - frame.machine
    axes = "".join(
        f"[axes.{name}]\ntravel = [{a}, {b}]\n" for name, a, b in zip("XYZ", low.tolist(), high.tolist(), strict=True)
    )
    Path("mill.toml").write_text(f'name = "mill"\nchain = "w b X Y Z t"\n{axes}')
    c, s = np.cos(frame.turn), np.sin(frame.turn)
    seen = drilled(holes()) @ np.array([[c, s], [-s, c]]) + frame.shift
    rows = "\n".join(",".join(f"{v:.7f}" for v in (*hole, *point)) for hole, point in zip(holes(), seen, strict=True))
    x, y, z = frame.origin
    head = (
        f"# machine: mill\n# instrument: part\n# u_um: 2\n# part_offset: {x} {y} {z}\n# target.t: 0 0 {-frame.tool}\n"
    )
    Path("plate.csv").write_text(f"{head}nominal_x,nominal_y,x,y\n{rows}\n")
    moves = "\n".join(f"G0 X{a:.3f} Y{b:.3f}\nG1 Z0. F100\nG0 Z5." for a, b in holes()[:30])
    Path("drill.nc").write_text(f"G21 G90 G17\nT1 M6\nG54 G43 H1\nG0 X0. Y0. Z5.\n{moves}\nM30\n")
    return ("--work-offset", f"G54={x},{y},{z}", "--tool-length", f"T1={frame.tool}")


def results(command, frame):
    """Figures and decisions of all steps in a frame."""
    set_up = written(frame)
    fitted = command("fit", "plate.csv", "--machine", "mill.toml", "-o", "cal.json", "--json", "-")
    assert fitted.status == 0, fitted.err
    fit = json.loads(fitted.out)
    predicted = command("predict", "plate.csv", "-m", "mill.toml", "-c", "cal.json", "-o", "p.csv", "--json", "-")
    assert predicted.status == 0, predicted.err
    with Path("p.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    off = np.array([[float(row[name]) for name in ("dx_um", "dy_um")] for row in rows])
    found = command("diagnose", "plate.csv", "--machine", "mill.toml", "-o", "new.json", "--json", "-")
    diagnosis = json.loads(found.out)
    done = command("drill.nc", "--machine", "mill.toml", "-c", "cal.json", *set_up, "-o", "out.nc", "--json", "c.json")
    assert done.status == 0, done.err
    report = json.loads(Path("c.json").read_text())
    return {
        "basis": fit["basis"],
        "rms": [fit[key][name] for key in ("before", "after") for name in ("rms_um", "heldout_rms_um")],
        "relative": (off - off.mean(axis=0)).ravel().tolist(),
        "u": json.loads(predicted.out)["u_um"]["between_positions"][:2],
        "not visible": sorted(fit["not_visible"]),
        "verdicts": [(each["kind"], each["axis"], each["verdict"]) for each in diagnosis["effects"]],
        "left": [diagnosis["after"][name] for name in ("rms_um", "heldout_rms_um")],
        "significant": [report["predicted_error_um"]["significant_share_of_improvement"]],
        "decision": report["moves"]["corrected"],
    }


@pytest.fixture(scope="module")
def reference():
    return {}


@pytest.mark.parametrize("name", quick(FRAMES, ["measured elsewhere"]))
def test_nothing_depends_on_the_origin_of_a_frame(command, name, reference):
    if not reference:
        reference.update(results(command, Frame()))
    found = results(command, FRAMES[name])
    assert reference["verdicts"]
    assert reference["significant"][0] > 0.8
    for what, value in found.items():
        numbers = what in ("rms", "relative", "u", "left", "significant")
        assert value == (pytest.approx(reference[what], rel=1e-4, abs=2e-2) if numbers else reference[what]), what


@pytest.mark.statistical
def test_a_tracker_s_fit_does_not_depend_on_the_zeros_of_the_axes(command):
    """Few positions leave much to the prior, which must not know where the axes have their zeros."""
    planned = ("--machine", "cframe", "--strategy", "random", "--points", "60", "--seed", "3")
    assert command("simulate", *planned, "-o", "here.csv").status == 0
    shifts = {"X": 1000.0, "Y": -800.0, "Z": 300.0}
    text = (MACHINES / "cframe.toml").read_text().replace("home = 500", "home = 800")
    for travel, moved in (("[0, 600]", "[1000, 1600]"), ("[0, 450]", "[-800, -350]"), ("[0, 500]", "[300, 800]")):
        text = text.replace(travel, moved)
    Path("there.toml").write_text(text)
    lines = Path("here.csv").read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    names = lines[first].split(",")
    moved = [
        ",".join(str(float(v) + shifts[n]) if n in shifts else v for n, v in zip(names, row.split(","), strict=True))
        for row in lines[first + 1 :]
    ]
    Path("there.csv").write_text("\n".join([*lines[: first + 1], *moved]) + "\n")
    found = []
    for name, machine in (("here", "cframe"), ("there", "there.toml")):
        done = command("fit", f"{name}.csv", "--machine", machine, "-o", f"{name}.json", "--json", "-")
        assert done.status == 0, done.err
        found.append(json.loads(done.out))
    for key in ("basis", "n_parameters", "not_visible"):
        assert found[0][key] == found[1][key]
    for key in ("rms_um", "heldout_rms_um"):
        assert found[0]["after"][key] == pytest.approx(found[1]["after"][key], rel=1e-4)
    assert found[0]["u_um"]["between_positions"] == pytest.approx(found[1]["u_um"]["between_positions"], rel=1e-3)


def test_a_turn_about_the_centre_is_one_about_the_axis_own_point():
    """Also where the basis of a translation was refined in between."""
    machine, rng = machines.load("cframe"), np.random.default_rng(3)
    six = [
        ErrorMotion(c, "X", Legendre((0.0, 600.0), 3), tuple(rng.normal(0.0, 20.0, 4).tolist()), u=(0.0,) * 4)
        for c in "XYZABC"
    ]
    arms = {"X": np.array([[0.0, 300.0, -200.0], [-300.0, 0.0, 100.0], [200.0, -100.0, 0.0]])}
    fine = BSpline(tuple(np.linspace(0.0, 600.0, 9).tolist()), 3)
    finer = ErrorMotion("X", "X", fine, tuple(rng.normal(0.0, 20.0, fine.size).tolist()), u=(0.0,) * fine.size)
    q = rng.uniform([0.0, 0.0, 0.0], [600.0, 450.0, 500.0], (50, 3))
    for motions in (six, [finer, *six[1:]]):
        model = msgspec.structs.replace(no_errors(machine), effects=centred(motions, arms))
        effects, matrix = about_own_points(model)
        own = msgspec.structs.replace(model, effects=effects).with_parameters(matrix @ model.parameters)
        assert {type(effect) for effect in effects} == {ErrorMotion}
        points = [tool_point(machine, q, errors=each.errors(machine, State(q))) for each in (model, own)]
        assert points[0] == pytest.approx(points[1], abs=1e-8)
        assert np.abs(points[0] - tool_point(machine, q)).max() > 1e-3
