/* The FMI 2.0 functions for states and statuses of an instance, and the required functions that
 * this unit does not support. */
#include <stdlib.h>
#include <string.h>

#include "component.h"

/* NOLINTBEGIN(readability-identifier-naming): the standard's names */

static int has_memory(const fmi2CallbackFunctions* functions) {
  return functions->allocateMemory != NULL && functions->freeMemory != NULL;
}

void* servotwin_allocate(const fmi2CallbackFunctions* functions, size_t size) {
  return has_memory(functions) ? functions->allocateMemory(1, size) : calloc(1, size);
}

void servotwin_free(const fmi2CallbackFunctions* functions, void* memory) {
  if (has_memory(functions)) {
    functions->freeMemory(memory);
  } else {
    free(memory);
  }
}

/* The states of an instance are copies of struct State. */
static fmi2Status keep(Component* c, const void* bytes, fmi2FMUstate* state) {
  if (*state == NULL) *state = servotwin_allocate(&c->functions, sizeof(State));
  if (*state == NULL) return servotwin_refuse(c, fmi2Error, "no memory for a state");
  memcpy(*state, bytes, sizeof(State));
  return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate* state) {
  Component* c = component;
  return keep(c, &c->state, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
  Component* c = component;
  if (state == NULL) return servotwin_refuse(c, fmi2Error, "there is no state");
  memcpy(&c->state, state, sizeof c->state);
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate* state) {
  const Component* c = component;
  if (state == NULL || *state == NULL) return fmi2OK;
  servotwin_free(&c->functions, *state);
  *state = NULL;
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) {
  (void)c;
  (void)state;
  *size = sizeof(State);
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
  Component* c = component;
  if (state == NULL || size < sizeof(State))
    return servotwin_refuse(c, fmi2Error, "the buffer is too small for a state");
  memcpy(bytes, state, sizeof(State));
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate* state) {
  Component* c = component;
  if (size != sizeof(State) || memcmp(bytes, c->unit.guid, strlen(c->unit.guid) + 1) != 0)
    return servotwin_refuse(c, fmi2Error, "these bytes are not a state of this unit");
  return keep(c, bytes, state);
}

/* Required functions that this unit does not support. */

static fmi2Status none_of_type(Component* c, size_t count, const char* type) {
  return count == 0 ? fmi2OK : servotwin_refuse(c, fmi2Error, "there is no %s variable", type);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Integer value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "integer");
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Boolean value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "boolean");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         fmi2String value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "string");
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Integer value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "integer");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Boolean value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "boolean");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         const fmi2String value[]) {
  (void)vr;
  (void)value;
  return none_of_type(c, count, "string");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real known_step[],
                                        fmi2Real unknown_step[]) {
  (void)unknown;
  (void)unknowns;
  (void)known;
  (void)knowns;
  (void)known_step;
  (void)unknown_step;
  return servotwin_refuse(c, fmi2Error, "there are no directional derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                        size_t count, const fmi2Integer order[], fmi2Real value[]) {
  (void)vr;
  (void)count;
  (void)order;
  (void)value;
  return servotwin_refuse(c, fmi2Error, "there are no derivatives of outputs");
}

fmi2Status fmi2CancelStep(fmi2Component c) {
  return servotwin_refuse(c, fmi2Error, "a step is done when fmi2DoStep returns");
}

fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status* value) {
  (void)kind;
  (void)value;
  return servotwin_refuse(c, fmi2Discard, "a step is done when fmi2DoStep returns");
}

fmi2Status fmi2GetRealStatus(fmi2Component component, fmi2StatusKind kind, fmi2Real* value) {
  const Component* c = component;
  if (kind != fmi2LastSuccessfulTime)
    return servotwin_refuse(c, fmi2Discard, "there is no such status");
  *value = c->state.start_s + c->state.cycles * c->state.set.model.cycle_s;
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, fmi2StatusKind kind, fmi2Integer* value) {
  (void)kind;
  (void)value;
  return servotwin_refuse(c, fmi2Discard, "there is no such status");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, fmi2StatusKind kind, fmi2Boolean* value) {
  const Component* c = component;
  if (kind != fmi2Terminated) return servotwin_refuse(c, fmi2Discard, "there is no such status");
  *value = c->state.mode == kTerminated;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, fmi2StatusKind kind, fmi2String* value) {
  (void)kind;
  (void)value;
  return servotwin_refuse(c, fmi2Discard, "there is no such status");
}

/* NOLINTEND(readability-identifier-naming) */
