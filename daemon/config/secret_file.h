// Files for the page that a configuration names: the token, the certificate and its key. Errors:
// std::runtime_error with the name of the file, never with its contents. Any thread.
#pragma once

#include <filesystem>
#include <string>

namespace servotwin::daemon {

inline constexpr std::size_t kMinTokenBytes = 16, kMaxTokenBytes = 256;

/// The file that a configuration in `folder` means by `name`. A relative name is looked for among
/// the credentials of systemd ($CREDENTIALS_DIRECTORY) first and then in `folder`.
[[nodiscard]] std::filesystem::path find_secret(const std::filesystem::path& name,
                                                const std::filesystem::path& folder);

/// The token in a file, without white space at its end: one line of kMinTokenBytes to
/// kMaxTokenBytes.
[[nodiscard]] std::string token_in(const std::filesystem::path& file);

}  // namespace servotwin::daemon
