/*?plan*/
/* x as above; every value of the interval has arrived */
static occ_status occ_planned_step(occ_filter *f, uint32_t values, const occ_value e[OCC_VALUES],
                                   occ_value x[OCC_STATES])
{
    const uint32_t k = f->k;
    const occ_value *const K = occ_gain[occ_gain_row[k]];
    const occ_value *const pivot = occ_innovation_pivot[occ_innovation_row[k]];
    const occ_value *const lower = occ_innovation_lower[occ_innovation_row[k]];
    occ_value white[OCC_VALUES];
    occ_value nis = OCC_ZERO;
    uint32_t i;
    uint32_t r;

    for (i = 0U; i < values; i++) {
        white[i] = e[i];
        for (r = 0U; r < i; r++) {
            white[i] -= lower[((i * (i - 1U)) / 2U) + r] * white[r];
        }
        if (!(pivot[i] > OCC_ZERO)) {
            return OCC_SINGULAR;
        }
        nis += (white[i] * white[i]) / pivot[i];
        for (r = 0U; r < OCC_STATES; r++) {
            x[r] += K[(i * OCC_STATES) + r] * e[i];
        }
    }
    if (occ_all_finite(x) == 0U) {
        return OCC_OVERFLOW;
    }
    f->nis = nis;
    return OCC_OK;
}

/*.*/
occ_status occ_step(occ_filter *f, const occ_value z[OCC_VALUES], const uint8_t valid[OCC_VALUES])
{
/*?linear*/
/*?full*/
    occ_value e[OCC_ROWS];
/*.*/
/*?!full*/
    occ_value e[OCC_VALUES];
/*.*/
    occ_value x[OCC_STATES];
    const occ_value *F;
    const occ_value *H;
    occ_status status;
/*.*/
    uint32_t kept[OCC_VALUES];
    uint32_t count = 0U;
    uint32_t values;
/*?!full*/
    uint32_t c;
/*.*/
    uint32_t r;

    if (f == NULL) {
        return OCC_NULL_POINTER;
    }
    if (f->k >= OCC_INTERVALS) {
/*?endless*/
        return OCC_OUTSIDE;
/*.*/
/*?!endless*/
        return OCC_END;
/*.*/
    }
    values = occ_values[f->k];
    for (r = 0U; r < OCC_VALUES; r++) {
        kept[r] = 0U;
/*?linear*/
        e[r] = OCC_ZERO;
/*.*/
    }
    if ((z == NULL) && (values > 0U)) {
        return OCC_NULL_POINTER;
    }
    for (r = 0U; r < values; r++) {
        if (((valid == NULL) || (valid[r] != 0U)) && (occ_is_nan(z[r]) == 0U)) {
            if (occ_is_finite(z[r]) == 0U) {
                return OCC_BAD_SAMPLE;
            }
            kept[count] = r;
            count++;
        }
    }
/*?nonlinear*/
    return occ_formula_step(f, z, kept, count, values);
}

/*.*/
/*?linear*/
    F = occ_transition[occ_transition_row[f->k]];
    H = occ_observe[occ_observe_row[f->k]];
    /* e = z - (H x + d) of what is kept, x = F x + g */
    for (r = 0U; r < count; r++) {
        e[r] = z[kept[r]] - occ_affine(occ_offset[occ_offset_row[f->k]][kept[r]], &H[kept[r]], OCC_VALUES, f->x);
    }
    for (r = 0U; r < OCC_STATES; r++) {
        x[r] = occ_affine(occ_input[occ_input_row[f->k]][r], &F[r], OCC_STATES, f->x);
    }
/*?plan full*/
    if ((f->planned != 0U) && (count == values)) {
        status = occ_planned_step(f, values, e, x);
    } else {
        status = occ_full_step(f, kept, count, e, x);
    }
/*.*/
/*?plan !full*/
    if (count == values) {
        status = occ_planned_step(f, values, e, x);
    } else {
        /* the planned gain moves x by what has arrived; the variances of the plan do not hold from here on */
        const occ_value *const K = occ_gain[occ_gain_row[f->k]];
        for (c = 0U; c < count; c++) {
            for (r = 0U; r < OCC_STATES; r++) {
                x[r] += K[(kept[c] * OCC_STATES) + r] * e[c];
            }
        }
        status = (occ_all_finite(x) != 0U) ? OCC_OK : OCC_OVERFLOW;
        if (status == OCC_OK) {
            f->planned = 0U;
            f->nis = OCC_ZERO;
            count = 0U;
        }
    }
/*.*/
/*?!plan*/
    status = occ_full_step(f, kept, count, e, x);
/*.*/
    if (status == OCC_OK) {
        for (r = 0U; r < OCC_STATES; r++) {
            f->x[r] = x[r];
        }
        f->dimension = count;
        f->k++;
/*?endless*/
        if (f->k >= OCC_INTERVALS) {
            f->k = OCC_AGAIN; /* the cycle begins again */
            f->round++;
        }
/*.*/
    }
    return status;
}

/*.*/
