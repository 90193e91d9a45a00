"""Renews the tables of docs/evidence.md: digits in which ncomp agrees with references of others, and the
recorded runs of the referees (`python -m tests.fuzz EXAMINER --record`).

python docs/make/evidence.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from support.evidence.page import PAGE, renewed

if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text()))
