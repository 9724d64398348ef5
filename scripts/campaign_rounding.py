"""Cost, bound and allowance of random problems in far regimes against enumeration in 60 digits.

The judge is tests/decimal_recursion.py, which shares no code with the product. Run from the project's folder:

    python -m scripts.campaign_rounding [count] [seed]

Counts bounds above the true optimum and costs that are off by more than the allowance, by regime.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from decimal import Decimal

import numpy as np

from occontrol.core.errors import OccontrolError
from tests.decimal_problems import as_problem, proven
from tests.decimal_recursion import REGIMES, Judge, random_data


def main() -> None:
    """Run the campaign and print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    table = defaultdict(lambda: defaultdict(float))
    for i in range(count):
        regime = REGIMES[i % len(REGIMES)]
        row, data = table[regime], random_data(rng, regime)
        try:
            weights, proof = proven(as_problem(data))
        except OccontrolError as error:
            row["refused"] += 1
            print(i, regime, str(error).splitlines()[0])
            continue
        judge = Judge(data)
        best, true = judge.optimum()[0], judge.cost(weights)
        J, bound = proof.certificate.cost, proof.certificate.lower_bound
        off, above = float(abs(true - Decimal(J))), float(Decimal(bound) - best)
        row["problems"] += 1
        row["not optimal"] += float(true - best) > 1e-9 * float(best)
        row["allowance exceeds 1e-4"] += proof.allowance > 1e-4 * abs(J)
        row["cost off"] += off > proof.allowance
        row["bound above"] += above > 0
        row["worst error"] = max(row["worst error"], off / abs(J))
        row["worst error/allowance"] = max(row["worst error/allowance"], off / proof.allowance)
        row["worst bound/allowance"] = max(row["worst bound/allowance"], above / proof.allowance)
        row["worst difference"] = max(row["worst difference"], proof.difference / abs(J))
        if off > proof.allowance or above > 0:
            print(i, regime, f"J {J:.17g} off {off:.3g} above {above:.3g} allowance {proof.allowance:.3g}", flush=True)
    for regime, row in table.items():
        print(regime, {name: float(f"{value:.3g}") for name, value in row.items()})


if __name__ == "__main__":
    main()
