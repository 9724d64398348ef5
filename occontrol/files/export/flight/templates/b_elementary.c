/* Elementary functions of +, -, *, / and comparisons alone: every processor finds the same bits. Arguments are reduced
 * to a small interval, where a Taylor series ends below the last place. */
/*?absolute*/
static occ_value occ_absolute(occ_value x)
{
    return (x < OCC_ZERO) ? -x : x;
}

/*.*/
/*?polynomial*/
static occ_value occ_polynomial(const occ_value *c, uint32_t count, occ_value x)
{
    occ_value sum = c[count - 1U];
    uint32_t i;

    for (i = count - 1U; i > 0U; i--) {
        sum = (sum * x) + c[i - 1U];
    }
    return sum;
}

/*.*/
/*?floor*/
static occ_value occ_floor(occ_value x)
{
    occ_value whole = x;

    if (occ_absolute(x) < OCC_WHOLE) {
        whole = (occ_value)(int64_t)x;
        if (whole > x) {
            whole -= OCC_ONE;
        }
    }
    return whole;
}

/*.*/
/*?ceil*/
static occ_value occ_ceil(occ_value x)
{
    return -occ_floor(-x);
}

/*.*/
/*?sign*/
static occ_value occ_sign(occ_value x)
{
    return (x > OCC_ZERO) ? OCC_ONE : ((x < OCC_ZERO) ? -OCC_ONE : x);
}

/*.*/
/*?powers*/
@POWERS@
/*.*/
/*?split*/
/* x = m 2^e with m from 1 to 2; x is above 0 and finite */
static occ_value occ_split(occ_value x, int32_t *e)
{
    occ_value m = x;
    uint32_t i;

    *e = 0;
    for (i = 0U; i < OCC_POWERS; i++) {
        if (m >= occ_powers[i]) {
            m *= occ_fractions[i];
            *e += occ_exponents[i];
        } else if ((m * occ_powers[i]) < OCC_TWO) {
            m *= occ_powers[i];
            *e -= occ_exponents[i];
        } else {
            /* nothing to do */
        }
    }
    return m;
}

/*.*/
/*?scale*/
/* m 2^e */
static occ_value occ_scale(occ_value m, int32_t e)
{
    occ_value scaled = m;
    int32_t left = e;
    uint32_t i;

    for (i = 0U; i < OCC_POWERS; i++) {
        if (left >= occ_exponents[i]) {
            scaled *= occ_powers[i];
            left -= occ_exponents[i];
        } else if (left <= -occ_exponents[i]) {
            scaled *= occ_fractions[i];
            left += occ_exponents[i];
        } else {
            /* nothing to do */
        }
    }
    return scaled;
}

/*.*/
/*?sqrt*/
static occ_value occ_sqrt(occ_value x)
{
    occ_value m;
    occ_value root;
    int32_t e;
    uint32_t i;

    if ((!(x > OCC_ZERO)) || (!(x <= OCC_LARGEST))) {
        return (x < OCC_ZERO) ? ((x - x) / (x - x)) : x;
    }
    m = occ_split(x, &e);
    if ((e % 2) != 0) {
        m *= OCC_TWO;
        e--;
    }
    root = @0.6875@ + (@0.34375@ * m);
    for (i = 0U; i < 4U; i++) {
        root = OCC_HALF * (root + (m / root));
    }
    return occ_scale(root, e / 2);
}

/*.*/
/*?hypot*/
static occ_value occ_hypot(occ_value x, occ_value y)
{
    const occ_value a = occ_absolute(x);
    const occ_value b = occ_absolute(y);
    const occ_value large = (a > b) ? a : b;
    const occ_value q = ((a > b) ? b : a) / large;

    return (large > OCC_ZERO) ? (large * occ_sqrt(OCC_ONE + (q * q))) : large;
}

/*.*/
/*?turn*/
/* cosine where `shift` is 1, sine where it is 0 */
static occ_value occ_turn(occ_value x, occ_value shift)
{
@HALF_PI@
@SINE@
@COSINE@
    const occ_value k = occ_floor((x / OCC_HALF_PI) + OCC_HALF);
    const occ_value turned = k + shift;
    const occ_value quarter = turned - (@4.0@ * occ_floor(turned / @4.0@));
    occ_value r = x;
    occ_value z;
    uint32_t i;

    for (i = 0U; i < 4U; i++) {
        r -= k * half_pi[i];
    }
    z = r * r;
    if (((quarter > OCC_HALF) && (quarter < @1.5@)) || (quarter > @2.5@)) {
        r = (OCC_ONE - (OCC_HALF * z)) + ((z * z) * occ_polynomial(cosine, OCC_COSINE, z));
    } else {
        r += (r * z) * occ_polynomial(sine, OCC_SINE, z);
    }
    return (quarter > @1.5@) ? -r : r;
}

/*.*/
/*?sin*/
static occ_value occ_sin(occ_value x)
{
    return occ_turn(x, OCC_ZERO);
}

/*.*/
/*?cos*/
static occ_value occ_cos(occ_value x)
{
    return occ_turn(x, OCC_ONE);
}

/*.*/
/*?tan*/
static occ_value occ_tan(occ_value x)
{
    return occ_sin(x) / occ_cos(x);
}

/*.*/
/*?exp*/
@EXPONENTIAL@
static occ_value occ_exp(occ_value x)
{
    occ_value y = (x > OCC_MOST) ? OCC_MOST : x;
    occ_value k;
    occ_value r;

    if (!(x <= OCC_LARGEST)) {
        return x;
    }
    y = (y < -OCC_MOST) ? -OCC_MOST : y;
    k = occ_floor((y / OCC_LN2) + OCC_HALF);
    r = (y - (k * OCC_LN2_HIGH)) - (k * OCC_LN2_LOW);
    return occ_scale((r + ((r * r) * occ_polynomial(occ_exponential, OCC_EXPONENTIAL, r))) + OCC_ONE, (int32_t)k);
}

/*.*/
/*?expm1*/
static occ_value occ_expm1(occ_value x)
{
    return (occ_absolute(x) < @0.3125@) ? (x + ((x * x) * occ_polynomial(occ_exponential, OCC_EXPONENTIAL, x)))
                                        : (occ_exp(x) - OCC_ONE);
}

/*.*/
/*?cosh*/
static occ_value occ_cosh(occ_value x)
{
    const occ_value high = occ_exp(occ_absolute(x));

    return (OCC_HALF * high) + (OCC_HALF / high);
}

/*.*/
/*?sinh*/
static occ_value occ_sinh(occ_value x)
{
@HYPERBOLIC@
    const occ_value z = x * x;
    occ_value high;
    occ_value found;

    if (occ_absolute(x) < OCC_ONE) {
        return x + ((x * z) * occ_polynomial(hyperbolic, OCC_HYPERBOLIC, z));
    }
    high = occ_exp(occ_absolute(x));
    found = (OCC_HALF * high) - (OCC_HALF / high);
    return (x < OCC_ZERO) ? -found : found;
}

/*.*/
/*?tanh*/
static occ_value occ_tanh(occ_value x)
{
    const occ_value a = occ_absolute(x);
    occ_value high;
    occ_value found;

    if (a < OCC_ONE) {
        high = occ_exp(a);
        return occ_sinh(x) / ((OCC_HALF * high) + (OCC_HALF / high));
    }
    found = OCC_ONE - (OCC_TWO / (occ_exp(OCC_TWO * a) + OCC_ONE));
    return (x < OCC_ZERO) ? -found : found;
}

/*.*/
/*?area*/
/* log((1 + s)/(1 - s)) near 0 */
static occ_value occ_area(occ_value s)
{
@AREA@
    const occ_value z = s * s;

    return (OCC_TWO * s) + ((s * z) * occ_polynomial(area, OCC_AREA, z));
}

/*.*/
/*?log*/
static occ_value occ_log(occ_value x)
{
    occ_value m;
    occ_value k;
    int32_t e;

    if ((!(x > OCC_ZERO)) || (!(x <= OCC_LARGEST))) {
        m = (x < OCC_ZERO) ? ((x - x) / (x - x)) : x;
        return (occ_absolute(x) <= OCC_ZERO) ? (-OCC_ONE / occ_absolute(x)) : m;
    }
    m = occ_split(x, &e);
    if (m > @1.4375@) {
        m *= OCC_HALF;
        e++;
    }
    k = (occ_value)e;
    return (k * OCC_LN2_HIGH) + (occ_area((m - OCC_ONE) / (m + OCC_ONE)) + (k * OCC_LN2_LOW));
}

/*.*/
/*?log1p*/
static occ_value occ_log1p(occ_value x)
{
    return (occ_absolute(x) < @0.3125@) ? occ_area(x / (OCC_TWO + x)) : occ_log(OCC_ONE + x);
}

/*.*/
/*?asinh*/
static occ_value occ_asinh(occ_value x)
{
    const occ_value a = occ_absolute(x);
    const occ_value found = occ_log1p(a + ((a * a) / (OCC_ONE + occ_sqrt((a * a) + OCC_ONE))));

    return (x < OCC_ZERO) ? -found : found;
}

/*.*/
/*?acosh*/
static occ_value occ_acosh(occ_value x)
{
    return occ_log(x + occ_sqrt((x - OCC_ONE) * (x + OCC_ONE)));
}

/*.*/
/*?atanh*/
static occ_value occ_atanh(occ_value x)
{
    const occ_value a = occ_absolute(x);
    const occ_value found = OCC_HALF * occ_log1p((OCC_TWO * a) / (OCC_ONE - a));

    return (x < OCC_ZERO) ? -found : found;
}

/*.*/
/*?atan*/
static occ_value occ_atan(occ_value x)
{
@ARC@
@ARCS@
    const occ_value a = occ_absolute(x);
    occ_value b = a;
    occ_value k;
    occ_value t;
    occ_value z;
    occ_value found;

    if (a > OCC_ONE) {
        b = OCC_ONE / a;
    }
    if (!(b <= OCC_ONE)) {
        return x;
    }
    k = occ_floor((@8.0@ * b) + OCC_HALF);
    t = (b - (k * @0.125@)) / (OCC_ONE + (b * (k * @0.125@)));
    z = t * t;
    found = arcs[(uint32_t)k] + (t + ((t * z) * occ_polynomial(arc, OCC_ARC, z)));
    if (a > OCC_ONE) {
        found = OCC_HALF_PI - found;
    }
    return (x < OCC_ZERO) ? -found : found;
}

/*.*/
/*?atan2*/
static occ_value occ_atan2(occ_value y, occ_value x)
{
    const occ_value a = occ_absolute(y);
    const occ_value b = occ_absolute(x);
    occ_value found = a;

    if (a > b) {
        found = OCC_HALF_PI - occ_atan(b / a);
    } else if (b > OCC_ZERO) {
        found = occ_atan(a / b);
    } else {
        /* 0, or not a number */
    }
    if (x < OCC_ZERO) {
        found = OCC_PI - found;
    }
    return (y < OCC_ZERO) ? -found : found;
}

/*.*/
/*?asin*/
static occ_value occ_asin(occ_value x)
{
    return occ_atan2(x, occ_sqrt((OCC_ONE - x) * (OCC_ONE + x)));
}

/*.*/
/*?acos*/
static occ_value occ_acos(occ_value x)
{
    return occ_atan2(occ_sqrt((OCC_ONE - x) * (OCC_ONE + x)), x);
}

/*.*/
/*?pow*/
static occ_value occ_pow(occ_value x, occ_value y)
{
    const occ_value a = occ_absolute(x);
    const occ_value found = occ_exp(y * occ_log(a));
    const occ_value half = OCC_TWO * occ_floor(y * OCC_HALF);

    if ((x > OCC_ZERO) || (occ_is_nan(x) != 0U)) {
        return found;
    }
    if (!(x < OCC_ZERO)) { /* 0 */
        if (y < OCC_ZERO) {
            return OCC_ONE / a;
        }
        return (y > OCC_ZERO) ? OCC_ZERO : OCC_ONE;
    }
    if (occ_floor(y) < y) {
        return (x - x) / (x - x);
    }
    return (half < y) ? -found : found;
}

/*.*/
