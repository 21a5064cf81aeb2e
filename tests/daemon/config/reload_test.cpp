#include "daemon/config/reload.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace servotwin::daemon {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

Config config_of(const std::string& text) {
  const CheckedConfig checked = check_config(text, "test.toml");
  EXPECT_THAT(checked.problems, IsEmpty());
  return checked.config;
}

TEST(Reload, WhatChangesAtOnceIsToldFromWhatNeedsARestart) {
  const Config running = config_of(
      "[machine]\nname='mill'\n[identify]\nwindow_s=8\nzeta=[0.2,2.0]\n"
      "[diagnose]\nreference_s=900\n[[axis]]\nname='X'\n");
  const Config newer = config_of(
      "[machine]\nname='lathe'\n[identify]\nwindow_s=9\nzeta=[0.3,2.0]\n"
      "[diagnose]\nreference_s=800\nrecord_s=20\nencoder_in_loop=true\n"
      "[store]\nrecordings_mb=5\nrecordings_max_mb=50\n[[axis]]\nname='Y'\n");
  const ConfigChanges changes = changes_between(running, newer);
  EXPECT_THAT(changes.at_once,
              ElementsAre("diagnose.encoder_in_loop = true (was its default)",
                          "diagnose.record_s = 20 (was its default)",
                          "identify.window_s = 9 (was 8)", testing::StartsWith("identify.zeta = "),
                          "store.recordings_max_mb = 50 (was its default)",
                          "store.recordings_mb = 5 (was its default)"));
  EXPECT_THAT(changes.by_restart,
              ElementsAre(testing::StartsWith("axis = "), "diagnose.reference_s = 800 (was 900)",
                          "machine.name = 'lathe' (was 'mill')"));
  const Config after = reloaded(running, newer);
  EXPECT_EQ(after.identify.window_s, 9.0);
  EXPECT_EQ(after.identify.options.bounds.zeta_min, 0.3);
  EXPECT_EQ(after.diagnose.record_s, 20.0);
  EXPECT_EQ(after.store.recordings_mb, 5.0);
  EXPECT_EQ(after.store.recordings_max_mb, 50.0);
  EXPECT_TRUE(after.diagnose.encoder_in_loop);
  EXPECT_EQ(after.machine, "mill");
  EXPECT_EQ(after.diagnose.reference_s, 900.0);
  EXPECT_EQ(after.axes[0].name, "X");
}

TEST(Reload, WhatNeedsARestartIsNamedUntilThereWasOne) {
  const Config newer = config_of("[machine]\nname='lathe'\n[identify]\nwindow_s=9\n");
  const Config running = reloaded(config_of("[machine]\nname='mill'\n"), newer);
  const ConfigChanges again = changes_between(running, newer);
  EXPECT_THAT(again.at_once, IsEmpty());
  EXPECT_THAT(again.by_restart, ElementsAre("machine.name = 'lathe' (was 'mill')"));
  EXPECT_EQ(again.text(),
            "configuration read again; needs a restart: machine.name = 'lathe' (was 'mill')");
}

TEST(Reload, ThePageNeedsARestartItsTokenDoesNotAndNobodyReadsItInTheLog) {
  const Config before = config_of("[http]\nlisten='127.0.0.1:8402'\ntoken='0123456789abcdef'\n"),
               newer = config_of(
                   "[http]\nlisten='0.0.0.0:8402'\ntoken='fedcba9876543210'\nnames=['mill']\n");
  const ConfigChanges changes = changes_between(before, newer);
  EXPECT_THAT(changes.at_once, ElementsAre("a new http.token"));
  EXPECT_EQ(changes.text(),
            "configuration read again: a new http.token; needs a restart: http.listen = "
            "'0.0.0.0:8402' (was '127.0.0.1:8402'), http.names = [ 'mill' ] (was its default)");
  const Config after = reloaded(before, newer);
  EXPECT_EQ(after.http.listen, "127.0.0.1:8402");
  EXPECT_EQ(after.http.token, "fedcba9876543210");
  EXPECT_THAT(changes_between(config_of(""), newer).text(),
              testing::Not(testing::HasSubstr("fedcba")));
}

TEST(Reload, NothingIsChangedByTheSame) {
  const Config config = config_of("[identify]\nwindow_s=9\n");
  EXPECT_EQ(changes_between(config, config).text(), "configuration read again: nothing changed");
}

TEST(Reload, AWishThatComesTooEarlyIsNotForgotten) {
  Reloads reloads([] { return config_of("[machine]\nname='lathe'\n"); });
  reloads.request();
  std::vector<std::string> read;
  reloads.serve_with([&](const std::function<Config()>& load) { read.push_back(load().machine); });
  EXPECT_THAT(read, ElementsAre("lathe"));
  reloads.request();
  EXPECT_THAT(read, ElementsAre("lathe", "lathe"));
  reloads.serve_with(nullptr);
  reloads.request();
  EXPECT_EQ(read.size(), 2U) << "nobody is there any more";
}

}  // namespace
}  // namespace servotwin::daemon
