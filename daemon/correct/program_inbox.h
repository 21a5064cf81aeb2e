// Programs that come over HTTP, and recognised ones that are accepted. They are files of the folder
// of programs like any other (daemon/correct/program_folder.h), so that there is one way in, and a
// restart keeps them: a program is written there under a temporary name, checked by what reads the
// folder and by what assembles the chunks, and renamed. Whatever fails, the file before it stays.
//
// Any thread; all calls wait for the disk, and for each other. Errors: none are thrown.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

#include "daemon/correct/program_list.h"
#include "daemon/store/event_log.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

class ProgramInbox {
 public:
  /// `folder`: empty: none is configured, and nothing can be put. Its last part is made where it is
  /// missing. `events` must outlive the object.
  ProgramInbox(std::filesystem::path folder, MachineDescription machine, EventLog& events)
      : folder_(std::move(folder)), machine_(std::move(machine)), events_(events) {}

  struct Outcome {
    enum class What : std::uint8_t {
      kDone,
      kRefused,   ///< it is not a path of this machine
      kNotThere,  ///< nothing to remove
      kFailed,    ///< the folder
    };
    What what = What::kDone;
    std::string text;  ///< one line for people
  };

  [[nodiscard]] bool has_folder() const noexcept { return !folder_.empty(); }
  /// Puts a program, or a new revision of it, into the folder. `program`: usable_name. `csv`: what
  /// the file holds.
  [[nodiscard]] Outcome put(const std::string& program, const std::string& csv);
  /// Puts a program into the folder that the daemon has recognised in the motion.
  [[nodiscard]] Outcome accept(const std::string& program);
  /// Removes its file.
  [[nodiscard]] Outcome remove(const std::string& program);
  /// What has become of the programs.
  [[nodiscard]] ProgramList& list() noexcept { return list_; }

 private:
  /// Why the file is not a path of this machine; empty if it is.
  [[nodiscard]] std::string problem(const std::filesystem::path& file,
                                    const std::string& program) const;
  /// Puts what `write` writes into the folder, if it is a path of this machine. `what`: for people.
  [[nodiscard]] Outcome enter(const std::string& program, const std::string& what,
                              const std::function<void(const AtomicFile&)>& write);

  std::filesystem::path folder_;
  MachineDescription machine_;
  EventLog& events_;
  std::mutex mutex_;  // of the folder
  ProgramList list_;
};

}  // namespace servotwin::daemon
