"""LinuxCNC: the INI file and the COMP_FILEs it names."""

from __future__ import annotations

from kinematics.effects import Effect
from kinematics.user_error import UserError
from postproc.tables.readers.source import Source, increasing, numbers, read_ini, refusal

MOST = 256


def read(source: Source) -> list[Effect]:
    """The table of every joint; lines that LinuxCNC would ignore without a message are refused."""
    found: list[Effect] = []
    ini_file = source.only(".ini", "LinuxCNC", "the assignment of the tables to joints")
    ini = read_ini(ini_file, source.files[ini_file], comment_prefixes=("#", ";"))
    joints = list(source.setting("joints", "")) or source.lettered
    for section in ini.sections():
        file = ini.get(section, "COMP_FILE", fallback="")
        if not section.startswith("JOINT_") or not file:
            continue
        joint = section.removeprefix("JOINT_")
        if joint not in map(str, range(len(joints))):
            raise UserError(f"{ini_file}: [{section}] is not one of the joints {' '.join(joints)}")
        name = file.rsplit("/", 1)[-1]
        if name not in source.files:
            raise UserError(f"{ini_file}: [{section}] names {file}, which is not among the files")
        kind = ini.get(section, "COMP_FILE_TYPE", fallback="0").strip()
        if kind not in ("0", "1"):
            raise UserError(f"{ini_file}: [{section}] COMP_FILE_TYPE {kind}: expected 0 or 1")
        rows = _rows(name, source.files[name])
        if kind == "0":
            rows = [[nominal, nominal - up, nominal - down] for nominal, up, down in rows]
        source.machine.index(joints[int(joint)])
        found += source.own(joints[int(joint)], rows)
    return found


def _rows(name: str, text: str) -> list[list[float]]:
    found: list[tuple[int, list[float]]] = []
    lines = text.rstrip().splitlines()
    for line, row in enumerate(lines, 1):
        words = row.split()
        if len(words) < 3:
            raise refusal(name, line, row, "expected three numbers: LinuxCNC stops reading at this line")
        found.append((line, numbers(words[:3], name, line, row)))
    if len(found) > MOST:
        raise refusal(name, MOST + 1, lines[MOST], f"LinuxCNC reads at most {MOST} rows")
    if not found:
        raise UserError(f"{name}: the file has no rows")
    increasing(found, name)
    return [row for _, row in found]
