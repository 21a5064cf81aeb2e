// HTTPS with the client of OpenSSL, another implementation than that of the server.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>

#include "daemon/web/http_server.h"
#include "tests/daemon/web/http_fixture.h"
#include "tests/support/certificate.h"
#include "tests/support/process.h"

namespace servotwin::daemon {
namespace {

using test::make_certificate;
using testing::HasSubstr;
using testing::Not;

class TlsTest : public HttpTest {
 protected:
  void SetUp() override {
    make_certificate(certificate_, key_);
    config_.tls_certificate = certificate_;
    config_.tls_key = key_;
    web_.reset();
    start();
  }
  /// The client of OpenSSL, which sends a request and trusts our certificate alone.
  [[nodiscard]] std::unique_ptr<test::Process> client(const std::string& request,
                                                      const std::string& options = "") const {
    const std::string file = directory_.file("request", request + "Host: localhost\r\n\r\n");
    return std::make_unique<test::Process>(std::vector<std::string>{
        "sh", "-c",
        "exec openssl s_client -quiet -connect 127.0.0.1:" + std::to_string(port_) + " -CAfile " +
            certificate_.string() + " -verify_return_error -verify_hostname localhost " + options +
            " < " + file});
  }
  [[nodiscard]] std::string answer_to(const std::string& request,
                                      const std::string& options = "") const {
    const auto openssl = client(request + "Connection: close\r\n", options);
    (void)openssl->end();
    return openssl->said();
  }
  const std::filesystem::path certificate_ = directory_.path() / "certificate.pem";
  const std::filesystem::path key_ = directory_.path() / "key.pem";
};

TEST_F(TlsTest, PageMetricsChangesAndTheStreamComeOverIt) {
  show();
  EXPECT_EQ(web_->url(), "https://127.0.0.1:" + std::to_string(port_) + "/");
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n"), HasSubstr("<!doctype html>"));
  EXPECT_THAT(answer_to("GET /metrics HTTP/1.1\r\n"), HasSubstr("servotwin_healthy"));
  const std::string arm = "POST /api/v1/offsets/arm HTTP/1.1\r\nAuthorization: Bearer ";
  EXPECT_THAT(answer_to(arm + "wrong\r\n"), HasSubstr("HTTP/1.1 401 "));
  EXPECT_FALSE(armed_);
  EXPECT_THAT(answer_to(arm + kToken + "\r\n"), HasSubstr("\"armed\":true"));
  EXPECT_TRUE(armed_);
  const auto stream = client("GET /api/v1/stream HTTP/1.1\r\n");
  ASSERT_TRUE(stream->says("Content-Type: text/event-stream")) << stream->said();
  MachineStatus status;
  status.frames = 4711;
  EXPECT_TRUE(tells(
      "\"frames\":4711", [&] { return stream->said(); }, status))
      << stream->said();
}

TEST_F(TlsTest, OldVersionsAndPlainTextAreNotAnswered) {
  // The client must offer it: its own default refuses TLS 1.1.
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n", "-tls1_1 -cipher ALL:@SECLEVEL=0"),
              Not(HasSubstr("<!doctype html>")));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n", "-tls1_2"), HasSubstr("<!doctype html>"));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n", "-tls1_3"), HasSubstr("<!doctype html>"));
  HttpConnection plain(port_);
  plain.send("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(plain.rest(), Not(HasSubstr("200 OK")));
}

TEST_F(TlsTest, ADisarmGetsThroughConnectionsThatNeverBeginTls) {
  show();
  armed_ = true;
  std::vector<std::unique_ptr<HttpConnection>> silent;
  for (int i = 0; i < 80; ++i) {
    silent.push_back(std::make_unique<HttpConnection>(port_));
    (void)silent.back()->try_sending("\x16");  // the first byte of a handshake
  }
  EXPECT_THAT(answer_to(std::string("POST /api/v1/offsets/disarm HTTP/1.1\r\nAuthorization: "
                                    "Bearer ") +
                        kToken + "\r\n"),
              HasSubstr("\"armed\":false"));
  EXPECT_FALSE(armed_);
}

TEST_F(TlsTest, ARenewedCertificateIsForNewConnectionsAndTheStreamGoesOn) {
  show();
  const auto stream = client("GET /api/v1/stream HTTP/1.1\r\n");
  ASSERT_TRUE(stream->says("Content-Type: text/event-stream")) << stream->said();
  const std::filesystem::path old = directory_.path() / "old.pem";
  std::filesystem::copy_file(certificate_, old);
  const std::string trusting_the_old = "-CAfile " + old.string();
  EXPECT_FALSE(web_->use_tls(read_tls_pair(certificate_, key_))) << "it is the same";
  make_certificate(certificate_, key_);
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n"), Not(HasSubstr("<!doctype html>")));
  EXPECT_TRUE(web_->use_tls(read_tls_pair(certificate_, key_)));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n"), HasSubstr("<!doctype html>"));
  EXPECT_THAT(answer_to("GET / HTTP/1.1\r\n", trusting_the_old), Not(HasSubstr("<!doctype html>")));
  MachineStatus status;
  status.frames = 4711;
  EXPECT_TRUE(tells(
      "\"frames\":4711", [&] { return stream->said(); }, status))
      << stream->said();
}

TEST_F(TlsTest, ACertificateThatExpiresIsNoted) {
  constexpr std::int64_t kDay_s = 86'400;
  make_certificate(certificate_, key_, 60);
  const std::int64_t now_s = std::time(nullptr);
  const TlsPair pair = read_tls_pair(certificate_, key_);
  EXPECT_EQ(expiry_note(pair, now_s + 29 * kDay_s), "");
  EXPECT_THAT(expiry_note(pair, now_s + 31 * kDay_s),
              HasSubstr("the certificate in http.tls_certificate expires soon: 2"));
  EXPECT_THAT(expiry_note(pair, now_s + 61 * kDay_s), HasSubstr("has expired: 2"));
  EXPECT_EQ(expiry_note({}, now_s), "");
}

TEST_F(TlsTest, WhatDoesNotFitIsSaidWithItsFile) {
  const std::filesystem::path other_key = directory_.path() / "other key.pem",
                              other = directory_.path() / "other.pem",
                              none = directory_.path() / "none.pem",
                              text = directory_.file("text.pem", "no certificate\n");
  make_certificate(other, other_key);
  const auto why = [](const std::filesystem::path& certificate, const std::filesystem::path& key) {
    return message_of([&] { (void)read_tls_pair(certificate, key); });
  };
  EXPECT_TRUE(read_tls_pair(other, other_key).given());
  EXPECT_FALSE(read_tls_pair({}, {}).given());
  EXPECT_EQ(why(certificate_, other_key),
            "http.tls_key: " + other_key.string() + ": is not the key of the certificate in " +
                certificate_.string() + "; that must come first in its file");
  EXPECT_EQ(why(none, key_), "http.tls_certificate: " + none.string() +
                                 ": cannot be opened: No such file or directory");
  EXPECT_EQ(why(certificate_, none),
            "http.tls_key: " + none.string() + ": cannot be opened: No such file or directory");
  EXPECT_THAT(why(text, key_), HasSubstr("http.tls_certificate: " + text.string() +
                                         ": is no certificate in PEM form: "));
  EXPECT_THAT(why(certificate_, text),
              HasSubstr("http.tls_key: " + text.string() +
                        ": is no private key in PEM form without a password: "));
}

}  // namespace
}  // namespace servotwin::daemon
