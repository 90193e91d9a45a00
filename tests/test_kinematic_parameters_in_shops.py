"""Files of kinematic parameters as shops have them: encodings, inches, cut off, commented, doubled, of other machines.

Each file is read as it was meant, or refused with the reason: no value is passed over in silence.
"""

import json
import re

import pytest
from support.kinematic_controls import trunnion
from support.programs import load, model_of

from kinematics.effects import LocationError
from kinematics.user_error import UserError
from postproc.control_data.formats import formats_of
from postproc.control_data.parameters.export_parameters import export_parameters
from postproc.control_data.parameters.parameter_format import ParameterFormat

FORMATS = formats_of(ParameterFormat)

LENGTH = 120.0
SIZES = {"E_X0C": 31.0, "E_Y0C": -22.0, "E_Y0A": 26.0}
ON = {form: trunnion("A") if form == "linuxcnc-kinematics" else load("trunnion_ac") for form in FORMATS}
_WRITTEN = {}


def written(form):
    """The file of a format with the location errors SIZES."""
    if form not in _WRITTEN:
        chosen, errors = FORMATS[form], [LocationError(name[2], name[-1], size) for name, size in SIZES.items()]
        model = model_of(ON[form], *errors)
        found = export_parameters(ON[form], model, chosen, chosen.settings(), "correction", (0.0, 0.0, -LENGTH))
        _WRITTEN[form] = found.files[chosen.file]
    return _WRITTEN[form]


def found(form, text, machine=None, settings=()):
    """Location errors of a text."""
    kind = FORMATS[form]
    read = kind.read_files(machine or ON[form], {kind.file: text}, kind.sign or "correction", settings).effects
    return {each.name: each.parameters[0] for each in read}


def as_written(errors):
    return {name: errors[name] for name in SIZES} == pytest.approx(SIZES, abs=0.2)


every_format = pytest.mark.parametrize("form", FORMATS)


@every_format
def test_the_file_and_its_rows_in_another_order_are_read(form):
    assert as_written(found(form, written(form)))
    if not form.startswith("heidenhain"):
        lines = written(form).splitlines()
        rows = [k for k, line in enumerate(lines) if re.match(r"setp|19|N2|\$", line)]
        turned = [lines[rows[-1 - rows.index(k)]] if k in rows else line for k, line in enumerate(lines)]
        assert as_written(found(form, "\n".join(turned) + "\n"))


@every_format
def test_line_ends_and_encodings(form, command, tmp_path):
    """CRLF, a byte order mark, and UTF-16 of an editor; by the command, which reads the bytes."""
    machine = tmp_path / "mill.toml"
    if form == "linuxcnc-kinematics":
        a, c = (", ".join(map(str, ON[form].axes[ON[form].index(name)].point)) for name in "AC")
        machine.write_text(
            'name = "mill"\nchain = "w C A b X Y Z t"\n'
            + "".join(f"axes.{name} = {{ travel = [-300, 300] }}\n" for name in "XYZ")
            + f"axes.A = {{ travel = [-100, 100], point = [{a}], direction = [-1, 0, 0] }}\n"
            + f"axes.C = {{ travel = [-360, 360], point = [{c}], direction = [0, 0, -1] }}\n"
        )
    name = str(machine) if machine.exists() else "trunnion_ac"
    text = written(form).replace("\n", "\r\n")
    for k, data in enumerate((text.encode(), text.encode("utf-8-sig"), text.encode("utf-16"))):
        (tmp_path / f"own{k}.txt").write_bytes(data)
        sign = () if form in ("linuxcnc-kinematics", "fanuc-kinematics") else ("--sign", "correction")
        done = command("import", f"own{k}.txt", "-m", name, "--format", form, *sign, "-o", f"own{k}.json")
        assert done.status == 0, done.err
        effects = json.loads((tmp_path / f"own{k}.json").read_text())["effects"]
        assert {e["component"] + e["axis"] for e in effects} >= {"XC", "YA"}
    (tmp_path / "bare.txt").write_bytes(text.encode("utf-16-le"))
    done = command("import", "bare.txt", "-m", name, "--format", form, *sign, "-o", "bare.json")
    assert done.status == 2
    assert "UTF-16" in done.err


@every_format
def test_a_file_in_inches_is_refused(form):
    def inches(match):
        return f"{float(match[0]) / 25.4:.6f}"

    lines = [
        line if re.search(r"AXIS[12]_|CARR([789]|1[012])\[|Trans +[ABC]", line) else re.sub(r"-?\d+\.\d+", inches, line)
        for line in written(form).splitlines()
    ]
    with pytest.raises(UserError, match=r"inch"):
        found(form, "\n".join(lines) + "\n")


@every_format
def test_a_file_of_another_machine_is_refused(form):
    other = trunnion("A") if form != "linuxcnc-kinematics" else load("trunnion_ac")
    settings = () if form != "linuxcnc-kinematics" else ("conventional=true",)
    with pytest.raises(UserError, match=r"mm from that of the machine file|does not point where A of the machine"):
        found(form, written(form), other, settings)


@every_format
def test_a_file_that_is_cut_off_is_refused(form):
    """Behind each line, and within the last numbers."""
    text = written(form)
    for at in [m.end() for m in re.finditer("\n", text)][:-1]:
        with pytest.raises(UserError):
            found(form, text[:at])
    number = list(re.finditer(r"\.\d+", text))[-1]
    for at in range(number.start() + 1, number.end() + 1):
        with pytest.raises(UserError):
            found(form, text[:at])


@every_format
def test_a_row_that_is_lost_is_refused(form):
    lines = written(form).splitlines()
    unused = "x-offset"  # along the line of A
    rows = [k for k, line in enumerate(lines) if re.match(r"setp|19|N2|\$|.*Trans", line) and unused not in line]
    for k in rows:
        if "Trans" in lines[k] and float(lines[k].split()[-1]) == 0.0:
            continue
        with pytest.raises(UserError):
            found(form, "\n".join(lines[:k] + lines[k + 1 :]) + "\n"), lines[k]


COMMENTS = {"linuxcnc-kinematics": "#", "fanuc-kinematics": "#", "siemens-trafo5": ";", "siemens-tcarr": ";"}


@every_format
def test_comments(form):
    """A row as a comment is lost, and an old row as a comment beside the new one does not count."""
    lines = written(form).splitlines()
    k = next(k for k, line in enumerate(lines) if re.match(r"setp|19|N2|\$|.*Trans +Y", line))
    mark = COMMENTS.get(form, "*")
    old = re.sub(r"-?\d+\.\d+", "99.0", lines[k])
    assert as_written(found(form, "\n".join([*lines[:k], f"{mark} {old}", *lines[k:]]) + "\n"))


@pytest.mark.parametrize(
    ("form", "old", "new", "reason"),
    [
        ("linuxcnc-kinematics", "setp (xyzac-trt-kins.z-offset) .*", r"net z-off => \1", "connected to a signal"),
        ("linuxcnc-kinematics", "(xyzac-trt-kins.z-offset) .*", r"\1 [TRT]Z_OFFSET", "of an INI file"),
        ("linuxcnc-kinematics", "setp (xyzac-trt-kins.z-offset) .*", r"sets \1 3.0", "expected setp PIN VALUE"),
        ("linuxcnc-kinematics", r"\Z", "setp xyzac-trt-kins.conventional-directions 1\n", "conventional=true"),
        ("linuxcnc-kinematics", r"\Z", "setp xyzac-trt-kins.tool-offset 50\n", "tool-offset"),
        ("linuxcnc-kinematics", r"(x-rot-point) (\S+)", r"\1 1_000", "no number"),
        ("siemens-trafo5", "M17\n", "", "M17"),
        ("siemens-tcarr", "M17\n", '$TC_CARR23[1]="T"\nM17\n', "kinematics T"),
        ("siemens-tcarr", "M17\n", "$TC_CARR41[1]=0.012\nM17\n", "fine offset"),
        ("heidenhain-transformations", r"\ADOC|\A", "BEGIN KIN.TAB INCH\n", "INCH"),
        ("heidenhain-transformations", r"\nline of A", "\n# line of A", "comment"),
        ("fanuc-kinematics", "# 19680 = 12", "19680,2", "19680"),
        ("fanuc-kinematics", r"\A", "N19700Q1L1P12.5\n", "CNC-PARA"),
    ],
)
def test_refusals(form, old, new, reason):
    text, count = re.subn(old, new, written(form), count=1)
    assert count == 1
    with pytest.raises(UserError, match=reason) as refused:
        found(form, text)
    assert str(refused.value).startswith(FORMATS[form].file)


@pytest.mark.parametrize(
    ("form", "old", "new"),
    [
        ("linuxcnc-kinematics", r"setp (\S+-rot-point) (\S+)", r"\1 = \2"),
        ("linuxcnc-kinematics", r"\Z", "net :tool-offset motion.tooloffset.z xyzac-trt-kins.tool-offset\n"),
        ("linuxcnc-kinematics", r"\Z", "setp xyzac-trt-kins.conventional-directions FALSE\n"),
        ("siemens-tcarr", "M17\n", '$TC_CARR23[1]="P"\n$TC_CARR41[1]=0.0\nM17\n'),
        ("heidenhain-transformations", r"\A", "BEGIN KIN.TAB MM\n"),
        ("heidenhain-transformations", r"\nline of A", "\nDOCK of A"),
        ("heidenhain-transformations", r"\nline of A +Trans", "\n; shift   Trans  Y  5.0\nline of A     Trans"),
        ("fanuc-kinematics", "# 19680 = 12", "19680,12"),
    ],
)
def test_other_forms_that_mean_the_same(form, old, new):
    text, count = re.subn(old, new, written(form))
    assert count
    assert as_written(found(form, text))
