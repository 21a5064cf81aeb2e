#include "daemon/correct/program_chunks.h"

#include <algorithm>
#include <stdexcept>

namespace servotwin::daemon {

std::string program_name(const std::filesystem::path& file) {
  std::string name = file.stem().string().substr(0, kMaxNameLength);
  for (char& letter : name) {
    if (!usable_name(std::string("x") + letter)) letter = '_';
  }
  return usable_name(name) ? name : "program";
}

std::vector<ProgramChunk> program_chunks(const Recording& path, const std::string& name, bool learn,
                                         std::uint64_t revision) {
  const std::size_t rows = path.time.size();
  std::vector<ProgramChunk> out((rows + kMaxChunkSamples - 1) / kMaxChunkSamples);
  if (out.size() > kMaxProgramChunks) {
    throw std::runtime_error(
        path.source + " has " + std::to_string(rows) + " rows, and a program at most " +
        std::to_string(kMaxProgramChunks * kMaxChunkSamples) + "; take a part of it");
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    ProgramChunk& chunk = out[i];
    chunk.program = name;
    chunk.revision = revision;
    chunk.chunk = static_cast<std::uint32_t>(i);
    chunk.chunks = static_cast<std::uint32_t>(out.size());
    chunk.learn = learn;
    const auto from = static_cast<std::ptrdiff_t>(i * kMaxChunkSamples);
    const auto to = static_cast<std::ptrdiff_t>(std::min(rows, (i + 1) * kMaxChunkSamples));
    chunk.time_s.assign(path.time.begin() + from, path.time.begin() + to);
    for (const AxisRecord& axis : path.axes) {
      chunk.axes.push_back(axis.name);
      chunk.command.insert(chunk.command.end(), axis.command.begin() + from,
                           axis.command.begin() + to);
    }
  }
  return out;
}

void require_kinds(const Recording& path, const std::vector<AxisDescription>& machine,
                   const std::string& of) {
  for (const AxisRecord& axis : path.axes) {
    const auto known =
        std::find_if(machine.begin(), machine.end(),
                     [&](const AxisDescription& one) { return one.name == axis.name; });
    if (known == machine.end() || known->rotary == axis.rotary) continue;
    const auto kind = [](bool rotary) { return std::string(rotary ? "rotary" : "linear"); };
    throw std::runtime_error(path.source + ": " + axis.name + ".command has the unit of a " +
                             kind(axis.rotary) + " axis, and " + axis.name + " of " + of + " is " +
                             kind(known->rotary) + "; correct the unit in the header");
  }
}

}  // namespace servotwin::daemon
