#include "daemon/correct/program_folder.h"

#include <algorithm>
#include <fstream>
#include <utility>
#include <variant>

#include "daemon/correct/program_assembly.h"
#include "daemon/correct/program_chunks.h"
#include "daemon/input/recorded_cycles.h"
#include "drivers/common/text.h"
#include "drivers/recordings/recording_file.h"

namespace servotwin::daemon {
namespace fs = std::filesystem;
namespace {

/// Whether the name is that of a program: .csv in any case, and no dot at its begin.
bool is_named_as_program(const fs::path& file) {
  std::string kind = file.extension().string();
  std::transform(kind.begin(), kind.end(), kind.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  return kind == ".csv" && file.filename().string().front() != '.';
}

/// A file that must say in its header what its columns are: nobody gives options with it.
Recording by_its_header(const fs::path& file) {
  try {
    return read_recording(file);
  } catch (const std::exception& error) {
    const std::string why = error.what();
    if (why.find("--columns") == why.npos && why.find("--rate") == why.npos) throw;
    std::string first;
    std::getline(std::ifstream(file), first);
    throw std::runtime_error(
        file.string() +
        ": the header of a program names its columns with their units, as "
        "time[s],X.command[mm],Y.command[mm] does; the first line of this file is " +
        in_quotes(first));
  }
}

}  // namespace

std::vector<ProgramChunk> read_program(const fs::path& file, const std::string& program,
                                       const MachineDescription& machine, std::uint64_t revision) {
  std::error_code vanished;
  const std::uintmax_t bytes = fs::file_size(file, vanished);
  if (!vanished && bytes > kMaxProgramFile_bytes)
    throw std::runtime_error(file.string() + " has " + std::to_string(bytes) +
                             " bytes, and at most " + std::to_string(kMaxProgramFile_bytes) +
                             " are read");
  const Recording path = recorded_cycles(by_its_header(file)).recording;
  require_kinds(path, machine.axes, "the machine");
  std::vector<ProgramChunk> chunks = program_chunks(path, program, true, revision);
  if (chunks.empty()) throw std::runtime_error(file.string() + " has no rows");
  return chunks;
}

CommandedPath program_in(const fs::path& file, const std::string& program,
                         const MachineDescription& machine) {
  ProgramAssembly assembly(machine);
  ProgramAssembly::Outcome outcome;
  for (const ProgramChunk& chunk : read_program(file, program, machine, 0)) {
    outcome = assembly.take(chunk, 0);
    if (const auto* refusal = std::get_if<ProgramRefusal>(&outcome))
      throw std::runtime_error(file.string() + ": " + refusal->reason);
  }
  return std::get<CommandedPath>(std::move(outcome));
}

fs::path file_of(const std::string& program, const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error, vanished;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& file = entry->path();
    if (is_named_as_program(file) && program_name(file) == program &&
        entry->is_regular_file(vanished))
      files.push_back(file);
  }
  if (error) throw std::runtime_error(folder.string() + ": cannot be read: " + error.message());
  return files.empty() ? folder / (program + ".csv")
                       : *std::min_element(files.begin(), files.end());
}

ProgramFolder::ProgramFolder(fs::path folder, MachineDescription machine)
    : folder_(std::move(folder)), machine_(std::move(machine)) {}

std::map<fs::path, ProgramFolder::File> ProgramFolder::files(std::error_code& error) const {
  std::map<fs::path, File> out;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    if (!is_named_as_program(path)) continue;
    File file;
    std::error_code vanished;  // between the listing and here
    if (!entry->is_regular_file(vanished)) continue;
    file.bytes = entry->file_size(vanished);
    file.changed = entry->last_write_time(vanished);
    if (vanished) continue;
    file.program = program_name(path);
    out.emplace(path, std::move(file));
  }
  return out;
}

ProgramFolder::Found ProgramFolder::read(const fs::path& file, const File& known,
                                         std::uint64_t revision) const {
  Found out;
  out.program = known.program;
  out.revision = revision;
  if (file.stem() != known.program) out.renamed = file.filename().string();
  const auto same_name = [&](const auto& other) {
    return other.first < file && other.second.program == known.program;
  };
  try {
    const auto other = std::find_if(files_.begin(), files_.end(), same_name);
    out.taken = other != files_.end();
    if (out.taken)
      throw std::runtime_error(file.string() + ": " + other->first.filename().string() +
                               " gives the same name of a program; rename one of them");
    out.chunks = read_program(file, known.program, machine_, revision);
  } catch (const std::exception& error) {
    out.problem = error.what();
  }
  return out;
}

ProgramFolder::News ProgramFolder::look(std::int64_t wall_ns) {
  News news;
  std::error_code error;
  std::map<fs::path, File> now = files(error);
  if (error) {
    // Files that cannot be seen for a moment, as on a network drive, are not gone.
    if (!std::exchange(unreadable_, true))
      news.problem = folder_.string() + ": cannot be read: " + error.message();
    return news;
  }
  unreadable_ = false;
  for (const auto& [path, file] : files_) {
    if (file.usable && now.count(path) == 0) news.gone.push_back(file.program);
  }
  std::vector<fs::path> settled;
  for (auto& [path, file] : now) {
    const auto before = files_.find(path);
    if (before == files_.end() || before->second.bytes != file.bytes ||
        before->second.changed != file.changed) {
      if (before != files_.end()) file.usable = before->second.usable;  // what it was still is
      continue;
    }
    file.read = true;
    file.usable = before->second.usable;
    if (!before->second.read) settled.push_back(path);
  }
  files_ = std::move(now);
  for (const fs::path& path : settled) {
    File& file = files_.at(path);
    news.found.push_back(read(path, file, static_cast<std::uint64_t>(wall_ns)));
    file.usable = news.found.back().problem.empty();
  }
  return news;
}

void ProgramFolder::find_again(const std::vector<std::string>& programs) {
  for (auto& [path, file] : files_) {
    if (std::find(programs.begin(), programs.end(), file.program) != programs.end())
      file.read = false;
  }
}

std::vector<std::string> ProgramFolder::programs() const {
  std::vector<std::string> out;
  for (const auto& [path, file] : files_) {
    if (file.usable) out.push_back(file.program);
  }
  return out;
}

std::string ProgramFolder::find(const std::function<bool(const CommandedPath&)>& is_it,
                                const std::stop_token& stop) const {
  for (const auto& [path, file] : files_) {
    if (stop.stop_requested()) break;
    try {
      if (is_it(program_in(path, file.program, machine_))) return file.program;
    } catch (const std::exception&) {
      continue;  // look() says why
    }
  }
  return {};
}

std::map<std::string, bool> ProgramFolder::found() const {
  std::map<std::string, bool> out;
  for (const auto& [path, file] : files_) out.emplace(file.program, file.read);
  return out;
}

}  // namespace servotwin::daemon
