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

/* x holds F x + g on entry and x+ on return; e the innovations of the `count` values that are kept */
static occ_status occ_full_step(occ_filter *f, const uint32_t kept[OCC_VALUES], uint32_t count,
                                occ_value e[OCC_ROWS], occ_value x[OCC_STATES])
{
    const uint32_t k = f->k;
    const uint32_t values = occ_values[k];
    const uint32_t rows = count + OCC_STATES;
    const occ_value *const F = occ_transition[occ_transition_row[k]];
    const occ_value *const H = occ_observe[occ_observe_row[k]];
    const occ_value *const noise = occ_noise_lower[occ_noise_row[k]];
    const occ_value *pivot;
    const occ_value *lower;
    occ_value a[OCC_ROWS][OCC_COLUMNS];
    occ_value scaled[OCC_COLUMNS];
    occ_value weight[OCC_COLUMNS];
    occ_value sum[OCC_ROWS];
    occ_value new_pivot[OCC_STATES];
    occ_value new_lower[OCC_LOWER];
    occ_value nis = OCC_ZERO;
    uint32_t place[OCC_ROWS]; /* of each row among all rows of the interval */
    uint32_t c;
    uint32_t i;
    uint32_t r;

    occ_factor(f, &pivot, &lower);
    for (r = 0U; r < count; r++) {
        place[r] = kept[r];
    }
    for (r = 0U; r < OCC_STATES; r++) {
        place[count + r] = values + r;
    }
    /* [H; F] L */
    for (c = 0U; c < OCC_STATES; c++) {
        weight[c] = pivot[c];
        for (r = 0U; r < count; r++) {
            a[r][c] = H[(c * OCC_VALUES) + kept[r]];
        }
        for (r = 0U; r < OCC_STATES; r++) {
            a[count + r][c] = F[(c * OCC_STATES) + r];
        }
    }
    for (r = 0U; r < rows; r++) {
        for (i = 1U; i < OCC_STATES; i++) {
            const occ_value own = a[r][i]; /* as it was: later ones change only what is before them */
            const occ_value *const l = &lower[(i * (i - 1U)) / 2U];
            for (c = 0U; c < i; c++) {
                a[r][c] += own * l[c];
            }
        }
    }
    /* the noise: a unit lower triangle over all rows of the interval; what is above it is never read */
    for (c = 0U; c < (values + OCC_STATES); c++) {
        weight[OCC_STATES + c] = occ_noise_pivot[occ_noise_row[k]][c];
    }
    for (r = 0U; r < rows; r++) {
        for (c = 0U; c < place[r]; c++) {
            a[r][OCC_STATES + c] = noise[((place[r] * (place[r] - 1U)) / 2U) + c];
        }
        a[r][OCC_STATES + place[r]] = OCC_ONE;
    }
    for (i = 0U; i < OCC_STATES; i++) {
        new_pivot[i] = OCC_ZERO;
    }
    for (i = 0U; i < OCC_LOWER; i++) {
        new_lower[i] = OCC_ZERO;
    }
    for (i = 0U; i < rows; i++) {
        const uint32_t columns = OCC_STATES + place[i] + 1U; /* beyond, the row is zero */
        for (c = 0U; c < columns; c++) {
            scaled[c] = weight[c] * a[i][c];
        }
        for (r = i; r < rows; r++) {
            occ_value total = OCC_ZERO;
            for (c = 0U; c < columns; c++) {
                total += scaled[c] * a[r][c];
            }
            sum[r] = total;
        }
        if (occ_is_finite(sum[i]) == 0U) {
            return OCC_OVERFLOW;
        }
        if (i < count) {
            if (!(sum[i] > OCC_ZERO)) {
                return OCC_SINGULAR;
            }
            nis += (e[i] * e[i]) / sum[i];
        } else {
            new_pivot[i - count] = sum[i];
        }
        for (r = i + 1U; r < rows; r++) {
            const occ_value multiple = (sum[i] > OCC_ZERO) ? (sum[r] / sum[i]) : OCC_ZERO;
            for (c = 0U; c < columns; c++) {
                a[r][c] -= multiple * a[i][c];
            }
            sum[r] = multiple;
        }
        for (r = i + 1U; r < rows; r++) {
            if (i >= count) {
                const uint32_t j = r - count;
                new_lower[((j * (j - 1U)) / 2U) + (i - count)] = sum[r];
            } else if (r < count) {
                e[r] -= sum[r] * e[i];
            } else {
                x[r - count] += sum[r] * e[i];
            }
        }
    }
    for (i = 0U; i < OCC_STATES; i++) {
        if (occ_is_finite(x[i]) == 0U) {
            return OCC_OVERFLOW;
        }
    }
    for (i = 0U; i < OCC_STATES; i++) {
        f->pivot[i] = new_pivot[i];
    }
    for (i = 0U; i < OCC_LOWER; i++) {
        f->lower[i] = new_lower[i];
    }
    f->planned = 0U;
    f->nis = nis;
    return OCC_OK;
}

/*.*/
