/* The interface of a co-simulation unit: types and functions of FMI 2.0.5 that one has, named and
 * typed as the standard has them (Functional Mock-up Interface for Model Exchange and
 * Co-Simulation, version 2.0.5, sections 2.1 and 4.2, Modelica Association, fmi-standard.org).
 *
 * Who links several units into one program has FMI2_FUNCTION_PREFIX in identifier.h; a shared
 * library is compiled with FMI2_OVERRIDE_FUNCTION_PREFIX, so that its functions have no prefix. */
#ifndef SERVOTWIN_FMI2_H
#define SERVOTWIN_FMI2_H

#include <stddef.h>

#include "identifier.h"

/* NOLINTBEGIN(readability-identifier-naming): the standard's names */
#if defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define FMI2_JOIN(a, b) a##b
#define FMI2_JOINED(a, b) FMI2_JOIN(a, b)
#define FMI2_NAME(name) FMI2_JOINED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2_NAME(name) name
#endif
#if defined(__GNUC__)
#define FMI2_EXPORT __attribute__((visibility("default")))
#elif defined(_WIN32)
#define FMI2_EXPORT __declspec(dllexport)
#else
#define FMI2_EXPORT
#endif

typedef void* fmi2Component;
typedef void* fmi2ComponentEnvironment;
typedef void* fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char* fmi2String;
typedef char fmi2Byte;
enum { fmi2False = 0, fmi2True = 1 };

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
  fmi2DoStepStatus,
  fmi2PendingStatus,
  fmi2LastSuccessfulTime,
  fmi2Terminated
} fmi2StatusKind;

typedef struct {
  void (*logger)(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                 fmi2String category, fmi2String message, ...);
  void* (*allocateMemory)(size_t count, size_t size);
  void (*freeMemory)(void* memory);
  void (*stepFinished)(fmi2ComponentEnvironment environment, fmi2Status status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#define fmi2GetTypesPlatform FMI2_NAME(fmi2GetTypesPlatform)
#define fmi2GetVersion FMI2_NAME(fmi2GetVersion)
#define fmi2SetDebugLogging FMI2_NAME(fmi2SetDebugLogging)
#define fmi2Instantiate FMI2_NAME(fmi2Instantiate)
#define fmi2FreeInstance FMI2_NAME(fmi2FreeInstance)
#define fmi2SetupExperiment FMI2_NAME(fmi2SetupExperiment)
#define fmi2EnterInitializationMode FMI2_NAME(fmi2EnterInitializationMode)
#define fmi2ExitInitializationMode FMI2_NAME(fmi2ExitInitializationMode)
#define fmi2Terminate FMI2_NAME(fmi2Terminate)
#define fmi2Reset FMI2_NAME(fmi2Reset)
#define fmi2GetReal FMI2_NAME(fmi2GetReal)
#define fmi2GetInteger FMI2_NAME(fmi2GetInteger)
#define fmi2GetBoolean FMI2_NAME(fmi2GetBoolean)
#define fmi2GetString FMI2_NAME(fmi2GetString)
#define fmi2SetReal FMI2_NAME(fmi2SetReal)
#define fmi2SetInteger FMI2_NAME(fmi2SetInteger)
#define fmi2SetBoolean FMI2_NAME(fmi2SetBoolean)
#define fmi2SetString FMI2_NAME(fmi2SetString)
#define fmi2GetFMUstate FMI2_NAME(fmi2GetFMUstate)
#define fmi2SetFMUstate FMI2_NAME(fmi2SetFMUstate)
#define fmi2FreeFMUstate FMI2_NAME(fmi2FreeFMUstate)
#define fmi2SerializedFMUstateSize FMI2_NAME(fmi2SerializedFMUstateSize)
#define fmi2SerializeFMUstate FMI2_NAME(fmi2SerializeFMUstate)
#define fmi2DeSerializeFMUstate FMI2_NAME(fmi2DeSerializeFMUstate)
#define fmi2GetDirectionalDerivative FMI2_NAME(fmi2GetDirectionalDerivative)
#define fmi2SetRealInputDerivatives FMI2_NAME(fmi2SetRealInputDerivatives)
#define fmi2GetRealOutputDerivatives FMI2_NAME(fmi2GetRealOutputDerivatives)
#define fmi2DoStep FMI2_NAME(fmi2DoStep)
#define fmi2CancelStep FMI2_NAME(fmi2CancelStep)
#define fmi2GetStatus FMI2_NAME(fmi2GetStatus)
#define fmi2GetRealStatus FMI2_NAME(fmi2GetRealStatus)
#define fmi2GetIntegerStatus FMI2_NAME(fmi2GetIntegerStatus)
#define fmi2GetBooleanStatus FMI2_NAME(fmi2GetBooleanStatus)
#define fmi2GetStringStatus FMI2_NAME(fmi2GetStringStatus)

FMI2_EXPORT const char* fmi2GetTypesPlatform(void);
FMI2_EXPORT const char* fmi2GetVersion(void);
FMI2_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                                           const fmi2String categories[]);
FMI2_EXPORT fmi2Component fmi2Instantiate(fmi2String instance, fmi2Type type, fmi2String guid,
                                          fmi2String resources,
                                          const fmi2CallbackFunctions* functions,
                                          fmi2Boolean visible, fmi2Boolean logging);
FMI2_EXPORT void fmi2FreeInstance(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined,
                                           fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean stop_defined, fmi2Real stop);
FMI2_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2Terminate(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2Reset(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                   fmi2Real value[]);
FMI2_EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                      fmi2Integer value[]);
FMI2_EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                      fmi2Boolean value[]);
FMI2_EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                     fmi2String value[]);
FMI2_EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                   const fmi2Real value[]);
FMI2_EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                      const fmi2Integer value[]);
FMI2_EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                      const fmi2Boolean value[]);
FMI2_EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                     const fmi2String value[]);
FMI2_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state);
FMI2_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state);
FMI2_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state);
FMI2_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state,
                                                  size_t* size);
FMI2_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                             size_t size);
FMI2_EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                               fmi2FMUstate* state);
FMI2_EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c,
                                                    const fmi2ValueReference unknown[],
                                                    size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns,
                                                    const fmi2Real known_step[],
                                                    fmi2Real unknown_step[]);
FMI2_EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                                   size_t count, const fmi2Integer order[],
                                                   const fmi2Real value[]);
FMI2_EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                                    size_t count, const fmi2Integer order[],
                                                    fmi2Real value[]);
FMI2_EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real step,
                                  fmi2Boolean no_state_before);
FMI2_EXPORT fmi2Status fmi2CancelStep(fmi2Component c);
FMI2_EXPORT fmi2Status fmi2GetStatus(fmi2Component c, fmi2StatusKind kind, fmi2Status* value);
FMI2_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, fmi2StatusKind kind, fmi2Real* value);
FMI2_EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, fmi2StatusKind kind,
                                            fmi2Integer* value);
FMI2_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, fmi2StatusKind kind,
                                            fmi2Boolean* value);
FMI2_EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, fmi2StatusKind kind, fmi2String* value);
/* NOLINTEND(readability-identifier-naming) */

#endif
