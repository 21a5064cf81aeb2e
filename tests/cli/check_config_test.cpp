// servotwin check-config: obstacles to a start of the daemon that are not errors in the text of its
// configuration.
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <fstream>

#include "daemon/store/store.h"
#include "daemon/web/http_server.h"
#include "program.h"
#include "recordings.h"
#include "tests/support/certificate.h"

namespace servotwin {
namespace {

using testing::ContainsRegex;
using testing::HasSubstr;
using testing::IsEmpty;

std::string rows(const std::string& axis) {
  std::string table = "time[s]," + axis + ".command[m]," + axis + ".actual[m]\n";
  for (int k = 0; k < 20; ++k) table += cell(0.001 * k) + "," + cell(k) + "," + cell(k) + "\n";
  return table;
}

std::string replaying(const Folder& folder, const std::string& files, const std::string& store) {
  return folder.write("m.toml", "[source.replay]\nfiles = [" + files +
                                    "]\n[[axis]]\nname = 'X'\n[store]\ndirectory = '" + store +
                                    "'\n");
}

TEST(CheckConfig, ReadsTheRecordingsAndMakesNothing) {
  const Folder folder;
  const std::string recording = "'" + folder.write("x.csv", rows("X")) + "'";
  const std::string config = replaying(folder, recording, folder / "a/b/store");
  const auto before = folder.list();
  const Answer answer = servotwin_says({"check-config", config});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr(": valid"));
  EXPECT_EQ(folder.list(), before) << "no store is made";
}

TEST(CheckConfig, EveryRecordingThatIsMissingIsSaidAndAStoreInAFile) {
  const Folder folder;
  const std::string recording = folder.write("x.csv", rows("X"));
  const std::string config = replaying(
      folder, "'" + folder / "one.csv" + "', '" + folder / "two.csv" + "'", recording + "/store");
  const Answer answer = servotwin_says({"check-config", config});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 4U) << answer;
  EXPECT_THAT(answer.complaints()[0], HasSubstr("x.csv/store: cannot be written: "));
  EXPECT_THAT(answer.complaints()[0], HasSubstr("Not a directory"));
  EXPECT_THAT(answer.complaints()[1], HasSubstr("one.csv: there is no such file"));
  EXPECT_THAT(answer.complaints()[2], HasSubstr("two.csv: there is no such file"));
  EXPECT_THAT(answer.complaints()[3], HasSubstr("m.toml: 3 problems"));
}

TEST(CheckConfig, AStoreWhereNothingCanBeMadeAndProcessorsThatAreNotThereAreSaid) {
  const Folder folder;
  const std::string config =
      folder.write("m.toml", "[store]\ndirectory = '/proc/x'\n[real_time]\ncpus = [0, 1023]\n");
  const Answer answer = servotwin_says({"check-config", config});
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_EQ(answer.complaints().size(), 3U) << answer;
  EXPECT_THAT(answer.complaints()[0], HasSubstr("store /proc/x: cannot be written: "));
  EXPECT_THAT(answer.complaints()[1], HasSubstr("real_time.cpus: there is no processor 1023"));
}

TEST(CheckConfig, AStoreAndAnAddressThatAreTakenAreNoted) {
  const Folder folder;
  const daemon::HttpServer server({"127.0.0.1", 0, false}, {}, [](const daemon::HttpRequest&) {
    return daemon::HttpResponse{};
  });
  const daemon::Store store(folder / "store", "mill");
  const std::string address = server.address().text();
  const Answer answer = servotwin_says(
      {"check-config", folder.write("m.toml", "[store]\ndirectory = '" + folder / "store" +
                                                  "'\n[http]\nlisten = '" + address + "'\n")});
  EXPECT_EQ(answer.status, 0) << "it may be for the daemon that has them: " << answer;
  EXPECT_THAT(answer.out, HasSubstr("note: store " + folder / "store" + " is in use"));
  EXPECT_THAT(answer.out, HasSubstr("note: " + address + " is in use"));
}

TEST(CheckConfig, WhoMayReadTheTokenIsNotedAndAPageOnTheNetworkWithoutTls) {
  const Folder folder;
  const std::string store = "[store]\ndirectory = '" + folder / "store" + "'\n[http]\n";
  const auto said = [&](const std::string& http, mode_t of_config, mode_t of_token) {
    const std::string config = folder.write("m.toml", store + http);
    const std::string token = folder.write("token", "a token of the test\n");
    chmod(config.c_str(), of_config);
    chmod(token.c_str(), of_token);
    const Answer answer = servotwin_says({"check-config", config});
    EXPECT_EQ(answer.status, 0) << answer;
    return answer.out;
  };
  const std::string here = "listen = '127.0.0.1:0'\n", token = "token = 'a token of the test'\n",
                    token_file = "token_file = 'token'\n";
  EXPECT_THAT(said(here + token, 0640, 0600),
              HasSubstr("note: " + folder / "m.toml" +
                        " contains http.token, and others than its owner can read it (mode 0640)"));
  EXPECT_THAT(said(here + token, 0600, 0644), testing::Not(HasSubstr("note: ")));
  EXPECT_THAT(said(here + token_file, 0644, 0604),
              HasSubstr("note: " + folder / "token" +
                        " contains the token, and others than its owner can read it (mode 0604)"));
  EXPECT_THAT(said(here + token_file, 0644, 0600), testing::Not(HasSubstr("note: ")));
  EXPECT_THAT(said("listen = '0.0.0.0:0'\n", 0644, 0600),
              HasSubstr("note: 0.0.0.0:0 can be reached from the network without TLS"));
  EXPECT_THAT(said("listen = '[::1]:0'\n", 0644, 0600), testing::Not(HasSubstr("without TLS")));
}

TEST(CheckConfig, ATlsCertificateThatCannotBeUsedIsSaid) {
  const Folder folder;
  const Answer answer = servotwin_says(
      {"check-config",
       folder.write("m.toml", "[store]\ndirectory = '" + folder / "store" +
                                  "'\n[http]\nlisten = 'none'\ntls_certificate = 'c.pem'\n"
                                  "tls_key = 'k.pem'\n")});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("http.tls_certificate: " + folder / "c.pem" +
                                    ": cannot be opened: No such file or directory"));
}

TEST(CheckConfig, ACertificateThatExpiresWithinAMonthIsNoted) {
  const Folder folder;
  const std::string config = folder.write(
      "m.toml", "[store]\ndirectory = '" + folder / "store" +
                    "'\n[http]\nlisten = 'none'\ntls_certificate = 'c.pem'\ntls_key = 'k.pem'\n");
  const std::string note = "note: the certificate in http.tls_certificate expires soon: 2";
  test::make_certificate(folder / "c.pem", folder / "k.pem", 29);
  EXPECT_THAT(servotwin_says({"check-config", config}).out, HasSubstr(note));
  test::make_certificate(folder / "c.pem", folder / "k.pem", 31);
  EXPECT_THAT(servotwin_says({"check-config", config}).out, testing::Not(HasSubstr("note: ")));
}

TEST(CheckConfig, AKeyOfVeryManyPartsIsAProblem) {
  const Folder folder;
  std::string key = "a";
  for (int i = 1; i < 20'000; ++i) key += ".a";
  const Answer answer = servotwin_says({"check-config", folder.write("m.toml", key + " = 1\n")});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("m.toml:1:64: a key has more than 32 parts"));
}

TEST(CheckConfig, ABandwidthThatLimitsNothingIsNoted) {
  const Folder folder;
  const auto said = [&](const std::string& bandwidth) {
    return servotwin_says(
        {"check-config",
         folder.write("a.toml", "[machine]\ncycle_s = 0.001\n[store]\ndirectory = \"" +
                                    (folder / "store") +
                                    "\"\n[http]\nlisten = \"none\"\n[[axis]]\nname = \"X\"\n"
                                    "correction = { peak = 1e-4, rate = 0.01, bandwidth = " +
                                    bandwidth + " }\n")});
  };
  const Answer wide = said("501");
  EXPECT_EQ(wide.status, 0) << wide;
  EXPECT_THAT(wide.out, HasSubstr("note: axis X: the correction bandwidth of 501 Hz has no effect, "
                                  "since half the cycle rate is 500 Hz"));
  EXPECT_EQ(said("500").out.find("note: axis X"), std::string::npos);
}

class OffsetsOverCan : public testing::Test {
 protected:
  /// check-config for a machine with one corrected axis on CAN over UDP.
  [[nodiscard]] Answer said(const std::string& timeout, const std::string& ilc,
                            const std::string& udp = "listen = '127.0.0.1:0'") const {
    (void)folder_.write("map.toml",
                        "cycle_s = 0.001\n[[axis]]\nname = 'X'\n" + timeout +
                            "\ncommand = {id = 0x181, start_bit = 0, length = 32, unit = 'um'}\n"
                            "offset = {id = 0x401, start_bit = 0, length = 32, unit = 'um', "
                            "message_bytes = 4}\n");
    return servotwin_says(
        {"check-config",
         folder_.write("m.toml", "[source.udp]\nmap = 'map.toml'\n" + udp +
                                     "\n[[axis]]\nname = 'X'\ncorrection = { peak = 1e-4, rate = "
                                     "0.01, bandwidth = 100 }\n[store]\ndirectory = '" +
                                     (folder_ / "store") + "'\n[http]\nlisten = 'none'\n[ilc]\n" +
                                     ilc + "\n")});
  }
  Folder folder_;
};

TEST_F(OffsetsOverCan, WhatTheDrivesMustHaveIsPrinted) {
  const Answer answer = said("offset_timeout_s = 0.025", "live = true\ndrive_ramp_s = 0.05");
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(
      answer.out,
      HasSubstr(
          "offsets     live; a drive keeps one for 20 ms or longer (validity_s), then ramps it "
          "to 0 within 50 ms (drive_ramp_s)\n"));
  EXPECT_THAT(answer.out, HasSubstr("drive       X: 0x1400 + n, sub-index 5, = 25 [ms]: event "
                                    "timer of the RPDO with 0x60B0 (0x401)"));
  EXPECT_THAT(answer.out, HasSubstr("drive       X: 0x6007:00: abort connection option code"));
}

TEST_F(OffsetsOverCan, ThatCannotBeArmedAreAProblem) {
  const auto problem = [&](const Answer& answer) {
    EXPECT_EQ(answer.status, 1) << answer;
    EXPECT_EQ(answer.complaints().size(), 1U) << answer;
    EXPECT_THAT(answer.err, HasSubstr("m.toml: offsets cannot be armed: "));
    return answer.err;
  };
  EXPECT_THAT(problem(said("", "live = true")), HasSubstr("does not say what the drive of axis X"));
  EXPECT_THAT(problem(said("offset_timeout_s = 'none'", "live = true")),
              HasSubstr("axis X keeps the last offset for ever"));
  EXPECT_THAT(problem(said("offset_timeout_s = 0.01", "live = true")),
              HasSubstr("ilc.validity_s = 0.02 s is longer than the time-out of 0.01 s"));
  EXPECT_THAT(problem(said("offset_timeout_s = 0.01", "live = true\nvalidity_s = 0.001")),
              HasSubstr("shorter than two cycles of the machine (0.002 s)"));
}

TEST_F(OffsetsOverCan, OfADryRunAndOfAnAxisThatIsNamedAreNoted) {
  const Answer dry = said("", "");
  EXPECT_EQ(dry.status, 0) << dry;
  EXPECT_THAT(dry.out, HasSubstr("offsets     dry run;"));
  EXPECT_THAT(dry.out, HasSubstr("note: with ilc.live = true offsets cannot be armed: "));
  EXPECT_THAT(dry.out, Not(HasSubstr("programs")));
  EXPECT_THAT(said("", "programs = 'nowhere'").out,
              ContainsRegex("programs    the .csv files in .*nowhere, which is not there: "));
  EXPECT_THAT(said("", "programs = '.'").out, Not(HasSubstr("cannot be read now")));
  const Answer named =
      said("offset_timeout_s = 'none'", "live = true\narm_without_timeout = ['X']");
  EXPECT_EQ(named.status, 0) << named;
  EXPECT_THAT(named.out, HasSubstr("note: the drive of axis X keeps the last offset for ever"));
  EXPECT_THAT(named.out, HasSubstr("the mapping states that the drive has none"));
}

TEST_F(OffsetsOverCan, FramesOfAnybodyAreNotAccepted) {
  const Answer open = said("", "", "listen = '0.0.0.0:20000'");
  EXPECT_EQ(open.status, 1) << open;
  EXPECT_THAT(open.err, HasSubstr("source.udp.listen: '0.0.0.0:20000': other hosts reach"));
  EXPECT_EQ(said("", "", "listen = '0.0.0.0:20000'\npeer = '127.0.0.1:5'").status, 0);
}

TEST(CheckConfig, AValidityBelowTwoCyclesIsAProblemOverDdsAsWell) {
  const Folder folder;
  const auto said = [&](const std::string& validity) {
    return servotwin_says(
        {"check-config",
         folder.write("a.toml", "[machine]\ncycle_s = 0.004\n[store]\ndirectory = '" +
                                    (folder / "store") +
                                    "'\n[http]\nlisten = 'none'\n[[axis]]\nname = 'X'\n"
                                    "correction = { peak = 1e-4, rate = 0.01, bandwidth = 100 }\n"
                                    "[ilc]\nlive = true\nvalidity_s = " +
                                    validity + "\n")});
  };
  EXPECT_THAT(said("0.007").err, HasSubstr("shorter than two cycles of the machine (0.008 s)"));
  EXPECT_EQ(said("0.008").status, 0) << said("0.008");
}

TEST(CheckConfig, AnAddressOfAnotherHostIsSaid) {
  const Folder folder;
  const Answer answer = servotwin_says(
      {"check-config", folder.write("m.toml", "[store]\ndirectory = '" + folder / "store" +
                                                  "'\n[http]\nlisten = '192.0.2.1:8402'\n")});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("this host has no such address"));
}

TEST(CheckConfig, ALimitThatIsWrongIsOneProblemAndWhatItNamesIsLookedAtLater) {
  const Folder folder;
  const Answer answer = servotwin_says(
      {"check-config", folder.write("m.toml",
                                    "[store]\ndirectory = '/proc/x'\nrecordings_mb = "
                                    "-1\nrecordings_max_mb = 100\n")});
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("store.recordings_mb = -1"));
  EXPECT_THAT(answer.err, HasSubstr("are checked once this is corrected"));
}

TEST(CheckConfig, TakesTheFileOfTheReference) {
  std::ifstream readme(SERVOTWIN_SOURCE_DIR "/docs/reference.md");
  std::string text;
  bool within = false;
  for (std::string line; std::getline(readme, line);) {
    within = within ? line.empty() || line.starts_with("    ") : line == "    [machine]";
    if (within) text += line + "\n";
  }
  ASSERT_THAT(text, HasSubstr("[real_time]"));
  const Folder folder;
  const Answer answer = servotwin_says({"check-config", folder.write("m.toml", text)});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("axes        X, Y\n"));
}

TEST(CheckConfig, SaysWhereTheDaemonListensAndWhereItSpeaks) {
  const Folder folder;
  const std::string config = folder.write(
      "m.toml", "[store]\ndirectory = '" + folder / "store" +
                    "'\n[source.dds]\ndomain = 3\n[dds]\ndomain = 5\npartition = 'cell'\n");
  const Answer answer = servotwin_says({"check-config", config});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("source      DDS domain 3, partition 'cell'\n"));
  EXPECT_THAT(answer.out, HasSubstr("output      DDS domain 5, partition 'cell'\n"));
}

TEST(CheckConfig, ARecordingOfOtherAxesIsSaid) {
  const Folder folder;
  const std::string recording = "'" + folder.write("y.csv", rows("Y")) + "'";
  const Answer answer =
      servotwin_says({"check-config", replaying(folder, recording, folder / "store")});
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("axis 1 is 'X' in the configuration and 'Y' in the recording"));
}

}  // namespace
}  // namespace servotwin
