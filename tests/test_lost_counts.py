"""Lost counts of a tracker's encoder: a step of its readings at one angle, told from errors of the machine."""

from dataclasses import dataclass

import numpy as np
import pytest
from shop_floor.hidden import Hidden
from shop_floor.question import ask
from support.diagnosis_cases import data_with

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.measurement.file import read_measurement
from kinematics.effects import AngleStep
from kinematics.effects.combined.where import beam

N = 240
ABOVE = float(np.degrees(np.quantile(beam(data_with(n=N).observed).angles[:, 0], 0.4)))
LOST = AngleStep("elevation", "azimuth", ABOVE, 40.0)


@dataclass(frozen=True)
class Pad(Hidden):
    """A foundation that is higher in one corner: a step of the machine that no error motion of an axis holds."""

    def tool(self, run):
        corner = (run.share("X") > 0.4) & (run.share("Y") > 0.6)
        return 1e-3 * self.size * corner[:, None] * [0.0, 0.0, 1.0]


@pytest.mark.xfail(
    strict=True,
    reason="what the model cannot do: beside a function that no basis holds, a step imitates its rest, weakly",
)
@pytest.mark.statistical
def test_a_step_that_imitates_a_pad_is_none(tmp_path):
    (tmp_path / "data.csv").write_text(ask("lines", "none", "gantry", 0, 210001).having(Pad(60.0)).sheet())
    found = diagnose(read_measurement(tmp_path / "data.csv", machines.load("gantry")))
    assert not [cause.effect.name for cause in found.causes if cause.kind == "tracker-angle"]


def test_rows_beyond_lost_counts_are_no_outliers_and_no_error_of_the_machine():
    found = diagnose(data_with(LOST, n=N))
    (cause,) = found.causes
    assert (cause.kind, cause.axis, cause.verdict) == ("tracker-angle", "elevation", "strong")
    assert cause.effect.parameters[0] == pytest.approx(40.0, abs=3.0 * cause.effect.u[0])
    assert not found.unexplained
    assert not found.outliers
    assert found.volume.machine_rms < 3.0


@pytest.mark.exam
def test_lost_counts_are_not_taken_for_a_noisier_instrument():
    """60 rows: residuals that the step leaves look like noise 1.5 times as large as specified."""
    above = float(np.degrees(np.quantile(beam(data_with(n=60, seed=5).observed).angles[:, 0], 0.4)))
    found = diagnose(data_with(AngleStep("elevation", "azimuth", above, 40.0), n=60, seed=5))
    (cause,) = found.causes
    assert (cause.kind, cause.axis, cause.verdict) == ("tracker-angle", "elevation", "strong")
