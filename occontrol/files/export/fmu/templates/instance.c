/* What both editions of FMI share: an instance, its variables, and steps of any size over the intervals inside.
 * The standard's headers are not needed: the few types are declared here. */
#include "occ_filter.h"
#include <math.h>
#include <string.h>

#if defined(_WIN32)
#define OCC_EXPORT __declspec(dllexport)
#else
#define OCC_EXPORT __attribute__((visibility("default")))
#endif

@REFERENCES@

#define OCC_INSTANCES 8U /* at a time: nothing is allocated */

typedef struct {
    occ_filter f;
    double z[OCC_VALUES];
    uint8_t valid[OCC_VALUES];
    occ_status status;
    uint8_t taken;
} occ_instance;

static occ_instance occ_instances[OCC_INSTANCES];

static void occ_restart(occ_instance *one)
{
    uint32_t i;

    one->status = occ_init(&one->f);
    for (i = 0U; i < OCC_VALUES; i++) {
        one->z[i] = 0.0;
        one->valid[i] = 0U;
    }
}

static occ_instance *occ_take(const char *token)
{
    uint32_t i;

    if ((token == NULL) || (strcmp(token, OCC_TOKEN) != 0) || (occ_check() != OCC_OK)) {
        return NULL;
    }
    for (i = 0U; i < OCC_INSTANCES; i++) {
        if (occ_instances[i].taken == 0U) {
            occ_instances[i].taken = 1U;
            occ_restart(&occ_instances[i]);
            return &occ_instances[i];
        }
    }
    return NULL;
}

/* whether the interval after so many others ends by t */
static uint8_t occ_ends_by(const occ_filter *f, uint32_t ahead, double t)
{
/*?endless*/
    const double begin = occ_time_after(f, ahead);
    const double end = occ_time_after(f, ahead + 1U);
    const uint8_t there = 1U;
/*.*/
/*?!endless*/
    const double begin = occ_time(f->k + ahead);
    const double end = occ_time(f->k + ahead + 1U);
    const uint8_t there = ((f->k + ahead) < OCC_INTERVALS) ? 1U : 0U;
/*.*/

    return (uint8_t)((there != 0U) && (end <= (t + (1.0e-9 * (end - begin)) + (4.0e-16 * fabs(t)))));
}

/* all intervals that end by t; the inputs are the values of the last one, those of the others are missing */
static int occ_advance(occ_instance *one, double t)
{
    occ_value z[OCC_VALUES];
    uint8_t none[OCC_VALUES];
    uint32_t i;

    for (i = 0U; i < OCC_VALUES; i++) {
        z[i] = (occ_value)one->z[i];
        none[i] = 0U;
    }
    one->status = (one->f.k >= OCC_INTERVALS) ? OCC_END : OCC_OK;
    while (occ_ends_by(&one->f, 0U, t) != 0U) {
        const uint8_t last = (uint8_t)(occ_ends_by(&one->f, 1U, t) == 0U);
        one->status = occ_step(&one->f, z, (last != 0U) ? one->valid : none);
        if (one->status != OCC_OK) {
            return 0; /* the interval stays; its values are missing when the next step passes it */
        }
    }
    return 1;
}

/* a reading at the very start is an input of the initialisation */
static void occ_begin(occ_instance *one)
{
    if (occ_time(1U) <= occ_time(0U)) {
        (void)occ_advance(one, occ_time(0U));
    }
}

static int occ_get_real(const occ_instance *one, uint32_t reference, double *value)
{
    occ_value v[OCC_STATES];
/*?predict*/
    occ_value w[OCC_OUTPUTS];
    occ_value s[OCC_OUTPUTS];
/*.*/

    if (reference == OCC_REF_TIME) {
/*?endless*/
        *value = occ_time_after(&one->f, 0U);
/*.*/
/*?!endless*/
        *value = occ_time(one->f.k);
/*.*/
    } else if ((reference >= OCC_REF_Z) && (reference < (OCC_REF_Z + OCC_VALUES))) {
        *value = one->z[reference - OCC_REF_Z];
    } else if ((reference >= OCC_REF_X) && (reference < (OCC_REF_X + OCC_STATES))) {
        *value = (double)one->f.x[reference - OCC_REF_X];
    } else if ((reference >= OCC_REF_SD_X) && (reference < (OCC_REF_SD_X + OCC_STATES))) {
        (void)occ_variance(&one->f, v);
        *value = sqrt((double)v[reference - OCC_REF_SD_X]);
    } else if (reference == OCC_REF_NIS) {
        *value = (double)one->f.nis;
/*?predict*/
    } else if ((reference >= OCC_REF_W) && (reference < (OCC_REF_W + OCC_OUTPUTS))) {
        (void)occ_predict(&one->f, w, s);
        *value = (double)w[reference - OCC_REF_W];
    } else if ((reference >= OCC_REF_SD_W) && (reference < (OCC_REF_SD_W + OCC_OUTPUTS))) {
        (void)occ_predict(&one->f, w, s);
        *value = sqrt((double)s[reference - OCC_REF_SD_W]);
/*.*/
    } else {
        return 0;
    }
    return 1;
}

static int occ_set_real(occ_instance *one, uint32_t reference, double value)
{
    const int known = (reference >= OCC_REF_Z) && (reference < (OCC_REF_Z + OCC_VALUES));

    if (known) {
        one->z[reference - OCC_REF_Z] = value;
    }
    return known;
}

static int occ_get_flag(const occ_instance *one, uint32_t reference, int *value)
{
    uint8_t in_use[OCC_SENSORS] = {0U};

    if ((reference >= OCC_REF_VALID) && (reference < (OCC_REF_VALID + OCC_VALUES))) {
        *value = (int)one->valid[reference - OCC_REF_VALID];
    } else if ((reference >= OCC_REF_NEXT) && (reference < (OCC_REF_NEXT + OCC_SENSORS))) {
        (void)occ_next(&one->f, in_use);
        *value = (int)in_use[reference - OCC_REF_NEXT];
    } else if (reference == OCC_REF_PLANNED) {
        *value = (int)one->f.planned;
    } else {
        return 0;
    }
    return 1;
}

static int occ_set_flag(occ_instance *one, uint32_t reference, int value)
{
    const int known = (reference >= OCC_REF_VALID) && (reference < (OCC_REF_VALID + OCC_VALUES));

    if (known) {
        one->valid[reference - OCC_REF_VALID] = (value != 0) ? 1U : 0U;
    }
    return known;
}

static int occ_get_whole(const occ_instance *one, uint32_t reference, int32_t *value)
{
    if (reference == OCC_REF_STATUS) {
        *value = (int32_t)one->status;
    } else if (reference == OCC_REF_COUNT) {
        *value = (one->f.k < OCC_INTERVALS) ? (int32_t)occ_values[one->f.k] : 0;
    } else {
        return 0;
    }
    return 1;
}

