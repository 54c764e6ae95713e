/* A ship as a co-simulation slave of FMI 2.0: her equations of motion in model.h, steering gear and solver here.
 *
 * Inputs are held over a communication step. The rudder goes to its order at its rate. The state is integrated by the
 * classical Runge-Kutta method of fourth order; a communication step is divided into equal steps that are no longer than
 * the parameter step, and one of these is divided where the rudder arrives, so that no step crosses a kink.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2.h"
#include "model.h"

#define FUNCTION(name) FMI2_EXPORT fmi2Status FMI2_NAME(name)
#define TINY_ANGLE 1e-12
#define TINY_TIME 1e-9

typedef enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED, FAILED } Phase;

typedef struct {
    double value[VARIABLES];
    double start_time;
    Phase phase;
} Status;

typedef struct {
    Status now;
    const fmi2CallbackFunctions *functions;
    char *name;
    int logging;
} Ship;

static fmi2Status tell(const Ship *ship, fmi2Status status, const char *message)
{
    if (ship->functions->logger && (ship->logging || status >= fmi2Error))
        ship->functions->logger(ship->functions->componentEnvironment, ship->name, status,
                                status >= fmi2Error ? "logStatusError" : "logAll", "%s", message);
    return status;
}

static fmi2Status refused(const Ship *ship, const char *message) { return tell(ship, fmi2Error, message); }

static double limited(double angle, double limit) { return fmax(-limit, fmin(limit, angle)); }

/* Rudder angle after a time: evenly towards the order, then at rest. */
static double rudder_after(const double *value, double time)
{
    const double error = limited(value[DELTA_ORDER], value[RUDDER_LIMIT]) - value[DELTA];
    const double reach = value[RUDDER_RATE] * time;
    if (fabs(error) > reach + TINY_ANGLE)
        return value[DELTA] + copysign(reach, error);
    return value[DELTA] + error;
}

static void moved(const double *state, const double *rate, double time, double *out)
{
    for (int k = 0; k < STATES; k++)
        out[k] = state[k] + time * rate[k];
}

/* One Runge-Kutta step in which the rudder moves evenly or rests. */
static void runge_kutta_step(double *value, double time, double tau)
{
    double k1[STATES], k2[STATES], k3[STATES], k4[STATES], state[STATES];
    const double middle = rudder_after(value, 0.5 * tau), end = rudder_after(value, tau);
    rates(value, value, value[DELTA], time, k1);
    moved(value, k1, 0.5 * tau, state);
    rates(value, state, middle, time + 0.5 * tau, k2);
    moved(value, k2, 0.5 * tau, state);
    rates(value, state, middle, time + 0.5 * tau, k3);
    moved(value, k3, tau, state);
    rates(value, state, end, time + tau, k4);
    for (int k = 0; k < STATES; k++)
        value[k] += tau / 6.0 * (k1[k] + k4[k] + 2.0 * (k2[k] + k3[k]));
    value[DELTA] = end;
}

static void advance(double *value, double time, double length)
{
    const int count = (int)fmax(1.0, ceil(length / value[STEP] - TINY_TIME));
    for (int k = 0; k < count; k++) {
        double done = length * k / count;
        const double due = length * (k + 1) / count;
        while (due - done > TINY_TIME) {
            const double error = fabs(limited(value[DELTA_ORDER], value[RUDDER_LIMIT]) - value[DELTA]);
            const double arrival = error > TINY_ANGLE ? error / value[RUDDER_RATE] : INFINITY;
            const double tau = fmin(due - done, arrival);
            runge_kutta_step(value, time + done, tau);
            done += tau;
        }
    }
}

static int in_range(const double *value)
{
    for (int k = 0; k <= DELTA; k++)
        if (!isfinite(value[k]))
            return 0;
    return value[U] > LEAST_U && value[U] < LARGEST_U && fabs(value[V]) < LARGEST_V && fabs(value[R]) < LARGEST_R;
}

static void reset(Ship *ship)
{
    memcpy(ship->now.value, START, sizeof START);
    ship->now.start_time = 0.0;
    ship->now.phase = INSTANTIATED;
}

FMI2_EXPORT const char *FMI2_NAME(fmi2GetTypesPlatform)(void) { return "default"; }

FMI2_EXPORT const char *FMI2_NAME(fmi2GetVersion)(void) { return "2.0"; }

FMI2_EXPORT fmi2Component FMI2_NAME(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                                     fmi2Boolean logging)
{
    (void)resources;
    (void)visible;
    if (!functions || !name)
        return NULL;
    Ship *ship = calloc(1, sizeof(Ship));
    if (!ship)
        return NULL;
    ship->name = calloc(strlen(name) + 1, 1);
    ship->functions = functions;
    ship->logging = logging;
    const char *wrong = !ship->name                    ? "no memory is left"
                        : type != fmi2CoSimulation     ? "this FMU is for co-simulation only"
                        : !guid || strcmp(guid, GUID)  ? "the GUID is not that of the modelDescription.xml"
                                                       : NULL;
    if (wrong) {
        refused(ship, wrong);
        free(ship->name);
        free(ship);
        return NULL;
    }
    strcpy(ship->name, name);
    reset(ship);
    return ship;
}

FMI2_EXPORT void FMI2_NAME(fmi2FreeInstance)(fmi2Component c)
{
    Ship *ship = c;
    if (ship) {
        free(ship->name);
        free(ship);
    }
}

FUNCTION(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean logging, size_t count, const fmi2String categories[])
{
    (void)count;
    (void)categories;
    ((Ship *)c)->logging = logging;
    return fmi2OK;
}

FUNCTION(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
                              fmi2Boolean stop_given, fmi2Real stop)
{
    Ship *ship = c;
    (void)tolerance_given;
    (void)tolerance;
    (void)stop_given;
    (void)stop;
    if (ship->now.phase != INSTANTIATED)
        return refused(ship, "fmi2SetupExperiment after initialization");
    ship->now.start_time = start;
    return fmi2OK;
}

FUNCTION(fmi2EnterInitializationMode)(fmi2Component c)
{
    Ship *ship = c;
    if (ship->now.phase != INSTANTIATED)
        return refused(ship, "fmi2EnterInitializationMode twice");
    ship->now.phase = INITIALIZING;
    return fmi2OK;
}

FUNCTION(fmi2ExitInitializationMode)(fmi2Component c)
{
    Ship *ship = c;
    if (ship->now.phase != INITIALIZING)
        return refused(ship, "fmi2ExitInitializationMode without fmi2EnterInitializationMode");
    if (!in_range(ship->now.value))
        return refused(ship, "the start values of u, v or r are beyond what a ship in a manoeuvre can do");
    ship->now.phase = RUNNING;
    return fmi2OK;
}

FUNCTION(fmi2Terminate)(fmi2Component c)
{
    Ship *ship = c;
    if (ship->now.phase != RUNNING && ship->now.phase != FAILED)
        return refused(ship, "fmi2Terminate without a run");
    ship->now.phase = TERMINATED;
    return fmi2OK;
}

FUNCTION(fmi2Reset)(fmi2Component c)
{
    reset(c);
    return fmi2OK;
}

FUNCTION(fmi2GetReal)(fmi2Component c, const fmi2ValueReference reference[], size_t count, fmi2Real value[])
{
    const Ship *ship = c;
    for (size_t k = 0; k < count; k++) {
        if (reference[k] >= VARIABLES)
            return refused(ship, "fmi2GetReal of an unknown value reference");
        value[k] = reference[k] == SHAFT ? shaft(ship->now.value) : ship->now.value[reference[k]];
    }
    return fmi2OK;
}

FUNCTION(fmi2SetReal)(fmi2Component c, const fmi2ValueReference reference[], size_t count, const fmi2Real value[])
{
    Ship *ship = c;
    const Phase phase = ship->now.phase;
    if (phase >= TERMINATED)
        return refused(ship, "fmi2SetReal after the end of a run");
    for (size_t k = 0; k < count; k++) {
        if (reference[k] >= VARIABLES || reference[k] == SHAFT)
            return refused(ship, "fmi2SetReal of a value reference that cannot be set");
        if (phase == RUNNING && !TUNABLE[reference[k]])
            return refused(ship, "fmi2SetReal of a variable that can be set before a run only");
        if (!isfinite(value[k]) || value[k] < LOW[reference[k]] || value[k] > HIGH[reference[k]])
            return refused(ship, "fmi2SetReal of a value out of its range, see modelDescription.xml");
    }
    for (size_t k = 0; k < count; k++)
        ship->now.value[reference[k]] = value[k];
    return fmi2OK;
}

FUNCTION(fmi2DoStep)(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean no_return)
{
    Ship *ship = c;
    (void)no_return;
    if (ship->now.phase != RUNNING)
        return refused(ship, "fmi2DoStep outside of a run");
    if (!(length > 0.0) || !isfinite(length) || length / ship->now.value[STEP] > 1e9 || !isfinite(time))
        return refused(ship, "fmi2DoStep by a step that is not positive, or too long");
    Status before = ship->now;
    advance(ship->now.value, time - ship->now.start_time, length);
    if (!in_range(ship->now.value)) {
        ship->now = before;
        ship->now.phase = FAILED;
        return refused(ship, "u, v or r left what a ship in a manoeuvre can do: the model says nothing there");
    }
    return fmi2OK;
}

FUNCTION(fmi2CancelStep)(fmi2Component c) { return refused(c, "no step is under way"); }

FUNCTION(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state)
        *state = calloc(1, sizeof(Status));
    if (!*state)
        return refused(c, "no memory is left");
    memcpy(*state, &((Ship *)c)->now, sizeof(Status));
    return fmi2OK;
}

FUNCTION(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{
    if (!state)
        return refused(c, "fmi2SetFMUstate without a state");
    memcpy(&((Ship *)c)->now, state, sizeof(Status));
    return fmi2OK;
}

FUNCTION(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FUNCTION(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(Status);
    return fmi2OK;
}

FUNCTION(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (!state || size < sizeof(Status))
        return refused(c, "fmi2SerializeFMUstate into too few bytes");
    memcpy(bytes, state, sizeof(Status));
    return fmi2OK;
}

FUNCTION(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    if (size < sizeof(Status))
        return refused(c, "fmi2DeSerializeFMUstate of too few bytes");
    if (!*state)
        *state = calloc(1, sizeof(Status));
    if (!*state)
        return refused(c, "no memory is left");
    memcpy(*state, bytes, sizeof(Status));
    return fmi2OK;
}

/* What the ship has none of. */
#define NONE(name, kind)                                                                                               \
    FUNCTION(name)(fmi2Component c, const fmi2ValueReference reference[], size_t count, kind value[])                  \
    {                                                                                                                  \
        (void)reference;                                                                                               \
        (void)value;                                                                                                   \
        return count ? refused(c, #name ": all variables are Real") : fmi2OK;                                          \
    }
NONE(fmi2GetInteger, fmi2Integer)
NONE(fmi2GetBoolean, fmi2Boolean)
NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer)
NONE(fmi2SetBoolean, const fmi2Boolean)
NONE(fmi2SetString, const fmi2String)

FUNCTION(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                       const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                       fmi2Real value[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)value;
    return refused(c, "directional derivatives are not provided");
}

FUNCTION(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference reference[], size_t count,
                                      const fmi2Integer order[], const fmi2Real value[])
{
    (void)reference;
    (void)count;
    (void)order;
    (void)value;
    return refused(c, "inputs are held over a step: they have no derivatives");
}

FUNCTION(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference reference[], size_t count,
                                       const fmi2Integer order[], fmi2Real value[])
{
    (void)reference;
    (void)count;
    (void)order;
    (void)value;
    return refused(c, "derivatives of outputs are not provided");
}

/* Steps are done when fmi2DoStep returns: there is no status to ask for. */
#define NO_STATUS(name, kind)                                                                                          \
    FUNCTION(name)(fmi2Component c, const fmi2StatusKind what, kind *value)                                            \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        (void)what;                                                                                                    \
        (void)value;                                                                                                   \
        return fmi2Discard;                                                                                            \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetRealStatus, fmi2Real)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)
