/* SPDX-License-Identifier: Apache-2.0
 * Copyright 2026 valve_twin maintainers
 *
 * The valve of model.h as FMI 2.0 for co-simulation.
 */
#include "fmi2Functions.h"
#include "model.h"

typedef struct {
    VtState state;
    const fmi2CallbackFunctions *callbacks;
    int logs;
    char name[VT_TEXT];
} Instance;

static fmi2Status answer(Instance *instance, int failed, const char *why)
{
    if (failed && instance->callbacks && instance->callbacks->logger)
        instance->callbacks->logger(instance->callbacks->componentEnvironment, instance->name,
                                    fmi2Error, "logStatusError", "%s", why);
    return failed ? fmi2Error : fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logs)
{
    (void)place;
    (void)visible;
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) return NULL;
    instance->callbacks = callbacks;
    instance->logs = logs;
    snprintf(instance->name, sizeof instance->name, "%s", name ? name : "");
    if (type != fmi2CoSimulation || !guid || strcmp(guid, VT_TOKEN) != 0) {
        answer(instance, 1, type != fmi2CoSimulation ? "it is for co-simulation only"
                                                     : "the guid is that of another FMU");
        free(instance);
        return NULL;
    }
    vt_reset(&instance->state);
    return instance;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    (void)n;
    (void)names;
    ((Instance *)c)->logs = on;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)stop;
    Instance *instance = c;
    if (instance->state.mode != VT_MADE) return answer(instance, 1, "set up after its start");
    instance->state.start = instance->state.time = instance->state.value[VT_TIME] = start;
    return answer(instance, !isfinite(start), "the start time is not finite");
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    if (instance->state.mode != VT_MADE) return answer(instance, 1, "initialized twice");
    instance->state.mode = VT_INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    char why[VT_TEXT] = "no initialization to leave";
    int failed = instance->state.mode != VT_INITIALIZING || vt_begin(&instance->state, why);
    return answer(instance, failed, why);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    ((Instance *)c)->state.mode = VT_ENDED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    vt_reset(&((Instance *)c)->state);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    char why[VT_TEXT];
    for (size_t i = 0; i < n; i++)
        if (vt_get(&((Instance *)c)->state, vr[i], &value[i], why)) return answer(c, 1, why);
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[])
{
    char why[VT_TEXT];
    for (size_t i = 0; i < n; i++)
        if (vt_set(&((Instance *)c)->state, vr[i], value[i], why)) return answer(c, 1, why);
    return fmi2OK;
}

#define NONE_OF(Kind)                                                                            \
    fmi2Status fmi2Get##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n,            \
                             fmi2##Kind value[])                                                  \
    {                                                                                             \
        (void)vr;                                                                                 \
        (void)value;                                                                              \
        return answer(c, n > 0, "it has variables of type Real only");                            \
    }                                                                                             \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n,            \
                             const fmi2##Kind value[])                                            \
    {                                                                                             \
        (void)vr;                                                                                 \
        (void)value;                                                                              \
        return answer(c, n > 0, "it has variables of type Real only");                            \
    }
NONE_OF(Integer)
NONE_OF(Boolean)
NONE_OF(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    if (!*kept) *kept = malloc(sizeof(VtState));
    if (!*kept) return answer(c, 1, "no memory");
    memcpy(*kept, &((Instance *)c)->state, sizeof(VtState));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate kept)
{
    if (!kept) return answer(c, 1, "no state to go back to");
    memcpy(&((Instance *)c)->state, kept, sizeof(VtState));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *kept)
{
    (void)c;
    free(*kept);
    *kept = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate kept, size_t *size)
{
    (void)c;
    (void)kept;
    *size = sizeof(VtState);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate kept, fmi2Byte bytes[], size_t size)
{
    if (!kept || size != sizeof(VtState)) return answer(c, 1, "another size than its state's");
    memcpy(bytes, kept, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *kept)
{
    if (size != sizeof(VtState)) return answer(c, 1, "another size than its state's");
    if (!*kept) *kept = malloc(size);
    if (!*kept) return answer(c, 1, "no memory");
    memcpy(*kept, bytes, size);
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real seed[], fmi2Real out[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)out;
    return answer(c, 1, "it gives no derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return answer(c, n > 0, "inputs are held, they have no derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return answer(c, n > 0, "outputs have no derivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean no_way_back)
{
    (void)no_way_back;
    char why[VT_TEXT];
    int failed = vt_advance(&((Instance *)c)->state, from, step, why);
    return answer(c, failed, why);
}

fmi2Status fmi2CancelStep(fmi2Component c) { return answer(c, 1, "a step is never pending"); }

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    return answer(c, 1, "a step is never pending");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return answer(c, 1, "a step is never pending");
    *value = ((Instance *)c)->state.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind;
    (void)value;
    return answer(c, 1, "a step is never pending");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) return answer(c, 1, "a step is never pending");
    *value = ((Instance *)c)->state.mode == VT_BROKEN;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind;
    (void)value;
    return answer(c, 1, "a step is never pending");
}
