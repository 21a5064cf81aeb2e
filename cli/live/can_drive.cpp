#include "cli/live/can_drive.h"

#include <array>
#include <memory>

#include "cli/common/command.h"
#include "cli/common/interrupt.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/live/virtual_drive.h"
#include "daemon/between/clock.h"
#include "daemon/identify/held_out.h"
#include "drivers/can/can_map.h"
#include "drivers/can/socketcan.h"
#include "drivers/common/text.h"

namespace servotwin::cli {
namespace {

constexpr double kDrivePatience_s = 0.1;  // longest delay of an interrupt

std::vector<daemon::TwinInForce> twins_of(const CanMap& map,
                                          const std::vector<std::filesystem::path>& files) {
  std::vector<daemon::TwinInForce> twins;
  for (const std::optional<ModelRecord>& record : models_of(map.machine, files, stdout)) {
    const std::size_t axis = twins.size();
    if (!record)
      throw UsageError("--model is missing for axis " + in_quotes(map.machine.axes[axis].name));
    twins.push_back(daemon::twin_in_force(*record, map.machine, axis));
  }
  return twins;
}

}  // namespace

void drive_on_can(const CanDriveOptions& options) {
  if (options.map.empty())
    throw UsageError("--can-map F.toml is required: it maps the bits of frames to signals");
  const CanMap map = load_can_map(options.map);
  const bool udp = !options.udp.peer.empty();
  const std::size_t given = udp ? 1 : options.interfaces.size();
  if (map.buses.size() != given) {
    throw UsageError(text("the mapping has %zu buses (%s), but %zu are given", map.buses.size(),
                          listed(map.buses).c_str(), given));
  }
  VirtualDrive drive(map, twins_of(map, options.models));
  std::vector<std::unique_ptr<CanBus>> buses;
  if (udp) buses.push_back(std::make_unique<CanUdp>(options.udp));
  for (const std::string& interface : options.interfaces)
    buses.push_back(std::make_unique<SocketCan>(interface));
  say(stdout, "answering " +
                  (udp ? options.udp.peer + " at " + options.udp.listen
                       : "on " + listed(options.interfaces)) +
                  " as the drives of " + std::to_string(map.machine.axes.size()) + " axes");

  const Interrupt interrupt;
  const std::int64_t begin = daemon::steady_ns();
  std::array<CanFrame, 64> batch;
  std::uint64_t not_sent = 0;
  while (!interrupt.came()) {
    if (options.seconds > 0.0 &&
        static_cast<double>(daemon::steady_ns() - begin) * 1e-9 > options.seconds)
      break;
    // Waits for the bus with the SYNC; the other buses carry targets only and are polled.
    for (std::size_t i = 0; i < buses.size(); ++i) {
      const std::size_t bus = (map.start.bus + 1 + i) % buses.size();
      const std::size_t count =
          buses[bus]->receive(batch, bus == map.start.bus ? kDrivePatience_s : 0.0);
      for (std::size_t k = 0; k < count; ++k) {
        for (const VirtualDrive::Answer& answer : drive.on_frame(bus, batch[k]))
          not_sent += 1 - buses[answer.bus]->send({&answer.frame, 1});
      }
    }
  }
  say(stdout, "answered in " + counted(drive.cycles(), "cycle") + ", " +
                  counted(not_sent, "frame") + " not sent, " +
                  counted(drive.not_carried(), "value") + " did not fit into the bits");
}

}  // namespace servotwin::cli
