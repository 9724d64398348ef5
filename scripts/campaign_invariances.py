"""What must not change a whole solve, on many random problems of every family, far regimes included.

    python -m scripts.campaign_invariances [count] [first seed] [family ..]

The invariances stand in tests/invariances.py (athans) and tests/invariances_others.py; the regimes of athans are those
of scripts/campaign_enumeration.py. Printed: whatever does not hold, and how often each invariance held and did not.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from scripts.campaign_enumeration import FAR, MODES, far_data
from tests.invariances import UNIT, athans
from tests.invariances_others import OTHERS


def of_athans(seed: int) -> dict[str, str | None]:
    """The invariances of one problem of athans, in the regime and mode of its seed."""
    rng, regime, mode = np.random.default_rng(seed), FAR[seed % len(FAR)], MODES[seed // len(FAR) % len(MODES)]
    data, origin = far_data(rng, regime, mode == "one step")
    found = athans(rng, data, origin, mode, UNIT if regime == "short" else 1 / UNIT)
    return {name: wrong and f"{regime}, {mode}: {wrong}" for name, wrong in found.items()}


def main() -> None:
    """Run the campaign and print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    families = sys.argv[3:] or ["athans", *OTHERS]
    for family in families:
        row = Counter()
        for seed in range(first, first + count):
            found = of_athans(seed) if family == "athans" else OTHERS[family](np.random.default_rng(seed))
            for name, wrong in found.items():
                row[f"{name} {'holds' if wrong is None else 'FAILS'}"] += 1
                if wrong is not None:
                    print(family, seed, name, wrong, flush=True)
            if (seed + 1 - first) % 10 == 0:
                print(family, seed + 1 - first, "problems", dict(row), flush=True)
        print(family, "all", dict(row), flush=True)


if __name__ == "__main__":
    main()
