"""Kinematic parameters of every control: written, read back, applied by virtual controls, and what they cannot hold."""

import dataclasses
import json
import re

import msgspec
import numpy as np
import pytest
from support.kinematic_controls import joints, trunnion
from support.programs import load, model_of
from support.tiers import quick

import machines
from kinematics.basis import Harmonics
from kinematics.effects import UM, Backlash, ErrorMotion, LocationError
from kinematics.error_model.model import no_errors, read_model, write_model
from kinematics.forward import forward, tool_point
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.commands.controls.export import check_format, format_names
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import formats_of
from postproc.control_data.parameters.export_parameters import export_parameters, fitted_volume
from postproc.control_data.parameters.line_errors import errors_of_lines
from postproc.control_data.parameters.parameter_format import ParameterFormat
from postproc.control_data.parameters.parameter_probe import probe
from postproc.control_data.parameters.rotary_lines import reflected
from postproc.control_data.readers.control_source import Source

FORMATS = formats_of(ParameterFormat)

LENGTH = 120.0
SECOND_ORDER = 0.03  # um
COARSE = ("fanuc", "heidenhain")
"""Formats with steps of 0.1 um."""
VALUES = {"X": 31.0, "Y": -22.0, "Z": 14.0, "A": 26.0, "B": -17.0, "C": 35.0}
HEAD_5AXIS = """
name = "head_5axis"
chain = "w b X Y Z C B t"
axes.X = { travel = [-500, 500] }
axes.Y = { travel = [-400, 400] }
axes.Z = { travel = [-300, 300] }
axes.C = { travel = [-200, 200], point = [0, 0, 250] }
axes.B = { travel = [-100, 100], point = [0, 0, 250], direction = [0, -1, 0] }
"""


SHIPPED = ("trunnion_ac", "trunnion_bc", "dmu50", "head_table", "head_head")
MACHINES = {name: lambda name=name: load(name) for name in SHIPPED} | {
    "trunnion A of LinuxCNC": lambda: trunnion("A"),
    "trunnion B of LinuxCNC": lambda: trunnion("B"),
    "head of LinuxCNC": lambda: machines.parse(HEAD_5AXIS, "head"),
}
CASES = [
    *(("linuxcnc-kinematics", name) for name in MACHINES if name.endswith("LinuxCNC")),
    *((form, name) for form in FORMATS if form != "linuxcnc-kinematics" for name in SHIPPED),
]
FEW = [
    CASES[0],
    ("siemens-trafo5", "dmu50"),
    ("siemens-tcarr", "head_head"),
    ("heidenhain-transformations", "dmu50"),
    ("fanuc-kinematics", "head_table"),
]
every_case = pytest.mark.parametrize(("form", "name"), quick(CASES, FEW), ids=[" ".join(case) for case in CASES])
_EXPORTED = {}


def positions_of_lines(machine):
    """Location errors of the rotary axes that shift their lines; of a head, lines shifted against the nose."""
    found = []
    for axis in (axis for axis in machine.axes if axis.rotary):
        for component in "XYZ":
            found.append(LocationError(component, axis.name, VALUES[component] + len(found), u=(1.0,)))
    return found


@pytest.mark.parametrize("name", SHIPPED)
def test_the_chains_of_siemens_are_closed(name, command, tmp_path):
    """Offsets that begin and end at one place add up to zero: a head's, a table's, or both parts of a head and table."""
    write_model(model_of(load(name), *positions_of_lines(load(name))), tmp_path / "cal.json")
    options = ("--machine", name, "-c", "cal.json", "--format", "siemens-tcarr", "--sign", "error", "-o", "out")
    done = command("export", *options)
    assert done.status == 0, done.err
    text = "\n".join(path.read_text() for path in (tmp_path / "out").iterdir() if "before" not in path.name)
    numbers = {int(n): float(v) for n, v in re.findall(r"\$TC_CARR(\d+)\[1\] *= *([-+.\d]+)", text)}
    chain = [np.array([numbers.get(first + k, 0.0) for k in range(3)]) for first in (1, 4, 15, 18)]
    parts = [chain[:2], chain[2:]] if name == "head_table" else [chain]
    assert any(np.abs(offset).max() > 10.0 for offset in chain)
    for part in parts:
        assert sum(part) == pytest.approx(np.zeros(3), abs=1e-3)


def pivot(machine, longer_um):
    """A pivot that is longer than in the machine file: B's line, and C's, lie higher above the nose."""
    b = machine.axes[machine.index("B")]
    line = float(np.sign(b.unit_direction[1]))
    waves = {"X": (-line * longer_um, 0.0), "Z": (0.0, -longer_um)}
    constant = [LocationError("Z", "B", longer_um)]
    return constant + [
        ErrorMotion(c, "B", Harmonics(b.travel, 1), (0.0, *parts), u=(0.0,) * 3) for c, parts in waves.items()
    ]


def errors(form, machine):
    """Errors that a format can hold, and tilts where it has them."""
    if machine.name == "head_5axis":
        return pivot(machine, 40.0)
    found = positions_of_lines(machine)
    if form.startswith(("siemens", "heidenhain")):
        found += [
            LocationError(c, axis.name, VALUES[c], u=(1.0,))
            for axis in machine.axes
            if axis.rotary and axis.side == "workpiece"  # a tilt in the head tilts the tool as well
            for c in "ABC"
            if c != axis.name
        ]
    return found


def exported(form, name, sign="correction", extra=()):
    key = form, name, sign, extra
    if key not in _EXPORTED:
        machine, chosen = MACHINES[name](), FORMATS[form]
        model = model_of(machine, *errors(form, machine), *extra)
        settings = parse_settings(chosen.settings, [])
        _EXPORTED[key] = export_parameters(machine, model, chosen, settings, sign, (0.0, 0.0, -LENGTH))
    return _EXPORTED[key]


def left_um(found, text, frame):
    """Tool point errors `(n, 3)`, um, of the machine under a virtual control with a file, for two tools."""
    machine = found.machine
    volume = fitted_volume(machine, found.whole, found.tool)
    tip = tool_point(machine, volume.q, volume.tool)
    programmed = tip + frame[:3] + np.cross(frame[3:], tip)
    sent = joints(found.format.name, text, machine, volume.q, programmed, -volume.tool[:, 2])
    actual = forward(machine, sent, found.whole.errors(machine, State(sent, volume.approach))).apply(volume.tool)
    return (actual - tip) / UM


def rms(vectors):
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def read_back(found, file):
    machine, files = found.machine, found.files
    moved = found.format.read(Source(machine, files, found.sign, found.settings), file, machine)
    return moved if found.sign == "correction" else reflected(machine, moved)


def test_every_format_has_a_case_and_is_offered():
    assert {form for form, _ in CASES} == set(FORMATS)
    assert set(FORMATS) <= set(format_names())
    with pytest.raises(UserError, match=r"--format linuxcnc-kins: expected one of linuxcnc, .*linuxcnc-kinematics"):
        check_format("linuxcnc-kins")


@every_case
def test_a_control_with_the_file_leaves_nothing_that_it_can_hold(form, name):
    """By the formulas of the control's manual; with the file to go back to, the machine is as before."""
    found = exported(form, name)
    before = rms(left_um(found, found.files[found.format.file_before], found.best.frame_alone))
    after = rms(left_um(found, found.files[found.format.file], found.best.frame))
    resolution = 0.3 if form.startswith(COARSE) else SECOND_ORDER
    assert before > 15.0
    assert after < resolution


@every_case
def test_reversed_changes_double_the_error(form, name):
    found = exported(form, name)
    reverse = dataclasses.replace(found, sign="error")
    wrong = left_um(found, reverse.files[found.format.file], -found.best.frame + 2 * found.best.frame_alone)
    before = left_um(found, found.files[found.format.file_before], found.best.frame_alone)
    assert rms(wrong) == pytest.approx(2.0 * rms(before), rel=0.02)


@every_case
def test_the_reader_finds_the_errors_that_the_lines_correct(form, name):
    known = FORMATS[form].sign
    for sign in (known,) if known else ("correction", "error"):
        found = dataclasses.replace(exported(form, name), sign=sign)
        machine = found.machine
        again = msgspec.structs.replace(
            no_errors(machine), effects=tuple(errors_of_lines(machine, read_back(found, found.format.file)))
        )
        volume = fitted_volume(machine, found.whole, found.tool)
        difference = [volume.deviation(model, volume.q) for model in (found.taken, again)]
        assert np.abs(difference[0] - difference[1]).max() / UM < (0.1 if form.startswith(COARSE) else SECOND_ORDER)
        assert errors_of_lines(machine, read_back(found, found.format.file_before)) == []


@pytest.mark.parametrize(("form", "name"), quick([CASES[0], CASES[3], CASES[-2], CASES[-1]], [CASES[0], CASES[-1]]))
def test_stages_and_the_rest(form, name):
    found = exported(form, name)
    point = found.errors_in_the_volume()["tool_point_um"]
    assert point["after_parameters_and_datum_shift"]["rms"] < 0.02 * point["before_and_datum_shift"]["rms"]
    assert point["after_parameters_and_nc_correction_of_the_rest"]["max"] < SECOND_ORDER
    assert point["after_nc_correction"]["max"] < 1e-3
    volume = fitted_volume(found.machine, found.whole, found.tool)
    whole, rest, taken = (m.errors(found.machine, volume.state) for m in (found.whole, found.rest, found.taken))
    assert rest == pytest.approx(whole - taken, abs=1e-12)


def test_what_the_parameters_cannot_hold_is_named():
    machine = trunnion("A")
    further = (LocationError("C", "Y", 30.0), LocationError("B", "C", 30.0), LocationError("C", "C", 40.0),
               Backlash("X", 12.0))  # fmt: skip
    for form, names in {
        "linuxcnc-kinematics": {"E_C0Y", "E_B0C", "E_C0C", "backlash X"},
        "siemens-tcarr": {"E_C0Y", "backlash X"},
    }.items():
        chosen = FORMATS[form]
        model = model_of(machine, *positions_of_lines(machine), *further)
        found = export_parameters(machine, model, chosen, chosen.settings(), "correction", (0, 0, -LENGTH))
        why = {each.name: each.why for each in found.left}
        assert set(why) == names
        assert why["E_C0Y"] == "location error of a linear axis"


def test_uncertainties_are_those_of_the_calibration():
    """The line of C follows the location errors of A and of C, that of A only its own."""
    found = exported("linuxcnc-kinematics", "trunnion A of LinuxCNC")
    u = {each.freedom.name: each.u for each in found.changes}
    assert u == pytest.approx({"C along X": 2**0.5, "C along Y": 2**0.5, "A along Y": 1.0, "A along Z": 1.0}, rel=1e-3)


def test_values_of_a_hal_file():
    """By hand: E_Y0A +20 um is a table whose A lies 20 um to -Y, and C with it."""
    machine, form = trunnion("A"), FORMATS["linuxcnc-kinematics"]
    model = model_of(machine, LocationError("Y", "A", 20.0), LocationError("X", "C", -8.0))
    found = export_parameters(machine, model, form, form.settings(), "correction", (0, 0, -LENGTH))
    pins = dict(re.findall(r"^setp xyzac-trt-kins\.(\S+) (\S+)$", found.files["kinematics.hal"], re.M))
    assert {name: float(value) for name, value in pins.items()} == pytest.approx(
        {"x-rot-point": 3.008, "y-rot-point": -7.02, "z-rot-point": 11.0,
         "x-offset": 0.0, "y-offset": -13.0, "z-offset": 74.0}, abs=2e-6
    )  # fmt: skip


@pytest.mark.parametrize(
    ("form", "name", "reason"),
    [
        ("linuxcnc-kinematics", "trunnion_ac", "turns A against ISO 841"),
        ("linuxcnc-kinematics", "dmu50", "B must be along Y and C along Z"),
        ("linuxcnc-kinematics", "head_table", "LinuxCNC has kinematic parameters for C on A"),
        ("linuxcnc-kinematics", "head_head", "5axiskins has C along Z, then B against ISO 841"),
        ("siemens-trafo5", "gantry", "the transformation has two rotary axes"),
        ("fanuc-kinematics", "cframe", "types for two rotary axes"),
        ("heidenhain-transformations", "cframe", "has no rotary axis"),
    ],
)
def test_machines_that_a_format_does_not_fit(form, name, reason):
    chosen = FORMATS[form]
    with pytest.raises(UserError, match=reason):
        chosen.freedoms(load(name), chosen.settings())


def test_a_linear_axis_under_the_table_is_refused():
    text = (
        'name = "odd"\nchain = "w X C A b Y Z t"\naxes.X = { travel = [0, 9] }\naxes.Y = { travel = [0, 9] }\n'
        "axes.Z = { travel = [0, 9] }\naxes.A = { travel = [0, 9], point = [0, 0, 0] }\n"
        "axes.C = { travel = [0, 9], point = [0, 0, 0] }\n"
    )
    odd = machines.parse(text, "odd")
    for form in FORMATS.values():
        with pytest.raises(UserError, match="a linear axis between a rotary axis and its end"):
            form.freedoms(odd, form.settings())


@pytest.mark.parametrize(("travel", "turn"), [((-30.0, 120.0), 90), ((-120.0, 30.0), -90), ((-200.0, 200.0), 180)])
def test_the_probe_turns_within_the_travel(travel, turn):
    machine, form = load("dmu50"), FORMATS["siemens-trafo5"]
    axes = (dataclasses.replace(axis, travel=travel) if axis.name == "B" else axis for axis in machine.axes)
    files = probe(dataclasses.replace(machine, axes=tuple(axes)), "B", form, form.settings())
    assert f"Turn B by {turn} degrees" in files["probe.md"].replace("\n", " ")


@every_case
def test_the_probe_shows_the_stated_shift(form, name):
    """A ball on the table, an indicator in the spindle, half or quarter of a turn: by the virtual control."""
    chosen, machine = FORMATS[form], MACHINES[name]()
    axis = "B" if name == "head of LinuxCNC" else next(axis.name for axis in machine.axes if axis.rotary)
    files = probe(machine, axis, chosen, chosen.settings())
    told = files["probe.md"].replace("\n", " ")
    angle = float(re.search(rf"Turn {axis} by (-?\d+) degrees", told)[1])
    apart = float(re.search(r"the tool is (\S+) mm farther in the (positive|negative)", told)[1])
    side = 1.0 if "farther in the positive direction" in told else -1.0
    along = np.array([float(v) for v in re.search(r"note the reading along\s+\(([^)]*)\)", told)[1].split(",")])
    q = np.zeros((2, len(machine.axes)))
    q[1, machine.index(axis)] = np.radians(angle)
    ball = np.tile([60.0, 20.0, -LENGTH], (2, 1))
    moves = []
    for file in (chosen.file_before, chosen.file):
        sent = joints(form, files[file], machine, q, ball, np.full(2, LENGTH))
        linear = sent[:, [machine.index(letter) for letter in "XYZ"]]
        moves.append(linear[1] - linear[0])
    assert (moves[1] - moves[0]) @ along == pytest.approx(side * apart, abs=2e-4)


@pytest.mark.parametrize(
    ("form", "name", "old", "new", "reason"),
    [
        ("linuxcnc-kinematics", 0, "setp xyzac-trt-kins.x-rot-point", "setp xyzac-trt-kins.x-rotation", "know the pin"),
        ("linuxcnc-kinematics", 0, "xyzac-trt-kins.x-rot-point 2", "xyzac-trt-kins.x-rot-point x2", "could not convert"),
        ("linuxcnc-kinematics", 0, "x-rot-point", "y-rot-point", "set twice"),
        ("linuxcnc-kinematics", 0, "setp xyzac-trt-kins.z-offset", "setp maxkins.z-offset", "does not know"),
        ("siemens-trafo5", 3, "N24558", "N24559 $MC_AXIS[0]=1\nN24558", "expected a vector of the transformation"),
        ("siemens-trafo5", 3, "BASE_TOOL_1[0]=", "BASE_TOOL_1[0]=1", "the chain is open"),
        ("siemens-tcarr", 3, "$TC_CARR5[1]", "$TC_CARR5[2]", "expected record 1"),
        ("siemens-tcarr", 3, "$TC_CARR5[1]=", "$TC_CARR13[1]=", "expected an offset or a line"),
        ("siemens-tcarr", 3, "$TC_CARR12[1]=-", "$TC_CARR12[1]=", "does not point where C"),
        ("heidenhain-transformations", 3, "Trans     A", "Trans     E", "with an axis of X Y Z A B C"),
        ("heidenhain-transformations", 3, "MachAxis  C", "MachAxis  B", "no axis B"),
        ("heidenhain-transformations", 3, "[END]", "", "last line must be"),
        ("fanuc-kinematics", 3, "19700,", "19706,", "expected a parameter from 19700"),
        ("fanuc-kinematics", 3, "19700,", "19701,", "given twice"),
        ("fanuc-kinematics", 3, "19704,", "19709,", "parameter 19704 is missing"),
    ],
)  # fmt: skip
def test_files_that_are_refused(form, name, old, new, reason):
    found = exported(form, "trunnion A of LinuxCNC" if name == 0 else "trunnion_ac")
    file = found.format.file
    assert old in found.files[file]
    text = found.files[file].replace(old, new, 1)
    with pytest.raises(UserError, match=reason) as refused:
        found.format.read(Source(found.machine, {file: text}, "correction", found.settings), file, found.machine)
    assert str(refused.value).startswith(file)


def test_the_commands(command, tmp_path):
    """Export, and import again: the lines in the control as a calibration."""
    machine = load("trunnion_ac")
    write_model(model_of(machine, *positions_of_lines(machine)), tmp_path / "cal.json")
    options = ("-m", "trunnion_ac", "--format", "siemens-tcarr", "--set", "record=2")
    export = ("export", *options, "-c", "cal.json", "--tool-mm", 100)
    done = command(*export, "-o", "out")
    assert done.status == 2
    assert "--probe" in done.err
    done = command(*export, "--sign", "correction", "-o", "out", "--rest", "rest.json", "--json", "out.json")
    assert done.status == 0, done.err
    told = json.loads((tmp_path / "out.json").read_text())
    assert told["files"] == ["kinematics.spf", "kinematics_before.spf", "sheet.md"]
    assert {row["name"] for row in told["parameters"]} >= {"$TC_CARR4[2]", "$TC_CARR12[2]"}
    stages = told["errors"]["volume"]["tool_point_um"]
    assert next(iter(stages)) == "before"
    assert stages["after_parameters_datum_shift_and_tables"]["rms"] < 0.1
    sheet = (tmp_path / "out" / "sheet.md").read_text()
    assert "Programs of axis positions do not change" in sheet
    assert (
        f"| with these parameters, work offset touched off again | {stages['after_parameters_and_datum_shift']['rms']:.2f}"
        in sheet
    )
    rest = read_model(tmp_path / "rest.json", machine)
    done = command("import", "out/kinematics.spf", *options, "--sign", "correction", "-o", "in.json")
    assert done.status == 0, done.err
    found = {effect.name: effect for effect in read_model(tmp_path / "in.json", machine).effects}
    assert found["E_Y0A"].value == pytest.approx(VALUES["Y"] + 4, abs=0.01)
    assert max(abs(effect.parameters[0]) for effect in rest.effects if effect.name == "E_Y0A") <= abs(VALUES["Y"]) + 5
    assert command("export", *options, "--probe", "C", "-o", "probe").status == 0
    assert (tmp_path / "probe" / "probe.md").exists()
    refused = command(*export, "--sign", "correction", "-o", "out2", "--program", "part.nc")
    assert refused.status == 2
