"""Chains of any axes."""

import numpy as np
from hypothesis import strategies as st

from kinematics.machine import ISO_DIRECTION

entry = st.integers(-3, 3) | st.integers(-30, 30).map(lambda i: i / 10) | st.floats(-1, 1, allow_subnormal=False)
vector = st.tuples(entry, entry, entry)


@st.composite
def chains(draw: st.DrawFn) -> str:
    """A machine's TOML: any axes in any order on either side, any directions and points."""
    names = draw(st.lists(st.sampled_from([*ISO_DIRECTION, "X2", "B2"]), min_size=1, max_size=5, unique=True))
    bed = draw(st.integers(0, len(names)))
    lines = ['name = "random"', f'chain = "{" ".join(["w", *names[:bed], "b", *names[bed:], "t"])}"']
    for name in names:
        direction = draw(vector.filter(lambda v: np.linalg.norm(v) > 0.05))
        point = [100 * v for v in draw(vector)]
        lines.append(f"axes.{name} = {{ travel = [-200, 150], direction = {list(direction)}, point = {point} }}")
    return "\n".join(lines)
