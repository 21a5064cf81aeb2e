// The certificate of the HTTP server and its private key. Any thread. Errors: BadTlsPair with the
// file, what is wrong with it, and what to do.
#pragma once

#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>

struct gnutls_pcert_st;
struct gnutls_privkey_st;

namespace servotwin::daemon {

struct BadTlsPair : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Both as PEM text. The certificate may be followed by those of its issuers. Both empty: no TLS.
struct TlsPair {
  std::string certificate, key;
  std::int64_t expires_s = 0;  ///< first end of validity in the chain [s since 1970]
  [[nodiscard]] bool given() const { return !certificate.empty(); }
};

/// Reads both files and checks that the key fits the certificate. Both names empty: no TLS.
[[nodiscard]] TlsPair read_tls_pair(const std::filesystem::path& certificate,
                                    const std::filesystem::path& key);

/// A line for people if a certificate has expired at `now_s` [s since 1970] or expires within
/// kExpiryNotice_days; empty otherwise.
inline constexpr int kExpiryNotice_days = 30;  // authorities renew at a third of 90 days
[[nodiscard]] std::string expiry_note(const TlsPair& pair, std::int64_t now_s);

/// What a gnutls_certificate_retrieve_function3 does with GNUTLS_CERT_RETR_DEINIT_ALL: gives
/// GnuTLS certificates and key for one handshake, which it frees. Returns 0, or -1 if there is no
/// memory.
[[nodiscard]] int offer(const TlsPair& pair, gnutls_pcert_st** chain, unsigned* count,
                        gnutls_privkey_st** key);

}  // namespace servotwin::daemon
