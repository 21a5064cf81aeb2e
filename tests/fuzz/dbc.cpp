// A .dbc file: every signal that is accepted lies in its message, and decodes and encodes without a
// fault.
#include "drivers/can/dbc.h"

#include <array>

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  fuzz::refused_or_read([&] {
    const Dbc dbc = parse_dbc(fuzz::text(data, size), "input.dbc");
    std::array<std::uint8_t, 64> frame{};
    frame.fill(0xA5);
    for (const DbcMessage& message : dbc.messages) {
      fuzz::require(message.length >= 0 && message.length <= 64);
      for (const DbcSignal& signal : message.signals) {
        const int bytes = bytes_needed(signal.signal);
        if (bytes == 0 || bytes > message.length) continue;
        const std::uint64_t raw = raw_bits(signal.signal, frame);
        std::array<std::uint8_t, 64> written{};
        set_raw_bits(signal.signal, raw, written);
        fuzz::require(raw_bits(signal.signal, written) == raw);
        (void)decoded(signal.signal, frame);
      }
    }
  });
  return 0;
}
