// Secrets that a configuration names by their file.
#include "daemon/config/secret_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "daemon/config/config.h"
#include "daemon/config/reload.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr const char* kToken = "a token of the test";

class SecretFileTest : public testing::Test {
 protected:
  void TearDown() override { unsetenv("CREDENTIALS_DIRECTORY"); }
  [[nodiscard]] CheckedConfig checked(const std::string& http) const {
    return check_config("[http]\n" + http, folder_.path() / "m.toml");
  }
  /// The only problem of this section.
  [[nodiscard]] std::string problem_of(const std::string& http) const {
    const CheckedConfig found = checked(http);
    EXPECT_EQ(found.problems.size(), 1U) << messages(found.problems);
    return found.problems.empty() ? "" : found.problems[0].message();
  }
  TemporaryDirectory folder_;
};

TEST_F(SecretFileTest, ATokenIsReadFromItsFileWithoutTheWhiteSpaceAtItsEnd) {
  for (const char* end : {"", "\n", "\r\n", " \t\n\n"}) {
    (void)folder_.file("token", kToken + std::string(end));
    const CheckedConfig found = checked("token_file = 'token'\n");
    EXPECT_THAT(found.problems, IsEmpty());
    EXPECT_EQ(found.config.http.token, kToken);
    EXPECT_EQ(found.config.http.token_file, folder_.path() / "token");
  }
}

TEST_F(SecretFileTest, ARelativeNameIsACredentialOfSystemdFirst) {
  (void)folder_.file("token", "the token beside the file");
  const TemporaryDirectory credentials;
  setenv("CREDENTIALS_DIRECTORY", credentials.path().c_str(), 1);
  EXPECT_EQ(checked("token_file = 'token'\n").config.http.token, "the token beside the file");
  (void)credentials.file("token", "the token of systemd\n");
  EXPECT_EQ(checked("token_file = 'token'\n").config.http.token, "the token of systemd");
  const std::string absolute = folder_.path() / "token";
  EXPECT_EQ(checked("token_file = '" + absolute + "'\n").config.http.token,
            "the token beside the file");
  (void)credentials.file("key.pem", "");
  const HttpConfig tls = checked("tls_key = 'key.pem'\ntls_certificate = 'c.pem'\n").config.http;
  EXPECT_EQ(tls.tls_key, credentials.path() / "key.pem");
  EXPECT_EQ(tls.tls_certificate, folder_.path() / "c.pem");
}

TEST_F(SecretFileTest, AFileThatHoldsNoTokenIsSaidWithItsPathAndWithoutItsContents) {
  const std::string file = folder_.path() / "token";
  const std::string begin =
      (folder_.path() / "m.toml").string() + ":2:14: http.token_file = 'token': " + file;
  const std::string config = "token_file = 'token'\n";
  EXPECT_EQ(problem_of(config), begin + ": cannot be opened: No such file or directory");
  const std::string rule = ": a token has 16 to 256 characters";
  (void)folder_.file("token", " \n");
  EXPECT_EQ(problem_of(config), begin + ": is empty" + rule);
  (void)folder_.file("token", "15 letters.....\n");
  EXPECT_EQ(problem_of(config), begin + ": is too short" + rule);
  (void)folder_.file("token", std::string(257, 'x'));
  EXPECT_EQ(problem_of(config), begin + ": is too long" + rule);
  (void)folder_.file("token", std::string(100'000, 'x'));
  EXPECT_EQ(problem_of(config), begin + ": is too long" + rule);
  (void)folder_.file("token", "a token of the test\nand another line\n");
  EXPECT_THAT(problem_of(config), HasSubstr(file + ": has more than one line"));
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);
  EXPECT_THAT(problem_of(config), HasSubstr(file + ": cannot be read: Is a directory"));
  std::filesystem::remove(file);
  ASSERT_EQ(mkfifo(file.c_str(), 0600), 0);
  EXPECT_EQ(problem_of(config), begin + ": is empty" + rule) << "nobody waits for a writer";
}

TEST_F(SecretFileTest, ATokenIsGivenOnceAndACertificateWithItsKey) {
  (void)folder_.file("token", kToken);
  EXPECT_THAT(problem_of("token = 'sixteen letters.'\ntoken_file = 'token'\n"),
              HasSubstr(":3:14: http.token_file = 'token': http.token is given as well; give one"));
  EXPECT_THAT(problem_of("tls_key = 'k.pem'\n"),
              HasSubstr(":2:11: http.tls_key = 'k.pem': TLS needs both"));
  EXPECT_THAT(problem_of("tls_certificate = 'c.pem'\n"),
              HasSubstr(":2:19: http.tls_certificate = 'c.pem': TLS needs both"));
}

TEST_F(SecretFileTest, ANewTokenInTheSameFileIsAChangeAndItsTextIsNotSaid) {
  (void)folder_.file("token", kToken);
  const Config before = checked("token_file = 'token'\n").config;
  EXPECT_EQ(changes_between(before, checked("token_file = 'token'\n").config).text(),
            "configuration read again: nothing changed");
  (void)folder_.file("token", "another token of the test");
  const Config after = checked("token_file = 'token'\n").config;
  EXPECT_EQ(changes_between(before, after).text(), "configuration read again: a new http.token");
  EXPECT_EQ(reloaded(before, after).http.token, "another token of the test");
}

}  // namespace
}  // namespace servotwin::daemon
