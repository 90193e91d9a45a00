"""Plain lists of targets and readings: what calipers, a digital scale or a dial gauge show."""

from pathlib import Path

import numpy as np
import pytest

import ncomp

LIST = "# axis: X\n# u_um: 30\ntarget_mm,reading_mm\n0,0.02\n100,100.05\n200,200.11\n100,100.01\n0,-0.03\n100,100.06\n"


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def read(text, *header, columns=None):
    Path("list.txt").write_text(text)
    return ncomp.read_measurement("list.txt", "gantry", header=header, columns=columns)


def test_a_list_is_a_measurement_of_one_axis():
    m = read(LIST)
    assert (1e3 * m.observed[:, 0]).tolist() == pytest.approx([20.0, 50.0, 110.0, 10.0, -30.0, 60.0])
    assert m.state.approach[:, 0].tolist() == [1, 1, 1, -1, -1, 1]
    assert m.run.tolist() == ["1", "1", "1", "1", "1", "2"]
    assert set(m.axis.tolist()) == {"X"}
    assert m.instrument.u_um == 30.0


@pytest.mark.parametrize("change", [lambda t: t.replace(".", ",").replace(",0\n", ",0\n"), lambda t: t])
def test_semicolons_with_decimal_commas_or_points(change):
    head, rows = LIST.split("reading_mm\n")
    other = head.replace("target_mm,", "target_mm;") + "reading_mm\n" + change(rows.replace(",", ";"))
    assert np.array_equal(read(other).observed, read(LIST).observed)


def test_units_in_brackets_as_spreadsheets_write_them():
    text = LIST.replace("target_mm,reading_mm", "Target[mm]\tReading [mm]").replace(",", "\t")
    assert np.array_equal(read(text).observed, read(LIST).observed)


def test_columns_of_another_name_by_a_map():
    """Inches, and the axis in the map."""
    Path("map.toml").write_text(
        'delimiter = "tab"\ndecimal = "."\n[columns]\ntarget_mm = "Soll"\nreading_mm = "Ist"\n[units]\nlinear = "inch"\n'
        '[header]\naxis = "Y"\nu_um = 30\n'
    )
    m = read("Soll\tIst\n0\t0\n10\t10.001\n", columns="map.toml")
    assert m.state.positions[:, 1].tolist() == pytest.approx([0.0, 254.0])
    assert m.observed[:, 0].tolist() == pytest.approx([0.0, 0.0254])


BAD = {
    "no axis": (LIST.replace("# axis: X\n", ""), "list.txt: the axis is missing: state header="),
    "no number": (
        LIST.replace("100.05", "100.05 mm"),
        "list.txt:5 column reading_mm: '100.05 mm' is no number; write the",
    ),
    "no uncertainty": (
        LIST.replace("# u_um: 30\n", ""),
        "the standard uncertainty (k=1) of the interferometer is missing",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_a_list_lacks_is_said(case):
    with pytest.raises(ncomp.UserError) as caught:
        read(BAD[case][0])
    assert BAD[case][1] in str(caught.value)
