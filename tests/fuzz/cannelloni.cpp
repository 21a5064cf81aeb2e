// A packet of CAN over UDP: no frame is longer than frames are, and the errors of a frame can be
// told.
#include "drivers/can/cannelloni.h"

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  std::optional<CannelloniPacket> packet = CannelloniPacket::parse({data, size});
  if (!packet) return 0;
  CanFrame frame;
  std::size_t frames = 0;
  while (packet->next(frame)) {
    fuzz::require(frame.length <= (frame.fd ? 64 : 8) && ++frames <= size);
    (void)can_errors(frame);
  }
  return 0;
}
