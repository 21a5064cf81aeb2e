// Assembles commanded paths from the chunks that come over the network, and checks them.
//
// A program is a path of some of the machine's axes in rows one cycle apart. These are refused with
// the reason: missing or contradicting chunks, axes that the machine does not have, values that are
// not finite, rows that are not one cycle apart, too many or too few rows. A revision is refused
// once; the rest of it is ignored. At most kMaxProgramsAtOnce programs are assembled at a time; a
// further one replaces the one that has waited longest.
//
// SI units. One thread; errors: none are thrown.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// Maximum of rows times axes of a program: 48 MB for everything that is computed along it.
inline constexpr std::size_t kMaxProgramValues = std::size_t{1} << 21U;
inline constexpr std::size_t kMinProgramRows = 16;
inline constexpr std::size_t kMaxProgramsAtOnce = 16;
/// A program whose next chunk has not come within this time is refused [ns].
inline constexpr std::int64_t kChunkPatience_ns = 10'000'000'000;

struct ProgramRefusal {
  std::string program;
  std::uint64_t revision = 0;
  std::string reason;  ///< one line: what, where, which value, which rule
};

class ProgramAssembly {
 public:
  explicit ProgramAssembly(MachineDescription machine) : machine_(std::move(machine)) {}

  /// The program that this chunk completes, or its refusal, or neither. `now_ns`: any monotonic
  /// clock.
  using Outcome = std::variant<std::monostate, CommandedPath, ProgramRefusal>;
  [[nodiscard]] Outcome take(const ProgramChunk& chunk, std::int64_t now_ns);
  /// The refusal of one program that has waited too long for a chunk; call it until there is none.
  [[nodiscard]] std::optional<ProgramRefusal> overdue(std::int64_t now_ns);

 private:
  struct Part {
    std::string name;
    std::uint64_t revision = 0;
    bool done = false;  // complete or refused: the rest of this revision is ignored
    bool learn = false;
    std::uint32_t next = 0, chunks = 0;
    std::vector<std::string> names;
    std::vector<std::size_t> axes;
    double last_time_s = 0.0;
    std::vector<std::vector<double>> command;
    std::int64_t last_ns = 0;
  };

  Part& part_of(const ProgramChunk& chunk);
  /// Why the chunk cannot be used; empty if it can.
  [[nodiscard]] std::string contradiction(const ProgramChunk& chunk, const Part& part) const;
  [[nodiscard]] std::string unknown_axes(const ProgramChunk& chunk,
                                         std::vector<std::size_t>& axes) const;
  [[nodiscard]] std::string not_usable(const ProgramChunk& chunk, const Part& part) const;

  MachineDescription machine_;
  std::vector<Part> parts_;
};

}  // namespace servotwin::daemon
