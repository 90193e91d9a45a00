"""Errors that remain after the tables of each format, for the demonstration calibration of the DMU 50: the table of
docs/tables.md.

Run it with `python -m benchmarks.tables`; some minutes. Tool 100 mm, settings as by default, values as errors where no
source states the sign.
"""

from __future__ import annotations

import time

import machines
from kinematics.error_model.model import read_model
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import formats_of
from postproc.control_data.tables.export_tables import export
from postproc.control_data.tables.table_format import TableFormat

FORMATS = formats_of(TableFormat)

SETTINGS = {
    "fanuc": ["unit_um=0.1", "largest=127"],
    "mitsubishi": ["unit_um=0.1"],
    "grbl": ["steps=X:250,Y:250,Z:400"],
    "marlin": ["x=-250:250:21", "y=-225:225:19"],
}


def main() -> None:
    """Print the table, row by row."""
    machine = machines.load("dmu50")
    path = machines.default_calibration(machine)
    assert path is not None
    model = read_model(path, machine)
    print("| format | tables | tool point RMS, um | max, um | with corrected programs, max | s |")
    print("|---|---|---|---|---|---|")
    for form in FORMATS.values():
        start = time.perf_counter()
        settings = parse_settings(form.settings, SETTINGS.get(form.name, []))
        exported = export(machine, model, form, settings, form.sign or "error", (0.0, 0.0, -100.0))
        took = time.perf_counter() - start
        point = exported.errors_in_the_volume()["tool_point_um"]
        if form is next(iter(FORMATS.values())):
            print(f"| none | | {point['before']['rms']:.1f} | {point['before']['max']:.1f} | | |")
        left = point.get("after_tables_and_datum_shift", point["after_tables"])
        both = point["after_tables_and_nc_correction_of_the_rest"]
        count = len(exported.content.terms) + len(exported.content.motions)
        numbers = f"{left['rms']:.2f} | {left['max']:.2f} | {both['max']:.3f} | {took:.0f}"
        print(f"| {form.name} | {count} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
