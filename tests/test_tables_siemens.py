"""Siemens EEC and CEC: the manuals' examples, a gantry that sags, and limits."""

import json

import numpy as np
import pytest
from support.programs import load, model_of
from support.table_cases import motions
from support.tiers import quick

import ncomp
from kinematics.basis import Legendre
from kinematics.effects import CrossAxis, Cyclic, ErrorMotion
from kinematics.error_model.model import write_model
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import FORMATS
from postproc.control_data.tables.export_tables import export
from postproc.control_data.tables.limits import Limits, check_terms
from postproc.control_data.tables.terms import Curve, Term

CFRAME = load("cframe")

# Extended Functions manual, K3 (6FC5397-1BP40-3BA1, 03/2013): 801 points, 1 mm apart, -200 ... 600.
K3 = {0: 0.003, 1: 0.01, 500: -0.007}
EEC = "\n".join(
    ["%_N_AX_EEC_INI", "CHANDATA(1)"]
    + [f"$AA_ENC_COMP[0,{k},X1]={K3.get(k, 0.0)} ; point {k}" for k in range(800)]
    + ["$AA_ENC_COMP[0,800,X1]=-0.0", "$AA_ENC_COMP_STEP[0,X1]=1.0", "$AA_ENC_COMP_MIN[0,X1]=-200.0"]
    + ["$AA_ENC_COMP_MAX[0,X1]=600.0", "$AA_ENC_COMP_IS_MODULO[0,X1]=0", "M17", ""]
)
# 802D sl Function Manual (6FC5397-1CP10-5BA0), p. 222: Y1 is AX2, X1 is AX1; the values between are ours.
CEC = """%_N_NC_CEC_INI
CHANDATA(1)
$AN_CEC[0,0]=0          ; point 0, for X1
$AN_CEC[0,1]=0.01       ; + 10 um
$AN_CEC[0,2]=0.02
$AN_CEC_INPUT_AXIS[0]=(AX2)     ; basic axis Y1
$AN_CEC_OUTPUT_AXIS[0]=(AX1)    ; compensation axis X1
$AN_CEC_STEP[0]=400.0
$AN_CEC_MIN[0]=-400.0
$AN_CEC_MAX[0]=400.0
$AN_CEC_DIRECTION[0]=0
$AN_CEC_MULT_BY_TABLE[0]=0
$AN_CEC_IS_MODULO[0]=0
M17
"""


def errors_of(format, text, sign, q, approach=None, **said):
    """Own error motions E_XX E_YY E_ZZ `(n, 3)`, mm, that the tables take away."""
    tables = FORMATS[format].read_files(CFRAME, {"a.ini": text}, sign, [f"{k}={v}" for k, v in said.items()]).effects
    q = np.atleast_2d(np.asarray(q, float))
    state = State(q, np.zeros(q.shape) if approach is None else np.broadcast_to(approach, q.shape))
    errors = model_of(CFRAME, *tables).errors(CFRAME, state)
    return np.stack([errors[:, i, i] for i in range(3)], axis=1)


def test_the_manual_s_encoder_table():
    """The value is the error: +3 um at -200, 0 at the end, which hold outside."""
    q = [[x, 0, 0] for x in (-300, -200, -199.5, -199, 300, 600, 700)]
    assert errors_of("siemens-eec", EEC, "error", q)[:, 0] * 1e3 == pytest.approx([3, 3, 6.5, 10, -7, 0, 0], abs=1e-9)


@pytest.mark.parametrize(("sign", "size"), [("error", 10.0), ("correction", -10.0)])
def test_the_manual_s_cross_table(sign, size):
    """X by the position of Y."""
    found = errors_of("siemens-cec", CEC, sign, [[0, 0, 0], [500, 400, 0], [0, -600, 0]])
    assert found * 1e3 == pytest.approx(np.array([[size, 0, 0], [2 * size, 0, 0], [0, 0, 0]]), abs=1e-9)


def test_two_directions_and_a_product():
    """Direction-dependent pitch (K3, p. 264) in two tables; the boring mill (802D sl, p. 224): sine over X times Z."""
    text = CEC.replace("(AX2)", "(X1)").replace("DIRECTION[0]=0", "DIRECTION[0]=1")
    forward, backward = (errors_of("siemens-cec", text, "error", [[0, 0, 0]], way)[0, 0] for way in (1, -1))
    assert (forward, backward) == pytest.approx((0.01, 0.0), abs=1e-12)
    second = CEC.replace("[0,", "[1,").replace("[0]", "[1]").replace("(AX2)", "(AX3)").replace("=0.02", "=3.0")
    text = CEC.replace("MULT_BY_TABLE[0]=0", "MULT_BY_TABLE[0]=2") + second.replace("=0.01 ", "=1.0 ")
    q = np.array([[0, y, z] for y in (-400, 0, 400) for z in (-400, 0, 200, 400)], float)
    found = errors_of("siemens-cec", text, "error", q)[:, 0]
    f, g = np.interp(q[:, 1], [-400, 0, 400], [0, 0.01, 0.02]), np.interp(q[:, 2], [-400, 0, 400], [0, 1, 3])
    assert found[[0, 1, 3, 4, 5, 7, 8, 9, 11]] == pytest.approx((f * g)[[0, 1, 3, 4, 5, 7, 8, 9, 11]], abs=1e-12)


BROKEN = {
    "points missing": (EEC.replace("$AA_ENC_COMP[0,400,X1]=0.0", ";"), "expected the points 0 to 800"),
    "a point twice": (EEC + "$AA_ENC_COMP[0,3,X1]=0.0\n", "a second value of this point"),
    "no whole number of steps": (EEC.replace("STEP[0,X1]=1.0", "STEP[0,X1]=0.99"), "must be a whole number of steps"),
    "another axis": (EEC.replace("X1", "Q1"), "axis Q1 is not one of X Y Z; give --set names=AXIS:Q1"),
    "another measuring system": (EEC.replace("[0,", "[1,"), "give --set system=1"),
    "no step": (EEC.replace("$AA_ENC_COMP_STEP", "; "), "_STEP missing"),
    "a word": (EEC.replace("=0.003", "=x"), "a.ini:3"),
    "modulo of a linear axis": (
        EEC.replace("MODULO[0,X1]=0", "MODULO[0,X1]=1"),
        "IS_MODULO needs a rotary axis and a turn",
    ),
    "a blank for =": (EEC.replace("$AA_ENC_COMP[0,0,X1]=", "$AA_ENC_COMP[0,0,X1] "), "a.ini:3"),
}


@pytest.mark.parametrize(("text", "said"), BROKEN.values(), ids=BROKEN)
def test_broken_tables_are_refused(text, said):
    with pytest.raises(UserError, match=said.replace("[", "\\[")):
        errors_of("siemens-eec", text, "error", [[0, 0, 0]])


def turning(end=360.0, last="0.0"):
    """The table of an axis that turns without end, with 0.002 degrees at 90."""
    points = ["0.0", "0.002", "0.0", "-0.002", last]
    return "\n".join(
        ["CHANDATA(1)", *(f"$AA_ENC_COMP[0,{k},C1]={point}" for k, point in enumerate(points)),
         f"$AA_ENC_COMP_STEP[0,C1]={end / 4}", "$AA_ENC_COMP_MIN[0,C1]=0.0", f"$AA_ENC_COMP_MAX[0,C1]={end}",
         "$AA_ENC_COMP_IS_MODULO[0,C1]=1", "M17", ""]
    )  # fmt: skip


def test_a_table_of_one_turn_repeats():
    dmu50 = load("dmu50")
    tables = FORMATS["siemens-eec"].read_files(dmu50, {"a.ini": turning()}, "error", ["names=C:C1"]).effects
    at = np.zeros((3, len(dmu50.axes)))
    at[:, dmu50.index("C")] = np.radians([90.0, 450.0, -90.0])
    errors = model_of(dmu50, *tables).errors(dmu50, State(at, np.zeros(at.shape)))[:, dmu50.index("C"), 5]
    assert np.degrees(errors) == pytest.approx([0.002, 0.002, -0.002], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "said"), [(turning(3600.0), "a turn of 360"), (turning(last="0.001"), "must be equal")]
)
def test_a_table_that_does_not_repeat_is_refused(text, said):
    with pytest.raises(UserError, match=said):
        FORMATS["siemens-eec"].read_files(load("dmu50"), {"a.ini": text}, "error", ["names=C:C1"])


def test_a_table_of_one_turn_is_exported_closed():
    dmu50 = load("dmu50")
    exported = ncomp.export(dmu50, "siemens-eec", model_of(dmu50, Cyclic("C", "C", 360.0, (100.0,), (0.0,))))
    (curve,) = (term.factors[0] for term in exported.content.terms)
    assert curve.values[0] == curve.values[-1]
    wave = 100e-6 * np.sin(np.radians(curve.nodes))
    np.testing.assert_allclose(np.abs(np.radians(curve.values)), np.abs(wave), atol=1e-6)


def sagging(size=60.0):
    """A gantry whose bridge bends under Z: E_ZY is a parabola over Y, and grows with the reach of Z."""
    gantry = load("gantry")
    sag = ErrorMotion("Z", "Y", Legendre((0.0, 3000.0), 2), (-size, 0.0, size), u=(1.0,) * 3)
    reach = CrossAxis("Z", "Y", "Z", (0.0, 3000.0), (0.0, 1500.0), 2, 1, (0.4 * size, 0.0, -0.4 * size))
    return gantry, model_of(gantry, sag, reach)


@pytest.mark.parametrize("sign", quick(["error", "correction"], ["error"]))
def test_a_product_takes_the_sag_of_a_gantry_away(sign):
    """By what was predicted; tables of one axis alone leave a part that depends on both."""
    gantry, model = sagging()
    form = FORMATS["siemens-cec"]
    found = {}
    for products in ("true", "false"):
        exported = export(gantry, model, form, parse_settings(form.settings, [f"products={products}"]), sign, (0, 0, 0))
        predicted = exported.errors_in_the_volume()["tool_point_um"]
        tables = form.read_files(gantry, exported.files, sign).effects
        rng = np.random.default_rng(7)
        q = rng.uniform(0, [5000, 3000, 1500], (4000, 3))
        corrected = q.copy()
        corrected[:, 2] -= model_of(gantry, *tables).errors(gantry, State(q, np.ones(q.shape)))[:, 2, 2]
        corrected[:, 2] += exported.datum.get("Z", 0.0)
        left = (model.errors(gantry, State(corrected))[:, 1, 2] + corrected[:, 2] - q[:, 2]) * 1e3
        found[products] = float(np.sqrt(np.mean(left**2)))
        assert found[products] == pytest.approx(predicted["after_tables_and_datum_shift"]["rms"], rel=0.03, abs=0.01)
    assert "$AN_CEC_MULT_BY_TABLE[" in exported.files["nc_cec.ini"]
    assert predicted["before"]["rms"] > 40
    assert found["true"] < 0.1
    assert found["false"] > 5


def test_few_tables_hold_what_matters_most():
    """A 802D sl has two tables: they go to the largest of six straightness errors."""
    form = FORMATS["siemens-cec"]
    settings = parse_settings(form.settings, ["control=802d", "products=false", "own=false"])
    sizes = {"YX": 3.0, "ZX": 50.0, "XY": 2.0, "ZY": 4.0, "XZ": 30.0, "YZ": 1.0}
    model = model_of(CFRAME, *(e for name, size in sizes.items() for e in motions(CFRAME, name, size)))
    exported = export(CFRAME, model, form, settings, "error", (0, 0, 0))
    assert {term.name for term in exported.content.terms} == {"Z(X)", "X(Z)"}
    names = [item.name for item in exported.left]
    assert "E_ZX" not in names


def test_limits_broken_on_purpose_are_refused():
    limits = Limits(points=3, resolution=1e-6, equidistant=True, tables=1, largest=0.1, zero_at_home=True)
    good = Term("X", (Curve("X", np.array([0.0, 300.0, 600.0]), np.array([0.0, 0.01, 0.0])),))
    check_terms([good], limits, "CEC", CFRAME)
    bad = {
        "holds at most 1 tables, and the correction needs 2": [good, good],
        "exceed the most, 3": [Term("X", (Curve("X", np.arange(4.0), np.zeros(4)),))],
        "must be equidistant": [Term("X", (Curve("X", np.array([0.0, 1.0, 3.0]), np.zeros(3)),))],
        "finite numbers that increase": [Term("X", (Curve("X", np.array([0.0, 1.0, 1.0]), np.zeros(3)),))],
        "exceeds the largest": [Term("X", (Curve("X", np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.2, 0])),))],
        "a value is not a finite number": [
            Term("X", (Curve("X", np.array([0.0, 1.0, 2.0]), np.array([0.0, np.nan, 0])),))
        ],
        "it must be 0": [Term("X", (Curve("X", np.array([0.0, 1.0, 2.0]), np.array([0.01, 0, 0])),))],
    }
    for said, terms in bad.items():
        with pytest.raises(UserError, match=said):
            check_terms(terms, limits, "CEC", CFRAME)
    turning = load("head_table")
    open_end = Term("C", (Curve("C", np.array([0.0, 180.0, 360.0]), np.array([0.0, 0.01, 0.02])),))
    with pytest.raises(UserError, match="first and last value must be equal"):
        check_terms([open_end], limits, "EEC", turning)


@pytest.mark.usefixtures("few_positions")
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (("control=828d", "points=201"), "828d holds at most 200 points in a table"),
        (("interval=0.5",), "200 points 0.5 apart do not reach"),
        (("names=Q:X1",), "expected AXIS:NAME"),
        (("control=810",), "--set: Invalid enum value '810'"),
    ],
)
def test_settings_that_cannot_be_are_refused(command, tmp_path, settings, said):
    write_model(model_of(CFRAME, *motions(CFRAME, "XX YX")), tmp_path / "c.json")
    more = [word for setting in settings for word in ("--set", setting)]
    done = command("export", "--machine", "cframe", "-c", "c.json", "--format", "siemens-cec", "--sign", "error", "-o", "o", *more)  # fmt: skip
    assert done.status == 2
    assert said in done.err
    assert not (tmp_path / "o").exists()


@pytest.mark.usefixtures("few_positions")
def test_pitch_by_one_format_and_the_rest_by_another(command, tmp_path):
    """EEC holds the pitch, CEC made from its rest holds the cross errors, programs do what is left: nothing twice."""
    write_model(model_of(CFRAME, *motions(CFRAME, "XX YX ZX AX")), tmp_path / "c.json")
    run = ("export", "--machine", "cframe", "--tool-mm", 50)
    assert command(*run, "-c", "c.json", "--format", "siemens-eec", "-o", "a", "--rest", "b.json").status == 0
    cec = (*run, "-c", "b.json", "--format", "siemens-cec", "--sign", "error", "--set", "own=false", "-o", "b")
    assert command(*cec, "--rest", "c2.json", "--json", "out.json").status == 0
    told = json.loads((tmp_path / "out.json").read_text())
    names = {table["name"] for table in told["tables"]}
    assert "X(X)" not in names
    assert "Z(X)" in names
    both = told["errors"]["volume"]["tool_point_um"]["after_tables_and_nc_correction_of_the_rest"]
    assert both["max"] < 0.02


def test_no_sign_no_table(command, tmp_path):
    write_model(model_of(CFRAME, *motions(CFRAME, "YX")), tmp_path / "c.json")
    run = ("export", "--machine", "cframe", "-c", "c.json", "--format", "siemens-cec", "-o", "out")
    done = command(*run)
    assert done.status == 2
    assert "--probe" in done.err
    done = command(*run, "--probe", "X")
    assert done.status == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["nc_cec.ini", "probe.md"]
    values = [
        line for line in (tmp_path / "out" / "nc_cec.ini").read_text().splitlines() if line.startswith("$AN_CEC[")
    ]
    numbers = [float(line.partition("=")[2]) for line in values]
    assert [value for value in numbers if value] == [0.02]
    assert numbers[0] == numbers[-1] == 0.0
