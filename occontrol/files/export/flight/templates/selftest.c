/* Self-test: the tables are unchanged and the filter finds the same bits as the computer that wrote it.
 * Opens no file, allocates nothing, runs from any folder; exits 0 when every vector is reproduced. */
#include "../occ_filter.h"
#include "vectors.h"
#include <stdio.h>
#include <string.h>

static int occ_fails(const char *what, unsigned long at)
{
    (void)printf("FAILED: %s, step %lu\n", what, at);
    return 1;
}

/*?filter*/
/* the sum over everything that the filter says at one step */
static uint32_t occ_sum(const occ_filter *f, occ_status status)
{
    occ_value said[OCC_SAID];
    uint32_t crc = 0xFFFFFFFFU;
    uint32_t i;
    uint32_t bit;
    uint32_t n = 0U;

    for (i = 0U; i < OCC_STATES; i++) {
        said[n] = f->x[i];
        n++;
    }
    said[n] = f->nis;
    n++;
    if (occ_variance(f, &said[n]) != OCC_OK) {
        return 0U;
    }
    n += OCC_STATES;
/*?full*/
    if (occ_covariance(f, &said[n]) != OCC_OK) {
        return 0U;
    }
    n += OCC_STATES * OCC_STATES;
/*.*/
/*?predict*/
    if ((f->k % OCC_PREDICTED_EVERY) == 0U) {
        if (occ_predict(f, &said[n], &said[n + OCC_OUTPUTS]) != OCC_OK) {
            return 0U;
        }
        n += 2U * OCC_OUTPUTS;
    }
/*.*/
    for (i = 0U; i <= n; i++) {
        uint64_t word = (uint64_t)(uint32_t)status + (16U * (uint64_t)f->dimension) + (f->planned ? 8192U : 0U);
        uint32_t left = 8U;
        if (i < n) {
            occ_word bits;
            (void)memcpy(&bits, &said[i], sizeof(bits));
            word = bits;
            left = (uint32_t)sizeof(bits);
        }
        for (; left > 0U; left--) {
            crc ^= (uint32_t)(word & 0xFFU);
            word >>= 8U;
            for (bit = 0U; bit < 8U; bit++) {
                crc = ((crc & 1U) != 0U) ? ((crc >> 1U) ^ 0xEDB88320U) : (crc >> 1U);
            }
        }
    }
    return crc ^ 0xFFFFFFFFU;
}

static int occ_replay(uint32_t pattern)
{
    occ_filter f;
    uint32_t k;
    occ_status status = occ_init(&f);

    for (k = 0U; k <= OCC_REPLAYED; k++) {
        if (occ_sum(&f, status) != occ_expected[pattern][k]) {
            return occ_fails(occ_patterns[pattern], (unsigned long)k);
        }
        if (k < OCC_REPLAYED) {
            status = occ_step(&f, occ_samples[k], occ_valid[pattern][k]);
        }
    }
/*?endless*/
    return (f.round == 3U) ? 0 : occ_fails("the number of cycles", (unsigned long)f.round);
/*.*/
/*?!endless*/
    if (f.k < OCC_INTERVALS) { /* not all is replayed, or the estimate left the numbers */
        return 0;
    }
    return (occ_step(&f, occ_samples[0], NULL) == OCC_END) ? 0 : occ_fails("the end of the horizon", (unsigned long)k);
/*.*/
}

/* all patterns at once: a filter shares nothing with another */
static int occ_interleaved(void)
{
    occ_filter f[OCC_PATTERNS];
    occ_status status[OCC_PATTERNS];
    uint32_t p;
    uint32_t k;

    for (p = 0U; p < OCC_PATTERNS; p++) {
        status[p] = occ_init(&f[p]);
    }
    for (k = 0U; k <= OCC_REPLAYED; k++) {
        for (p = 0U; p < OCC_PATTERNS; p++) {
            if (occ_sum(&f[p], status[p]) != occ_expected[p][k]) {
                return occ_fails("filters side by side", (unsigned long)k);
            }
            if (k < OCC_REPLAYED) {
                status[p] = occ_step(&f[p], occ_samples[k], occ_valid[p][k]);
            }
        }
    }
    return 0;
}

/*.*/
int main(void)
{
    uint8_t in_use[OCC_SENSORS];
    uint32_t k;
    uint32_t found;
    int failed = 0;

    if (occ_check() != OCC_OK) {
        failed += occ_fails(occ_words(OCC_BAD_TABLE), 0UL);
    }
    for (k = 0U; k < OCC_INTERVALS; k++) {
        if ((occ_in_use(k, in_use) != OCC_OK) || (occ_interval(occ_time(k + 1U), &found) != OCC_OK)) {
            failed += occ_fails("the schedule", (unsigned long)k);
        }
    }
/*?filter*/
    for (k = 0U; k < OCC_PATTERNS; k++) {
        failed += occ_replay(k);
    }
    failed += occ_interleaved();
/*.*/
    if (failed == 0) {
        (void)printf("passed: %s\n", occ_digest());
    }
    return (failed == 0) ? 0 : 1;
}
