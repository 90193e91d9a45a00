"""Lines of ISO programs of every form, many of them refused."""

from hypothesis import strategies as st

blanks = st.text(" \t", max_size=2)
numbers = st.from_regex(r"[+-]?[ \t]?([0-9]{1,6}(\.[0-9]{0,6})?|\.[0-9]{1,6})", fullmatch=True)
addresses = st.sampled_from("GMXYZABCUVWIJKRFSTHDNOPQLExyzgmfijkr")
words = st.builds("".join, st.tuples(addresses, blanks, numbers))
inner = st.text("abcXYZ 0123.;-+é/*%#=[]_\t", max_size=12)
comments = st.one_of(
    st.just(""),
    inner.map(lambda text: f"({text})"),
    st.text("(abcXYZ) 012;.", max_size=12).map(lambda text: f";{text}"),
)
skips = st.sampled_from(["", "", "", "/", "/1", "/9 "])
line_ends = st.sampled_from(["\n", "\r\n", "", "\r", "\r\r\n"])
heads = st.sampled_from(["", "", "", "", "%", "\0\0%", "#1=5", "F#2", "X[1+2]", "IF[#1EQ2]GOTO3", "o100 sub"])


@st.composite
def blocks(draw):
    parts = draw(st.lists(st.one_of(words, words, words, comments.filter(lambda c: ";" not in c)), max_size=8))
    separated = "".join(part + draw(blanks) for part in parts)
    return draw(skips) + draw(blanks) + draw(heads) + separated + draw(comments) + draw(line_ends)
