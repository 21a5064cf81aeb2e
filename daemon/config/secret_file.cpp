#include "daemon/config/secret_file.h"

#include <fcntl.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>
#include <system_error>

#include "drivers/common/file_handle.h"

namespace servotwin::daemon {

std::filesystem::path find_secret(const std::filesystem::path& name,
                                  const std::filesystem::path& folder) {
  const char* credentials = std::getenv("CREDENTIALS_DIRECTORY");
  std::error_code unknown;
  if (name.is_relative() && credentials != nullptr &&
      std::filesystem::exists(credentials / name, unknown))
    return credentials / name;
  return folder / name;
}

std::string token_in(const std::filesystem::path& file) {
  const auto refuse = [&](const std::string& why) {
    throw std::runtime_error(file.string() + ": " + why);
  };
  // O_NONBLOCK: a pipe without a writer is empty; reading does not wait for one.
  const FileHandle handle = FileHandle::open(file, O_RDONLY | O_NONBLOCK | O_NOCTTY);
  char block[4096];
  std::string token(block, handle.read(block, sizeof block));
  token.erase(token.find_last_not_of(" \t\r\n") + 1);
  const std::string rule = ": a token has " + std::to_string(kMinTokenBytes) + " to " +
                           std::to_string(kMaxTokenBytes) + " characters";
  if (token.empty()) refuse("is empty" + rule);
  if (token.size() < kMinTokenBytes) refuse("is too short" + rule);
  if (token.size() > kMaxTokenBytes) refuse("is too long" + rule);
  if (std::any_of(token.begin(), token.end(), [](unsigned char c) { return c < ' ' || c == 127; }))
    refuse("has more than one line, or control characters: a token is one line of text");
  return token;
}

}  // namespace servotwin::daemon
