"""Spheres in LinuxCNC's simulator: a machine with location errors that closes the probe's contact at a sphere."""

import json
from pathlib import Path

import numpy as np
from clients.linuxcnc_sim import Config

SPHERE = Path(__file__).parents[1] / "clients" / "sim" / "sphere.py"
LETTERS = "XYZABC"


def chain_of(machine, effects):
    """The axes with their location errors as constant rigid motions, mm and rad, without ncomp's kinematics."""
    chain = []
    for axis in machine.axes:
        six = np.zeros(6)
        for effect in effects:
            if effect.axis == axis.name and axis.rotary:
                size = 1e-3 if effect.component in "XYZ" else 1e-6
                six["XYZABC".index(effect.component)] += effect.value * size
        frame = axis.error_frame
        chain.append(
            {
                "rotary": bool(axis.rotary),
                "side": axis.side,
                "direction": axis.unit_direction.tolist(),
                "point": list(map(float, axis.point)),
                "shift": (frame @ six[:3]).tolist(),
                "turn": (frame @ six[3:]).tolist(),
            }
        )
    return chain


def config_of(machine, effects, spheres, tip, log, *, tip_radius=3.0, radius=12.5):
    """A simulator whose probe touches spheres, centres in mm; its joints are the axes of the machine."""
    order = [machine.names.index(name) for name in LETTERS if name in machine.names]
    job = {
        "chain": chain_of(machine, effects),
        "tip": list(tip),
        "tip_radius": tip_radius,
        "spheres": [[list(map(float, centre)), radius] for centre in spheres],
    }
    hal = ["loadusr -W ./sphere.py", "net contact sphere.contact => motion.probe-input"]
    hal += [f"net motor-{joint} => sphere.q-{k}" for joint, k in enumerate(order)]
    return Config(
        "".join(machine.names[k] for k in order),
        hal=hal,
        files={"sphere.py": SPHERE.read_text(), "chain.json": json.dumps(job)},
        written=[log],
        velocity=1000.0,
        acceleration=50_000.0,
    )
