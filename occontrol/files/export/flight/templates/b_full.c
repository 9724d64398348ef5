/*?full*/
/* the factor of the covariance: of the plan as long as it holds */
static void occ_factor(const occ_filter *f, const occ_value **pivot, const occ_value **lower)
{
/*?plan*/
    if (f->planned != 0U) {
        *pivot = occ_root_pivot[occ_root_row[f->k]];
        *lower = occ_root_lower[occ_root_row[f->k]];
        return;
    }
/*.*/
    *pivot = f->pivot;
    *lower = f->lower;
}

/* a holds one row for every value that is kept, then one for every state, and beyond columns[] of a row zeros; weight
 * the variances of the columns. x is what the state becomes without the values, e their innovations. Every row is made
 * orthogonal to those before it: what is left of a row is a pivot, what was taken off the later ones a column of
 * gain or factor. Sums run over even and odd columns apart. */
static occ_status occ_sweep(occ_filter *f, occ_value a[OCC_ROWS][OCC_COLUMNS], const occ_value weight[OCC_COLUMNS],
                            const uint32_t columns[OCC_ROWS], uint32_t count, occ_value e[OCC_ROWS],
                            occ_value x[OCC_STATES])
{
    const uint32_t rows = count + OCC_STATES;
    const occ_value *before = a[0];
    occ_value scaled[OCC_COLUMNS];
    occ_value multiple[OCC_ROWS];
    occ_value pivot[OCC_STATES];
    occ_value lower[OCC_LOWER];
    occ_value nis = OCC_ZERO;
    uint32_t c;
    uint32_t i;
    uint32_t r;

    lower[0] = OCC_ZERO; /* where there is one state */
    for (r = 0U; r < rows; r++) {
        multiple[r] = OCC_ZERO;
    }
    for (r = 0U; r < OCC_STATES; r++) {
        pivot[r] = OCC_ZERO;
    }
    for (i = 0U; i < rows; i++) {
        occ_value *const own = a[i];
        occ_value even = OCC_ZERO;
        occ_value odd = OCC_ZERO;
        occ_value left;
        occ_value inverse;
        for (c = 0U; c < columns[i]; c += 2U) {
            own[c] -= multiple[i] * before[c];
            own[c + 1U] -= multiple[i] * before[c + 1U];
            scaled[c] = weight[c] * own[c];
            scaled[c + 1U] = weight[c + 1U] * own[c + 1U];
            even += scaled[c] * own[c];
            odd += scaled[c + 1U] * own[c + 1U];
        }
        left = even + odd;
        if (occ_is_finite(left) == 0U) {
            return OCC_OVERFLOW;
        }
        inverse = OCC_ZERO;
        if (left >= OCC_SMALLEST) {
            inverse = OCC_ONE / left;
        }
        if (i >= count) {
            pivot[i - count] = left;
        } else if (inverse > OCC_ZERO) {
            nis += (e[i] * e[i]) * inverse;
        } else {
            return OCC_SINGULAR;
        }
        for (r = i + 1U; r < rows; r++) {
            occ_value *const row = a[r];
            const occ_value last = multiple[r];
            even = OCC_ZERO;
            odd = OCC_ZERO;
            for (c = 0U; c < columns[i]; c += 2U) {
                const occ_value one = row[c] - (last * before[c]);
                const occ_value two = row[c + 1U] - (last * before[c + 1U]);
                row[c] = one;
                row[c + 1U] = two;
                even += scaled[c] * one;
                odd += scaled[c + 1U] * two;
            }
            multiple[r] = (even + odd) * inverse;
            if (i >= count) {
                const uint32_t j = r - count;
                lower[((j * (j - 1U)) / 2U) + (i - count)] = multiple[r];
            } else if (r < count) {
                e[r] -= multiple[r] * e[i];
            } else {
                x[r - count] += multiple[r] * e[i];
            }
        }
        before = own;
    }
    if (occ_all_finite(x) == 0U) {
        return OCC_OVERFLOW;
    }
    for (i = 0U; i < OCC_STATES; i++) {
        f->pivot[i] = pivot[i];
    }
    for (i = 0U; i < OCC_LOWER; i++) {
        f->lower[i] = lower[i];
    }
    f->planned = 0U;
    f->nis = nis;
    return OCC_OK;
}

/* the first OCC_STATES entries of a row of a: m L, where m is a row of a matrix whose columns are `apart` */
static void occ_times_factor(occ_value row[OCC_COLUMNS], const occ_value *m, uint32_t apart, const occ_value *lower)
{
    uint32_t c;
    uint32_t i;

    for (c = 0U; c < OCC_STATES; c++) {
        occ_value sum = m[c * apart];
        for (i = c + 1U; i < OCC_STATES; i++) {
            sum += m[i * apart] * lower[((i * (i - 1U)) / 2U) + c];
        }
        row[c] = sum;
    }
    for (c = OCC_STATES; c < OCC_COLUMNS; c++) {
        row[c] = OCC_ZERO;
    }
}

/*.*/
/*?full linear*/
/* x holds F x + g on entry and x+ on return; e the innovations of the `count` values that are kept */
static occ_status occ_full_step(occ_filter *f, const uint32_t kept[OCC_VALUES], uint32_t count,
                                occ_value e[OCC_ROWS], occ_value x[OCC_STATES])
{
    const uint32_t k = f->k;
    const uint32_t values = occ_values[k];
    const occ_value *const F = occ_transition[occ_transition_row[k]];
    const occ_value *const H = occ_observe[occ_observe_row[k]];
    const occ_value *const noise = occ_noise_lower[occ_noise_row[k]];
    const occ_value *pivot;
    const occ_value *lower;
    occ_value a[OCC_ROWS][OCC_COLUMNS];
    occ_value weight[OCC_COLUMNS];
    uint32_t columns[OCC_ROWS];
    uint32_t c;
    uint32_t r;

    occ_factor(f, &pivot, &lower);
    for (c = 0U; c < OCC_COLUMNS; c++) {
        weight[c] = OCC_ZERO;
    }
    for (c = 0U; c < OCC_STATES; c++) {
        weight[c] = pivot[c];
    }
    for (c = 0U; c < (values + OCC_STATES); c++) {
        weight[OCC_STATES + c] = occ_noise_pivot[occ_noise_row[k]][c];
    }
    /* [H; F] L, and beside it the noise: a unit lower triangle over all rows of the interval */
    for (r = 0U; r < (count + OCC_STATES); r++) {
        const uint32_t place = (r < count) ? kept[r] : (values + (r - count)); /* among all rows of the interval */
        if (r < count) {
            occ_times_factor(a[r], &H[place], OCC_VALUES, lower);
        } else {
            occ_times_factor(a[r], &F[r - count], OCC_STATES, lower);
        }
        for (c = 0U; c < place; c++) {
            a[r][OCC_STATES + c] = noise[((place * (place - 1U)) / 2U) + c];
        }
        a[r][OCC_STATES + place] = OCC_ONE;
        columns[r] = OCC_STATES + place + 1U; /* beyond, the row is zero */
    }
    return occ_sweep(f, a, weight, columns, count, e, x);
}

/*.*/
