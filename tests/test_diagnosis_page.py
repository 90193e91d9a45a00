"""Words and tables of the report of a diagnosis."""

from calibration.diagnosis.conclusion.design import Designed
from calibration.reports.causes.text import in_full, quantity_name, with_uncertainty
from calibration.reports.separability import separability_section
from kinematics.effects import Cyclic, TrackerDrift


def test_a_cell_lists_a_family_in_short():
    each = [Designed("cross-axis", f"E_X{i}", "visible", 0.5, 0.0, (), "") for i in range(5)]
    (row,) = separability_section(each).table.rows
    assert row == ("cross-axis", "all 5", "", "")
    (row,) = separability_section([*each, each[0]._replace(verdict="not visible")]).table.rows
    assert row == ("cross-axis", "E_X0, E_X1, E_X2, 2 more", "", "E_X0")
    one = Designed("tracker-drift", "tracker-drift", "tied", 0.5, 0.0, (("thermal-drift Y", 0.91),), "")
    two = [
        Designed("thermal-drift", f"thermal-drift {c}", "tied", 0.5, 0.0, (("tracker-drift", cosine),), "")
        for c, cosine in (("X", 0.93), ("Y", 0.98))
    ]
    rows = separability_section([one, *two]).table.rows
    assert rows[0] == ("tracker-drift", "", "yes: thermal-drift (0.91)", "")
    assert rows[1] == ("thermal-drift", "", "X, Y: tracker-drift (0.98)", "")


def test_causes_are_named_in_full_among_others():
    assert [in_full(name) for name in ("E_XY(X)", "E_XY", "E_C0Y", "backlash X")] == [
        "cross-axis E_XY(X)", "E_XY", "E_C0Y", "backlash X",
    ]  # fmt: skip
    assert [quantity_name(q) for q in Cyclic("X", "X", 10.0, (1.0, 2.0), (0.0, 0.0)).parameter_table[:3]] == [
        "period", "sine 1", "sine 2",
    ]  # fmt: skip
    assert [quantity_name(q) for q in TrackerDrift().parameter_table[2:4]] == ["shift z", "turn x"]
    assert with_uncertainty(-0.03212, 0.365) == "-0.03 ± 0.73"
    assert with_uncertainty(20.0, 0.0) == "20"
    assert with_uncertainty(1834.2, 115.0) == "1834 ± 230"
