/* @TITLE@
 * written by occontrol export --to flight, @KIND@; run @SHORT_DIGEST@
 *
 *   occ_filter f;
 *   if ((occ_check() == OCC_OK) && (occ_init(&f) == OCC_OK)) {
 *       occ_next(&f, in_use);           which sensors to read during the coming interval
 *       occ_step(&f, z, NULL);          at its end: their values, one sensor after the other; NaN: missing
 *       occ_variance(&f, v);            f.x is the estimate at @NOW@, v its variances
 *   }
 *
 * A status other than OCC_OK leaves the filter as it was. */
#ifndef OCC_FILTER_H
#define OCC_FILTER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

@SIZES@

typedef enum {
    OCC_OK = 0,
    OCC_NULL_POINTER = 1,
    OCC_END = 2,
    OCC_BAD_SAMPLE = 3,
    OCC_SINGULAR = 4,
    OCC_OVERFLOW = 5,
    OCC_BAD_TABLE = 6,
    OCC_OUTSIDE = 7,
    OCC_BAD_STATE = 8
} occ_status;

@ENUMS@

/*?filter*/
typedef struct {
    occ_value x[OCC_STATES];  /* the estimate at @NOW_K@ */
/*?full*/
    occ_value pivot[OCC_STATES]; /* of the covariance L diag(pivot) L', once the plan does not hold */
    occ_value lower[OCC_LOWER];  /* L below its diagonal, row by row */
/*.*/
    occ_value nis;            /* normalised innovation squared of the last values */
    uint32_t dimension;       /* how many values there were */
/*?endless*/
    uint64_t round;           /* cycles done */
    uint32_t k;               /* the coming interval */
/*.*/
/*?!endless*/
    uint32_t k;               /* steps done */
/*.*/
    uint8_t planned;          /* 1 while gains and variances are those computed beforehand */
} occ_filter;

/* Start of the horizon. */
occ_status occ_init(occ_filter *f);
/*?plan*/
/* Start at time k with the estimate x and the planned covariance: OCC_OUTSIDE, OCC_BAD_STATE. */
occ_status occ_init_at(occ_filter *f, uint32_t k, const occ_value x[OCC_STATES]);
/*.*/
/* Advance by one interval with the values z of the sensors in use, in their order; a value that is NaN, or whose
 * valid[] is 0 (valid may be NULL), is missing. OCC_END, OCC_BAD_SAMPLE, OCC_SINGULAR, OCC_OVERFLOW. */
occ_status occ_step(occ_filter *f, const occ_value z[OCC_VALUES], const uint8_t valid[OCC_VALUES]);
/* Variances of the estimate. */
occ_status occ_variance(const occ_filter *f, occ_value v[OCC_STATES]);
/*?full*/
/* The whole covariance, row by row. */
occ_status occ_covariance(const occ_filter *f, occ_value p[OCC_STATES * OCC_STATES]);
/*.*/
/*?predict*/
/* Prediction w of the output@AT@, and its variances v. */
occ_status occ_predict(const occ_filter *f, occ_value w[OCC_OUTPUTS], occ_value v[OCC_OUTPUTS]);
/*.*/
/*?endless*/
/* Time of the estimate after so many more steps; 0: now. */
double occ_time_after(const occ_filter *f, uint32_t steps);
/* Which sensors to read during the coming interval (1) and which not (0). */
/*.*/
/*?!endless*/
/* Which sensors to read during the coming interval (1) and which not (0): OCC_END. */
/*.*/
occ_status occ_next(const occ_filter *f, uint8_t in_use[OCC_SENSORS]);
/* Where the values of a sensor stand among those of interval k; count is 0 where it is not in use. */
occ_status occ_place(uint32_t k, uint32_t sensor, uint32_t *first, uint32_t *count);
/*.*/
/* Which sensors to read during interval k: OCC_OUTSIDE. */
occ_status occ_in_use(uint32_t k, uint8_t in_use[OCC_SENSORS]);
/* @INTERVAL@: OCC_OUTSIDE. */
occ_status occ_interval(double t, uint32_t *k);
/* @TIME@ */
double occ_time(uint32_t k);
/* Whether every table is as it was written: OCC_BAD_TABLE. */
occ_status occ_check(void);
/* SHA-256 of the run that this was written from. */
const char *occ_digest(void);
/* A status in words. */
const char *occ_words(occ_status status);

/* The tables; rows that are equal are stored once, occ_NAME_row[k] says which row belongs to k. */
@DECLARATIONS@

#ifdef __cplusplus
}
#endif

#endif
