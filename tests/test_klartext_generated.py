"""Generated Klartext: every block keeps its text and its words their places; a program comes back, or is refused."""

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st
from support.klartext_programs import correct, read
from support.programs import load, random_model
from support.tiers import drawn

from kinematics.user_error import UserError
from postproc.heidenhain.blocks import parse_block, read_block
from postproc.text.block import Edit, edited

NAMES = ["Q1", "QL3", "Q200"]
numbers = st.integers(-3000, 3000).map(lambda n: n / 10)


@st.composite
def value(draw):
    number, style = draw(numbers), draw(st.sampled_from(["{:+g}", "{:+.3f}", "{:g}", " {:+g}", "{:+.2f},"]))
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from("+-")) + draw(st.sampled_from(NAMES))
    if style.endswith(","):
        return style[:-1].format(number).replace(".", ",")
    return style.format(number)


def words(addresses, least=1):
    chosen = st.lists(st.sampled_from(addresses), min_size=least, max_size=3, unique_by=lambda a: a.strip("I"))
    return chosen.flatmap(lambda names: st.tuples(*(value().map(lambda v, n=n: n + v) for n in names)).map(" ".join))


AXES, POLAR = ["X", "Y", "Z", "IX", "IY", "IZ"], ["PR", "PA", "IPA", "IPR"]
tails = st.sampled_from(["", " F500", " FMAX", " R0 F AUTO", " M8", " ; X+5 DR+", " R0 FQ1 M3", "\t"])
senses = st.sampled_from([" DR+", " DR-"])
OTHERS = [
    "Q1 = 5 * ( 2 + 1 )", "FN 0: QL3 =+2,5", "M128", "M129", "PLANE SPATIAL SPA+0 SPB+0 SPC+0 STAY", "PLANE RESET STAY",
    "CYCL DEF 7.0 DATUM", "CYCL DEF 7.1 X+5 Z-1", "CYCL DEF 10.1 ROT+30", "CYCL DEF 200 D Q200=2 Q203=+0 Q204=+9", "RND R2",
    "CYCL CALL M8", "CYCL CALL POS X+5 Y+7 Z+0", "TOOL CALL 3 Z S100 DL+0,1", "CC", "L", "STOP M0", "* - structure", "; ~ x",
    "BLK FORM 0.1 Z X+0 Y+0 Z-5", "APPR LCT X+1 Y+2 R5 RL", "DEP LCT X+0 Y+0 R5", "DEP LT LEN5", "LBL 7", "CALL LBL 7 REP 2/2",
    "FN 18: SYSREAD Q1 = ID50 NR2", "L X+1 FMAX M91", "M140 MB MAX", "FUNCTION TCPM F TCP AXIS POS", "/L X+5", "LN X1 NX0 NZ1",
]  # fmt: skip
bodies = st.one_of(
    st.tuples(words(AXES), tails).map(lambda t: f"L {t[0]}{t[1]}"),
    st.tuples(words(["X", "Y", "IX", "IY"], 2)).map(lambda t: f"CC {t[0]}"),
    st.tuples(words(POLAR), tails).map(lambda t: f"LP {t[0]}{t[1]}"),
    st.tuples(words(["PA", "IPA", "IZ", "Z"]), senses, tails).map("CP {0[0]}{0[1]}{0[2]}".format),
    st.tuples(words(AXES, 2), senses, tails).map("C {0[0]}{0[1]}{0[2]}".format),
    st.tuples(words(["X", "Y"], 2), value(), senses).map("CR {0[0]} R{0[1]}{0[2]}".format),
    words(["X", "Y", "IX"], 2).map("CT {}".format),
    st.sampled_from(OTHERS),
)
lines = st.tuples(st.sampled_from(["", "12 ", "0007  "]), bodies, st.sampled_from(["\n", "\r\n"])).map("".join)
sizes = st.integers(2, 60)
GEOMETRY = [
    "CC IX+{0} IY+0\nC IX+{0} IY+{0} DR-", "CC IX+{0} IY-{1}\nC IX+0 IY+0 DR+ F200", "CR IX+{0} IY+{0} R+{0} DR-", "CC IX-{0} IY+3",
    "L IX+{0} IY+3\nCT IX+5 IY-{1}", "LP PR+{0} PA-{1}", "LP IPR+{0} F500", "LP IPA+{1} IZ-1,5", "CP IPA-{0}7 IZ+{1} DR-", "CP PA+{1}1 DR+",
    "L IX+{0} RL F200\nL IY-{1}\nL IX+5 R0", "L X-{0} Y+{1}", "L X+{0},25 Z+{1}", "L Z+Q1 F{0}", "L IX-QL3",
]  # fmt: skip
whole = st.tuples(st.sampled_from(GEOMETRY), sizes, sizes).map(lambda t: t[0].format(*t[1:]) + "\n")
steps = st.one_of(whole, whole, whole, lines)


@settings(max_examples=150)
@given(lines)
def test_words_stand_where_they_say(text):
    block = read_block(1, text)
    assert block.text == text
    assert block == parse_block(1, text)
    spans = sorted((word.at, word.end) for word in block.words)
    assert all(end <= start for (_, end), (start, _) in itertools.pairwise(spans))
    same = [Edit(word.start, word.end, text[word.start : word.end]) for word in block.words]
    assert edited(text, same) == text


@drawn(few=20, many=60, body=st.lists(steps, max_size=8))
def test_a_program_comes_back_or_is_refused(body):
    """And its correction is read again, as the same moves."""
    text = (
        "BEGIN PGM T MM\nQ1 = 3\nFN 0: QL3 =+7\nQ200 = 2\nL X+0 Y+0 Z+50 FMAX\nCC X+9 Y+9\n"
        + "".join(body)
        + "END PGM T MM\n"
    )
    try:
        assert correct(text) == text
    except UserError:
        return
    try:
        written = correct(text, model=random_model(load("gantry"), 2, size=20.0))
    except UserError:
        return
    nominal, commanded = read(text), read(written)
    assert (commanded.kind[~commanded.added] == nominal.kind).all()
    assert abs(commanded.target[~commanded.intermediate] - nominal.target).max(initial=0.0) < 0.5
