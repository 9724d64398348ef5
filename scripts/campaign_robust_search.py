#!/usr/bin/env python3
"""The search of the robust family against every sequence, on many random problems.

    scripts/campaign_robust_search.py --count 300 --seed 1

The tests do the same on twenty. Ends with an AssertionError that names the first problem on which the search misses
the optimum or its bound lies above it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.families.robust.random_tables import compare_with_enumeration


def main() -> None:
    """Run the campaign and print what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    worse = compare_with_enumeration(options.count, options.seed)
    print(f"{options.count} problems: the search found every optimum; choosing step by step was worse on {worse}")


if __name__ == "__main__":
    main()
