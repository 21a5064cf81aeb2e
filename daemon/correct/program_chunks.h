// A path from a file as the chunks of a program, for a daemon that receives programs
// (daemon/correct/program_assembly.h): `servotwin preview` sends them, a watched folder offers
// them.
//
// SI units. Any thread. Errors: std::runtime_error in one line.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// A valid name for a program, derived from the name of its file: other letters become '_'.
[[nodiscard]] std::string program_name(const std::filesystem::path& file);

/// The path (daemon/input/recorded_cycles.h) divided into chunks, all of the same revision. Throws
/// if it has more rows than a program may have.
[[nodiscard]] std::vector<ProgramChunk> program_chunks(const Recording& path,
                                                       const std::string& name, bool learn,
                                                       std::uint64_t revision);

/// Chunks have no units: degrees would be read as metres. Throws if an axis of the path is rotary
/// and that of the machine is not, or the other way round. An axis that the machine does not have
/// is not its business. `of`: the machine, as it is called in the message.
void require_kinds(const Recording& path, const std::vector<AxisDescription>& machine,
                   const std::string& of);

}  // namespace servotwin::daemon
