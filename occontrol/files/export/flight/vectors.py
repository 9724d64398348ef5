"""What the self-test replays: samples along the plan, and the sum over everything that the filter says at every step.

Three patterns, because each alone is blind: with every value the planned gains are used and the plant's noise is never
read; with a value lost it is the other way round.
"""

from __future__ import annotations

import random
import zlib

import numpy as np

from occontrol.files.export.c_text import c_string
from occontrol.files.export.flight.content import Content
from occontrol.files.export.flight.reference import ReferenceFilter, Status
from occontrol.files.export.flight.tables import Table

PATTERNS = ("every value", "the first value lost", "one value in five lost")
LOST = 0.2


def reference_of(content: Content) -> ReferenceFilter:
    """The reference of the filter of a `content`, of either kind."""
    if content.plan.formulas is None:
        return ReferenceFilter(content)
    from occontrol.files.export.flight.reference_formulas import FormulaReference

    return FormulaReference(content)


def samples(content: Content, reference: ReferenceFilter | None = None) -> np.ndarray:
    """Values (R, m) that a consistent filter might see over the intervals of a replay, along its path.

    Parameters
    ----------
    content : Content with a filter
    reference : its reference, where there is one already
    """
    generator = random.Random(content.plan.intervals)  # the same numbers everywhere and always
    reference, N = reference or reference_of(content), content.replayed
    z = np.zeros((N, content.values), dtype=reference.type)
    for k in range(N):
        h, spread = reference.foreseen()
        for i, (value, deviation) in enumerate(zip(h, spread, strict=True)):
            z[k, i] = float(f"{float(value + 1.7 * (2 * generator.random() - 1) * deviation):.9g}")
        if reference.step(z[k]) != Status.OK:  # nothing to be seen there: stand still
            z[k] = np.nan
            reference.step(z[k])
    return z


def losses(content: Content) -> np.ndarray:
    """(3, R, m) whether each value arrives, for each of PATTERNS.

    Parameters
    ----------
    content : Content with a filter
    """
    generator = random.Random(content.values)
    there = np.ones((len(PATTERNS), content.replayed, content.values), dtype="u1")
    first = np.flatnonzero(content.table("values")[: content.replayed])
    if len(first):
        there[1, first[0], 0] = 0
    for k in range(content.replayed):
        for i in range(content.values):
            there[2, k, i] = generator.random() >= LOST
    return there


def said(reference: ReferenceFilter, status: Status) -> int:
    """The sum over everything that the filter says, as the self-test makes it, after a step with `status`.

    Parameters
    ----------
    reference : ReferenceFilter
    status : of the step
    """
    parts = [reference.x, np.atleast_1d(reference.nis), reference.variance()]
    if reference.full:
        parts.append(reference.covariance().ravel())
    if "predict" in reference.content.flags and reference.k % reference.content.predicted_every == 0:
        prediction = reference.predict()
        if prediction is None:
            return 0
        parts += list(prediction)
    numbers = np.concatenate(parts).astype(reference.type.newbyteorder("<"))
    word = int(status) + 16 * reference.dimension + 8192 * bool(reference.planned)
    return zlib.crc32(numbers.tobytes() + word.to_bytes(8, "little"))


def expected(
    content: Content, z: np.ndarray, there: np.ndarray, reference: ReferenceFilter | None = None
) -> np.ndarray:
    """(3, R+1) the sum before the first step and after each.

    Parameters
    ----------
    content : Content with a filter
    z : (R, m) samples
    there : (3, R, m) whether they arrive
    reference : its reference, where there is one already
    """
    reference = reference or reference_of(content)
    sums = np.zeros((len(there), len(z) + 1), dtype="u4")
    for p, pattern in enumerate(there):
        reference.init()
        sums[p, 0] = said(reference, Status.OK)
        for k in range(len(z)):
            status = reference.step(z[k], pattern[k])
            sums[p, k + 1] = said(reference, status)
    return sums


def vectors(content: Content) -> str:
    """host/vectors.h of a `content` with a filter."""
    reference = reference_of(content)
    z, there = samples(content, reference), losses(content)
    n, outputs = content.table("mean").shape[1], content.plan.filter.outputs if content.plan.filter else 0
    size = 2 * n + 1 + (n * n if "full" in content.flags else 0) + 2 * outputs
    lines = ["#ifndef OCC_VECTORS_H", "#define OCC_VECTORS_H", "", f"#define OCC_SAID {size}U"]
    lines += [f"#define OCC_PATTERNS {len(PATTERNS)}U", f"#define OCC_REPLAYED {content.replayed}U"]
    lines += [f"#define OCC_PREDICTED_EVERY {content.predicted_every}U"] if outputs else []
    lines += [f"typedef {'uint64_t' if content.options.precision == 'double' else 'uint32_t'} occ_word;", ""]
    spoken = ", ".join(map(c_string, PATTERNS))
    lines += [f"static const char *const occ_patterns[OCC_PATTERNS] = {{{spoken}}};"]
    lost = np.any(np.isnan(z), axis=1)
    z, there = np.where(lost[:, None], 0, z), np.where(lost[None, :, None], 0, there).astype("u1")
    sums = expected(content, z, there, reference)
    lines += [f"static {Table('samples', z.astype(content.options.dtype)).definition()}"]
    lines += [f"static {_nested('valid', there)}", f"static {Table('expected', sums).definition()}"]
    return "\n".join([*lines, "#endif", ""])


def _nested(name: str, values: np.ndarray) -> str:
    """A definition in three dimensions."""
    bodies = [Table(name, each).definition().split(" = ", 1)[1].rstrip(";\n") for each in values]
    sizes = "".join(f"[{size}]" for size in values.shape)
    return f"const uint8_t occ_{name}{sizes} = {{\n" + ",\n".join(bodies) + "};\n"
