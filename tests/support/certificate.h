// A certificate of "localhost" that is its own issuer, made by OpenSSL.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/process.h"

namespace servotwin::test {

/// Replaces both files.
inline void make_certificate(const std::filesystem::path& certificate,
                             const std::filesystem::path& key, int days = 60) {
  Process openssl({"openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt",
                   "ec_paramgen_curve:P-256", "-nodes", "-days", std::to_string(days), "-subj",
                   "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-keyout", key,
                   "-out", certificate});
  const int status = openssl.end();
  ASSERT_EQ(status, 0) << openssl.said();
}

}  // namespace servotwin::test
