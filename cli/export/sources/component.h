/* The data of an instance of the unit; there are no global data. Different instances may be used by
 * different threads. */
#ifndef SERVOTWIN_COMPONENT_H
#define SERVOTWIN_COMPONENT_H

#include "axis.h"
#include "fmi2.h"
#include "model_text.h"

typedef enum { kInstantiated, kInitializing, kStepping, kTerminated } Mode;

enum { kOrders = 3 }; /* derivatives of the command that can be given */

/* The variables that a host sets. */
typedef struct {
  AxisModel model;
  double command, neighbour_acceleration, in_cut;
} Settable;

/* The complete state of an instance. */
typedef struct {
  char guid[kUnitText];
  Mode mode;
  Settable set;
  AxisState axis;
  double derivative[kOrders]; /* of the command */
  int derivatives_given;      /* for the next step */
  double start_s;
  double cycles; /* since the start */
} State;

typedef struct {
  State state;
  UnitModel unit; /* as it was read */
  fmi2CallbackFunctions functions;
  char name[kUnitText];
} Component;

/* Memory of the host, or of the C library if the host does not provide both functions. */
void* servotwin_allocate(const fmi2CallbackFunctions* functions, size_t size);
void servotwin_free(const fmi2CallbackFunctions* functions, void* memory);
/* Logs the reason and returns the status. */
fmi2Status servotwin_refuse(const Component* c, fmi2Status status, const char* format, ...);

#endif
