"""Run by the Python of `.nc_gcode`: a program in each line of the input, its rows in the line of the output (`nc_gcode.py`)."""

import json
import sys

from nc_gcode_interpreter import nc_to_dataframe


def main():
    """Answer until the input ends."""
    for line in sys.stdin:
        try:
            frame, _ = nc_to_dataframe(json.loads(line), disable_forward_fill=True)
            answer = [{name: value for name, value in row.items() if value is not None} for row in frame.to_dicts()]
        except Exception as error:
            answer = f"{type(error).__name__}: {error}"
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
