"""Files of a control as texts, and the errors that they correct as an error model."""

from __future__ import annotations

import codecs
import datetime
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from kinematics.effects import Effect
from kinematics.error_model.joined import joined
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import Provenance, reference
from kinematics.files import fingerprint, read_input
from kinematics.files.mistaken import kind_of_file
from kinematics.machine import Machine
from kinematics.user_error import UserError


def texts_in(paths: Iterable[Path]) -> tuple[dict[str, str], dict[str, str]]:
    """Texts and fingerprints by file name; for a folder, of all its files except sheets (.md)."""
    files = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    texts, prints = {}, {}
    for file in files:
        if file.suffix == ".md" or file.is_dir():
            continue
        data = read_input(file, "tables")
        if file.name in texts:
            raise UserError(f"{file}: two files have this name; give them different names")
        texts[file.name] = decoded(data, f"tables {file}")
        prints[file.name] = fingerprint(data)
    return texts, prints


def decoded(data: bytes, name: str) -> str:
    """The text of a file with or without a byte order mark; UserError for a binary file."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    if b"\0" in data:
        if data[1::2].count(0) > len(data) // 3:
            raise UserError(f"{name}: this is UTF-16 without a byte order mark: save it as plain text (UTF-8)")
        found = kind_of_file(data) or "a file with zero bytes"
        raise UserError(f"{name}: expected a text file, found {found}: give the files of the control")
    return data.removeprefix(codecs.BOM_UTF8).decode("latin-1")


def imported_model(
    machine: Machine,
    effects: Sequence[Effect],
    base: ErrorModel | None,
    sign: float,
    title: str,
    prints: dict[str, str],
) -> ErrorModel:
    """The errors of the files as a model, or `sign` times these errors joined to the model `base`."""
    if base is None:
        made = Provenance("ncomp import", datetime.datetime.now(datetime.UTC), title, prints)
        return ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))
    model = joined(base, effects, sign)
    source = f"{base.provenance.source}; {'with' if sign > 0 else 'less'} {title}".removeprefix("; ")
    made = msgspec.structs.replace(base.provenance, source=source, inputs=base.provenance.inputs | prints)
    return msgspec.structs.replace(model, provenance=made)
