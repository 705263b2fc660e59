/* SPDX-License-Identifier: Apache-2.0
 * Copyright 2026 valve_twin maintainers
 *
 * The valve of law.h in samples of VT_PERIOD: what both versions of FMI share. Everything that
 * changes lies in a VtState without pointers, so that a copy of its bytes is its whole state.
 *
 * An input acts VT_LAG samples after it was sampled; it is sampled where a communication step
 * begins at or crosses the time of a sample, and held until the next. Before the first input
 * acts the output stays where it started.
 */
#ifndef VT_MODEL_H
#define VT_MODEL_H

#include "law.h"
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum { VT_TIME, VT_INPUT, VT_OUTPUT = VT_INPUT + VT_INPUTS, VT_FIRST, VT_PARAMETER,
       VT_STATE = VT_PARAMETER + VT_PARAMETERS, VT_DELAY = VT_STATE + VT_STATES - 1, VT_COUNT };
enum { VT_MADE, VT_INITIALIZING, VT_RUNNING, VT_ENDED, VT_BROKEN };
enum { VT_TEXT = 256 };

typedef struct {
    int mode;
    int taken;        /* whether the inputs of the present sample are in the line */
    long long sample; /* samples since the start */
    double start, time;
    double value[VT_COUNT];
    double x[VT_STATES];
    double line[VT_LAG + 1][VT_INPUTS];
} VtState;

static void vt_reset(VtState *s)
{
    memset(s, 0, sizeof *s);
    memcpy(s->value, vt_start, sizeof s->value);
}

/* Put what the valve is into what is read of it. */
static void vt_show(VtState *s)
{
    s->value[VT_TIME] = s->time;
    s->value[VT_OUTPUT] = s->x[0];
    for (int i = 1; i < VT_STATES; i++) s->value[VT_STATE + i - 1] = s->x[i];
}

/* Begin at the start position; returns 0 or says in `why` what is wrong. */
static int vt_begin(VtState *s, char *why)
{
    s->sample = 0;
    s->taken = 0;
    s->time = s->start;
    memset(s->x, 0, sizeof s->x);
    s->x[0] = s->value[VT_FIRST];
    vt_rest(s->x, s->value + VT_INPUT, s->value + VT_PARAMETER);
    vt_show(s);
    s->mode = VT_RUNNING;
    for (int i = 0; i < VT_STATES; i++)
        if (!isfinite(s->x[i])) {
            snprintf(why, VT_TEXT, "a state is not finite at the start");
            return 1;
        }
    return 0;
}

static int vt_set(VtState *s, unsigned reference, double value, char *why)
{
    if (reference >= VT_COUNT) {
        snprintf(why, VT_TEXT, "value reference %u: there is none", reference);
        return 1;
    }
    const char *name = vt_names[reference];
    int input = reference >= VT_INPUT && reference < VT_OUTPUT;
    int parameter = reference >= VT_PARAMETER && reference < VT_STATE;
    int first = reference == VT_FIRST && s->mode <= VT_INITIALIZING;
    if (!input && !parameter && !first) {
        snprintf(why, VT_TEXT, "%s: cannot be set now", name);
        return 1;
    }
    if (!isfinite(value)) {
        snprintf(why, VT_TEXT, "%s = %g: must be a finite number", name, value);
        return 1;
    }
    if (parameter) {
        double low = vt_lower[reference - VT_PARAMETER], high = vt_upper[reference - VT_PARAMETER];
        if (value < low || value > high) {
            snprintf(why, VT_TEXT, "%s = %g: must lie from %g to %g", name, value, low, high);
            return 1;
        }
    }
    s->value[reference] = value;
    if (first) {
        s->x[0] = value;
        vt_show(s);
    }
    return 0;
}

static int vt_get(const VtState *s, unsigned reference, double *value, char *why)
{
    if (reference >= VT_COUNT) {
        snprintf(why, VT_TEXT, "value reference %u: there is none", reference);
        return 1;
    }
    *value = s->value[reference];
    return 0;
}

/* Advance to `from` + `step`; returns 0 or says in `why` what is wrong. */
static int vt_advance(VtState *s, double from, double step, char *why)
{
    const double near = 1e-6 * VT_PERIOD;
    if (s->mode != VT_RUNNING) {
        snprintf(why, VT_TEXT, "a step before the initialization or after the end");
        return 1;
    }
    if (!(step > 0.0) || !isfinite(step) || !(fabs(from - s->time) <= near + 1e-12 * fabs(from))) {
        snprintf(why, VT_TEXT, "a step of %g s from %g s: must be above 0 and from %g s on", step,
                 from, s->time);
        return 1;
    }
    const double until = from + step;
    for (;;) {
        double next = s->start + (double)(s->sample + 1) * VT_PERIOD;
        if (!s->taken) {
            memcpy(s->line[s->sample % (VT_LAG + 1)], s->value + VT_INPUT,
                   sizeof s->line[0]);
            s->taken = 1;
        }
        if (next > until + near) break;
        s->sample++;
        s->taken = 0;
        if (s->sample >= VT_LAG)
            vt_step(s->x, s->line[(s->sample - VT_LAG) % (VT_LAG + 1)],
                    s->value + VT_PARAMETER);
        for (int i = 0; i < VT_STATES; i++)
            if (!isfinite(s->x[i])) {
                snprintf(why, VT_TEXT, "state %d is not finite at %g s", i, next);
                s->mode = VT_BROKEN;
                return 1;
            }
        if (next >= until - near) break; /* the next sample takes the inputs of the next step */
    }
    s->time = until;
    vt_show(s);
    return 0;
}

#endif
