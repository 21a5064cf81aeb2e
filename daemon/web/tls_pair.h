// The certificate of the HTTP server and its private key. Any thread. Errors: BadTlsPair with the
// file, what is wrong with it, and what to do.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

namespace servotwin::daemon {

struct BadTlsPair : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Both as PEM text. The certificate may be followed by those of its issuers. Both empty: no TLS.
struct TlsPair {
  std::string certificate, key;
  [[nodiscard]] bool given() const { return !certificate.empty(); }
};

/// Reads both files and checks that the key fits the certificate. Both names empty: no TLS.
[[nodiscard]] TlsPair read_tls_pair(const std::filesystem::path& certificate,
                                    const std::filesystem::path& key);

}  // namespace servotwin::daemon
