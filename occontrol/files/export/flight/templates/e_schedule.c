const char *occ_digest(void)
{
    return OCC_DIGEST;
}

const char *occ_words(occ_status status)
{
    static const char *const words[] = {
        "done",
        "a pointer is NULL",
        "the horizon is over",
        "a sample is infinite",
        "an innovation has no variance",
        "the estimate leaves the range of the numbers",
        "a table has changed since it was written",
        "outside the horizon",
        "a state is not finite"};
    const uint32_t which = (uint32_t)status;

    return (which < (uint32_t)(sizeof(words) / sizeof(words[0]))) ? words[which] : "no such status";
}

double occ_time(uint32_t k)
{
    return occ_edges[(k < OCC_INTERVALS) ? k : OCC_INTERVALS][0];
}

/*?endless*/
/* t brought into the first cycle, and without a rounding: from t of any size the largest length * 2^j that is in it is
 * taken away, then the next smaller one */
static double occ_in_cycle(double t)
{
    const double begin = occ_edges[OCC_AGAIN][0];
    const double length = occ_edges[OCC_INTERVALS][0] - begin;
    double left = t - begin;
    double largest = length;
    uint32_t larger = 1U;
    uint8_t more = 1U;

    while ((larger < 1100U) && (more != 0U)) {
        more = (largest <= (left / 2.0)) ? 1U : 0U;
        if (more != 0U) {
            largest *= 2.0;
            larger++;
        }
    }
    while (larger > 0U) {
        if (left >= largest) {
            left -= largest;
        }
        largest /= 2.0;
        larger--;
    }
    return begin + left;
}

double occ_time_after(const occ_filter *f, uint32_t steps)
{
    const uint32_t period = OCC_INTERVALS - OCC_AGAIN;
    const double length = occ_edges[OCC_INTERVALS][0] - occ_edges[OCC_AGAIN][0];
    double t = 0.0;

    if (f != NULL) {
        const uint64_t at = (uint64_t)f->k + steps;
        uint64_t rounds = f->round;
        uint64_t place = at;
        if (at >= OCC_INTERVALS) {
            rounds += (at - OCC_AGAIN) / period;
            place = OCC_AGAIN + ((at - OCC_AGAIN) % period);
        }
        t = occ_edges[place][0] + ((double)rounds * length);
    }
    return t;
}

/*.*/
occ_status occ_interval(double t, uint32_t *k)
{
    uint32_t low = 0U;
    uint32_t high = OCC_INTERVALS;
/*?endless*/
    double here = t;
    double slack;
/*.*/
    occ_status status = OCC_OK;

    if (k == NULL) {
        status = OCC_NULL_POINTER;
/*?endless*/
    } else if (!((t >= occ_edges[0][0]) && (t <= 1.0e300))) {
/*.*/
/*?!endless*/
    } else if (!((t >= occ_edges[0][0]) && (t <= occ_edges[OCC_INTERVALS][0]))) {
/*.*/
        status = OCC_OUTSIDE;
    } else {
/*?endless*/
        slack = 8.9e-16 * t; /* a time that was added up over many cycles counts as the edge that it is meant to be */
        if (t >= (occ_edges[OCC_INTERVALS][0] - slack)) {
            here = occ_in_cycle(t);
            if (here >= (occ_edges[OCC_INTERVALS][0] - slack)) {
                here = occ_edges[OCC_AGAIN][0];
            }
/*?instants*/
            if (here <= (occ_edges[OCC_AGAIN][0] + slack)) {
                here = occ_edges[OCC_INTERVALS][0]; /* the last reading of a cycle */
            }
            low = OCC_AGAIN;
/*.*/
        }
/*.*/
/*?instants*/
        /* the first reading that is not before t */
        while (low < high) {
            const uint32_t middle = low + ((high - low) / 2U);
            if (occ_edges[middle + 1U][0] < @LATE@) {
                low = middle + 1U;
            } else {
                high = middle;
            }
        }
/*.*/
/*?!instants*/
        while ((high - low) > 1U) {
            const uint32_t middle = low + ((high - low) / 2U);
            if (occ_edges[middle][0] <= @EARLY@) {
                low = middle;
            } else {
                high = middle;
            }
        }
/*.*/
        *k = low;
    }
    return status;
}

occ_status occ_in_use(uint32_t k, uint8_t in_use[OCC_SENSORS])
{
    uint32_t j;
    occ_status status = OCC_OK;

    if (in_use == NULL) {
        status = OCC_NULL_POINTER;
    } else if (k >= OCC_INTERVALS) {
        status = OCC_OUTSIDE;
    } else {
        for (j = 0U; j < OCC_SENSORS; j++) {
            in_use[j] = occ_schedule[occ_schedule_row[k]][j];
        }
    }
    return status;
}

/*?filter*/
occ_status occ_next(const occ_filter *f, uint8_t in_use[OCC_SENSORS])
{
    occ_status status = OCC_NULL_POINTER;

    if (f != NULL) {
/*?endless*/
        status = occ_in_use(f->k, in_use);
/*.*/
/*?!endless*/
        status = (f->k >= OCC_INTERVALS) ? OCC_END : OCC_OK;
        if (status == OCC_OK) {
            status = occ_in_use(f->k, in_use);
        }
/*.*/
    }
    return status;
}

occ_status occ_place(uint32_t k, uint32_t sensor, uint32_t *first, uint32_t *count)
{
    uint32_t at = 0U;
    uint32_t j;
    occ_status status = OCC_OK;

    if ((first == NULL) || (count == NULL)) {
        status = OCC_NULL_POINTER;
    } else if ((k >= OCC_INTERVALS) || (sensor >= OCC_SENSORS)) {
        status = OCC_OUTSIDE;
    } else {
        for (j = 0U; j < sensor; j++) {
            if (occ_schedule[occ_schedule_row[k]][j] != 0U) {
                at += occ_sensor_values[0][j];
            }
        }
        *first = at;
        *count = (occ_schedule[occ_schedule_row[k]][sensor] != 0U) ? occ_sensor_values[0][sensor] : 0U;
    }
    return status;
}

/*.*/
/* CRC-32 (IEEE 802.3) over the numbers of a table, least significant byte first whatever the processor */
static uint32_t occ_crc(const unsigned char *bytes, uint32_t count, uint32_t width)
{
    const uint16_t probe = 1U;
    const unsigned char first = *(const unsigned char *)&probe;
    const uint32_t flip = (first == 1U) ? 0U : (width - 1U);
    uint32_t crc = 0xFFFFFFFFU;
    uint32_t i;
    uint32_t bit;

    for (i = 0U; i < count; i++) {
        crc ^= (uint32_t)bytes[i ^ flip];
        for (bit = 0U; bit < 8U; bit++) {
            crc = ((crc & 1U) != 0U) ? ((crc >> 1U) ^ 0xEDB88320U) : (crc >> 1U);
        }
    }
    return crc ^ 0xFFFFFFFFU;
}

occ_status occ_check(void)
{
    static const struct {
        const unsigned char *bytes;
        uint32_t count;
        uint32_t width;
        uint32_t crc;
    } tables[] = {
@CHECKS@
    };
    uint32_t i;
    uint32_t wrong = 0U;

    for (i = 0U; i < (uint32_t)(sizeof(tables) / sizeof(tables[0])); i++) {
        wrong |= occ_crc(tables[i].bytes, tables[i].count, tables[i].width) ^ tables[i].crc;
    }
    return (wrong == 0U) ? OCC_OK : OCC_BAD_TABLE;
}
