/* SPDX-License-Identifier: Apache-2.0
 * Copyright 2026 valve_twin maintainers
 *
 * The valve of model.h as FMI 3.0 for co-simulation.
 */
#include "fmi3Functions.h"
#include "model.h"

typedef struct {
    VtState state;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Instance;

static fmi3Status answer(fmi3Instance c, int failed, const char *why)
{
    Instance *instance = c;
    if (failed && instance && instance->log)
        instance->log(instance->environment, fmi3Error, "logStatusError", why);
    return failed ? fmi3Error : fmi3OK;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, fmi3Boolean logs,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference wanted[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)place, (void)visible, (void)logs, (void)early, (void)wanted, (void)update;
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) return NULL;
    instance->log = log;
    instance->environment = environment;
    const char *why = !token || strcmp(token, VT_TOKEN) != 0 ? "the token is that of another FMU"
                      : events || n > 0                      ? "it has no events and no updates"
                                                             : NULL;
    if (why) {
        answer(instance, 1, why);
        free(instance);
        return NULL;
    }
    vt_reset(&instance->state);
    return instance;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)c, (void)on, (void)n, (void)names;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerant, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    (void)tolerant, (void)tolerance, (void)ends, (void)stop;
    VtState *s = &((Instance *)c)->state;
    if (s->mode != VT_MADE) return answer(c, 1, "initialized twice");
    if (!isfinite(start)) return answer(c, 1, "the start time is not finite");
    s->start = s->time = s->value[VT_TIME] = start;
    s->mode = VT_INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    char why[VT_TEXT] = "no initialization to leave";
    VtState *s = &((Instance *)c)->state;
    int failed = s->mode != VT_INITIALIZING || vt_begin(s, why);
    return answer(c, failed, why);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    ((Instance *)c)->state.mode = VT_ENDED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    vt_reset(&((Instance *)c)->state);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Float64 value[], size_t values)
{
    char why[VT_TEXT];
    if (n != values) return answer(c, 1, "as many values as variables, please");
    for (size_t i = 0; i < n; i++)
        if (vt_get(&((Instance *)c)->state, vr[i], &value[i], why)) return answer(c, 1, why);
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 value[], size_t values)
{
    char why[VT_TEXT];
    if (n != values) return answer(c, 1, "as many values as variables, please");
    for (size_t i = 0; i < n; i++)
        if (vt_set(&((Instance *)c)->state, vr[i], value[i], why)) return answer(c, 1, why);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 from, fmi3Float64 step, fmi3Boolean no_way_back,
                      fmi3Boolean *event, fmi3Boolean *ends, fmi3Boolean *early, fmi3Float64 *last)
{
    (void)no_way_back;
    char why[VT_TEXT];
    VtState *s = &((Instance *)c)->state;
    int failed = vt_advance(s, from, step, why);
    *event = *ends = *early = fmi3False;
    *last = s->time;
    return answer(c, failed, why);
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *kept)
{
    if (!*kept) *kept = malloc(sizeof(VtState));
    if (!*kept) return answer(c, 1, "no memory");
    memcpy(*kept, &((Instance *)c)->state, sizeof(VtState));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState kept)
{
    if (!kept) return answer(c, 1, "no state to go back to");
    memcpy(&((Instance *)c)->state, kept, sizeof(VtState));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *kept)
{
    (void)c;
    free(*kept);
    *kept = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState kept, size_t *size)
{
    (void)c, (void)kept;
    *size = sizeof(VtState);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState kept, fmi3Byte bytes[], size_t size)
{
    if (!kept || size != sizeof(VtState)) return answer(c, 1, "another size than its state's");
    memcpy(bytes, kept, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *kept)
{
    if (size != sizeof(VtState)) return answer(c, 1, "another size than its state's");
    if (!*kept) *kept = malloc(size);
    if (!*kept) return answer(c, 1, "no memory");
    memcpy(*kept, bytes, size);
    return fmi3OK;
}

/* Types that it has no variables of. */
#define HAS_NO(Kind)                                                                              \
    fmi3Status fmi3Get##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n,             \
                             fmi3##Kind value[], size_t values)                                   \
    {                                                                                             \
        (void)vr, (void)value, (void)values;                                                      \
        return answer(c, n > 0, "it has variables of type Float64 only");                         \
    }                                                                                             \
    fmi3Status fmi3Set##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n,             \
                             const fmi3##Kind value[], size_t values)                             \
    {                                                                                             \
        (void)vr, (void)value, (void)values;                                                      \
        return answer(c, n > 0, "it has variables of type Float64 only");                         \
    }
HAS_NO(Float32)
HAS_NO(Int8)
HAS_NO(UInt8)
HAS_NO(Int16)
HAS_NO(UInt16)
HAS_NO(Int32)
HAS_NO(UInt32)
HAS_NO(Int64)
HAS_NO(UInt64)
HAS_NO(Boolean)
HAS_NO(String)

/* Functions of what it has not: modes, clocks, derivatives, the other kinds of FMU. */
#define LACKS(Name, ...)                                                                          \
    fmi3Status fmi3##Name(fmi3Instance c, ##__VA_ARGS__)                                          \
    {                                                                                             \
        return answer(c, 1, #Name ": it has no such thing");                                      \
    }
#define VR const fmi3ValueReference vr[], size_t n
LACKS(GetBinary, VR, size_t sizes[], fmi3Binary value[], size_t values)
LACKS(SetBinary, VR, const size_t sizes[], const fmi3Binary value[], size_t values)
LACKS(GetClock, VR, fmi3Clock value[])
LACKS(SetClock, VR, const fmi3Clock value[])
LACKS(EnterEventMode)
LACKS(EnterStepMode)
LACKS(EnterConfigurationMode)
LACKS(ExitConfigurationMode)
LACKS(EvaluateDiscreteStates)
LACKS(EnterContinuousTimeMode)
LACKS(GetNumberOfVariableDependencies, fmi3ValueReference of, size_t *n)
LACKS(GetVariableDependencies, fmi3ValueReference of, size_t at[], fmi3ValueReference on[],
      size_t places[], fmi3DependencyKind kinds[], size_t n)
LACKS(GetDirectionalDerivative, VR, const fmi3ValueReference knowns[], size_t k,
      const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t values)
LACKS(GetAdjointDerivative, VR, const fmi3ValueReference knowns[], size_t k,
      const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t values)
LACKS(GetIntervalDecimal, VR, fmi3Float64 value[], fmi3IntervalQualifier kinds[])
LACKS(GetIntervalFraction, VR, fmi3UInt64 count[], fmi3UInt64 parts[],
      fmi3IntervalQualifier kinds[])
LACKS(GetShiftDecimal, VR, fmi3Float64 value[])
LACKS(GetShiftFraction, VR, fmi3UInt64 count[], fmi3UInt64 parts[])
LACKS(SetIntervalDecimal, VR, const fmi3Float64 value[])
LACKS(SetIntervalFraction, VR, const fmi3UInt64 count[], const fmi3UInt64 parts[])
LACKS(SetShiftDecimal, VR, const fmi3Float64 value[])
LACKS(SetShiftFraction, VR, const fmi3UInt64 count[], const fmi3UInt64 parts[])
LACKS(UpdateDiscreteStates, fmi3Boolean *more, fmi3Boolean *ends, fmi3Boolean *nominals,
      fmi3Boolean *values, fmi3Boolean *timed, fmi3Float64 *next)
LACKS(CompletedIntegratorStep, fmi3Boolean no_way_back, fmi3Boolean *event, fmi3Boolean *ends)
LACKS(SetTime, fmi3Float64 time)
LACKS(SetContinuousStates, const fmi3Float64 value[], size_t n)
LACKS(GetContinuousStateDerivatives, fmi3Float64 value[], size_t n)
LACKS(GetEventIndicators, fmi3Float64 value[], size_t n)
LACKS(GetContinuousStates, fmi3Float64 value[], size_t n)
LACKS(GetNominalsOfContinuousStates, fmi3Float64 value[], size_t n)
LACKS(GetNumberOfEventIndicators, size_t *n)
LACKS(GetNumberOfContinuousStates, size_t *n)
LACKS(GetOutputDerivatives, VR, const fmi3Int32 orders[], fmi3Float64 value[], size_t values)
LACKS(ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place,
                                          fmi3Boolean visible, fmi3Boolean logs,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)place, (void)visible, (void)logs;
    if (log) log(environment, fmi3Error, "logStatusError", "it is for co-simulation only");
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible, fmi3Boolean logs,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)place, (void)visible, (void)logs;
    (void)clock, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", "it is for co-simulation only");
    return NULL;
}
