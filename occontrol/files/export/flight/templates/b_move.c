/*?nonlinear*/
/* c = a b, (n, n) row by row */
static void occ_product(const occ_value a[OCC_SQUARE], const occ_value b[OCC_SQUARE], occ_value c[OCC_SQUARE])
{
    uint32_t i;
    uint32_t j;
    uint32_t r;

    for (i = 0U; i < OCC_STATES; i++) {
        for (j = 0U; j < OCC_STATES; j++) {
            occ_value sum = OCC_ZERO;
            for (r = 0U; r < OCC_STATES; r++) {
                sum += a[(i * OCC_STATES) + r] * b[(r * OCC_STATES) + j];
            }
            c[(i * OCC_STATES) + j] = sum;
        }
    }
}

/* q (size, size) row by row = L diag(d) L': L below its diagonal, d on it; what is left of a pivot by rounding is 0 */
static void occ_factorise(occ_value *q, uint32_t size)
{
    uint32_t i;
    uint32_t j;
    uint32_t c;

    for (i = 0U; i < size; i++) {
        for (j = 0U; j <= i; j++) {
            const occ_value whole = q[(i * size) + j];
            const occ_value pivot = q[(j * size) + j];
            occ_value left = whole;
            for (c = 0U; c < j; c++) {
                left -= (q[(i * size) + c] * q[(c * size) + c]) * q[(j * size) + c];
            }
            if (j == i) {
                q[(i * size) + j] = (left > (OCC_SPANNED * whole)) ? left : OCC_ZERO;
            } else {
                left = (pivot > OCC_ZERO) ? left : OCC_ZERO;
                q[(i * size) + j] = left / ((pivot > OCC_ZERO) ? pivot : OCC_ONE);
            }
        }
    }
}

/*.*/
/*?nonlinear continuous*/
/* x after one classical Runge-Kutta step of length h from t, and the derivative of that by x */
static void occ_single_step(occ_value x[OCC_STATES], occ_value slope[OCC_SQUARE], occ_value t, occ_value h)
{
    static const occ_value ahead[4] = {OCC_ZERO, OCC_HALF, OCC_HALF, OCC_ONE};
    static const occ_value shares[4] = {OCC_ONE, OCC_TWO, OCC_TWO, OCC_ONE};
    occ_value at[OCC_STATES];
    occ_value f[OCC_STATES];
    occ_value sum[OCC_STATES];
    occ_value inner[OCC_SQUARE];
    occ_value jacobian[OCC_SQUARE];
    occ_value change[OCC_SQUARE];
    uint32_t i;
    uint32_t stage;

    for (i = 0U; i < OCC_STATES; i++) {
        f[i] = OCC_ZERO;
        sum[i] = OCC_ZERO;
    }
    for (i = 0U; i < OCC_SQUARE; i++) {
        change[i] = OCC_ZERO;
        slope[i] = OCC_ZERO;
    }
    for (stage = 0U; stage < 4U; stage++) {
        const occ_value c = ahead[stage] * h;
        for (i = 0U; i < OCC_STATES; i++) {
            at[i] = x[i] + (c * f[i]);
        }
        for (i = 0U; i < OCC_SQUARE; i++) {
            inner[i] = c * change[i];
        }
        for (i = 0U; i < OCC_STATES; i++) {
            inner[i * (OCC_STATES + 1U)] += OCC_ONE;
        }
        occ_right(at, t + c, f, jacobian);
        occ_product(jacobian, inner, change);
        for (i = 0U; i < OCC_STATES; i++) {
            sum[i] += shares[stage] * f[i];
        }
        for (i = 0U; i < OCC_SQUARE; i++) {
            slope[i] += shares[stage] * change[i];
        }
    }
    for (i = 0U; i < OCC_STATES; i++) {
        x[i] += (h / OCC_SIX) * sum[i];
    }
    for (i = 0U; i < OCC_SQUARE; i++) {
        slope[i] *= h / OCC_SIX;
    }
    for (i = 0U; i < OCC_STATES; i++) {
        slope[i * (OCC_STATES + 1U)] += OCC_ONE;
    }
}

/*.*/
/*?nonlinear noise continuous*/
/* q + share times the noise at x and t */
static void occ_add_noise(occ_value q[OCC_SQUARE], const occ_value x[OCC_STATES], occ_value t, occ_value share)
{
    occ_value intensity[OCC_SQUARE];
    uint32_t i;

    occ_noise(x, t, intensity);
    for (i = 0U; i < OCC_SQUARE; i++) {
        q[i] += share * intensity[i];
    }
}

/* slope q slope' */
static void occ_carry(occ_value q[OCC_SQUARE], const occ_value slope[OCC_SQUARE])
{
    occ_value half[OCC_SQUARE];
    uint32_t i;
    uint32_t j;
    uint32_t r;

    occ_product(slope, q, half);
    for (i = 0U; i < OCC_STATES; i++) {
        for (j = 0U; j <= i; j++) {
            occ_value sum = OCC_ZERO;
            for (r = 0U; r < OCC_STATES; r++) {
                sum += half[(i * OCC_STATES) + r] * slope[(j * OCC_STATES) + r];
            }
            q[(i * OCC_STATES) + j] = sum;
            q[(j * OCC_STATES) + i] = sum;
        }
    }
}

/*.*/
/*?nonlinear*/
/* estimate and covariance over span k of time: [Phi L, noise] is made a triangle again */
static occ_status occ_move(occ_filter *f, uint32_t k)
{
    const double length = occ_lengths[k][0];
    occ_value moved[OCC_SQUARE];
    occ_value slope[OCC_SQUARE];
    occ_value half[OCC_SQUARE];
/*?noise*/
    occ_value q[OCC_SQUARE];
/*.*/
    occ_value a[OCC_ROWS][OCC_COLUMNS];
    occ_value weight[OCC_COLUMNS];
    occ_value e[OCC_ROWS];
    uint32_t columns[OCC_ROWS];
    uint32_t c;
    uint32_t r;
/*?continuous*/
    const double count = 2.0 * (double)OCC_SUBSTEPS;
    const double each = length / count;
    const occ_value h = (occ_value)each;
    double now = occ_since[k][0];
    double done = 0.0;
    uint32_t i;
/*.*/

    if (!(length > 0.0)) {
        return OCC_OK;
    }
    for (r = 0U; r < OCC_STATES; r++) {
        for (c = 0U; c < OCC_STATES; c++) {
            moved[(r * OCC_STATES) + c] = (c < r) ? f->lower[((r * (r - 1U)) / 2U) + c] : OCC_ZERO;
        }
        moved[r * (OCC_STATES + 1U)] = OCC_ONE;
    }
/*?continuous*/
/*?noise*/
    for (c = 0U; c < OCC_SQUARE; c++) {
        q[c] = OCC_ZERO;
    }
/*.*/
    for (i = 0U; i < (2U * OCC_SUBSTEPS); i++) {
        const occ_value t = (occ_value)now;
/*?noise*/
        /* by Simpson's rule: 1, 4, 2, .., 4, 1 */
        occ_add_noise(q, f->x, t, (((i % 2U) == 1U) ? OCC_FOUR : ((i == 0U) ? OCC_ONE : OCC_TWO)) * (h / OCC_THREE));
/*.*/
        occ_single_step(f->x, slope, t, h);
        done += 1.0;
        now = occ_since[k][0] + ((length * done) / count);
/*?noise*/
        occ_carry(q, slope);
/*.*/
        occ_product(slope, moved, half);
        for (c = 0U; c < OCC_SQUARE; c++) {
            moved[c] = half[c];
        }
    }
/*?noise*/
    occ_add_noise(q, f->x, (occ_value)now, h / OCC_THREE);
/*.*/
/*.*/
/*?discrete*/
/*?noise*/
    occ_noise(f->x, (occ_value)occ_since[k][0], q);
/*.*/
    for (r = 0U; r < OCC_STATES; r++) {
        e[r] = f->x[r];
    }
    occ_right(e, (occ_value)occ_since[k][0], f->x, slope);
    occ_product(slope, moved, half);
    for (c = 0U; c < OCC_SQUARE; c++) {
        moved[c] = half[c];
    }
/*.*/
/*?noise*/
    occ_factorise(q, OCC_STATES);
/*.*/
    for (c = 0U; c < OCC_COLUMNS; c++) {
        weight[c] = OCC_ZERO;
    }
    for (r = 0U; r < OCC_STATES; r++) {
        weight[r] = f->pivot[r];
        for (c = 0U; c < OCC_COLUMNS; c++) {
            a[r][c] = (c < OCC_STATES) ? moved[(r * OCC_STATES) + c] : OCC_ZERO;
        }
        columns[r] = OCC_STATES;
/*?noise*/
        weight[OCC_STATES + r] = q[r * (OCC_STATES + 1U)];
        for (c = 0U; c < r; c++) {
            a[r][OCC_STATES + c] = q[(r * OCC_STATES) + c];
        }
        a[r][OCC_STATES + r] = OCC_ONE;
        columns[r] = OCC_STATES + r + 1U; /* beyond, the row is zero */
/*.*/
    }
    return occ_sweep(f, a, weight, columns, 0U, e, f->x);
}

/* x, which holds the estimate before, by the `count` values of z that are kept */
static occ_status occ_formula_step(occ_filter *f, const occ_value z[OCC_VALUES], const uint32_t kept[OCC_VALUES],
                                   uint32_t count, uint32_t values)
{
    const uint32_t k = f->k;
    const occ_value t = (occ_value)occ_edges[k + 1U][0];
    occ_filter g; /* f stays as it is where anything fails */
    occ_value h[OCC_VALUES];
    occ_value slope[OCC_VALUES * OCC_STATES];
    occ_value noise[OCC_VALUES * OCC_VALUES];
    occ_value a[OCC_ROWS][OCC_COLUMNS];
    occ_value weight[OCC_COLUMNS];
    occ_value e[OCC_ROWS];
    uint32_t columns[OCC_ROWS];
    uint32_t c;
    uint32_t r;
    occ_status status;

    g = *f;
    status = occ_move(&g, k);
    g.nis = OCC_ZERO;
    if ((status == OCC_OK) && (count > 0U)) {
        occ_expect(k, g.x, t, h, slope, noise);
        occ_factorise(noise, OCC_VALUES);
        for (c = 0U; c < OCC_COLUMNS; c++) {
            weight[c] = OCC_ZERO;
        }
        for (c = 0U; c < OCC_STATES; c++) {
            weight[c] = g.pivot[c];
        }
        for (r = 0U; r < OCC_VALUES; r++) {
            weight[OCC_STATES + r] = noise[r * (OCC_VALUES + 1U)];
            noise[r * (OCC_VALUES + 1U)] = OCC_ONE; /* from here on a unit triangle */
            for (c = r + 1U; c < OCC_VALUES; c++) {
                noise[(r * OCC_VALUES) + c] = OCC_ZERO;
            }
        }
        for (r = 0U; r < (count + OCC_STATES); r++) {
            for (c = 0U; c < OCC_COLUMNS; c++) {
                a[r][c] = OCC_ZERO;
            }
            columns[r] = OCC_STATES + values;
            if (r < count) {
                const uint32_t place = kept[r];
                occ_times_factor(a[r], &slope[place * OCC_STATES], 1U, g.lower);
                for (c = 0U; c < OCC_VALUES; c++) {
                    a[r][OCC_STATES + c] = noise[(place * OCC_VALUES) + c];
                }
                columns[r] = OCC_STATES + place + 1U; /* beyond, the row is zero */
                e[r] = z[place] - h[place];
/*?angles*/
                if (occ_angle[occ_angle_row[k]][place] != 0U) {
                    e[r] -= OCC_TURN * occ_floor((e[r] + OCC_PI) / OCC_TURN);
                }
/*.*/
            } else {
                for (c = 0U; c < (r - count); c++) {
                    a[r][c] = g.lower[(((r - count) * ((r - count) - 1U)) / 2U) + c];
                }
                a[r][r - count] = OCC_ONE;
            }
        }
        status = occ_sweep(&g, a, weight, columns, count, e, g.x);
    }
    if (status == OCC_OK) {
        g.dimension = count;
        g.k = k + 1U;
        g.planned = 0U;
        *f = g;
    }
    return status;
}

/*.*/
