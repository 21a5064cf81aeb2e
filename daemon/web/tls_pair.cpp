#include "daemon/web/tls_pair.h"

#include <gnutls/gnutls.h>
#include <gnutls/x509.h>

#include "drivers/file_handle.h"

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

gnutls_datum_t datum(std::string& text) {
  return {reinterpret_cast<unsigned char*>(text.data()), static_cast<unsigned>(text.size())};
}

void check_certificate(std::string& pem, const std::string& place) {
  const gnutls_datum_t data = datum(pem);
  gnutls_x509_crt_t* chain = nullptr;
  unsigned count = 0;
  const int error = gnutls_x509_crt_list_import2(&chain, &count, &data, GNUTLS_X509_FMT_PEM, 0);
  if (error < 0)
    throw BadTlsPair(place + ": is no certificate in PEM form: " + gnutls_strerror(error));
  for (unsigned i = 0; i < count; ++i) gnutls_x509_crt_deinit(chain[i]);
  gnutls_free(chain);
}

void check_key(std::string& pem, const std::string& place) {
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

}  // namespace servotwin::daemon
