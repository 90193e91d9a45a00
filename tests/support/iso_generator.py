"""A generator of ISO programs with variables, loops, subprograms, arcs, offsets and cycles."""

from hypothesis import strategies as st

HEAD = "G21 G90 G54 G17 G98 G94 F500\n#1=1 #2=2.5 #<depth>=4\nG0 X0. Y0. Z50.\n"
values = st.integers(-30, 30).map(lambda tenths: f"{tenths / 10}")
names = st.sampled_from(["#1", "#2", "#<depth>"])
formulas = st.recursive(
    st.one_of(names, values.map(lambda text: f"[{text}]")),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"[{t[0]} {t[1]} {t[2]}]"),
        st.tuples(st.sampled_from(["SIN", "COS", "ABS"]), inner).map(lambda t: f"{t[0]}[{t[1]}]"),
    ),
    max_leaves=3,
)
words = st.one_of(values, formulas)
OUTSIDE = 2
"""Level of statements that stand in no other."""


@st.composite
def lines(draw, level: int, used: list[int]):
    """A few statements; `used` holds the numbers of O-words given so far."""
    kinds = ["line", "line", "rapid", "assign", "arc", "increment", "shift", "cycle", "preset", "turned", "holes"]
    kinds += ["while", "repeat", "if"] if level else []
    kinds += ["call"] if level == OUTSIDE else []  # LinuxCNC takes no subprogram that a loop defines twice
    return "".join([draw(statement(kind, level, used)) for kind in draw(st.lists(st.sampled_from(kinds), max_size=5))])


def number(used: list[int]) -> int:
    used.append(len(used) + 100)
    return used[-1]


@st.composite
def statement(draw, kind: str, level: int, used: list[int]):
    inner = lines(level - 1, used)
    n = number(used)
    match kind:
        case "line" | "rapid":
            axes = draw(st.lists(st.sampled_from("XYZ"), unique=True, min_size=1))
            return f"G{int(kind == 'line')} " + " ".join(f"{axis}{draw(words)}" for axis in sorted(axes)) + "\n"
        case "assign":
            return f"{draw(names)}={draw(formulas)}\n"
        case "arc":
            sense, i = draw(st.sampled_from("23")), draw(st.integers(1, 9))
            return f"G1 X{draw(words)} Y{draw(words)}\nG91 G{sense} X{2 * i}. Y0. I{i}.\nG90\n"
        case "increment":
            return f"G91 G1 X{draw(words)} Z{draw(values)}\nG90\n"
        case "shift":
            return f"G52 X{draw(values)}\nG1 X{draw(words)} Y1. Z1.\nG52 X0.\nG1 X0. Y0. Z9.\n"
        case "preset":
            return f"G92 X{draw(values)} Y{draw(words)}\nG1 X{draw(words)} Z1.\nG92.1\nG1 X0. Y0. Z9.\n"
        case "turned":
            angle, plane = draw(st.integers(-180, 180)), draw(st.sampled_from(["", "G52 X2.\n"]))
            body = (
                f"G55\n{plane}G1 X{draw(words)} Y{draw(words)} Z1.\nG91 G3 X4. Y0. I2.\nG90\nG1 X1. Y{draw(values)}\n"
            )
            return f"G10 L2 P2 X{draw(values)} R{angle}\n{body}G52 X0.\nG54 G1 X0. Y0. Z9.\n"
        case "holes":
            first, second, normal = draw(st.sampled_from(["XYZ", "ZXY", "YZX"]))
            plane = {"Z": "G17", "Y": "G18", "X": "G19"}[normal]
            drilled = f"{plane} G81 {first}{draw(words)} {second}2. {normal}-{draw(st.integers(1, 9))}. R20. L2\n"
            return f"G0 {normal}40.\n{drilled}{second}3.\nG80 G17\nG1 {normal}9.\n"
        case "cycle":
            return f"G0 Z40.\nG81 X{draw(words)} Y{draw(words)} Z-{draw(st.integers(1, 9))}. R20.\nG80\nG1 Z30.\n"
        case "while":
            passes = draw(st.integers(0, 3))
            return f"#{n}=0\no{n} while [#{n} lt {passes}]\n{draw(inner)}#{n}=[#{n}+1]\no{n} endwhile\n"
        case "repeat":
            return f"o{n} repeat [{draw(st.integers(0, 2))}]\n{draw(inner)}o{n} endrepeat\n"
        case "if":
            return f"o{n} if [#1 gt {draw(values)}05]\n{draw(inner)}o{n} else\n{draw(inner)}o{n} endif\n"
        case _:
            return f"o{n} sub\nG1 X#1 Y[#2*2]\no{n} endsub\no{n} call [{draw(values)}] [{draw(values)}]\n"
