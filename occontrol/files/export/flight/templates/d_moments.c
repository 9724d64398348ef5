/*?full*/
/* entry (i, j) of L diag(pivot) L', j <= i */
static occ_value occ_entry(const occ_value *pivot, const occ_value *lower, uint32_t i, uint32_t j)
{
    occ_value sum = OCC_ZERO;
    uint32_t c;

    for (c = 0U; c <= j; c++) {
        const occ_value one = (c < i) ? lower[((i * (i - 1U)) / 2U) + c] : OCC_ONE;
        const occ_value other = (c < j) ? lower[((j * (j - 1U)) / 2U) + c] : OCC_ONE;
        sum += (one * pivot[c]) * other;
    }
    return sum;
}

occ_status occ_covariance(const occ_filter *f, occ_value p[OCC_STATES * OCC_STATES])
{
    const occ_value *pivot;
    const occ_value *lower;
    uint32_t i;
    uint32_t j;

    if ((f == NULL) || (p == NULL)) {
        return OCC_NULL_POINTER;
    }
    if (f->k > OCC_INTERVALS) {
        return OCC_OUTSIDE;
    }
    occ_factor(f, &pivot, &lower);
    for (i = 0U; i < OCC_STATES; i++) {
        for (j = 0U; j <= i; j++) {
            p[(i * OCC_STATES) + j] = occ_entry(pivot, lower, i, j);
            p[(j * OCC_STATES) + i] = p[(i * OCC_STATES) + j];
        }
    }
    return OCC_OK;
}

/*.*/
occ_status occ_variance(const occ_filter *f, occ_value v[OCC_STATES])
{
/*?full*/
    const occ_value *pivot;
    const occ_value *lower;
/*.*/
    uint32_t i;

    if ((f == NULL) || (v == NULL)) {
        return OCC_NULL_POINTER;
    }
    if (f->k > OCC_INTERVALS) {
        return OCC_OUTSIDE;
    }
/*?full*/
    occ_factor(f, &pivot, &lower);
    for (i = 0U; i < OCC_STATES; i++) {
        v[i] = occ_entry(pivot, lower, i, i);
    }
/*.*/
/*?!full*/
    for (i = 0U; i < OCC_STATES; i++) {
        v[i] = occ_planned_variance[occ_planned_variance_row[f->k]][i];
    }
/*.*/
    return OCC_OK;
}

/*?predict*/
occ_status occ_predict(const occ_filter *f, occ_value w[OCC_OUTPUTS], occ_value v[OCC_OUTPUTS])
{
    const occ_value *D;
/*?nonlinear*/
    occ_filter g;
    occ_status status = OCC_OK;
/*.*/
/*?full*/
    const occ_value *pivot;
    const occ_value *lower;
    uint32_t c;
/*.*/
    uint32_t r;

    if ((f == NULL) || (w == NULL) || (v == NULL)) {
        return OCC_NULL_POINTER;
    }
    if (f->k > OCC_INTERVALS) {
        return OCC_OUTSIDE;
    }
/*?nonlinear*/
    g = *f; /* moves on to the time of the prediction */
    for (c = f->k; (c < OCC_LAST) && (status == OCC_OK); c++) {
        status = occ_move(&g, c);
    }
    if (status != OCC_OK) {
        return status;
    }
/*.*/
    D = occ_predict_matrix[occ_predict_matrix_row[f->k]];
    for (r = 0U; r < OCC_OUTPUTS; r++) {
/*?nonlinear*/
        w[r] = occ_affine(occ_predict_offset[occ_predict_offset_row[f->k]][r], &D[r], OCC_OUTPUTS, g.x);
/*.*/
/*?linear*/
        w[r] = occ_affine(occ_predict_offset[occ_predict_offset_row[f->k]][r], &D[r], OCC_OUTPUTS, f->x);
/*.*/
        v[r] = occ_predict_variance[occ_predict_variance_row[f->k]][r];
    }
/*?full*/
    /* the noise until then + D L diag(.) L' D' */
/*?nonlinear*/
    occ_factor(&g, &pivot, &lower);
/*.*/
/*?linear*/
    occ_factor(f, &pivot, &lower);
/*.*/
    for (r = 0U; r < OCC_OUTPUTS; r++) {
        occ_value row[OCC_COLUMNS];
        occ_times_factor(row, &D[r], OCC_OUTPUTS, lower);
        for (c = 0U; c < OCC_STATES; c++) {
            v[r] += (row[c] * pivot[c]) * row[c];
        }
    }
/*.*/
    return OCC_OK;
}

/*.*/
