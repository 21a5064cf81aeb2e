/* The FMI 2.0 functions for co-simulation of the twin of one axis: creating and freeing an
 * instance, its variables and its steps.
 *
 * A refused call leaves the instance unchanged and logs the reason. The variables are described in
 * docs/files.md. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "component.h"

/* NOLINTBEGIN(readability-identifier-naming): the standard's names */

/* Value references; a parameter's is kFirstParameter + kPerEffect * effect + place, the shapes
 * first and the coefficients from kMaxShapes on. */
enum {
  kCommand,
  kNeighbourAcceleration,
  kInCut,
  kTrackingError,
  kPosition,
  kVelocity,
  kFirstParameter = 16,
  kPerEffect = kMaxShapes + kMaxCoefficients
};

fmi2Status servotwin_refuse(const Component* c, fmi2Status status, const char* format, ...) {
  char message[kMessage];
  va_list values;
  va_start(values, format);
  /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is, by va_start */
  vsnprintf(message, sizeof message, format, values);
  va_end(values);
  if (c->functions.logger != NULL) {
    c->functions.logger(c->functions.componentEnvironment, c->name, status,
                        status == fmi2Error ? "logStatusError" : "logStatusDiscard", "%s", message);
  }
  return status;
}

const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }

static void reset(Component* c) {
  memset(&c->state, 0, sizeof c->state);
  memcpy(c->state.guid, c->unit.guid, sizeof c->state.guid);
  c->state.mode = kInstantiated;
  c->state.set.model = c->unit.model;
}

static int hexadecimal(char digit) {
  const char* const digits = "0123456789abcdef";
  const char lower = (char)(digit >= 'A' && digit <= 'F' ? digit - 'A' + 'a' : digit);
  const char* at = lower != '\0' ? strchr(digits, lower) : NULL;
  return at != NULL ? (int)(at - digits) : -1;
}

/* The file model.txt in the folder of this URI, "file:///a/b" or "file:/a/b"; 0: none. */
static int model_file_of(const char* uri, char* file, size_t size) {
  static const char kScheme[] = "file:", kLocal[] = "//localhost/", kName[] = "/model.txt";
  size_t length = 0;
  if (uri == NULL || strncmp(uri, kScheme, sizeof kScheme - 1) != 0) return 0;
  uri += sizeof kScheme - 1;
  if (strncmp(uri, kLocal, sizeof kLocal - 1) == 0) {
    uri += sizeof kLocal - 2;
  } else if (strncmp(uri, "//", 2) == 0) {
    uri += 2;
  }
#if defined(_WIN32)
  if (uri[0] == '/' && uri[1] != '\0' && uri[2] == ':') uri += 1;
#endif
  while (*uri != '\0' && length + sizeof kName < size) {
    const int high = *uri == '%' ? hexadecimal(uri[1]) : -1;
    const int low = high >= 0 ? hexadecimal(uri[2]) : -1;
    file[length++] = low >= 0 ? (char)(16 * high + low) : *uri;
    uri += low >= 0 ? 3 : 1;
  }
  if (*uri != '\0') return 0;
  while (length > 0 && file[length - 1] == '/') --length;
  memcpy(file + length, kName, sizeof kName);
  return 1;
}

fmi2Component fmi2Instantiate(fmi2String instance, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions* functions,
                              fmi2Boolean visible, fmi2Boolean logging) {
  char file[4096], why[kMessage];
  Component* c = NULL;
  (void)visible;
  (void)logging;
  if (functions == NULL) return NULL;
  c = servotwin_allocate(functions, sizeof *c);
  if (c == NULL) return NULL;
  memset(c, 0, sizeof *c);
  c->functions = *functions;
  if (instance != NULL) strncpy(c->name, instance, sizeof c->name - 1);
  why[0] = '\0';
  if (type != fmi2CoSimulation) {
    snprintf(why, sizeof why, "the unit is for co-simulation only");
  } else if (!model_file_of(resources, file, sizeof file)) {
    snprintf(why, sizeof why, "fmuResourceLocation '%.300s' is not a file: URI of a folder",
             resources != NULL ? resources : "");
  } else if (servotwin_read_model(file, &c->unit, why) &&
             (guid == NULL || strcmp(guid, c->unit.guid) != 0)) {
    snprintf(why, sizeof why, "the GUID is %.100s, that of resources/model.txt is %.100s",
             guid != NULL ? guid : "not given", c->unit.guid);
  }
  if (why[0] != '\0') {
    servotwin_refuse(c, fmi2Error, "%s", why);
    fmi2FreeInstance(c);
    return NULL;
  }
  reset(c);
  return c;
}

void fmi2FreeInstance(fmi2Component component) {
  Component* c = component;
  if (c == NULL) return;
  const fmi2CallbackFunctions functions = c->functions; /* c itself is freed with them */
  servotwin_free(&functions, c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String categories[]) {
  (void)c;
  (void)on;
  (void)count;
  (void)categories;
  return fmi2OK; /* only reasons of refusals are logged */
}

static fmi2Status change_mode(Component* c, Mode from, Mode to, const char* function) {
  if (c->state.mode != from)
    return servotwin_refuse(c, fmi2Error, "%s is not allowed in this state", function);
  c->state.mode = to;
  return fmi2OK;
}

static void start(Component* c) {
  servotwin_start(&c->state.set.model, &c->state.axis, c->state.set.command, c->state.start_s);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined,
                               fmi2Real tolerance, fmi2Real start_s, fmi2Boolean stop_defined,
                               fmi2Real stop) {
  Component* c = component;
  (void)tolerance_defined;
  (void)tolerance;
  (void)stop_defined;
  (void)stop;
  if (!isfinite(start_s)) return servotwin_refuse(c, fmi2Error, "the start time is not finite");
  c->state.start_s = start_s;
  return change_mode(c, kInstantiated, kInstantiated, "fmi2SetupExperiment");
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  return change_mode(c, kInstantiated, kInitializing, "fmi2EnterInitializationMode");
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
  Component* c = component;
  const fmi2Status status = change_mode(c, kInitializing, kStepping, "fmi2ExitInitializationMode");
  if (status == fmi2OK) start(c);
  return status;
}

fmi2Status fmi2Terminate(fmi2Component c) {
  return change_mode(c, kStepping, kTerminated, "fmi2Terminate");
}

fmi2Status fmi2Reset(fmi2Component c) {
  reset(c);
  return fmi2OK;
}

/* The address of a parameter, and its bounds; NULL: no parameter has this reference. */
static double* parameter_of(Component* c, fmi2ValueReference vr, const Bounds** bounds) {
  int count = 0;
  if (vr < kFirstParameter) return NULL;
  const int effect = (int)(vr - kFirstParameter) / kPerEffect;
  const int place = (int)(vr - kFirstParameter) % kPerEffect;
  if (vr >= kFirstParameter + kPerEffect * (unsigned)c->state.set.model.effects) return NULL;
  AxisEffect* e = &c->state.set.model.effect[effect];
  const EffectKind* kind = &servotwin_effects(&count)[e->kind];
  if (place < kind->shapes) {
    *bounds = &c->unit.shape[effect][place];
    return &e->shape[place];
  }
  if (place >= kMaxShapes && place - kMaxShapes < kind->coefficients) {
    *bounds = &c->unit.coefficient[effect][place - kMaxShapes];
    return &e->coefficient[place - kMaxShapes];
  }
  return NULL;
}

static double* input_of(State* s, fmi2ValueReference vr) {
  switch (vr) {
    case kCommand:
      return &s->set.command;
    case kNeighbourAcceleration:
      return &s->set.neighbour_acceleration;
    case kInCut:
      return &s->set.in_cut;
    default:
      return NULL;
  }
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t count,
                       fmi2Real value[]) {
  Component* c = component;
  State* s = &c->state;
  if (s->mode == kInitializing) start(c); /* with the values set during initialization */
  const double reading = s->axis.position + s->axis.reading;
  for (size_t i = 0; i < count; ++i) {
    const Bounds* bounds = NULL;
    const double* own = input_of(s, vr[i]);
    if (own == NULL) own = parameter_of(c, vr[i], &bounds);
    if (own != NULL) {
      value[i] = *own;
    } else if (vr[i] >= kTrackingError && vr[i] <= kVelocity && s->mode == kInstantiated) {
      return servotwin_refuse(c, fmi2Error, "outputs are available from initialization mode on");
    } else if (vr[i] == kTrackingError) {
      value[i] = s->set.command - reading;
    } else if (vr[i] == kPosition) {
      value[i] = reading;
    } else if (vr[i] == kVelocity) {
      value[i] = s->axis.velocity;
    } else {
      return servotwin_refuse(c, fmi2Error, "there is no real variable %u", vr[i]);
    }
  }
  return fmi2OK;
}

/* Sets one variable; it may be changed even if it is refused. */
static fmi2Status set_real(Component* c, fmi2ValueReference vr, double value) {
  const Bounds* bounds = NULL;
  double* own = input_of(&c->state, vr);
  if (own == NULL) own = parameter_of(c, vr, &bounds);
  if (own == NULL) return servotwin_refuse(c, fmi2Error, "variable %u cannot be set", vr);
  if (!isfinite(value))
    return servotwin_refuse(c, fmi2Error, "variable %u: %g is not finite", vr, value);
  if (bounds != NULL && c->state.mode > kInitializing)
    return servotwin_refuse(c, fmi2Error, "%s is fixed after initialization", bounds->name);
  if (bounds != NULL && (value < bounds->lower || value > bounds->upper)) {
    return servotwin_refuse(c, fmi2Error, "%s = %g is outside %g .. %g", bounds->name, value,
                            bounds->lower, bounds->upper);
  }
  *own = value;
  if (servotwin_delay_s(&c->state.set.model) >
      (kMaxDelayCycles + 1e-3) * c->state.set.model.cycle_s) {
    return servotwin_refuse(c, fmi2Error, "a delay of %g s is more than %d cycles of %g s", value,
                            (int)kMaxDelayCycles, c->state.set.model.cycle_s);
  }
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[]) {
  Component* c = component;
  const Settable before = c->state.set;
  for (size_t i = 0; i < count; ++i) {
    const fmi2Status status = set_real(c, vr[i], value[i]);
    if (status == fmi2OK) continue;
    c->state.set = before;
    return status;
  }
  return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[],
                                       size_t count, const fmi2Integer order[],
                                       const fmi2Real value[]) {
  Component* c = component;
  for (size_t i = 0; i < count; ++i) {
    if (vr[i] != kCommand || order[i] < 1 || order[i] > kOrders) {
      return servotwin_refuse(c, fmi2Error, "only derivatives 1 to %d of the command can be given",
                              (int)kOrders);
    }
    if (!isfinite(value[i])) return servotwin_refuse(c, fmi2Error, "a derivative is not finite");
  }
  for (size_t i = 0; i < count; ++i) c->state.derivative[order[i] - 1] = value[i];
  if (count > 0) c->state.derivatives_given = 1;
  return fmi2OK;
}

/* One cycle whose command is a cubic that began `from_s` before it and is known. */
static void step_along(State* s, double from_s) {
  const double h = s->set.model.cycle_s, end_s = from_s + h;
  const double* d = s->derivative;
  const double end = s->set.command + end_s * (d[0] + end_s * (d[1] / 2 + end_s * d[2] / 6));
  if (servotwin_delay_s(&s->set.model) > 0.0) {
    servotwin_follow(&s->set.model, &s->axis, end, s->set.neighbour_acceleration, s->set.in_cut);
    return;
  }
  CommandPiece piece;
  piece.velocity = d[0] + from_s * (d[1] + from_s * d[2] / 2);
  piece.acceleration = d[1] + from_s * d[2];
  piece.jerk = d[2];
  piece.end_position = end;
  piece.end_velocity = piece.velocity + h * (piece.acceleration + h * piece.jerk / 2);
  piece.end_acceleration = piece.acceleration + h * piece.jerk;
  piece.neighbour_acceleration = s->set.neighbour_acceleration;
  piece.in_cut = s->set.in_cut;
  servotwin_step(&s->set.model, &s->axis, &piece);
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real step,
                      fmi2Boolean no_state_before) {
  Component* c = component;
  State* s = &c->state;
  const double h = s->set.model.cycle_s;
  const double at = s->start_s + s->cycles * h;
  const double cycles = floor(step / h + 0.5);
  (void)no_state_before;
  if (s->mode != kStepping)
    return servotwin_refuse(c, fmi2Error, "fmi2DoStep is not allowed in this state");
  if (!(fabs(point - at) <= h / 4)) {
    return servotwin_refuse(c, fmi2Error,
                            "the communication point is %.9g s, the last step ended at %.9g s",
                            point, at);
  }
  if (!(cycles >= 1 && cycles <= 1e9 && fabs(step - cycles * h) <= 1e-6 * h)) {
    return servotwin_refuse(
        c, fmi2Error,
        "a communication step of %.9g s is not a whole multiple of the model's sample time "
        "of %.9g s",
        step, h);
  }
  for (double i = 0; i < cycles; ++i) {
    if (s->derivatives_given) {
      step_along(s, i * h);
    } else {
      servotwin_follow(&s->set.model, &s->axis, s->set.command, s->set.neighbour_acceleration,
                       s->set.in_cut);
    }
  }
  if (s->derivatives_given) {
    const double* d = s->derivative;
    const double whole = cycles * h;
    s->set.command += whole * (d[0] + whole * (d[1] / 2 + whole * d[2] / 6));
  }
  memset(s->derivative, 0, sizeof s->derivative);
  s->derivatives_given = 0;
  s->cycles += cycles;
  return fmi2OK;
}

/* NOLINTEND(readability-identifier-naming) */
