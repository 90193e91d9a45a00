"""Faults that change nothing a user can see, each with its reason."""

from __future__ import annotations

NO_TILTS = "the step of tilts, which this format does not have"
ARGUED: dict[tuple[str, str, str, str], str] = {
    (
        "kinematics/inverse.py",
        "_branches",
        "_angle_about(lines[1], p, lines[0]) + np.stack([opening, -opening])",
        "_angle_about(lines[1], p, lines[0]) - np.stack([opening, -opening])",
    ): "the two branches exchange their numbers; the solutions are the same",
    ("kinematics/inverse.py", "closed_form", "1e-06", "9.999999999999999e-06"): (
        "axes nearer to parallel than that go through the search, which ends at the same positions"
    ),
    ("kinematics/inverse.py", "", "100.0", "1000.0"): (
        "the weight between orientation and position in a search whose end is the same pose for each weight"
    ),
    ("postproc/motion/segments.py", "_of_whole_moves", "begin + end", "begin - end"): (
        "only whether the sum is finite is asked"
    ),
    (
        "postproc/control_data/tables/build.py",
        "_Writer._equidistant_on_both",
        "len(part.positions[0]) // 2 + 1",
        "len(part.positions[0]) // 2 - 1",
    ): "how fine the grid of a table may be at most; the sheet states the error of the table that is written",
    ("postproc/control_data/formats/fanuc_kinematics.py", "", "1e-09", "1e-08"): NO_TILTS,
    ("postproc/control_data/formats/linuxcnc_kinematics.py", "", "1e-09", "1e-08"): NO_TILTS,
}
"""Reason by file, function, code before and code after."""
