#include "daemon/input/offset_contract.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "drivers/can/can_frame.h"
#include "drivers/can/eds.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {

// Between two offsets lies a cycle, and a frame may come a cycle late: a shorter offset has expired
// in the drive before it is renewed, and no run lasts.
constexpr double kMinValidity_cycles = 2.0;
// Communication parameters of RPDO 1, with the event timer in sub-index 5 (CiA 301).
constexpr int kFirstRpdo = 0x1400, kEventTimer = 5;

std::optional<double> timeout_of(const CanMap& map, std::size_t axis) {
  const MappedSignal* offset = map.find(axis, CanChannel::kOffset);
  return offset == nullptr ? std::nullopt : offset->timeout_s;
}

bool permitted_by_name(const Config& config, const std::string& axis) {
  const std::vector<std::string>& names = config.ilc.arm_without_timeout;
  return std::find(names.begin(), names.end(), axis) != names.end();
}

void add_axis(const Config& config, const std::string& axis, std::optional<double> timeout_s,
              OffsetContract& contract) {
  if (!timeout_s) {
    contract.refusals.push_back(
        "the CAN mapping does not say what the drive of axis " + axis +
        " does when offsets stop; give its [[axis]] offset_timeout_s, the time after which the "
        "drive drops an offset [s], or \"none\"");
  } else if (std::isinf(*timeout_s)) {
    const std::string fact =
        "the drive of axis " + axis +
        " keeps the last offset for ever if this daemon is killed, and after any gap "
        "longer than ilc.validity_s; the next run then begins with a step";
    if (permitted_by_name(config, axis)) {
      contract.remarks.push_back(fact + "; ilc.arm_without_timeout permits it");
    } else {
      contract.refusals.push_back(fact +
                                  " (offset_timeout_s = \"none\"); set a time-out in the drive, or "
                                  "permit it by ilc.arm_without_timeout = [\"" +
                                  axis + "\"]");
    }
  } else if (config.ilc.validity_s > *timeout_s) {
    contract.refusals.push_back(
        "ilc.validity_s = " + number(config.ilc.validity_s) + " s is longer than the time-out of " +
        number(*timeout_s) + " s after which the drive of axis " + axis +
        " drops an offset (offset_timeout_s of the CAN mapping); the time-out must not be shorter");
  } else {
    contract.drive_timeout_s = std::max(contract.drive_timeout_s, *timeout_s);
  }
}

}  // namespace

std::string OffsetContract::refusal() const {
  std::string out;
  for (const std::string& one : refusals)
    out += (out.empty() ? "offsets cannot be armed: " : "; ") + one;
  return out;
}

std::vector<std::size_t> corrected_axes(const Config& config) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    if (config.axes[i].correction) out.push_back(i);
  }
  return out;
}

OffsetContract offset_contract(const Config& config, double cycle_s, const CanMap* map) {
  OffsetContract contract;
  const std::vector<std::size_t> axes = corrected_axes(config);
  if (axes.empty()) return contract;
  if (const double least_s = kMinValidity_cycles * cycle_s; config.ilc.validity_s < least_s) {
    contract.refusals.push_back("ilc.validity_s = " + number(config.ilc.validity_s) +
                                " s is shorter than two cycles of the machine (" + number(least_s) +
                                " s); an offset would expire before it is renewed");
  }
  for (const std::size_t axis : axes) {
    if (map != nullptr) add_axis(config, config.axes[axis].name, timeout_of(*map, axis), contract);
  }
  return contract;
}

std::vector<std::string> drive_settings(const Config& config, const CanMap& map) {
  std::vector<std::string> lines;
  for (const std::size_t axis : corrected_axes(config)) {
    const MappedSignal* offset = map.find(axis, CanChannel::kOffset);
    if (offset == nullptr) continue;
    const MappedMessage& message = map.messages[offset->message];
    const double stated_s = offset->timeout_s.value_or(0.0);
    const bool states = stated_s > 0.0 && std::isfinite(stated_s);
    const std::string object = message.rpdo > 0
                                   ? object_text(kFirstRpdo + message.rpdo - 1, kEventTimer)
                                   : "0x1400 + n, sub-index 5,";
    const std::string& name = config.axes[axis].name;
    lines.push_back(
        name + ": " + object +
        (states ? " = " + number(std::ceil(1e3 * stated_s - 1e-6))
                : " >= " + number(std::ceil(1e3 * config.ilc.validity_s - 1e-6))) +
        " [ms]: event timer of the RPDO with 0x60B0 (" + can_id_text(message.id, message.extended) +
        "); the mapping states " +
        (states ? "offset_timeout_s = " + number(stated_s)
                : (offset->timeout_s ? "that the drive has none" : "no offset_timeout_s")));
    lines.push_back(name +
                    ": 0x6007:00: abort connection option code; 1, 2 and 3 stop the axis after the "
                    "time-out. Otherwise the drive must ramp the offset to 0 within " +
                    number(1e3 * config.ilc.drive_ramp_s) + " ms: see its manual");
  }
  return lines;
}

}  // namespace servotwin::daemon
