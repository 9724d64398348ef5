"""The parts of the README beside flight code that depend on the run."""

from __future__ import annotations

from occontrol.files.export.flight.content import Content
from occontrol.files.export.flight.manifest import sizes


def example(content: Content) -> str:
    """The first lines of a program that uses a `content`."""
    lines = ["uint8_t in_use[OCC_SENSORS];"]
    if content.plan.filter is None:
        lines += ["uint32_t k;", "if ((occ_check() == OCC_OK) && (occ_interval(t, &k) == OCC_OK)) {"]
        lines += ["    occ_in_use(k, in_use);        /* 1 for every sensor to use at t */", "}"]
    else:
        lines += ["occ_value z[OCC_VALUES], v[OCC_STATES];", "occ_filter f;"]
        lines += ["if ((occ_check() != OCC_OK) || (occ_init(&f) != OCC_OK)) { /* do not start */ }"]
        lines += ["while (occ_next(&f, in_use) == OCC_OK) {"]
        lines += ["    /* read the sensors in use, their values one after the other into z; NaN: missing */"]
        lines += ["    if (occ_step(&f, z, NULL) != OCC_OK) { /* f is as it was */ }"]
        now = "occ_time(f.k)" if content.plan.again is None else "occ_time_after(&f, 0U)"
        lines += [f"    occ_variance(&f, v);          /* f.x is the estimate at {now} */", "}"]
    return "\n".join(f"    {line}" for line in lines)


def sizes_in_words(content: Content) -> str:
    """How large a `content` is, and what it does where values are missing."""
    plan, found = content.plan, sizes(content)
    lines = [f"{plan.intervals} intervals, {len(plan.names)} sensors. Tables: {found['tables']['total']} bytes"]
    if plan.filter is None:
        return lines[0] + f". No filter: {plan.why}."
    lines[0] += f"; a filter: {found['filter']} bytes; its working arrays: {found['stack_of_working_arrays']}."
    flags = content.flags
    if plan.again is not None:
        lines.append(
            f"A cycle repeated for ever: interval {plan.again} follows the last one, `round` counts the cycles.\n"
            "Times count from the start of the first cycle; those of later ones are as exact as a double holds them."
        )
    if content.replayed < plan.intervals:
        lines.append(f"The self-test runs over the first {content.replayed} intervals.")
    if "nonlinear" in flags:
        lines.append(
            "An extended Kalman filter: the formulas are linearised at the estimate in every step, covariances are\n"
            "factors L diag(d) L'. Elementary functions are written out, so that every processor finds the same bits."
        )
    elif {"full", "plan"} <= flags:
        lines.append(
            "While every value arrives, gains and variances are those of the plan; from the first missing value on\n"
            "they are computed, as factors L diag(d) L' of the covariance."
        )
    elif "full" in flags:
        lines.append("Gains and variances are computed at every step, as factors L diag(d) L' of the covariance.")
    else:
        lines.append(
            "Gains only: a missing value moves nothing, and from then on `planned` is 0: the estimate is no longer\n"
            "the best one, and the variances, still those of the plan, are too small."
        )
    return "\n\n".join(lines)
