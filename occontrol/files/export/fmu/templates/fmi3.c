/* FMI 3.0, co-simulation. */
#include <stdbool.h>

typedef void *fmi3Instance;
typedef uint32_t fmi3ValueReference;
typedef const char *fmi3String;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;

OCC_EXPORT const char *fmi3GetVersion(void);
OCC_EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

OCC_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n_required, void *environment,
    const void *log, const void *update);
OCC_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n_required, void *environment,
    const void *log, const void *update)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early;
    (void)required;
    (void)n_required;
    (void)environment;
    (void)log;
    (void)update;
    return events ? NULL : occ_take(token);
}

OCC_EXPORT void fmi3FreeInstance(fmi3Instance c);
OCC_EXPORT void fmi3FreeInstance(fmi3Instance c)
{
    if (c != NULL) {
        ((occ_instance *)c)->taken = 0U;
    }
}

OCC_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                  fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop);
OCC_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                                  fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return (c != NULL) ? fmi3OK : fmi3Error;
}

OCC_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c);
OCC_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    if (c == NULL) {
        return fmi3Error;
    }
    occ_begin((occ_instance *)c);
    return fmi3OK;
}

OCC_EXPORT fmi3Status fmi3Terminate(fmi3Instance c);
OCC_EXPORT fmi3Status fmi3Terminate(fmi3Instance c)
{
    return (c != NULL) ? fmi3OK : fmi3Error;
}

OCC_EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance c);
OCC_EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    return (c != NULL) ? fmi3OK : fmi3Error;
}

OCC_EXPORT fmi3Status fmi3Reset(fmi3Instance c);
OCC_EXPORT fmi3Status fmi3Reset(fmi3Instance c)
{
    if (c == NULL) {
        return fmi3Error;
    }
    occ_restart((occ_instance *)c);
    return fmi3OK;
}

OCC_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]);
OCC_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)on;
    (void)n;
    (void)categories;
    return (c != NULL) ? fmi3OK : fmi3Error;
}

OCC_EXPORT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 step, fmi3Boolean no_return,
                                 fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last);
OCC_EXPORT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 step, fmi3Boolean no_return,
                                 fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last)
{
    (void)no_return;
    if ((c == NULL) || (event == NULL) || (end == NULL) || (early == NULL) || (last == NULL)) {
        return fmi3Error;
    }
    *event = false;
    *end = false;
    *early = false;
    *last = t + step;
    return (occ_advance((occ_instance *)c, t + step) != 0) ? fmi3OK : fmi3Warning;
}

/* getters and setters, all alike */
@ACCESS@
@REFUSED@
