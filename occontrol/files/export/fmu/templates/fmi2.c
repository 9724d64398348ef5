/* FMI 2.0, co-simulation. */
typedef void *fmi2Component;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;

OCC_EXPORT const char *fmi2GetTypesPlatform(void);
OCC_EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

OCC_EXPORT const char *fmi2GetVersion(void);
OCC_EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

OCC_EXPORT fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String guid, fmi2String resources,
                                         const void *callbacks, fmi2Boolean visible, fmi2Boolean logging);
OCC_EXPORT fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String guid, fmi2String resources,
                                         const void *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name;
    (void)resources;
    (void)callbacks;
    (void)visible;
    (void)logging;
    return (type == 1) ? occ_take(guid) : NULL;
}

OCC_EXPORT void fmi2FreeInstance(fmi2Component c);
OCC_EXPORT void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        ((occ_instance *)c)->taken = 0U;
    }
}

OCC_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                          fmi2Real start, fmi2Boolean has_stop, fmi2Real stop);
OCC_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                          fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return (c != NULL) ? fmi2OK : fmi2Error;
}

OCC_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c);
OCC_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return (c != NULL) ? fmi2OK : fmi2Error;
}

OCC_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c);
OCC_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    if (c == NULL) {
        return fmi2Error;
    }
    occ_begin((occ_instance *)c);
    return fmi2OK;
}

OCC_EXPORT fmi2Status fmi2Terminate(fmi2Component c);
OCC_EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    return (c != NULL) ? fmi2OK : fmi2Error;
}

OCC_EXPORT fmi2Status fmi2Reset(fmi2Component c);
OCC_EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    if (c == NULL) {
        return fmi2Error;
    }
    occ_restart((occ_instance *)c);
    return fmi2OK;
}

OCC_EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no_return);
OCC_EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no_return)
{
    (void)no_return;
    if (c == NULL) {
        return fmi2Error;
    }
    return (occ_advance((occ_instance *)c, t + step) != 0) ? fmi2OK : fmi2Warning;
}

OCC_EXPORT fmi2Status fmi2CancelStep(fmi2Component c);
OCC_EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

/* getters and setters, all alike */
@ACCESS@
@REFUSED@
