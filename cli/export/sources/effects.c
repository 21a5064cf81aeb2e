/* The table of effects; see effects.h. */
#include "effects.h"

#include <math.h>
#include <string.h>

double servotwin_direction(const Motion* m) {
  if (!isnan(m->friction)) return m->friction;
  const double turned = 1e3 * m->velocity;
  if (turned < -1.0) return -1.0;
  return turned > 1.0 ? 1.0 : turned;
}

double servotwin_saturated(double velocity, double limit) {
  const double q = velocity / limit;
  if (q > 1.0) return 1.0;
  return q < -1.0 ? -1.0 : q;
}

static const double kOnset_s = 0.05;

double servotwin_onset(double time_s, double at_s) {
  const double share = (time_s - at_s) / kOnset_s;
  if (share < 0.0) return 0.0;
  return share > 1.0 ? 1.0 : share;
}

static void nothing(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  (void)shape;
  (void)memory;
  (void)m;
  (void)force;
}

#define MEMORY(member) sizeof(((EffectMemory*)0)->member)

static const EffectKind kEffects[] = {
    {"coulomb_friction", kActsAsFriction, kOnBoth, 1, 2, 0, NULL, servotwin_coulomb_friction, NULL},
    {"presliding", kActsAsFriction, kOnBoth, 2, 2, MEMORY(springs), servotwin_presliding_start,
     servotwin_presliding, NULL},
    {"smoothed_presliding", kActsAsFriction, kOnBoth, 2, 2, MEMORY(springs),
     servotwin_presliding_start, servotwin_smoothed_presliding, NULL},
    {"gms", kActsAsFriction, kOnBoth, 5, 9, MEMORY(attracted), servotwin_gms_start, servotwin_gms,
     servotwin_gms_friction},
    {"maxwell_slip", kActsAsFriction, kOnBoth, 6, 7, MEMORY(springs), servotwin_maxwell_slip_start,
     servotwin_maxwell_slip, servotwin_maxwell_slip_friction},
    {"lugre", kActsAsFriction, kOnBoth, 5, 2, MEMORY(value), NULL, servotwin_lugre, NULL},
    {"dahl", kActsAsFriction, kOnBoth, 1, 2, MEMORY(value), NULL, servotwin_dahl, NULL},
    {"stribeck", kActsAsFriction, kOnBoth, 4, 6, 0, NULL, servotwin_stribeck,
     servotwin_stribeck_friction},
    {"modified_stribeck", kActsAsFriction, kOnBoth, 4, 6, 0, NULL, servotwin_modified_stribeck,
     servotwin_stribeck_friction},
    {"presliding_stribeck", kActsAsFriction, kOnBoth, 5, 2, MEMORY(attracted),
     servotwin_presliding_stribeck_start, servotwin_presliding_stribeck, NULL},
    {"friction_map", kActsAsForce, kOnBoth, 8, 5, 0, NULL, servotwin_friction_map, NULL},
    {"asymmetric_friction", kActsAsForce, kOnBoth, 0, 2, 0, NULL, servotwin_asymmetric_friction,
     NULL},
    {"falling_friction", kActsAsForce, kOnBoth, 2, 1, 0, NULL, servotwin_falling_friction, NULL},
    {"position_dependent_friction", kActsAsForce, kOnBoth, 1, 4, 0, NULL,
     servotwin_position_dependent_friction, NULL},
    {"added_friction", kActsAsForce, kOnBoth, 1, 2, 0, NULL, servotwin_added_friction, NULL},
    {"dwell_stiction", kActsAsForce, kOnBoth, 2, 1, MEMORY(rest), NULL, servotwin_dwell_stiction,
     NULL},
    {"viscous_drift", kActsAsForce, kOnBoth, 1, 1, 0, NULL, servotwin_viscous_drift, NULL},
    {"gravity_offset", kActsAsForce, kOnLoad, 0, 1, 0, NULL, servotwin_constant_force, NULL},
    {"feedforward_mismatch", kActsAsForce, kOnMotor, 0, 2, 0, NULL, servotwin_feedforward_mismatch,
     NULL},
    {"cogging", kActsAsForce, kOnMotor, 1, 4, 0, NULL, servotwin_cogging, NULL},
    {"swinging_load", kActsAsForce, kOnLoad, 0, 2, 0, NULL, servotwin_swinging_load, NULL},
    {"compliance", kActsAsForce, kOnMotor, 2, 4, MEMORY(mode), NULL, servotwin_compliance, NULL},
    {"control_filter", kActsAsForce, kOnMotor, 2, 4, MEMORY(filter), NULL, servotwin_control_filter,
     NULL},
    {"cross_coupling", kActsAsForce, kOnLoad, 2, 3, MEMORY(other), NULL, servotwin_cross_coupling,
     NULL},
    {"cross_coupling_by_motion", kActsAsForce, kOnLoad, 0, 1, 0, NULL,
     servotwin_cross_coupling_by_motion, NULL},
    {"cutting_force", kActsAsForce, kOnLoad, 1, 3, 0, NULL, servotwin_cutting_force, NULL},
    {"encoder_error", kActsAsForce, kOnLoad, 1, 2, 0, NULL, servotwin_encoder_error, NULL},
    {"gain_change", kActsAsForce, kOnMotor, 1, 2, MEMORY(value), NULL, servotwin_gain_change, NULL},
    {"impulse_disturbance", kActsAsForce, kOnLoad, 5, 4, 0, NULL, servotwin_impulse_disturbance,
     NULL},
    {"inertia_change", kActsAsForce, kOnLoad, 1, 1, 0, NULL, servotwin_inertia_change, NULL},
    {"periodic_disturbance", kActsAsForce, kOnLoad, 1, 2, 0, NULL, servotwin_periodic_disturbance,
     NULL},
    {"torque_saturation", kActsAsForce, kOnMotor, 3, 1, MEMORY(limit), NULL,
     servotwin_torque_saturation, NULL},
    {"torque_saturation_holding", kActsAsForce, kOnMotor, 3, 1, MEMORY(limit), NULL,
     servotwin_torque_saturation_holding, NULL},
    {"torque_saturation_back_calculation", kActsAsForce, kOnMotor, 3, 1, MEMORY(value), NULL,
     servotwin_torque_saturation_back_calculation, NULL},
    {"unexplained_over_position", kActsAsForce, kOnLoad, 2, 9, 0, NULL,
     servotwin_unexplained_over_position, NULL},
    {"unexplained_over_velocity", kActsAsForce, kOnLoad, 2, 9, 0, NULL,
     servotwin_unexplained_over_velocity, NULL},
    {"unexplained_over_acceleration", kActsAsForce, kOnLoad, 2, 9, 0, NULL,
     servotwin_unexplained_over_acceleration, NULL},
    {"backlash_in_loop", kActsAsForce, kOnMotor, 1, 1, MEMORY(value), NULL,
     servotwin_backlash_in_loop, NULL},
    {"backlash_behind_encoder", kActsAsForce, kOnMotor, 3, 2, MEMORY(gap), NULL,
     servotwin_backlash_behind_encoder, NULL},
    {"backlash", kActsOnReading, kOnLoad, 3, 2, MEMORY(gap), NULL, servotwin_backlash, NULL},
    {"lead_error", kActsOnReading, kOnLoad, 1, 4, 0, NULL, servotwin_lead_error, NULL},
    {"thermal_growth", kActsOnReading, kOnLoad, 1, 3, 0, NULL, servotwin_thermal_growth, NULL},
    {"time_delay", kDelaysCommand, kOnLoad, 1, 0, 0, NULL, nothing, NULL},
};

const EffectKind* servotwin_effects(int* count) {
  *count = (int)(sizeof kEffects / sizeof kEffects[0]);
  return kEffects;
}

int servotwin_find_effect(const char* id) {
  int count = 0;
  const EffectKind* effects = servotwin_effects(&count);
  for (int i = 0; i < count; ++i) {
    if (strcmp(effects[i].id, id) == 0) return i;
  }
  return -1;
}
