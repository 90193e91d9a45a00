"""The packages in a bill of materials (CycloneDX JSON of `make sbom`), with versions and licences, as a table.

python docs/make/licences.py out/ncomp.cdx.json
"""

import json
import sys
from pathlib import Path


def licence_of(component: dict) -> str:
    """The licence as its package states it."""
    found = [
        each.get("expression") or each["license"].get("id") or each["license"].get("name", "")
        for each in component.get("licenses", ())
    ]
    return "; ".join(dict.fromkeys(text.splitlines()[0][:60] for text in found if text)) or "not stated"


if __name__ == "__main__":
    content = json.loads(Path(sys.argv[1]).read_text())
    for component in sorted(content["components"], key=lambda each: each["name"].lower()):
        print(f"{component['name']:24} {component.get('version', ''):14} {licence_of(component)}")
