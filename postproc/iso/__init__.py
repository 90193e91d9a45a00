"""ISO programs of FANUC, LinuxCNC and their kin."""
