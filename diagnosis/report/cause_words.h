// Causes in plain English for a maintenance engineer. Any thread.
#pragma once

#include <string>
#include <vector>

#include "diagnosis/search/diagnose.h"

namespace servotwin {

/// The plain name of a cause of the contract, such as "friction that differs between the two
/// directions"; the identifier itself where there is no such cause. `rises`: whether
/// friction_rises().
[[nodiscard]] std::string plain_name(const std::string& id, bool rises = false);
/// The same; of a load that swings with the axis not "a constant force".
[[nodiscard]] std::string plain_name(const Diagnosis& diagnosis, const Cause& cause);

/// How large the cause is, in mm, um, ms and N per kg of moved mass (mrad, urad and N m per kg m^2
/// on a rotary axis).
[[nodiscard]] std::string plain_size(const Diagnosis& diagnosis, const Cause& cause);

/// A cause that the torque shows.
struct Shown {
  std::string name;   ///< plain_name() of it
  std::string check;  ///< what to check on the machine
};
/// The verdict in a few sentences: which axis, which causes, how large, and what to check first.
/// `by_torque`: further causes that the torque shows.
[[nodiscard]] std::string plain_verdict(const Diagnosis& diagnosis,
                                        const std::vector<Shown>& by_torque = {});

}  // namespace servotwin
