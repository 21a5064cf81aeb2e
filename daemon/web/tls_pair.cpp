#include "daemon/web/tls_pair.h"

#include <gnutls/abstract.h>
#include <gnutls/gnutls.h>
#include <gnutls/x509.h>

#include <algorithm>
#include <ctime>
#include <limits>
#include <vector>

#include "drivers/common/file_handle.h"

namespace servotwin::daemon {
namespace {

constexpr std::size_t kMaxPemBytes = std::size_t{1} << 20;  // a chain has some kilobytes

std::string text_of(const std::string& setting, const std::filesystem::path& file) {
  try {
    return read_text(file, kMaxPemBytes);
  } catch (const std::runtime_error& error) {
    throw BadTlsPair(setting + ": " + error.what());
  }
}

gnutls_datum_t datum(const std::string& text) {
  return {reinterpret_cast<unsigned char*>(const_cast<char*>(text.data())),
          static_cast<unsigned>(text.size())};
}

/// The certificates of a PEM text.
struct Chain {
  explicit Chain(const std::string& pem) {
    const gnutls_datum_t data = datum(pem);
    error = gnutls_x509_crt_list_import2(&all, &count, &data, GNUTLS_X509_FMT_PEM, 0);
  }
  Chain(const Chain&) = delete;
  Chain& operator=(const Chain&) = delete;
  ~Chain() {
    for (unsigned i = 0; i < count; ++i) gnutls_x509_crt_deinit(all[i]);
    gnutls_free(all);
  }
  gnutls_x509_crt_t* all = nullptr;
  unsigned count = 0;
  int error;
};

/// The first end of validity [s since 1970].
std::int64_t check_certificate(const std::string& pem, const std::string& place) {
  const Chain chain(pem);
  if (chain.error < 0)
    throw BadTlsPair(place + ": is no certificate in PEM form: " + gnutls_strerror(chain.error));
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  for (unsigned i = 0; i < chain.count; ++i)
    first = std::min<std::int64_t>(first, gnutls_x509_crt_get_expiration_time(chain.all[i]));
  return first;
}

std::string date_of(std::int64_t time_s) {
  const std::time_t time = time_s;
  std::tm utc{};
  gmtime_r(&time, &utc);
  char text[40];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", &utc)};
}

void check_key(const std::string& pem, const std::string& place) {
  const gnutls_datum_t data = datum(pem);
  gnutls_x509_privkey_t key = nullptr;
  gnutls_x509_privkey_init(&key);
  const int error =
      gnutls_x509_privkey_import2(key, &data, GNUTLS_X509_FMT_PEM, nullptr, GNUTLS_PKCS_PLAIN);
  gnutls_x509_privkey_deinit(key);
  if (error < 0)
    throw BadTlsPair(
        place + ": is no private key in PEM form without a password: " + gnutls_strerror(error));
}

}  // namespace

TlsPair read_tls_pair(const std::filesystem::path& certificate, const std::filesystem::path& key) {
  if (certificate.empty()) return {};
  TlsPair pair{text_of("http.tls_certificate", certificate), text_of("http.tls_key", key)};
  pair.expires_s =
      check_certificate(pair.certificate, "http.tls_certificate: " + certificate.string());
  check_key(pair.key, "http.tls_key: " + key.string());
  gnutls_certificate_credentials_t both = nullptr;
  gnutls_certificate_allocate_credentials(&both);
  const gnutls_datum_t certificate_data = datum(pair.certificate), key_data = datum(pair.key);
  const int error =
      gnutls_certificate_set_x509_key_mem(both, &certificate_data, &key_data, GNUTLS_X509_FMT_PEM);
  gnutls_certificate_free_credentials(both);
  if (error == GNUTLS_E_CERTIFICATE_KEY_MISMATCH)
    throw BadTlsPair("http.tls_key: " + key.string() + ": is not the key of the certificate in " +
                     certificate.string() + "; that must come first in its file");
  if (error < 0)
    throw BadTlsPair("http.tls_key: " + key.string() + ": cannot be used with " +
                     certificate.string() + ": " + gnutls_strerror(error));
  return pair;
}

std::string expiry_note(const TlsPair& pair, std::int64_t now_s) {
  constexpr std::int64_t kDay_s = 86'400;
  if (!pair.given() || pair.expires_s - now_s > kExpiryNotice_days * kDay_s) return {};
  return std::string("the certificate in http.tls_certificate ") +
         (pair.expires_s <= now_s ? "has expired: " : "expires soon: ") + date_of(pair.expires_s) +
         "; renew it, then reload servotwind";
}

int offer(const TlsPair& pair, gnutls_pcert_st** chain, unsigned* count, gnutls_privkey_st** key) {
  const Chain certificates(pair.certificate);
  *count = certificates.count;
  *chain = static_cast<gnutls_pcert_st*>(gnutls_calloc(*count, sizeof(gnutls_pcert_st)));
  if (*chain == nullptr) return -1;
  const gnutls_datum_t data = datum(pair.key);
  if (gnutls_pcert_import_x509_list(*chain, certificates.all, count, 0) < 0) {
    gnutls_free(*chain);
    return -1;
  }
  gnutls_privkey_init(key);
  return gnutls_privkey_import_x509_raw(*key, &data, GNUTLS_X509_FMT_PEM, nullptr, 0) < 0 ? -1 : 0;
}

}  // namespace servotwin::daemon
