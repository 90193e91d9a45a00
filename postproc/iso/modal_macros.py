"""Modal macro calls of ISO programs: behind which blocks the macro of G66 runs."""

from __future__ import annotations

from postproc.iso.codes import LENGTH_CODES, PLACING, STANDING
from postproc.iso.words import Content


def calls_macro(content: Content, claimed: float | None, inside: str, stayed: bool) -> bool:
    """Whether the macro runs behind a block; Refusal where that depends on the control.

    `claimed`: the code that takes the coordinates of the block; `inside`: what else is on; `stayed`: its move has no
    length.
    """
    if claimed in STANDING or claimed in PLACING:
        return False
    if claimed is not None:
        raise content.refuse(f"G{claimed:g} while G66 is on: whether its macro runs behind it depends on the control")
    if not content.moves:
        if LENGTH_CODES.isdisjoint(content.g):
            return False
        raise content.refuse("a length without coordinates while G66 is on: whether its macro runs behind it depends")
    if inside:
        raise content.refuse(f"{inside} while G66 is on: what comes first is not documented")
    if stayed:
        raise content.refuse(
            "says the place where the tool stands while G66 is on: whether its macro runs behind it is not documented"
        )
    return True
