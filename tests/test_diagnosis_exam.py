"""The questions of the exam of diagnoses (benchmarks/diagnosis_exam.py), and how answers are scored."""

from itertools import product

import numpy as np
import pytest
from support.tiers import quick
from virtual_machine import draws, observe
from virtual_machine import instrument_causes as instrument
from virtual_machine import machine_causes as machine
from virtual_machine.scoring import Score, score

import machines
from calibration.measurement.file import read_measurement

EVERY = list(product(draws.KINDS, draws.MACHINES))
MACHINE_OF = [(kind, draws.MACHINES[n % len(draws.MACHINES)]) for n, kind in enumerate(draws.KINDS)]
"""One machine for each kind."""


@pytest.mark.parametrize(("kind", "name"), quick(EVERY, MACHINE_OF[::4], MACHINE_OF))
def test_questions_can_be_read_and_have_the_size_that_they_say(kind, name, tmp_path):
    draw = draws.draw([kind], name, 7)
    assert draw.sheet() == draws.draw([kind], name, 7).sheet() != draws.draw([kind], name, 8).sheet()
    sheets = [draw.sheet(), draw.sheet(clean=True), *([draw.earlier_sheet()] if draw.earlier else [])]
    for text in sheets:
        (tmp_path / "data.csv").write_text(text, encoding="utf-8")
        measurement = read_measurement(tmp_path / "data.csv", machines.load(name))
        assert 250 <= len(measurement) <= 600
        assert not [
            note for note in measurement.notes if any(word in note for word in ("travel", "not used", "ignored"))
        ]
    assert len(set(sheets)) == len(sheets)
    moved = observe.displacement(draw.setup, draw.causes[0])
    if draw.calibrated == "before":
        moved = observe.aligned(moved, observe.without_noise(draw.setup), draw.setup.session.stations)
    moved = moved[draw.setup.session.on_tool]
    size = np.sqrt(np.mean(np.sum(moved**2, axis=1))) / observe.noise_of_mean(draw.setup)
    if kind == "outliers":
        assert size > 0.5
    else:
        assert size == pytest.approx(draw.times[0], rel=1e-3)
        assert draws.TIMES[0] <= draw.times[0] <= draws.TIMES[1]


@pytest.mark.parametrize("kind", draws.BY_LASER)
def test_questions_to_an_interferometer_can_be_read_and_have_their_size(kind, tmp_path):
    draw = draws.by_laser(kind, "dmu50", 5)
    (tmp_path / "data.csv").write_text(draw.sheet(), encoding="utf-8")
    measurement = read_measurement(tmp_path / "data.csv", machines.load("dmu50"))
    assert len(measurement) == 360
    axis = draw.laser_along
    assert draw.causes[0].answer().axes == (axis,)
    moved = observe.exact_readings(draw.setup.having(*draw.causes), axis) - observe.exact_readings(draw.setup, axis)
    u = np.sqrt(measurement.covariances[:, 0, 0])
    np.testing.assert_allclose(u, observe.noise_along(draw.setup, axis, draws.LASER), rtol=1e-9)
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(
        draw.times[0] * np.sqrt(np.mean(u**2 / draw.setup.session.visits())), rel=1e-3
    )


RIGHT = {
    "backlash": machine.Backlash("X", 12.0),
    "cyclic": machine.Cyclic("C", 5.0, (0.4, 0.1), (6.0, 1.0)),
    "thermal-drift": machine.Drift("Z", 900.0, -9.0),
    "location": machine.Tilt("Y", "C", 20.0),
    "cross-axis": machine.Sag("Y", "X", 9.0),
    "outliers": instrument.Outliers((7, 30), (60.0, 0.0, -20.0, 5.0, 9.0, 80.0)),
    "station-shift": instrument.StationShift("s2", 200, (5.0, -3.0, 8.0), (2.0, 1.0, -4.0)),
    "tracker-angle": instrument.AngleHarmonic("azimuth", 1, 6.0, -3.0),
}
SAID = {
    "backlash": ({"axis": "X"}, {"width_um": 12.4}, {"width_um": 0.3}, {}),
    "cyclic": (
        {"axis": "C"},
        {"period_deg": 5.001, "sine_urad": [5.5, 1.0], "cosine_urad": [2.3, 0.1]},
        {"period_deg": 0.001, "sine_urad": [0.2, 0.2], "cosine_urad": [0.2, 0.2]},
        {"component": "C", "axis": "C"},
    ),
    "thermal-drift": (
        {"axis": None},
        {"amplitudes_um": [-9.3], "time_constants_s": [950.0]},
        {"amplitudes_um": [0.3], "time_constants_s": [40.0]},
        {"component": "Z"},
    ),
    "location": ({"axis": "Y"}, {"value_urad": 19.0}, {"value_urad": 1.0}, {"component": "C", "axis": "Y"}),
    # own X, other Y: P0 P1, P1 P1, P0 P2, P1 P2
    "cross-axis": (
        {"axis": "X"},
        {},
        {},
        {
            "component": "Z", "axis": "X", "other": "Y", "own_degree": 1, "other_degree": 2,
            "coefficients": [0.1, 0.2, 0.3, -6.1], "u": [0.2, 0.2, 0.2, 0.2],
        },
    ),
    "outliers": ({"axis": None, "rows": [30, 7]}, {}, {}, {}),
    "station-shift": (
        {"axis": None, "station": "s2"},
        {"shift_um": [-5.2, 3.0, -8.3], "turn_urad": [-2.0, -1.0, 4.0]},
        {"shift_um": [0.3, 0.3, 0.3], "turn_urad": [0.3, 0.3, 0.3]},
        {},
    ),
    "tracker-angle": (
        {"axis": None, "circle": "azimuth"},
        {"sine_urad": 6.3, "cosine_urad": -3.3},
        {"sine_urad": 0.3, "cosine_urad": 0.3},
        {},
    ),
}  # fmt: skip


def effect_said(kind: str, **changes):
    told, parameters, u, _ = SAID[kind]
    return {
        "kind": kind,
        "where": "-",
        "parameters": parameters,
        "u": u,
        "verdict": "strong",
        "alternatives": [],
        **told,
        **changes,
    }


def judged(kind: str, *said):
    return score({"effects": said}, {"effects": [{"kind": kind, **SAID[kind][3]}]}, [RIGHT[kind].answer()])


@pytest.mark.parametrize("kind", RIGHT)
def test_a_right_diagnosis_is_scored_right_and_wrong_ones_wrong(kind):
    right = effect_said(kind)
    parameters = sum(map(len, RIGHT[kind].answer().sizes.values()))
    assert judged(kind, right) == Score((True,), (), parameters, parameters)
    assert judged(kind) == Score((False,), ())
    assert not judged(kind, {**right, "kind": "settling"}).named[0]
    assert judged(kind, right, effect_said("backlash", axis="Z")).blamed == ("backlash Z strong",)
    assert judged(kind, right, right).blamed
    if parameters and kind != "cross-axis":
        far = {key: (np.array(value) * 3).tolist() for key, value in right["parameters"].items()}
        assert judged(kind, {**right, "parameters": far}).inside == 0
        assert (
            judged(
                kind, {**right, "u": {key: (np.array(value) * 0).tolist() for key, value in right["u"].items()}}
            ).inside
            == 0
        )
    sibling = effect_said(
        "backlash", axis="Z", alternatives=[{"kind": kind, "axis": right["axis"], "cosine": 0.99, "odds": 1.0}]
    )
    assert judged(kind, sibling).tied


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        ("backlash", {"axis": "Y"}),
        ("cyclic", {"axis": "X"}),
        ("thermal-drift", {"component": "X"}),
        ("location", {"component": "B"}),
        ("cross-axis", {"other": "Z"}),
        ("outliers", {"rows": [7]}),
        ("station-shift", {"station": "s1"}),
        ("tracker-angle", {"circle": "elevation"}),
    ],
)
def test_a_wrong_axis_component_row_station_or_circle_is_no_naming(kind, wrong):
    assert not judged(kind, effect_said(kind, **wrong)).named[0]


@pytest.mark.parametrize(
    ("kind", "place"), [("thermal-drift", "Z"), ("station-shift", "s2"), ("tracker-angle", "azimuth")]
)
def test_what_is_of_no_axis_may_give_its_place_as_axis(kind, place):
    told = {key: value for key, value in effect_said(kind, axis=place).items() if key not in ("circle", "station")}
    assert judged(kind, told).named == (True,)
    assert not judged(kind, {**told, "axis": "B"}).named[0]


def test_half_a_station_shift_of_the_wrong_sign_is_not_inside():
    mixed = effect_said("station-shift", parameters={"shift_um": [5.0, -3.0, 8.0], "turn_urad": [-2.0, -1.0, 4.0]})
    assert judged("station-shift", mixed).inside == 3
