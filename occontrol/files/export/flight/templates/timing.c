/* Nanoseconds per step on this computer: with the plan, and with the covariance computed from the first step on. */
#include "../occ_filter.h"
#include "vectors.h"
#include <stdio.h>
#include <time.h>

/* the quickest of many replays: others may be using this computer too */
static double occ_run(uint32_t pattern, double *sum)
{
    const clock_t begin = clock();
    double quickest = 1.0e300;

    while ((clock() - begin) < (clock_t)(CLOCKS_PER_SEC / 5)) {
        const clock_t start = clock();
        unsigned long steps = 0UL;
        double each;
        while (steps < 2000UL) {
            occ_filter f;
            uint32_t k;
            (void)occ_init(&f);
            for (k = 0U; k < OCC_REPLAYED; k++) {
                (void)occ_step(&f, occ_samples[k], occ_valid[pattern][k]);
            }
            *sum += (double)f.x[0];
            steps += OCC_REPLAYED;
        }
        each = (1.0e9 * ((double)(clock() - start) / (double)CLOCKS_PER_SEC)) / (double)steps;
        quickest = (each < quickest) ? each : quickest;
    }
    return quickest;
}

int main(void)
{
    double sum = (double)occ_expected[0][0] + (double)occ_patterns[0][0];
    const double planned = occ_run(0U, &sum);
    const double lost = occ_run(1U, &sum);

    (void)printf("%.0f %.0f%s\n", planned, lost, (sum > 1.0e300) ? "!" : "");
    return 0;
}
