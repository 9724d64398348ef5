/* The filter along the schedule: C99, no heap, no recursion, no library, nothing shared between two filters.
 *
/*?linear*/
 *   z = H x + d + v,   x+ = F x + g + w        values z arrive at the end of an interval, x+ holds there
/*.*/
/*?nonlinear continuous*/
 *   dx/dt = f(x, t) + w,   z = h(x, t) + v     values z arrive at the end of an interval; extended Kalman filter:
 *                                              slopes of f and h are those at the estimate, Runge-Kutta steps
/*.*/
/*?nonlinear discrete*/
 *   x+ = f(x, k) + w,   z = h(x, k) + v        extended Kalman filter: slopes of f and h are those at the estimate
/*.*/
/*?full linear*/
 *   [ H L  V ]                                 P = L diag(d) L', cov [v; w] = [V; W] diag(.) [V; W]':
 *   [ F L  W ] = [unit lower triangle] [rest]  weighted Gram-Schmidt on the rows gives L+, d+ and the gain,
 *                                              so that P stays definite whatever the data (Thornton, Bierman)
/*.*/
/*?nonlinear*/
 *   [ F L  W ] = [unit lower triangle] [rest]  P = L diag(d) L', noise W diag(.) W': weighted Gram-Schmidt on the rows
 *   [ H L  V ]                                 gives the factors before a reading, and once more, with [L 0] below the
 *   [   L  0 ]                                 second line, those after it and the gain (Thornton, Bierman)
/*.*/
 * Matrices are stored column by column; sums run from the first term to the last, so that every compiler that keeps
 * to C99 finds the same bits. */
#include "occ_filter.h"

#if defined(__FAST_MATH__)
#error "fast-math removes the tests for values that are missing: compile without it"
#endif
#if defined(__FLT_EVAL_METHOD__) && (__FLT_EVAL_METHOD__ != 0) && (__FLT_EVAL_METHOD__ != 16)
#error "this processor computes with other digits than it stores: on x86 use -msse2 -mfpmath=sse"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

/*?full*/
#define OCC_ROWS (OCC_VALUES + OCC_STATES)
#define OCC_COLUMNS (2U * ((OCC_STATES + OCC_ROWS + 1U) / 2U)) /* an even number */
/*.*/

static uint8_t occ_is_nan(occ_value a)
{
    return ((!(a <= OCC_LARGEST)) && (!(a >= -OCC_LARGEST))) ? 1U : 0U;
}

static uint8_t occ_is_finite(occ_value a)
{
    return ((a <= OCC_LARGEST) && (a >= -OCC_LARGEST)) ? 1U : 0U;
}

static uint8_t occ_all_finite(const occ_value x[OCC_STATES])
{
    uint32_t i;
    uint8_t all = 1U;

    for (i = 0U; i < OCC_STATES; i++) {
        all &= occ_is_finite(x[i]);
    }
    return all;
}

/*?affine*/
/* d + m x, where m is a row of a matrix whose columns are `apart` */
static occ_value occ_affine(occ_value d, const occ_value *m, uint32_t apart, const occ_value x[OCC_STATES])
{
    occ_value sum = d;
    uint32_t c;

    for (c = 0U; c < OCC_STATES; c++) {
        sum += m[c * apart] * x[c];
    }
    return sum;
}

/*.*/
occ_status occ_init(occ_filter *f)
{
    uint32_t i;

    if (f == NULL) {
        return OCC_NULL_POINTER;
    }
    f->k = 0U;
/*?endless*/
    f->round = 0U;
/*.*/
    f->dimension = 0U;
    f->planned = OCC_HAS_PLAN;
    f->nis = OCC_ZERO;
    for (i = 0U; i < OCC_STATES; i++) {
        f->x[i] = occ_mean[0][i];
    }
/*?full*/
    for (i = 0U; i < OCC_STATES; i++) {
        f->pivot[i] = occ_root_pivot[occ_root_row[0]][i];
    }
    for (i = 0U; i < OCC_LOWER; i++) {
        f->lower[i] = occ_root_lower[occ_root_row[0]][i];
    }
/*.*/
    return OCC_OK;
}

/*?plan*/
occ_status occ_init_at(occ_filter *f, uint32_t k, const occ_value x[OCC_STATES])
{
    uint32_t i;
    occ_status status;

    if ((f == NULL) || (x == NULL)) {
        return OCC_NULL_POINTER;
    }
/*?endless*/
    if (k >= OCC_INTERVALS) {
        return OCC_OUTSIDE;
    }
/*.*/
/*?!endless*/
    if (k > OCC_INTERVALS) {
        return OCC_OUTSIDE;
    }
/*.*/
    if (occ_all_finite(x) == 0U) {
        return OCC_BAD_STATE;
    }
    status = occ_init(f);
    f->k = k;
    for (i = 0U; i < OCC_STATES; i++) {
        f->x[i] = x[i];
    }
    return status;
}

/*.*/
