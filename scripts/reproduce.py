"""The figures and tables of the source papers, made anew: python scripts/reproduce.py oshman|liu_hwang|das [folder]."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

PAPERS = {"oshman": "figures/oshman.py", "liu_hwang": "figures/liu_hwang.py", "das": "figures/das.py"}


def main(words: list[str]) -> int:
    """Run the script of one paper; its pictures go to the folder, docs/figures if left out."""
    if not words or words[0] not in PAPERS or len(words) > 2:
        print(f"usage: reproduce.py {'|'.join(PAPERS)} [folder]", file=sys.stderr)
        return 2
    path = Path(__file__).parent / PAPERS[words[0]]
    spec = importlib.util.spec_from_file_location(words[0], path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[words[0]] = module
    spec.loader.exec_module(module)
    folder = Path(words[1]) if len(words) == 2 else Path(__file__).parents[1] / "docs" / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    return int(module.main(folder) or 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
