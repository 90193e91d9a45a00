"""Random error motions in a file, and the errors that a virtual machine has with the tables of an export."""

import msgspec
import numpy as np
from virtual_machine.chain import nominal_points, tool_points
from virtual_machine.controls import MARLIN_POINTS

from kinematics.basis import BSpline
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import no_errors, write_model
from support.programs import load

SETTINGS = {
    "fanuc": ("--set", "largest=100", "--set", "total=6000"),
    "mitsubishi": ("--set", "unit_um=0.2"),
    "grbl": ("--set", "steps=X:250,Y:320,Z:1600"),
}
TOOL = np.array([0.0, 0.0, -80.0])
ENDLESS = (0.0, 360.0)
KNOTS = 6


def bounds(axis):
    """Travel, or one turn of an axis that turns on, mm or degrees."""
    return ENDLESS if axis.rotary and axis.travel[1] - axis.travel[0] > 360.0 else axis.travel


def settings(machine, format):
    """Options of an export and of its import; Marlin's mesh is over the travel."""
    if format != "marlin":
        return SETTINGS.get(format, ())
    axes = [load(machine).axes[load(machine).index(name)] for name in "XY"]
    mesh = zip("xy", axes, MARLIN_POINTS, strict=True)
    words = [f"{name}={axis.travel[0]:g}:{axis.travel[1]:g}:{points}" for name, axis, points in mesh]
    return ("--set", words[0], "--set", words[1])


def calibration(machine, path, seed=()):
    """All error motions at random, linear between a few knots, closed over a full turn; and backlash of two axes."""
    rng = np.random.default_rng([*(ord(letter) for letter in machine.name), *seed])
    effects = []
    for axis in machine.axes:
        knots = np.linspace(*bounds(axis), KNOTS)
        for component in "XYZABC":
            values = np.cumsum(rng.normal(0.0, 8.0, KNOTS))
            if axis.rotary:
                values -= np.linspace(0.0, values[-1] - values[0], KNOTS)
            parameters = tuple(values.tolist())
            basis = BSpline(tuple(knots.tolist()), 1)
            effects.append(ErrorMotion(component, axis.name, basis, parameters, u=(1.0,) * KNOTS))
    effects += [Backlash("X", 14.0), Backlash(machine.axes[0].name if machine.axes[0].name != "X" else "Z", 9.0)]
    write_model(msgspec.structs.replace(no_errors(machine), effects=tuple(effects)), path)


def places(chain, turns=2, n=20_000):
    """Commands `(n, axes)`, mm and degrees, in the volume (endless axes in turns to either side), and directions."""
    rng = np.random.default_rng(11)
    low, high = np.array([bounds(axis) for axis in chain.axes]).T
    commands = rng.uniform(low, high, (n, len(low)))
    endless = np.array([np.isinf(axis.travel[1]) for axis in chain.axes])
    commands += 360.0 * endless * rng.integers(-turns, turns, commands.shape)
    return commands, rng.choice([-1.0, 1.0], commands.shape)


def missed(chain, truth, motors, commands, ways):
    """Tool point error `(n,)`, um, of the virtual machine with its motors there."""
    targets, zero = np.broadcast_to(TOOL, (len(commands), 3)), np.zeros((len(commands), 6))
    errors = truth.errors(chain, motors, ways)
    actual = tool_points(chain, chain.to_radians(motors), errors, zero, targets)
    return 1e3 * np.linalg.norm(actual - nominal_points(chain, chain.to_radians(commands), targets), axis=1)


def rms(sizes):
    return float(np.sqrt(np.mean(sizes**2)))
