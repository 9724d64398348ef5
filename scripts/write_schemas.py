"""Write the JSON Schemas that the package ships for editors: families/*/schema.json, and families/schema.json for all.

    .venv/bin/python scripts/write_schemas.py
"""

from __future__ import annotations

from occontrol.api import json_schema
from occontrol.families import names, shipped_schema
from occontrol.files.schema.json_schema import text


def main() -> None:
    """Write the schema of every family, and that of all together, into the package."""
    for name in [*names(), None]:
        shipped_schema(name).write_text(text(json_schema(name)), encoding="utf-8")
        print(shipped_schema(name))


if __name__ == "__main__":
    main()
