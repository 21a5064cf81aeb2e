// Programs as files: a folder that is looked at, for machines whose control cannot send a path over
// DDS. Every .csv file in it is a commanded path (docs/files.md) and becomes a program that is
// learned, named after its file; a file that changes is a new revision of it.
//
// A file is read once its size and time have been the same for two looks, so that a file that is
// still being written waits; one that is renamed into the folder is complete. Other files, folders
// and names that begin with a dot are left alone. Nothing is written there but by
// program_inbox.h.
//
// One thread; errors: none are thrown, what is wrong is in the result.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <stop_token>
#include <string>
#include <system_error>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// Largest file that is read [byte]: a program of the maximum of rows in twelve columns of twelve
/// digits takes a third of it.
inline constexpr std::uintmax_t kMaxProgramFile_bytes = 256'000'000;

/// The path in a file as the chunks of `program`, in one revision, to be learned. Throws
/// std::runtime_error, in one line that begins with the file, if it is not a path of these axes.
[[nodiscard]] std::vector<ProgramChunk> read_program(const std::filesystem::path& file,
                                                     const std::string& program,
                                                     const MachineDescription& machine,
                                                     std::uint64_t revision);

/// The path in a file as the program that such chunks make. Throws std::runtime_error, in one line
/// that begins with the file, if it is none of this machine.
[[nodiscard]] CommandedPath program_in(const std::filesystem::path& file,
                                       const std::string& program,
                                       const MachineDescription& machine);

/// The file of `folder` that gives `program`, the first by name; where there is none, the file that
/// would. Throws std::runtime_error if the folder cannot be read.
[[nodiscard]] std::filesystem::path file_of(const std::string& program,
                                            const std::filesystem::path& folder);

class ProgramFolder {
 public:
  struct Found {
    std::string program;
    std::uint64_t revision = 0;
    std::vector<ProgramChunk>
        chunks;           ///< complete; empty: it cannot be used, and `problem` says why
    std::string problem;  ///< one line with the file's path
    std::string renamed;  ///< its file, if the name of the program is not that of the file
    bool taken = false;   ///< another file has this name already, as `problem` says
  };
  struct News {
    std::vector<Found> found;
    std::vector<std::string> gone;  ///< programs whose file is no longer there
    std::string problem;  ///< the folder cannot be read: said once, until it can be read again
  };

  /// `folder`: may be missing for now.
  ProgramFolder(std::filesystem::path folder, MachineDescription machine);

  /// What has changed since the last call; call it about once a second. `wall_ns`: now, which
  /// becomes the revision of what is found.
  [[nodiscard]] News look(std::int64_t wall_ns);
  /// Finds these again at the next look, as a new revision, if their file is still there.
  void find_again(const std::vector<std::string>& programs);
  /// The programs whose files were found and could be read.
  [[nodiscard]] std::vector<std::string> programs() const;
  /// The programs of all files that were found, and whether they have been read.
  [[nodiscard]] std::map<std::string, bool> found() const;
  /// The first program whose file `is_it`, read now, or empty; one that cannot be read is not it.
  [[nodiscard]] std::string find(const std::function<bool(const CommandedPath&)>& is_it,
                                 const std::stop_token& stop) const;
  [[nodiscard]] const std::filesystem::path& folder() const noexcept { return folder_; }

 private:
  struct File {
    std::uintmax_t bytes = 0;
    std::filesystem::file_time_type changed;
    std::string program;
    bool read = false, usable = false;
  };

  [[nodiscard]] std::map<std::filesystem::path, File> files(std::error_code& error) const;
  [[nodiscard]] Found read(const std::filesystem::path& file, const File& known,
                           std::uint64_t revision) const;

  std::filesystem::path folder_;
  MachineDescription machine_;
  std::map<std::filesystem::path, File> files_;  // in the order of their names
  bool unreadable_ = false;
};

}  // namespace servotwin::daemon
