"""Programs with the tool axis as a vector, by the command: the figures of the run are those of `verify`."""

import json
from pathlib import Path

import pytest
from support.command import succeed
from support.programs import load, random_model

from kinematics.error_model.model import write_model

PROGRAMS = {
    "v.mpf": "G17 G90 G71 G94\nT1 M6 D1\nG54\nG0 X0 Y0 Z100 {0}=0 C=0\nTRAORI\n"
    "G0 X45.123 Y-3.221 Z40. A3=0.2137 B3=0.0123 C3=0.9768\n"
    "G1 X45.101 Y-3.101 Z5.321 A3=0.2141 B3=0.0131 C3=0.9767 F1000\nX44.998 Y-2.845 A3=0.2 B3=0.1 C3=0.97\nM30\n",
    "v.h": "BEGIN PGM V MM\nTOOL CALL 1 Z S1000\nL X+0 Y+0 Z+100 {0}+0 C+0 R0 FMAX\nM128\n"
    "LN X+45.123 Y-3.221 Z+40 TX+0.2137 TY+0.0123 TZ+0.9768 FMAX\n"
    "LN X+45.101 Y-3.101 Z+5.321 TX+0.2141 TY+0.0131 TZ+0.9767 F1000\n"
    "LN X+44.998 Y-2.845 Z+5.2 TX+0.2 TY+0.1 TZ+0.97 F1000\nM129\nEND PGM V MM\n",
}


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize(("machine", "tilt"), [("dmu50", "B"), ("trunnion_ac", "A"), ("head_table", "B")])
def test_the_figures_of_a_run_count_with_the_turned_axes(name, machine, tilt, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(PROGRAMS[name].format(tilt))
    write_model(random_model(load(machine), 3, 30.0), Path("cal.json"))
    options = ["--machine", machine, "--calibration", "cal.json", "--set-up-zero", "--no-travel-check"]
    accepted = ["--accept", "outside,insignificant", "-o", "out", "--json", "run.json"]
    succeed("correct", name, *options, *accepted)
    found = json.loads(Path("run.json").read_text())
    before, after = found["predicted_error_um"]["before"], found["predicted_error_um"]["after"]
    assert before["max"] > 5.0
    assert after["max"] < 0.5
    axis = found["predicted_tool_axis_error_urad"]
    assert axis["after"]["max"] == pytest.approx(axis["before"]["max"], rel=0.01)
