"""Machine files as texts: linear axes with equal travels, and rotary axes through the origin that turn without end."""


def machine_text(chain="w b X Y Z t", more="", travel=(-500, 500), name="mill"):
    """A machine file; travel: ends of all linear axes, mm; more: its entries after the axes."""
    low, high = travel
    axes = [axis for axis in chain.split() if axis not in ("w", "b", "t")]
    entries = (
        f"[axes.{axis}]\npoint = [0, 0, 0]\ntravel = [-inf, inf]\n"
        if axis[0] in "ABC"
        else f"[axes.{axis}]\ntravel = [{low}, {high}]\n"
        for axis in axes
    )
    return f'name = "{name}"\nchain = "{chain}"\n{"".join(entries)}{more}'
