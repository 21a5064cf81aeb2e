// An axis whose motor and load are two masses on a spring, without or with play between them. The
// equations: twin/two_mass_axis.h.
//
// No force along a motion that is given: the motor's motion and the load's follow from each other.
// The twin steps them together; identification fits the parameters in free simulation.
#pragma once

#include <array>
#include <cstddef>

#include "twin/effect.h"

namespace servotwin {

/// Where the recorded encoder is, and which one closes the position loop.
enum class Encoders {
  kMotor,    ///< at the motor, in the loop
  kLoad,     ///< at the load, in the loop; the motor's velocity closes the velocity loop
  kOutside,  ///< at the load; the motor's closes the loop
};

template <Encoders encoders, bool play>
struct TwoMass {
  static constexpr bool kPlay = play;
  static constexpr Encoders kEncoders = encoders;
  static constexpr std::string_view kId =
      play ? (encoders == Encoders::kMotor  ? "two_mass_play"
              : encoders == Encoders::kLoad ? "two_mass_play_load_encoder"
                                            : "two_mass_play_outside")
           : (encoders == Encoders::kMotor  ? "two_mass"
              : encoders == Encoders::kLoad ? "two_mass_load_encoder"
                                            : "two_mass_outside");
  static constexpr Identity kIdentity{
      .id = kId,
      .meaning = play ? "play between motor and load" : "motor and load as two masses on a spring",
      .acts = Acts::kAxis,
      .cause = play ? "backlash" : "compliance",
      .check = play ? "play of coupling, nut or gear, and bearings between motor and load"
                    : "stiffness of coupling, screw and nut, or gear, and bearings; preload"};
  static constexpr Parameter kFrequency{
      "frequency_hz",        "Hz", 2.0,
      play ? 500.0 : 2000.0, 50.0, "frequency of the load on its spring with the motor held"};
  static constexpr Parameter kDamping{
      "damping_ratio", "1", 0.002, 0.7, 0.05, "damping ratio of the same"};
  static constexpr Parameter kLoadShare{
      "load_share", "1", 0.02, 0.98, 0.5, "share of the moved mass that is behind the spring"};
  static constexpr Parameter kFrictionShare{
      "friction_share", "1", 0.0, 1.0, 1.0, "share of the friction that acts on the load"};
  static constexpr Parameter kReset{
      "reset",
      "1/s",
      0.1,
      1000.0,
      30.0,
      "reset rate of the velocity control's integrator, which integrates the motor's velocity"};
  static constexpr Parameter kWidth{"width", "m", 1e-7, 1e-2, 1e-5, "width of the gap"};
  static constexpr std::size_t kFrictionShareAt = 3;  ///< of the shapes
  static constexpr std::size_t kResetAt = 4;          ///< of the shapes, where there is one
  static constexpr std::size_t kWidthAt = encoders == Encoders::kLoad ? 5 : 4;
  static constexpr auto kShapes = [] {
    if constexpr (encoders == Encoders::kLoad) {
      if constexpr (play)
        return std::array<Parameter, 6>{kFrequency,     kDamping, kLoadShare,
                                        kFrictionShare, kReset,   kWidth};
      else
        return std::array<Parameter, 5>{kFrequency, kDamping, kLoadShare, kFrictionShare, kReset};
    } else {
      if constexpr (play)
        return std::array<Parameter, 5>{kFrequency, kDamping, kLoadShare, kFrictionShare, kWidth};
      else
        return std::array<Parameter, 4>{kFrequency, kDamping, kLoadShare, kFrictionShare};
    }
  }();
  static constexpr std::array<Parameter, 0> kCoefficients{};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& /*m*/,
                          T* /*force*/) noexcept {}
};

using TwoMassMotorEncoder = TwoMass<Encoders::kMotor, false>;
using TwoMassLoadEncoder = TwoMass<Encoders::kLoad, false>;
using TwoMassOutside = TwoMass<Encoders::kOutside, false>;
using PlayMotorEncoder = TwoMass<Encoders::kMotor, true>;
using PlayLoadEncoder = TwoMass<Encoders::kLoad, true>;
using PlayOutside = TwoMass<Encoders::kOutside, true>;

}  // namespace servotwin
