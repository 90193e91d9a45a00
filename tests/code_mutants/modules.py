"""The modules that decide signs and positions, and the quick tests that may notice a fault in them."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULES: dict[str, tuple[str, ...]] = {
    "kinematics": (
        "kinematics/forward.py", "kinematics/transforms.py", "kinematics/turn.py", "kinematics/inverse.py",
        "kinematics/deviation.py", "kinematics/derive.py", "kinematics/error_transform.py", "kinematics/basis.py",
        "kinematics/second_differences.py", "kinematics/touch_off.py", "kinematics/correction.py",
    ),
    "compensation, datum": ("postproc/compensation/*.py", "postproc/control_data/work_offsets.py"),
    "backlash": (
        "postproc/correct/backlash/*.py", "kinematics/error_model/play.py", "postproc/motion/reversals.py",
    ),
    "writers of words": ("postproc/write/*.py", "postproc/text/number_style.py"),
    "tables": (
        "postproc/control_data/formats/*.py", "postproc/control_data/formats/firmware/*.py",
        "postproc/control_data/readers/*.py", "postproc/control_data/readers/firmware/*.py",
        "postproc/control_data/tables/*.py", "postproc/control_data/parameters/*.py",
    ),
    "tool tables, height maps": ("postproc/control_data/tool_tables/*.py", "postproc/control_data/height_maps/*.py"),
    "words and units of programs": (
        "postproc/control/arcs.py", "postproc/control/plain_arcs.py", "postproc/control/tilted_planes.py",
        "postproc/control/words.py", "postproc/motion/arcs.py", "postproc/motion/circles.py",
        "postproc/motion/circle_columns.py", "postproc/motion/frames.py", "postproc/motion/rotary_words.py",
        "postproc/motion/axis_words.py", "postproc/motion/segments.py",
    ),
    "tool point programs": ("postproc/correct/tcp/*.py", "postproc/correct/rotary/*.py"),
    "readers of measurements": (
        "calibration/measurement/readers/*.py", "calibration/measurement/states.py",
        "calibration/measurement/written_file.py", "kinematics/files/text_cells.py", "calibration/instruments/*.py",
        "calibration/instruments/lengths/geometry.py", "calibration/instruments/ranging/*.py",
    ),
}  # fmt: skip
"""Patterns of the paths of modules, by what they decide."""
TESTS = (
    "transforms turn forward_thesis inverse conventions basis second_differences error_transform compensate datum "
    "outside significance conditions pipeline location_errors run_zeros predict predict_arrays "
    "reported_corrections simulate circles_of_arcs direction direction_klartext play block_numbers writer numbers hand_texts "
    "hand_positions cycles klartext_arcs klartext_polar klartext_planes siemens_circles siemens_moves siemens "
    "rotary_feed rotary_words plain_lines height_maps tcp tool_vectors turns_of_arcs turned_frames iso heidenhain "
    "frames three_dialects set_up tables_golden units_of_controls tables_siemens export tables_nodes tables_waves "
    "tables tables_applied tables_consumers kinematic_parameters kinematic_parameters_in_shops table_units "
    "tool_tables phone_tables mesh_moves readers readers_ballbar readers_ecmc readers_epics readers_twincat "
    "measurement_file target_readings level touch_probe ballbar lengths ranging robot logs drift iso_coordinates six_degrees iso230"
)
"""Names of test modules, with blanks between them."""


def files(area: str) -> list[str]:
    """The modules of an area, by their paths below the repository."""
    found = {path for pattern in MODULES[area] for path in ROOT.glob(pattern)}
    return sorted(path.relative_to(ROOT).as_posix() for path in found)


def modules_of_tests() -> list[str]:
    """The test modules, by their paths below the repository."""
    return [f"tests/test_{name}.py" for name in TESTS.split() if (ROOT / f"tests/test_{name}.py").is_file()]
