// An .eds or .dcf file: what is accepted has PDOs that fit into a frame.
#include "drivers/can/eds.h"

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  fuzz::refused_or_read([&] {
    const EdsDevice device = parse_eds(fuzz::text(data, size), "input.eds", 1);
    for (const Pdo& pdo : device.pdos) {
      fuzz::require(pdo.bytes() >= 0);
      fuzz::require(!text_of(pdo).empty());
    }
  });
  return 0;
}
