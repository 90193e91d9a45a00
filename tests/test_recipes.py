"""The recipes for developers: their examples are complete, and a user's commands use what they add."""

import json
import os
import re
import subprocess
import sys
import tomllib
import types
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.programs import load, model_of

from calibration.instruments import KINDS
from calibration.measurement.readers import FOREIGN, Reader
from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import read_model, write_model
from kinematics.files import fingerprint
from kinematics.state import State
from postproc.control_data.formats import FORMATS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "develop" / "recipes.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r'^```\w+ title="([^"]+)"\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL))

OVERSHOOT = EXAMPLES["overshoot.py"].replace("from kinematics", "from ncomp.kinematics")


@pytest.fixture
def module(monkeypatch):
    """The module of an example."""

    def made(name: str) -> types.ModuleType:
        found = types.ModuleType(Path(name).stem)
        monkeypatch.setitem(sys.modules, found.__name__, found)
        exec(compile(EXAMPLES[name], name, "exec"), vars(found))
        return found

    return made


def test_a_machine_is_one_file(command):
    Path("mill.toml").write_text(EXAMPLES["mill.toml"])
    Path("part.nc").write_text("G21 G90 G54\nG1 X10. Y20. Z30. F100\nM30\n")
    done = command("part.nc", "-m", "mill.toml", "-c", "none", "--set-up-zero", "-o", "out.nc")
    assert done.status == 0, done.err
    assert "X10. Y20. Z30." in Path("out.nc").read_text()


def run_apart(folder: Path, *words: str, first: str = "pass") -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own, because modules are loaded once; `first`: a statement before it."""
    code = f"import sys; sys.argv[0] = 'ncomp'\n{first}\nfrom postproc.cli import run; run()"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture
def with_plugin(tmp_path):
    """The command line with the example of an effect; status, output and errors."""
    (tmp_path / "overshoot.py").write_text(OVERSHOOT)
    return partial(run_apart, tmp_path)


@pytest.mark.statistical
def test_an_effect_of_ones_own_is_one_file(with_plugin, tmp_path):
    """It is simulated, fitted, diagnosed, corrected, exported and reported like the others."""

    def ncomp(*words: str) -> None:
        done = with_plugin(*words, "--plugin", "overshoot.py")
        assert done.returncode == 0, done.stderr

    def written(name: str) -> dict:
        return json.loads((tmp_path / name).read_text())

    simulated = (
        "simulate",
        "-m",
        "cframe",
        "--strategy",
        "random",
        "--points",
        "60",
        "--order",
        "shuffled",
        "--seed",
        "3",
    )
    ncomp(*simulated, "--errors", "none", "--effect", "overshoot:axis=X,size=40", "-o", "data.csv")
    ncomp(
        "fit", "data.csv", "-m", "cframe", "--effect", "overshoot:axis=X,size=0", "-o", "cal.json", "--report", "p.html"
    )
    (found,) = (effect for effect in written("cal.json")["effects"] if effect["kind"] == "overshoot")
    assert found["size"] == pytest.approx(40.0, abs=4.0 * found["u"][0])
    assert "overshoot X" in (tmp_path / "p.html").read_text()
    ncomp("diagnose", "data.csv", "-m", "cframe", "-o", "new.json", "--json", "found.json")
    (cause,) = written("found.json")["effects"]
    tied = {other["kind"] for other in cause["alternatives"] if other["odds"] < 150.0}
    assert {cause["kind"], *tied} == {"overshoot", "backlash"}
    (tmp_path / "in.nc").write_text("G21 G90 G54\nG0 X300. Y200. Z100.\nG1 X400. F500\nX350.\nM30\n")
    ncomp("in.nc", "-m", "cframe", "-c", "cal.json", "--set-up-zero", "--accept", "insignificant", "-o", "out.nc")
    assert "X349.9" in (tmp_path / "out.nc").read_text() or "X350.0" in (tmp_path / "out.nc").read_text()
    export = ("export", "-m", "cframe", "-c", "cal.json", "--format", "csv", "-o", "tables", "--plugin", "overshoot.py")
    assert "note" not in with_plugin(*export).stderr
    plugin = (tmp_path / "overshoot.py").read_bytes()
    for name in ("cal.json", "new.json"):
        kinds = {effect["kind"] for effect in written(name)["effects"]}
        noted = written(name)["provenance"]["inputs"].get("plug-in overshoot.py")
        assert noted == (fingerprint(plugin) if "overshoot" in kinds else None)
    (tmp_path / "overshoot.py").write_bytes(plugin + b"# changed\n")
    done = with_plugin(*(word.replace("tables", "others") for word in export))
    assert done.returncode == 0
    assert f"made with plug-in overshoot.py, {fingerprint(plugin)}, and this run uses" in done.stderr


@pytest.fixture
def installed(tmp_path):
    """The package of the recipe, as an installer writes it."""
    (tmp_path / "ncomp_overshoot.py").write_text(OVERSHOOT)
    project = tomllib.loads(EXAMPLES["pyproject.toml"])["project"]
    folder = tmp_path / f"ncomp_overshoot-{project['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    ((group, (entry,)),) = ((group, list(given.items())) for group, given in project["entry-points"].items())
    (folder / "entry_points.txt").write_text(f"[{group}]\n{' = '.join(entry)}\n")


@pytest.mark.statistical
@pytest.mark.usefixtures("installed")
def test_an_installed_package_gives_its_effect_on_request(with_plugin, tmp_path):
    points = ("--strategy", "random", "--points", "40", "--order", "shuffled", "--seed", "3")
    with_effect = ("simulate", "-m", "cframe", *points, "--effect", "overshoot:axis=X,size=40", "-o", "data.csv")
    assert with_plugin(*with_effect).returncode == 2
    done = with_plugin(*with_effect, "--plugin", "overshoot")
    assert done.returncode == 0, done.stderr
    fit = ("fit", "data.csv", "-m", "cframe", "--effect", "overshoot:axis=X,size=0", "-o", "cal.json")
    done = with_plugin(*fit, "--plugin=overshoot")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "cal.json").read_text())["provenance"]["inputs"]["plug-in overshoot"] == (
        "ncomp-overshoot 1.0"
    )
    refused = with_plugin("machines", "--plugin", "overshot")
    assert refused.returncode == 2
    assert "(installed: overshoot)" in refused.stderr
    (tmp_path / "ncomp_overshoot.py").write_text("import nothing_of_this_name\n")
    refused = with_plugin(*fit, "--plugin", "overshoot")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "--plugin overshoot: ModuleNotFoundError: " in refused.stderr


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("EffectBase, Remedy", "Remedy", "plugin.py:14: NameError: name 'EffectBase' is not defined"),
        ("    WORKSHOP = ", "    REPAIR = ", "Overshoot has no WORKSHOP"),
        ('tag="overshoot"', 'tag="backlash"', "its kind 'backlash' is that of another effect"),
        ("def columns(", "def columns((", "plugin.py:34: SyntaxError: "),
    ],
)
def test_a_wrong_plugin_is_refused(right, wrong, said, with_plugin, tmp_path):
    assert right in EXAMPLES["overshoot.py"]
    (tmp_path / "plugin.py").write_text(EXAMPLES["overshoot.py"].replace(right, wrong))
    done = with_plugin("predict", "points.csv", "-m", "cframe", "-c", "none", "-o", "out.csv", "--plugin", "plugin.py")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_a_plugin_that_is_not_there_is_refused(with_plugin):
    for words in (("--plugin", "none.py"), ("--plugin=cal.json",), ("--plugin",)):
        done = with_plugin("machines", *words)
        assert done.returncode == 2
        assert "expected a Python file with the class of an effect" in done.stderr


def test_a_calibration_with_an_unknown_effect_asks_for_its_plugin(command):
    write_model(model_of(load("gantry"), Backlash("X", 10.0)), Path("cal.json"))
    Path("cal.json").write_text(Path("cal.json").read_text().replace('"backlash"', '"overshoot"'))
    refused = command("export", "-m", "gantry", "-c", "cal.json", "--format", "csv", "-o", "tables")
    assert refused.status == 2
    assert "name its file with --plugin FILE.py" in refused.err


def test_a_plugin_that_comes_too_late_is_refused(command):
    Path("overshoot.py").write_text(EXAMPLES["overshoot.py"])
    refused = command("machines", "--plugin", "overshoot.py")
    assert refused.status == 2
    assert "the effects are loaded already" in refused.err


def test_an_instrument_is_one_file(command, module, monkeypatch):
    """It is simulated, written, read, fitted and diagnosed like the others."""
    monkeypatch.setitem(KINDS, "autocollimator", module("autocollimator.py").Autocollimator)
    axes = ("--strategy", "axes", "--spacing", "100", "--range", "Y=200", "--range", "Z=200", "--runs", "2")
    virtual = ("--instrument", "autocollimator", "-u", "u_yaw_urad=0.5", "--seed", "3")
    done = command("simulate", "-m", "cframe", *axes, *virtual, "-o", "yaw.csv", "--truth", "truth.json")
    assert done.status == 0, done.err
    assert "yaw_urad" in Path("yaw.csv").read_text()
    done = command("fit", "yaw.csv", "-m", "cframe", "--basis", "targets:7", "-o", "cal.json")
    assert done.status == 0, done.err
    assert b"sees yaw only" in done.out
    machine = load("cframe")
    truth, found = (read_model(Path(name), machine) for name in ("truth.json", "cal.json"))
    assert {motion.component for motion, _ in found.error_motions} == {"C"}
    nodes = next(motion.basis.nodes for motion, _ in found.error_motions if motion.axis == "X")
    q = np.tile([axis.home for axis in machine.axes], (7, 1)) * machine.scale
    q[:, machine.index("X")] = nodes
    away = [
        model.errors(machine, State(q, approach=np.zeros_like(q)))[:, machine.index("X"), 5] for model in (truth, found)
    ]
    assert np.std(away[0]) > 2e-6
    assert np.std(away[1] - away[0]) < 1e-6
    done = command("diagnose", "yaw.csv", "-m", "cframe", "-o", "new.json")
    assert done.status == 0, done.err


def test_a_format_of_a_control_is_one_file(command, module, monkeypatch):
    monkeypatch.setitem(FORMATS, "pairs", module("pairs.py").FORMAT)
    motion = ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 2), (0.0, 30.0, 50.0))
    write_model(model_of(load("gantry"), motion), Path("cal.json"))
    done = command("export", "-m", "gantry", "-c", "cal.json", "--format", "pairs", "-o", "tables")
    assert done.status == 0, done.err
    position, error = np.loadtxt("tables/X.txt").T
    expected = motion.basis.columns(position) @ motion.parameters
    assert error == pytest.approx(expected, abs=0.05)
    assert "actual minus nominal" in Path("tables/sheet.md").read_text()
    done = command("import", "tables", "-m", "gantry", "--format", "pairs", "-o", "in_control.json")
    assert done.status == 0, done.err
    (read,) = read_model(Path("in_control.json"), load("gantry")).effects
    assert read.basis.columns(position) @ read.parameters == pytest.approx(error, abs=1e-9)


def test_a_reader_is_one_file(command, module, monkeypatch):
    reader = module("dial_gauge.py")
    monkeypatch.setitem(FOREIGN, "dial-gauge", Reader(reader.recognises, reader.to_table))
    Path("dial.txt").write_text("DIAL X\n0; 0\n100; 2.5\n200; 5\n300; 7.4\n400; 10.1\n")
    done = command("iso230", "dial.txt", "-m", "gantry", "--header", "u_um=0.5", "--json", "-")
    assert done.status == 0, done.err
    assert "10.1" in json.dumps(json.loads(done.out))
    Path("dial.txt").write_text("DIAL X\n0; 0\n100 2.5\n")
    refused = command("iso230", "dial.txt", "-m", "gantry", "--header", "u_um=0.5")
    assert refused.status == 2
    assert "dial.txt:3" in refused.err


@pytest.mark.parametrize(
    ("code", "before", "after"),
    [
        ("G131", "G131 is not known to ncomp", ""),
        ("G199", "G199 is not known to ncomp", "in.nc:2: 'G199': G199 clamps the workpiece"),
    ],
)
def test_a_code_is_one_row(code, before, after, tmp_path):
    """The lines of the example, behind those of the module that lists the codes."""
    (tmp_path / "in.nc").write_text(f"G21 G90 G54\n{code}\nG1 X10. Y20. Z30. F100\nM30\n")
    words = ("in.nc", "-m", "gantry", "-c", "none", "--set-up-zero", "-o", "out.nc")
    refused = run_apart(tmp_path, *words)
    assert refused.returncode == 2
    assert before in refused.stderr
    done = run_apart(
        tmp_path, *words, first=f"from postproc.iso import codes; exec({EXAMPLES['codes.py']!r}, vars(codes))"
    )
    assert done.returncode == (2 if after else 0), done.stderr
    assert after in done.stderr
    assert not after or not (tmp_path / "out.nc").exists()
    assert after or (tmp_path / "out.nc").read_text().count(code) == 1
