#include "daemon/correct/program_assembly.h"

#include <algorithm>
#include <cmath>

#include "daemon/between/clock.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {

// Tolerance of the row distance as a share of the cycle: tables are written with six digits.
constexpr double kRowSpacingTolerance = 0.01;

std::string of_chunks(std::uint32_t chunk, std::uint32_t chunks) {
  return "chunk " + std::to_string(chunk) + " of " + std::to_string(chunks);
}

std::vector<std::string> names_of(const MachineDescription& machine) {
  std::vector<std::string> out;
  for (const AxisDescription& axis : machine.axes) out.push_back(axis.name);
  return out;
}

}  // namespace

ProgramAssembly::Part& ProgramAssembly::part_of(const ProgramChunk& chunk) {
  const auto named = [&](const Part& part) { return part.name == chunk.program; };
  auto found = std::find_if(parts_.begin(), parts_.end(), named);
  if (found == parts_.end()) {
    if (parts_.size() == kMaxProgramsAtOnce)
      parts_.erase(std::min_element(parts_.begin(), parts_.end(), [](const Part& a, const Part& b) {
        return a.last_ns < b.last_ns;
      }));
    found = parts_.emplace(parts_.end());
    found->name = chunk.program;
    found->revision = chunk.revision;
  } else if (found->revision != chunk.revision || chunk.chunk == 0) {
    *found = Part();
    found->name = chunk.program;
    found->revision = chunk.revision;
  }
  return *found;
}

std::string ProgramAssembly::contradiction(const ProgramChunk& chunk, const Part& part) const {
  if (chunk.chunks == 0 || chunk.chunk >= chunk.chunks)
    return of_chunks(chunk.chunk, chunk.chunks) + ": chunks are counted from 0";
  if (chunk.chunks > kMaxProgramChunks)
    return "too long: " + std::to_string(chunk.chunks) + " chunks, at most " +
           std::to_string(kMaxProgramChunks) + " of " + std::to_string(kMaxChunkSamples) +
           " rows are possible";
  if (chunk.chunk != part.next)
    return of_chunks(part.next, chunk.chunks) + " is missing: chunk " +
           std::to_string(chunk.chunk) + " came instead";
  if (part.next > 0 &&
      (chunk.chunks != part.chunks || chunk.axes != part.names || chunk.learn != part.learn))
    return of_chunks(chunk.chunk, chunk.chunks) +
           " has other values of chunks, axes or learn than the chunks before; start again at "
           "chunk 0";
  const std::size_t rows = chunk.time_s.size();
  if (rows == 0) return of_chunks(chunk.chunk, chunk.chunks) + " has no rows";
  if (chunk.command.size() != rows * chunk.axes.size())
    return of_chunks(chunk.chunk, chunk.chunks) + ": command_m has " +
           std::to_string(chunk.command.size()) + " values, and " + std::to_string(rows) +
           " rows of " + std::to_string(chunk.axes.size()) + " axes need " +
           std::to_string(rows * chunk.axes.size());
  return {};
}

std::string ProgramAssembly::unknown_axes(const ProgramChunk& chunk,
                                          std::vector<std::size_t>& axes) const {
  const std::vector<std::string> known = names_of(machine_);
  if (chunk.axes.empty()) return "names no axes";
  for (const std::string& name : chunk.axes) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end())
      return "the machine has no axis " + in_quotes(name) + "; it has " + listed(known);
    const auto axis = static_cast<std::size_t>(found - known.begin());
    if (std::find(axes.begin(), axes.end(), axis) != axes.end())
      return "axis " + in_quotes(name) + " is named twice";
    axes.push_back(axis);
  }
  return {};
}

std::string ProgramAssembly::not_usable(const ProgramChunk& chunk, const Part& part) const {
  const std::size_t rows = chunk.time_s.size();
  const std::size_t before = part.command.empty() ? 0 : part.command.front().size();
  if ((before + rows) * part.axes.size() > kMaxProgramValues)
    return "too long: more than " + std::to_string(kMaxProgramValues / part.axes.size()) +
           " rows of " + std::to_string(part.axes.size()) + " axes";
  for (std::size_t k = 0; k < rows; ++k) {
    const std::string row = " of row " + std::to_string(before + k);
    const double time_s = chunk.time_s[k];
    if (!std::isfinite(time_s)) return "time_s" + row + " is not a number";
    if (before + k > 0) {
      const double step_s = time_s - (k == 0 ? part.last_time_s : chunk.time_s[k - 1]);
      if (!(std::abs(step_s - machine_.cycle_s) <= kRowSpacingTolerance * machine_.cycle_s))
        return "the time" + row + " is " + number(step_s) +
               " s after that of the row before, but rows must be one cycle of the machine "
               "apart, " +
               number(machine_.cycle_s) + " s";
    }
    for (std::size_t i = 0; i < part.axes.size(); ++i) {
      if (!std::isfinite(chunk.command[i * rows + k]))
        return "command_m of axis " + part.names[i] + row + " is not a number";
    }
  }
  return {};
}

ProgramAssembly::Outcome ProgramAssembly::take(const ProgramChunk& chunk, std::int64_t now_ns) {
  Part& part = part_of(chunk);
  part.last_ns = now_ns;
  if (part.done) return std::monostate();
  const auto refuse = [&](std::string why) -> Outcome {
    part.done = true;
    part.command.clear();
    return ProgramRefusal{chunk.program, chunk.revision, std::move(why)};
  };
  if (std::string why = contradiction(chunk, part); !why.empty()) return refuse(std::move(why));
  if (part.next == 0) {
    if (std::string why = unknown_axes(chunk, part.axes); !why.empty())
      return refuse(std::move(why));
    part.names = chunk.axes;
    part.learn = chunk.learn;
    part.chunks = chunk.chunks;
    part.command.resize(part.axes.size());
  }
  if (std::string why = not_usable(chunk, part); !why.empty()) return refuse(std::move(why));
  const auto rows = static_cast<std::ptrdiff_t>(chunk.time_s.size());
  for (std::size_t i = 0; i < part.axes.size(); ++i) {
    const auto from = chunk.command.begin() + static_cast<std::ptrdiff_t>(i) * rows;
    part.command[i].insert(part.command[i].end(), from, from + rows);
  }
  part.last_time_s = chunk.time_s.back();
  if (++part.next < part.chunks) return std::monostate();
  if (part.command.front().size() < kMinProgramRows)
    return refuse("too short: " + std::to_string(part.command.front().size()) + " rows, at least " +
                  std::to_string(kMinProgramRows) + " are needed");
  CommandedPath program{part.name, part.revision, part.learn, part.axes, {}};
  for (const std::vector<double>& axis : part.command)
    program.command.emplace_back(
        Eigen::Map<const Eigen::ArrayXd>(axis.data(), static_cast<Eigen::Index>(axis.size())));
  part.done = true;
  part.command.clear();
  return program;
}

std::optional<ProgramRefusal> ProgramAssembly::overdue(std::int64_t now_ns) {
  for (Part& part : parts_) {
    if (part.done || between_ns(part.last_ns, now_ns) < kChunkPatience_ns) continue;
    part.done = true;
    part.command.clear();
    return ProgramRefusal{part.name, part.revision,
                          of_chunks(part.next, part.chunks) + " is missing: it has not come for " +
                              number(1e-9 * static_cast<double>(kChunkPatience_ns)) + " s"};
  }
  return std::nullopt;
}

}  // namespace servotwin::daemon
