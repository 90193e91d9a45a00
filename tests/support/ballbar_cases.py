"""Virtual ballbar measurements on the C-frame machine."""

import machines
from calibration.instruments import Ballbar
from calibration.measurement.measurement import Target
from calibration.simulation.ballbar import Circles, swept
from calibration.simulation.measure_plan import streams
from calibration.simulation.true_model import model_of

CENTRE = (300.0, 225.0, 150.0)
CFRAME = machines.load("cframe")
TOOL_BALL = "t1", Target((0.0, 0.0, -120.0))


def circles_of(
    *effects, machine=CFRAME, planes=("XY",), feeds=(1000.0, 3000.0), bar=None, seed=0, noise=1.0, step=1.0,
    centre=CENTRE, arc=(0.0, 360.0),
):  # fmt: skip
    """Circles of a machine with these effects alone, and the true model."""
    model = model_of(machine, effects)
    draws = streams(seed, 2)
    circles = Circles(centre, planes, feeds, step, arc)
    return swept(machine, model, bar or Ballbar(u_um=0.3), circles, TOOL_BALL, (draws[0], draws[1]), noise), model
