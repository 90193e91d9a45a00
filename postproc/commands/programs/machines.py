"""`ncomp machines`: the shipped machines, or one machine file."""

from __future__ import annotations

import ncomp
from postproc.commands.options.declared import argument

EPILOG = "Examples:\n\n`ncomp machines`\n\n`ncomp machines dmu50`\n\n`ncomp machines my_mill.toml`"


def machines(
    name: str | None = argument("Name of a machine, or path of its .toml file.", "NAME", default=None),
) -> None:
    """List the shipped machines, or show one machine and check its file."""
    import machines as shipped
    from postproc.commands.show.terminal import output, show_machine

    if name is None:
        for each in shipped.names():
            machine = shipped.load(each)
            output.print(f"{each:<12} {machine.chain:<24} {machine.description}")
        return
    machine = ncomp.load_machine(name)
    path = shipped.default_calibration(machine)
    show_machine(machine, "none of its own" if path is None else path.name)
