"""Random programs, examined by readers and machines that share no code with ncomp.

    python -m tests.fuzz EXAMINER --programs 20000 --seed 1 --jobs 2

An examiner is a module of this package with two functions, `draw(seed) -> Case` and `judge(case) -> Outcome`. What it
finds is shrunk and written to `found/EXAMINER/`, from where `tests/test_fuzz.py` replays it.
"""

EXAMINERS: tuple[str, ...] = (
    "linuxcnc",
    "linuxcnc_files",
    "play",
    "drives",
    "mutated_programs",
    "mutated_files",
    "verified",
    "contours",
    "cycles",
    "fanuc",
    "klartext",
    "siemens",
    "simulator",
)
"""Modules of this package that examine."""
