"""Generated ISO programs with variables, loops, subprograms, arcs, offsets and cycles: read as LinuxCNC reads them."""

import numpy as np
from support.iso_generator import HEAD, OUTSIDE, lines
from support.programs import correct, load, read, shifted
from support.tiers import drawn

from postproc.motion.moves import Kind

SHIFT = [-0.003, 0.0042, -0.0055]


def places(motions):
    """Ends of all moves but cycles, in machine coordinates."""
    return motions.machine_target[~np.isin(motions.kind, (Kind.CYCLE, Kind.PRESET))]


def relative_deviations(linuxcnc, program, drilling):
    result = linuxcnc.run(program)
    assert result.exit_status == 0, f"line {result.line}: {result.message}\n{program}"
    return np.array([move.machine[:3] for move in result.moves if move.line not in drilling]).reshape(-1, 3)


@drawn(few=5, many=15, body=lines(OUTSIDE, []))
def test_linuxcnc_runs_the_same_moves(linuxcnc, body):
    """The program, and its correction for a constant error, which moves every end by just that."""
    machine, text = load("gantry"), HEAD + body + "M2\n"
    assert correct(text, machine, travel_check=False).text == text
    written = correct(text, machine, shifted(machine, X=3.0, Y=-4.2, Z=5.5), travel_check=False).text.partition("\n")[2]
    before, after = read(text, machine), read(written, machine)
    moved = after.machine_target - before.machine_target
    turned = np.array([frame.couples for frame in before.frames])[before.frame]
    np.testing.assert_allclose(moved[~turned], np.broadcast_to(SHIFT, moved[~turned].shape), atol=1e-9)
    np.testing.assert_allclose(moved, np.broadcast_to(SHIFT, moved.shape), atol=8e-5)
    drilling = {
        i for i, line in enumerate(text.split("\n"), start=1) if "R20." in line or line in ("Y3.", "X3.", "Z3.")
    }
    for program, motions in ((text, before), (written, after)):
        np.testing.assert_allclose(relative_deviations(linuxcnc, program, drilling), places(motions), atol=1e-6)
