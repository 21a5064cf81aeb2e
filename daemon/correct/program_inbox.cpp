#include "daemon/correct/program_inbox.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <system_error>

#include "daemon/correct/program_folder.h"
#include "drivers/common/text.h"
#include "drivers/recordings/table/csv.h"

namespace servotwin::daemon {
namespace fs = std::filesystem;
namespace {

using What = ProgramInbox::Outcome::What;

/// Throws, with what to do, if no file can be made or removed in the folder.
void require_writable(const fs::path& folder) {
  std::error_code there_already;
  fs::create_directory(folder, there_already);
  if (::access(folder.c_str(), W_OK | X_OK) == 0) return;
  throw std::runtime_error(
      folder.string() + ": cannot be written: " + std::generic_category().message(errno) +
      "; let the user of the daemon write into ilc.programs, or take a folder in its state "
      "directory");
}

/// A path as a file of the folder has it.
Recording recording_of(const CommandedPath& path, const MachineDescription& machine) {
  Recording out;
  for (Eigen::Index k = 0; k < path.rows(); ++k)
    out.time.push_back(machine.cycle_s * static_cast<double>(k));
  for (std::size_t i = 0; i < path.axes.size(); ++i) {
    const AxisDescription& axis = machine.axes[path.axes[i]];
    const Eigen::ArrayXd& command = path.command[i];
    out.axes.push_back({axis.name,
                        axis.rotary,
                        {command.begin(), command.end()},
                        std::vector<double>(out.time.size(), kAbsent),
                        {},
                        {}});
  }
  return out;
}

bool same_path(const CommandedPath& a, const CommandedPath& b) {
  return a.axes == b.axes && a.rows() == b.rows() &&
         std::equal(a.command.begin(), a.command.end(), b.command.begin(),
                    [](const auto& one, const auto& other) { return (one == other).all(); });
}

}  // namespace

std::string ProgramInbox::problem(const fs::path& file, const std::string& program) const {
  try {
    (void)program_in(file, program, machine_);
    return {};
  } catch (const std::exception& error) {
    // Who has sent it does not know the temporary name.
    std::string why = error.what();
    if (const std::size_t at = why.find(file.string()); at != why.npos)
      why.replace(at, file.string().size(), program + ".csv");
    return why;
  }
}

ProgramInbox::Outcome ProgramInbox::enter(const std::string& program, const std::string& what,
                                          const std::function<void(const AtomicFile&)>& write) {
  const fs::path file = file_of(program, folder_);
  const bool replaces = fs::exists(file);
  if (replaces && !fs::is_regular_file(file))
    throw std::runtime_error(file.string() + ": cannot be replaced: it is not a regular file");
  AtomicFile incoming(file);
  write(incoming);
  if (std::string why = problem(incoming.temporary(), program); !why.empty())
    return {What::kRefused, std::move(why)};
  incoming.commit();
  list_.changed(program);
  events_.note_soon("program_received", "",
                    "program " + in_quotes(program) + ": " + what +
                        (replaces ? ", in place of " : ", put into the folder as ") +
                        file.filename().string());
  return {What::kDone, "it is read within two seconds, or after the program that is being learned"};
}

ProgramInbox::Outcome ProgramInbox::put(const std::string& program, const std::string& csv) {
  const std::lock_guard lock(mutex_);
  try {
    require_writable(folder_);
    return enter(program, std::to_string(csv.size()) + " bytes received over HTTP",
                 [&](const AtomicFile& file) { file.write(csv); });
  } catch (const std::exception& error) {
    return {What::kFailed, error.what()};
  }
}

ProgramInbox::Outcome ProgramInbox::accept(const std::string& program) {
  const std::lock_guard lock(mutex_);
  try {
    const std::shared_ptr<const CommandedPath> path = list_.states()[program].recognised;
    if (path == nullptr)
      return {What::kRefused, "program " + in_quotes(program) +
                                  ": the request has no body, and no motion has been recognised "
                                  "under this name; send the path as CSV"};
    require_writable(folder_);
    if (const fs::path file = file_of(program, folder_); fs::is_regular_file(file)) {
      if (same_path(program_in(file, program, machine_), *path))
        return {What::kDone, "it is in the folder already"};
      return {What::kRefused, "program " + in_quotes(program) + ": " + file.filename().string() +
                                  " in the folder has another path; rename it, or remove it"};
    }
    return enter(
        program, "recognised motion of " + std::to_string(path->rows()) + " rows",
        [&](const AtomicFile& file) { write_recording_csv(file, recording_of(*path, machine_)); });
  } catch (const std::exception& error) {
    return {What::kFailed, error.what()};
  }
}

ProgramInbox::Outcome ProgramInbox::remove(const std::string& program) {
  const std::lock_guard lock(mutex_);
  try {
    const fs::path file = file_of(program, folder_);
    if (!fs::is_regular_file(file))
      return {What::kNotThere,
              "no file in the folder of programs gives program " + in_quotes(program)};
    require_writable(folder_);
    fs::remove(file);
    list_.changed(program, true);
    events_.note_soon(
        "program_removed", "",
        "program " + in_quotes(program) + ": " + file.filename().string() + " removed over HTTP");
    return {What::kDone,
            "its file is removed; its correction is withdrawn within two seconds, or after the "
            "program that is being learned (disarm to end it at once)"};
  } catch (const std::exception& error) {
    return {What::kFailed, error.what()};
  }
}

}  // namespace servotwin::daemon
