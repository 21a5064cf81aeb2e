// The gate of live corrections: no limits, clocks and requests whatever make an output that breaks
// what ilc/gate.h promises.
//
// Input: one byte that chooses the limits (its last seven bits above 1: as the next 48 bytes say;
// its first bit set: then eight more bytes say the cycle), then requests of 25 bytes: flags,
// offset, step of the clock, time until the request expires.
#include <cstring>

#include "tests/fuzz/fuzz.h"
#include "tests/ilc/gate_promises.h"

namespace {

/// Numbers from the front of the input; the last ones may be cut off.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), left_(size) {}
  [[nodiscard]] bool empty() const { return left_ == 0; }
  template <class Number>
  Number next() {
    Number out{};
    const std::size_t size = std::min(sizeof(Number), left_);
    if (size > 0) std::memcpy(&out, data_, size);
    data_ += size;
    left_ -= size;
    return out;
  }

 private:
  const std::uint8_t* data_;
  std::size_t left_;
};

/// Clocks may be anything, their sums too.
std::int64_t sum(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) + static_cast<std::uint64_t>(b));
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  Bytes bytes(data, size);
  GateLimits limits{20e-6, 2e-3, 50.0, 0.05, 0.01, 3600.0, true};
  const auto first = bytes.next<std::uint8_t>();
  const int choice = first & 0x7F;
  if (choice == 1) limits.rate = 0.1e-3;
  if (choice > 1) {
    for (double* limit : {&limits.peak, &limits.rate, &limits.bandwidth_hz, &limits.ramp_s,
                          &limits.validity_s, &limits.model_age_s})
      *limit = bytes.next<double>();
  }
  if ((first & 0x80U) != 0) limits.cycle_s = bytes.next<double>();
  Gate gate(limits);
  GatePromises promises(limits);
  GateRequest request;
  while (!bytes.empty()) {
    const auto flags = bytes.next<std::uint8_t>();
    request.offset = bytes.next<double>();
    request.now_ns = sum(request.now_ns, bytes.next<std::int64_t>());
    request.expires_ns = sum(request.now_ns, bytes.next<std::int64_t>());
    request.model_validated = (flags & 1U) == 0;
    request.model_validated_ns = (flags & 2U) == 0 ? request.now_ns : 0;
    request.axis_state_matches = (flags & 4U) == 0;
    const GateOutput out = gate.pass(request);
    fuzz::require(promises.broken(request, out) == nullptr);
  }
  return 0;
}
