// Who may use the directory of a Store: one process at a time, as one user.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <set>
#include <stdexcept>
#include <system_error>

#include "daemon/store/store.h"

namespace servotwin::daemon {
namespace {

namespace fs = std::filesystem;

constexpr auto kOthers = fs::perms::group_all | fs::perms::others_all;

std::string system_error(int error) { return std::generic_category().message(error); }

/// The nearest existing directory, in which missing ones would be created.
std::filesystem::path nearest(const std::filesystem::path& directory) {
  std::error_code ignored;
  std::filesystem::path place = directory;
  while (!place.empty() && !std::filesystem::exists(place, ignored) &&
         place != place.parent_path()) {
    place = place.parent_path();
  }
  return place.empty() ? "." : place;
}

[[noreturn]] void refuse(const std::filesystem::path& directory, const std::filesystem::path& place,
                         const std::string& why) {
  const std::string where = place == directory ? "" : place.string() + ": ";
  throw std::runtime_error("store " + directory.string() + ": cannot be written: " + where + why);
}

/// A lock of the whole file that belongs to the open file, not to the process. It can be asked for
/// without being taken, so that asking never keeps a daemon from starting.
struct flock whole_file(short type) {
  struct flock lock = {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  return lock;
}

/// Whether a servotwind of version 0.1.0 owns the store. Its lock is an exclusive flock(), which
/// does not exclude the one above. A shared one is refused while it is held, keeps such a daemon
/// from starting later, and lets everybody else lock the file for reading.
bool owned_by_0_1_0(int lock) {
  return flock(lock, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

bool made_by_a_store(const std::string& name) {
  static const std::set<std::string> folders{"lock", "models", "recordings", "reports"};
  return folders.contains(name) || name.starts_with("servotwin.sqlite");
}

}  // namespace

void Store::require_writable(const std::filesystem::path& directory) {
  const std::filesystem::path place = nearest(directory);
  std::error_code ignored;
  if (!std::filesystem::is_directory(place, ignored))
    refuse(directory, place, system_error(ENOTDIR));
  if (access(place.c_str(), W_OK | X_OK) != 0) refuse(directory, place, system_error(errno));
  for (const char* name : {"lock", "servotwin.sqlite"}) {
    const std::filesystem::path file = directory / name;
    if (access(file.c_str(), W_OK) != 0 && errno != ENOENT && errno != ENOTDIR)
      refuse(directory, file, system_error(errno));
  }
}

void Store::try_making(const std::filesystem::path& directory) {
  const std::filesystem::path place = nearest(directory);
  std::string name = place / ".servotwin-XXXXXX";
  if (mkdtemp(name.data()) == nullptr)
    refuse(directory, place, "no file can be created there: " + system_error(errno));
  rmdir(name.c_str());
}

bool Store::in_use(const std::filesystem::path& directory) {
  const int lock = ::open((directory / "lock").c_str(), O_RDONLY | O_CLOEXEC);
  if (lock < 0) return false;
  struct flock whole = whole_file(F_RDLCK);
  const bool held = fcntl(lock, F_OFD_GETLK, &whole) == 0 && whole.l_type != F_UNLCK;
  close(lock);
  return held;
}

int Store::lock_directory(const std::filesystem::path& directory) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error)
    throw std::runtime_error("store " + directory.string() + ": cannot be created: " +
                             error.message() + "; give a writable directory with --store");
  const std::filesystem::path file = directory / "lock";
  const int lock = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock < 0)
    throw std::runtime_error("store " + directory.string() + ": cannot be written: " +
                             system_error(errno) + "; give a writable directory with --store");
  struct flock whole = whole_file(F_WRLCK);
  if (fcntl(lock, F_OFD_SETLK, &whole) != 0 || owned_by_0_1_0(lock)) {
    close(lock);
    throw std::runtime_error(
        "store " + directory.string() +
        ": is in use by another servotwind; give another directory with --store");
  }
  return lock;
}

void Store::tighten_permissions() {
  int tightened = 0;
  std::string open_to_others;
  const auto tighten = [&](const fs::path& path) {
    std::error_code error;
    const fs::file_status status = fs::symlink_status(path, error);
    if (error || fs::is_symlink(status) || (status.permissions() & kOthers) == fs::perms::none)
      return;
    fs::permissions(path, kOthers, fs::perm_options::remove, error);
    if (error && open_to_others.empty())
      open_to_others = path.string() + " is open to other users: " + error.message();
    if (!error) ++tightened;
  };
  // A directory that the store shares with other files, or that all users share, is left as it is.
  bool alone = (fs::status(directory_).permissions() & fs::perms::sticky_bit) == fs::perms::none;
  for (const fs::directory_entry& entry : fs::directory_iterator(directory_)) {
    if (!made_by_a_store(entry.path().filename())) {
      alone = false;
      continue;
    }
    tighten(entry.path());
    if (!entry.is_directory() || entry.is_symlink()) continue;
    for (const fs::directory_entry& inner : fs::recursive_directory_iterator(
             entry.path(), fs::directory_options::skip_permission_denied))
      tighten(inner.path());
  }
  if (alone) tighten(directory_);
  if (tightened > 0)
    note("other users could read " + std::to_string(tightened) +
         " of the files and folders of the store; now only the user of the daemon can");
  if (!open_to_others.empty()) note(open_to_others);
}

}  // namespace servotwin::daemon
