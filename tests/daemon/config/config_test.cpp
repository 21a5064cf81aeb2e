#include "daemon/config/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/support.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

std::vector<std::string> problems_of(const std::string& text) {
  std::vector<std::string> out;
  for (const ConfigProblem& problem : check_config(text, "m.toml").problems) {
    out.push_back(problem.message());
  }
  return out;
}

/// The only problem of the text.
std::string problem_of(const std::string& text) {
  const std::vector<std::string> problems = problems_of(text);
  EXPECT_EQ(problems.size(), 1U) << testing::PrintToString(problems);
  return problems.empty() ? "" : problems.front();
}

TEST(Config, NothingSetIsTheDefaults) {
  const CheckedConfig checked = check_config("", "m.toml");
  EXPECT_TRUE(checked.problems.empty());
  EXPECT_EQ(checked.config.machine, "machine");
  EXPECT_EQ(checked.config.source, SourceKind::kDds);
  EXPECT_EQ(checked.config.identify.window_s, 8.0);
  EXPECT_EQ(checked.config.diagnose.every_s, 3600.0);
  EXPECT_EQ(checked.config.diagnose.false_alarm_days, 30.0);
  EXPECT_TRUE(checked.config.axes.empty());
}

TEST(Config, FrictionAndStructureAreNamedAsOnTheCommandLine) {
  const Config config =
      check_config("[identify]\nfriction = 'gms'\nstructure = 'auto'\n", "m.toml").config;
  EXPECT_EQ(config.identify.options.friction, kind_of<Gms>());
  EXPECT_EQ(config.identify.options.masses, Masses::kChosen);
}

TEST(Config, EveryKeyIsRead) {
  const CheckedConfig checked = check_config(R"(
    [machine]
    name = "mill-7"
    cycle_s = 0.002
    [[axis]]
    name = "X"
    torque_unit = "Nm"
    source = "dds"
    path = "main"
    [[axis]]
    name = "B"
    units = "rad"
    encoder_in_loop = false
    [[axis]]
    name = "Y"
    path = "main"
    [source.dds]
    domain = 12
    partition = "cell-3"
    strength = 7
    [identify]
    method = "pole-search"
    window_s = 10
    memory_s = 30.5
    judge_s = 5
    min_improvement = 0.05
    real_pole_hz = [2, 800]
    omega_hz = [3.0, 200.0]
    zeta = [0.3, 1.5]
    delay_max_s = 0.01
    modes = 2
    [diagnose]
    every_s = 600
    record_s = 45.5
    false_alarm_days = 7
    reference_s = 1800
    encoder_in_loop = true
    [store]
    directory = "/var/lib/servotwin"
    recordings_mb = 50
    recordings_max_mb = 500
    [http]
    listen = "0.0.0.0:80"
    token = "sixteen letters."
    names = ["mill-7.example", "mill"]
    [real_time]
    priority = 70
  )",
                                             "m.toml");
  EXPECT_TRUE(checked.problems.empty()) << checked.problems.front().what;
  const Config& config = checked.config;
  EXPECT_EQ(config.machine, "mill-7");
  EXPECT_EQ(config.cycle_s, 0.002);
  ASSERT_EQ(config.axes.size(), 3U);
  EXPECT_EQ(config.axes[0].path, "main");
  EXPECT_EQ(config.axes[1].path, "");
  EXPECT_TRUE(config.diagnose.encoder_in_loop);
  EXPECT_EQ(config.diagnose.encoder_in_loop_of, (std::map<std::string, bool>{{"B", false}}));
  EXPECT_EQ(config.store.recordings_max_mb, 500.0);
  EXPECT_EQ(config.axes[0].name, "X");
  EXPECT_EQ(config.axes[0].torque_unit, "Nm");
  EXPECT_FALSE(config.axes[0].rotary);
  EXPECT_TRUE(config.axes[1].rotary);
  EXPECT_EQ(config.dds.domain, 12U);
  EXPECT_EQ(config.dds.partition, "cell-3");
  EXPECT_EQ(config.dds.strength, 7);
  EXPECT_EQ(config.identify.window_s, 10.0);
  EXPECT_EQ(config.identify.memory_s, 30.5);
  EXPECT_EQ(config.identify.judge_s, 5.0);
  EXPECT_EQ(config.identify.min_improvement, 0.05);
  const IdentifyOptions& options = config.identify.options;
  EXPECT_EQ(options.method, Method::kPoleSearch);
  EXPECT_EQ(options.bounds.real_min_hz, 2.0);
  EXPECT_EQ(options.bounds.real_max_hz, 800.0);
  EXPECT_EQ(options.bounds.omega_min_hz, 3.0);
  EXPECT_EQ(options.bounds.omega_max_hz, 200.0);
  EXPECT_EQ(options.bounds.zeta_min, 0.3);
  EXPECT_EQ(options.bounds.zeta_max, 1.5);
  EXPECT_EQ(options.delay_max_s, 0.01);
  EXPECT_EQ(options.modes, 2);
  EXPECT_EQ(options.friction, std::nullopt);
  EXPECT_EQ(options.masses, Masses::kRigid);
  EXPECT_EQ(config.diagnose.every_s, 600.0);
  EXPECT_EQ(config.diagnose.record_s, 45.5);
  EXPECT_EQ(config.diagnose.false_alarm_days, 7.0);
  EXPECT_EQ(config.diagnose.reference_s, 1800.0);
  EXPECT_EQ(config.store.directory, "/var/lib/servotwin");
  EXPECT_EQ(config.store.recordings_mb, 50.0);
  EXPECT_EQ(config.http.listen, "0.0.0.0:80");
  EXPECT_EQ(config.http.token, "sixteen letters.");
  EXPECT_EQ(config.http.names, (std::vector<std::string>{"mill-7.example", "mill"}));
  EXPECT_EQ(config.priority, 70);
}

TEST(Config, ASourceThatNoAxisNamesIsKnownAsUnused) {
  const std::string can = "[source.can]\nmap = 'm.toml'\n[[axis]]\nname = 'X'\nsource = 'dds'\n";
  EXPECT_EQ(check_config(can, "m.toml").config.unused, std::vector<std::string>{"can"});
  EXPECT_TRUE(check_config(can + "encoder = 'can'\n", "m.toml").config.unused.empty());
  EXPECT_TRUE(check_config("[source.dds]\ndomain = 3\n[source.can]\nmap = 'm.toml'\n[[axis]]\n"
                           "name = 'X'\nsource = 'can'\n",
                           "m.toml")
                  .config.unused.empty());
}

TEST(Config, WhatTheDaemonSaysHasAPlaceWhateverTheSource) {
  const Config can =
      check_config("[dds]\ndomain = 5\nstrength = 3\n[source.can]\nmap = 'm.toml'\n", "m.toml")
          .config;
  EXPECT_EQ(can.source, SourceKind::kCan) << "no axis.source is needed";
  EXPECT_EQ(can.dds.domain, 5U);
  EXPECT_EQ(can.dds.strength, 3);

  const Config one = check_config("[dds]\ndomain = 5\npartition = 'cell'\n", "m.toml").config;
  EXPECT_EQ(one.source, SourceKind::kDds);
  EXPECT_FALSE(one.dds_in) << "the frames are there, too";

  const Config two =
      check_config("[dds]\ndomain = 5\n[source.dds]\ndomain = 0\npartition = 'cell'\n", "m.toml")
          .config;
  EXPECT_EQ(two.dds.domain, 5U);
  EXPECT_EQ(two.dds.partition, "cell") << "said once";
  ASSERT_TRUE(two.dds_in);
  EXPECT_EQ(two.dds_in->domain, 0U);
  EXPECT_EQ(two.dds_in->partition, "cell");

  const Config old = check_config(
                         "[[axis]]\nname = 'X'\nsource = 'can'\n[source.can]\nmap = 'm.toml'\n"
                         "[source.dds]\ndomain = 7\nstrength = 2\n",
                         "m.toml")
                         .config;
  EXPECT_EQ(old.source, SourceKind::kCan);
  EXPECT_EQ(old.dds.domain, 7U) << "as it was before there was [dds]";
  EXPECT_EQ(old.dds.strength, 2);

  EXPECT_THAT(problem_of("[dds]\nstrength = 1\n[source.dds]\nstrength = 2\n"),
              HasSubstr("m.toml:4:12: source.dds.strength = 2: "));
  EXPECT_THAT(problem_of("[dds]\ndomian = 1\n"), HasSubstr("dds.domian: there is no such key"));
  EXPECT_THAT(problem_of("[source.can]\nmap = 'm.toml'\n[source.dds]\n"), HasSubstr("to [dds]"));
}

TEST(Config, ReplayIsReadWithItsFiles) {
  const CheckedConfig checked = check_config(R"(
    [source.replay]
    files = ["a.csv", "b.mat"]
    columns = "X.command=qg[m]"
    speed = 4
  )",
                                             "m.toml");
  EXPECT_TRUE(checked.problems.empty());
  EXPECT_EQ(checked.config.source, SourceKind::kReplay);
  EXPECT_EQ(checked.config.replay.files, (std::vector<std::filesystem::path>{"a.csv", "b.mat"}));
  EXPECT_EQ(checked.config.replay.columns, "X.command=qg[m]");
  EXPECT_EQ(checked.config.replay.speed, 4.0);
}

TEST(Config, AnUnknownKeyIsNamedWithItsPlaceAndTheNearestOne) {
  EXPECT_EQ(problem_of("[identify]\nwindow = 8\n"),
            "m.toml:2:1: identify.window: there is no such key; did you mean 'window_s'?");
  EXPECT_THAT(problem_of("[machin]\n"), HasSubstr("did you mean 'machine'?"));
  EXPECT_THAT(problem_of("[source.ddz]\n"),
              HasSubstr("m.toml:1:9: source.ddz: there is no such key; did you mean 'dds'?"));
  EXPECT_THAT(problem_of("[[axis]]\nname = 'X'\nunit = 'm'\n"),
              HasSubstr("m.toml:3:1: axis.unit: there is no such key; did you mean 'units'?"));
}

struct WrongKey {
  const char* text;
  const char* message;
};

class ConfigRefuses : public testing::TestWithParam<WrongKey> {};
std::ostream& operator<<(std::ostream& out, const WrongKey& wrong) { return out << wrong.message; }

TEST_P(ConfigRefuses, WithPlaceValueAndRule) {
  EXPECT_EQ(problem_of(GetParam().text), GetParam().message);
}

INSTANTIATE_TEST_SUITE_P(
    EachRule, ConfigRefuses,
    testing::Values(
        WrongKey{"[identify]\nmethod = tru\n",
                 "m.toml:2:13: Error while parsing boolean: expected 'true', saw 'tru '"},
        WrongKey{"[identify]\nstructure = 'auto'\nmodes = 2\n",
                 "m.toml:3:9: identify.modes = 2: two masses have the vibration of their spring: "
                 "leave out modes or structure"},
        WrongKey{"[identify]\nmethod = 'pole-search'\nfriction = 'dahl'\n",
                 "m.toml:3:12: identify.friction = 'dahl': needs method = \"joint\""},
        WrongKey{"[identify]\ndelay_max_s = 0.0625\n",
                 "m.toml:2:15: identify.delay_max_s = 0.0625: must be a number from 0 to 0.05 s"},
        WrongKey{
            "[machine]\nname = ''\n",
            "m.toml:2:8: machine.name = '': must be 1 to 63 letters, digits or any of . _ -, not "
            "beginning with a dot"},
        WrongKey{
            "[machine]\nname = '../x'\n",
            "m.toml:2:8: machine.name = '../x': must be 1 to 63 letters, digits or any of . _ -, "
            "not beginning with a dot"},
        WrongKey{"[machine]\ncycle_s = 2\n",
                 "m.toml:2:11: machine.cycle_s = 2: must be a number from 1e-05 to 1 s"},
        WrongKey{"[machine]\ncycle_s = nan\n",
                 "m.toml:2:11: machine.cycle_s = nan: must be a number from 1e-05 to 1 s"},
        WrongKey{"[machine]\ncycle_s = '1 ms'\n",
                 "m.toml:2:11: machine.cycle_s = '1 ms': must be a number from 1e-05 to 1 s"},
        WrongKey{"machine = 3\n", "m.toml:1:11: machine = 3: must be a table: [machine]"},
        WrongKey{"axis = 3\n", "m.toml:1:8: axis = 3: must be given as [[axis]] tables"},
        WrongKey{"[[axis]]\n", "m.toml:1:1: axis.name: every axis needs one"},
        WrongKey{"[[axis]]\nname = 'X'\n[[axis]]\nname = 'X'\n",
                 "m.toml:4:8: axis.name = 'X': another axis has the same name"},
        WrongKey{
            "[[axis]]\nname = 'X,Y'\n",
            "m.toml:2:8: axis.name = 'X,Y': must be 1 to 31 letters, digits or any of . _ -, not "
            "beginning with a dot"},
        WrongKey{"[[axis]]\nname = 'X'\nunits = 'mm'\n",
                 "m.toml:3:9: axis.units = 'mm': must be one of 'm', 'rad'"},
        WrongKey{"[[axis]]\nname = 'X'\npath = 'main'\n",
                 "m.toml:3:8: axis.path = 'main': a path has 2 to 5 axes, this one has 1"},
        WrongKey{"[[axis]]\nname = 'X'\npath = 'main'\n[[axis]]\nname = 'Y'\npath = 'main'\n"
                 "[[axis]]\nname = 'C'\nunits = 'rad'\npath = 'main'\n",
                 "m.toml:10:8: axis.path = 'main': needs linear axes, but this axis has units = "
                 "'rad'"},
        WrongKey{"[[axis]]\nname = 'X'\nencoder_in_loop = 'yes'\n",
                 "m.toml:3:19: axis.encoder_in_loop = 'yes': must be true or false"},
        WrongKey{"[[axis]]\nname = 'X'\ncorrection = { peak = 1e-4, rate = 0.01 }\n",
                 "m.toml:3:14: axis.correction.bandwidth: a correction needs peak, rate and "
                 "bandwidth"},
        WrongKey{"[[axis]]\nname = 'X'\ncorrection = { peak = 0, rate = 0.01, bandwidth = 50 }\n",
                 "m.toml:3:23: axis.correction.peak = 0: must be a number from 1e-09 to 1 of the "
                 "axis"},
        WrongKey{"[[axis]]\nname = 'X'\ncorrection = { peak = 1e-4, rate = 1, bandwidth = 50, "
                 "peek = 1 }\n",
                 "m.toml:3:55: axis.correction.peek: there is no such key; did you mean 'peak'?"},
        WrongKey{"[ilc]\nlives = true\n",
                 "m.toml:2:1: ilc.lives: there is no such key; did you mean 'live'?"},
        WrongKey{"[ilc]\nlive = 1\n", "m.toml:2:8: ilc.live = 1: must be true or false"},
        WrongKey{"[ilc]\nvalidity_s = 0\n",
                 "m.toml:2:14: ilc.validity_s = 0: must be a number from 0.001 to 1 s"},
        WrongKey{
            "[store]\nrecordings_max_mb = 100\n",
            "m.toml:2:21: store.recordings_max_mb = 100: must not be less than recordings_mb = "
            "1024"},
        WrongKey{"[[axis]]\nname = 'X'\nsource = 'replay'\n",
                 "m.toml:3:10: axis.source = 'replay': there is no [source.replay]"},
        WrongKey{"[[axis]]\nname = 'X'\nencoder = 'can'\n",
                 "m.toml:3:11: axis.encoder = 'can': there is no [source.can]"},
        WrongKey{
            "[[axis]]\nname = 'X'\nsource = 'udp'\nencoder = 'can'\n[source.can]\nmap = 'a'\n"
            "[source.udp]\nmap = 'a'\n",
            "m.toml:4:11: axis.encoder = 'can': another axis has 'udp'; of two sources one must "
            "be dds, since a mapping describes all buses"},
        WrongKey{"[[axis]]\nname = 'X'\nsource = 'dds'\nencoder = 'can'\n[[axis]]\nname = 'Y'\n"
                 "source = 'udp'\n[source.can]\nmap = 'a'\n[source.udp]\nmap = 'a'\n",
                 "m.toml:7:10: axis.source = 'udp': the axes have 'dds' and 'can' already; two "
                 "sources can be joined, not three"},
        WrongKey{"[[axis]]\nname = 'X'\nsource = 'replay'\nencoder = 'dds'\n[source.replay]\n"
                 "files = ['a']\n",
                 "m.toml:4:11: axis.encoder = 'dds': another axis has 'replay', and a recording "
                 "cannot be joined with a source"},
        WrongKey{"[[axis]]\nname = 'X'\nencoder = 'replay'\n",
                 "m.toml:3:11: axis.encoder = 'replay': must be one of 'dds', 'can', 'udp'"},
        WrongKey{"[[axis]]\nname = 'X'\nsource = 'can'\nencoder = 'dds'\n[source.can]\nmap = 'a'\n"
                 "[ilc]\nlive = true\n",
                 "m.toml:8:8: ilc.live = true: of two sources offsets are only sent over DDS: the "
                 "commands "
                 "of all axes must come from there"},
        WrongKey{"[[axis]]\nname = 'X'\nsource = 'dds'\n[[axis]]\nname = 'Y'\nsource = 'can'\n"
                 "correction = { peak = 1e-4, rate = 1, bandwidth = 50 }\n[source.can]\nmap = 'a'\n"
                 "[ilc]\nlive = true\n",
                 "m.toml:11:8: ilc.live = true: of two sources offsets are only sent over DDS: the "
                 "commands of all axes must come from there"},
        WrongKey{"[source.dds]\ndomain = 231\n",
                 "m.toml:2:10: source.dds.domain = 231: must be a whole number from 0 to 230"},
        WrongKey{"[source.dds]\nstrength = -1\n",
                 "m.toml:2:12: source.dds.strength = -1: must be a whole number from 0 to 1000"},
        WrongKey{"[source.dds]\ndomain = 1.5\n",
                 "m.toml:2:10: source.dds.domain = 1.5: must be a whole number from 0 to 230"},
        WrongKey{"[source.replay]\n",
                 "m.toml:1:1: source.replay.files: is missing: list the recordings to replay"},
        WrongKey{
            "[source.replay]\nfiles = 'a.csv'\n",
            "m.toml:2:9: source.replay.files = 'a.csv': must be a list of file names in quotes"},
        WrongKey{
            "[source.replay]\nfiles = ['a.csv', 3]\n",
            "m.toml:2:9: source.replay.files = [ 'a.csv', 3 ]: must be a list of file names in "
            "quotes"},
        WrongKey{"[source.dds]\n[source.replay]\nfiles = ['a']\n",
                 "m.toml:2:1: source.replay: there is a source.dds as well; choose "
                 "one with axis.source, or move the daemon's own DDS settings to [dds]"},
        WrongKey{
            "[identify]\nomega_hz = [210, 1]\n",
            "m.toml:2:12: identify.omega_hz = [ 210, 1 ]: must be [lowest, highest] within 0.001 "
            "to 100000 Hz"},
        WrongKey{
            "[identify]\nwindow_s = 30\n",
            "m.toml:2:12: identify.window_s = 30: a model is fitted to the last memory_s = 24 s, "
            "which must not be less than window_s = 30 s"},
        WrongKey{"[diagnose]\nevery_s = -1\n",
                 "m.toml:2:11: diagnose.every_s = -1: must be a number from 0 to 1e+07 s"},
        WrongKey{"[diagnose]\nevery = 60\n",
                 "m.toml:2:1: diagnose.every: there is no such key; did you mean 'every_s'?"},
        WrongKey{"[diagnose]\nrecord_s = 2\n",
                 "m.toml:2:12: diagnose.record_s = 2: must be a number from 5 to 600 s"},
        WrongKey{"[diagnose]\nreference_s = 'long'\n",
                 "m.toml:2:15: diagnose.reference_s = 'long': must be a number from 60 to 86400 s"},
        WrongKey{
            "[diagnose]\nfalse_alarm_days = nan\n",
            "m.toml:2:20: diagnose.false_alarm_days = nan: must be a number from 0 to 36525 days "
            "of motion"},
        WrongKey{"[http]\nlisten = 'localhost:80'\n",
                 "m.toml:2:10: http.listen = 'localhost:80': must be ADDRESS:PORT, such as "
                 "'127.0.0.1:8402', '[::1]:8402' or, for everybody on the network, "
                 "'0.0.0.0:8402'; or 'none'"},
        WrongKey{"[http]\ntoken = 'short'\n",
                 "m.toml:2:9: http.token: must be a text of 16 to 256 characters in quotes"},
        WrongKey{"[http]\nnames = [1]\n",
                 "m.toml:2:9: http.names = [ 1 ]: must be a list of host names in quotes"},
        WrongKey{"[[axis]]\nname = 'X'\n[ilc]\narm_without_timeout = ['Y']\n",
                 "m.toml:4:23: ilc.arm_without_timeout = [ 'Y' ]: there is no [[axis]] named 'Y'"},
        WrongKey{
            "[ilc]\narm_without_timeout = true\n",
            "m.toml:2:23: ilc.arm_without_timeout = true: must be a list of axis names in quotes"},
        WrongKey{"[real_time]\npriority = 99\n",
                 "m.toml:2:12: real_time.priority = 99: must be a whole number from 0 to 98"}));

/// "a.a.a", `parts` times.
std::string key_of(std::size_t parts, const std::string& part = "a") {
  std::string key = part;
  for (std::size_t i = 1; i < parts; ++i) key += "." + part;
  return key;
}

// Every part is a table in the one before; they are read and destroyed by recursion.
TEST(Config, AKeyOfVeryManyPartsIsRefusedWithItsPlace) {
  const std::string rule = ": a key has more than 32 parts";
  const std::string key = key_of(20'000);
  for (const std::string& before : std::vector<std::string>{
           "", "x = \"\"\"a \\\" ' # \"\"\"\"\"\n", "x = '''a \\'''\n", "x = 'a\\'\n",
           "x = \"\\\"\" # '\n", "x = \"\"\n", "x = [1.5, 2.5]\n"}) {
    EXPECT_THAT(
        problem_of(before + key + " = 1\n"),
        testing::StartsWith("m.toml:" + std::string(before.empty() ? "1" : "2") + ":64" + rule))
        << before;
  }
  EXPECT_THAT(problem_of("\n[" + key + "]\nx = 1\n"), HasSubstr("m.toml:2:65" + rule));
  EXPECT_THAT(problem_of("[[" + key + "]]\nx = 1\n"), HasSubstr(rule));
  EXPECT_THAT(problem_of("x = { " + key + " = 1 }\n"), HasSubstr(rule));
  EXPECT_THAT(problem_of("x = [\"\"\"a\"\"\"\", { " + key + " = 1 }]\n"), HasSubstr(rule))
      << "a quote before the last three belongs to the text";
  EXPECT_THAT(problem_of(key_of(20'000, "\"a.b\"") + " = 1\n"), HasSubstr(rule));
  EXPECT_THAT(problem_of(key_of(20'000, " a ") + " = 1\n"), HasSubstr(rule));
}

TEST(Config, PartsOfAKeyAreNoDotsInTextsAndComments) {
  const std::string dots(20'000, '.');
  EXPECT_THAT(problems_of("# " + dots + "\n[source.replay]\ncolumns = '" + dots.substr(0, 4000) +
                          "'\nfiles = [\"" + dots + "\", '" + dots + "', \"\"\"\n" + dots +
                          "\"\"\", '''" + dots + "''', '1.5.csv'] # " + dots + "\n"),
              testing::IsEmpty());
  EXPECT_THAT(problem_of(key_of(32) + " = 1\n"),
              testing::StartsWith("m.toml:1:1: a: there is no such key"));
}

TEST(Config, NoOffsetIsSentUnlessItIsAskedFor) {
  const CheckedConfig checked = check_config("[[axis]]\nname = 'X'\n", "m.toml");
  EXPECT_FALSE(checked.config.ilc.live);
  EXPECT_FALSE(checked.config.axes[0].correction);
}

TEST(Config, WhatRepeatsIsOfferedAndIsLearnedOnlyWhereThereIsAFolder) {
  EXPECT_EQ(check_config("", "m.toml").config.ilc.recognise, IlcConfig::Recognise::kOffer);
  EXPECT_EQ(check_config("[ilc]\nrecognise = 'off'\n", "m.toml").config.ilc.recognise,
            IlcConfig::Recognise::kOff);
  const CheckedConfig checked = check_config("[ilc]\nrecognise = 'learn'\n", "m.toml");
  ASSERT_EQ(checked.problems.size(), 1U);
  EXPECT_THAT(checked.problems[0].what, HasSubstr("give ilc.programs as well"));
}

TEST(Config, CorrectionsAreReadWithTheirLimits) {
  const CheckedConfig checked = check_config(R"(
    [[axis]]
    name = "X"
    correction = { peak = 2e-4, rate = 0.01, bandwidth = 100 }
    [ilc]
    aim = "contour"
    programs = "parts"
    recognise = "learn"
    trials = 7
    live = true
    ramp_s = 0.2
    validity_s = 0.05
    model_age_s = 3600
    match_tolerance = 1e-5
    residual_band = 5.5
    delay_cycles = 2
    arm_without_timeout = ["X"]
    offset_in_command = false
  )",
                                             "m.toml");
  ASSERT_TRUE(checked.problems.empty()) << checked.problems.front().what;
  const std::optional<OffsetLimits>& limits = checked.config.axes[0].correction;
  ASSERT_TRUE(limits);
  EXPECT_EQ(limits->peak, 2e-4);
  EXPECT_EQ(limits->rate, 0.01);
  EXPECT_EQ(limits->bandwidth_hz, 100.0);
  const IlcConfig& ilc = checked.config.ilc;
  EXPECT_TRUE(ilc.contour);
  EXPECT_EQ(ilc.programs, "parts");
  EXPECT_EQ(ilc.recognise, IlcConfig::Recognise::kLearn);
  EXPECT_EQ(ilc.trials, 7);
  EXPECT_TRUE(ilc.live);
  EXPECT_EQ(ilc.ramp_s, 0.2);
  EXPECT_EQ(ilc.validity_s, 0.05);
  EXPECT_EQ(ilc.model_age_s, 3600.0);
  EXPECT_EQ(ilc.match_tolerance, 1e-5);
  EXPECT_EQ(ilc.residual_band, 5.5);
  EXPECT_EQ(ilc.delay_cycles, 2);
  EXPECT_EQ(ilc.arm_without_timeout, std::vector<std::string>{"X"});
  EXPECT_EQ(ilc.in_command, false);
}

TEST(Config, AllProblemsAreReportedAtOnceInTheOrderOfTheFile) {
  const std::vector<std::string> problems =
      problems_of("[machine]\nnam = 'x'\ncycle_s = -1\n[store]\ndirectory = 3\n[htp]\n");
  ASSERT_EQ(problems.size(), 4U);
  EXPECT_THAT(problems[0], HasSubstr("m.toml:2:1: machine.nam"));
  EXPECT_THAT(problems[1], HasSubstr("m.toml:3:11: machine.cycle_s"));
  EXPECT_THAT(problems[2], HasSubstr("m.toml:5:13: store.directory"));
  EXPECT_THAT(problems[3], HasSubstr("m.toml:6:2: htp"));
}

TEST(Config, WhatIsNotTomlIsOneProblemWithItsPlace) {
  EXPECT_THAT(problem_of("[machine\nname = 1"), HasSubstr("m.toml:1:9: "));
  EXPECT_THAT(problem_of("time[s],X.command[m]\n0,1\n"), HasSubstr("m.toml:1:"));
}

TEST(Config, AFileThatCannotBeReadIsNamed) {
  TemporaryDirectory directory;
  EXPECT_EQ(
      message_of([&] { (void)load_config(directory.path() / "none.toml"); }),
      (directory.path() / "none.toml").string() + ": cannot be opened: No such file or directory");
  EXPECT_THAT(message_of([&] { (void)load_config(directory.path()); }),
              HasSubstr("cannot be read: Is a directory"));
}

TEST(Config, AnEmptyFileIsAConfiguration) {
  TemporaryDirectory directory;
  const std::ofstream file(directory.path() / "empty.toml");
  EXPECT_EQ(load_config(directory.path() / "empty.toml").machine, "machine");
}

TEST(Config, TheStoreIsWhereTheServiceManagerSays) {
  setenv("STATE_DIRECTORY", "/var/lib/servotwin", 1);
  EXPECT_EQ(default_store(), "/var/lib/servotwin");
  unsetenv("STATE_DIRECTORY");
  setenv("XDG_STATE_HOME", "/home/me/.state", 1);
  EXPECT_EQ(default_store(), "/home/me/.state/servotwin");
  unsetenv("XDG_STATE_HOME");
}

TEST(Config, CanAndUdpAreSourcesWithAMapping) {
  const CheckedConfig can = check_config(
      "[source.can]\nmap = \"m.toml\"\ninterfaces = [\"can1\"]\nfilter = true\n", "/etc/st/a.toml");
  EXPECT_TRUE(can.problems.empty());
  EXPECT_EQ(can.config.source, SourceKind::kCan);
  EXPECT_EQ(can.config.can.map, "/etc/st/m.toml");
  EXPECT_EQ(can.config.can.interfaces, std::vector<std::string>{"can1"});
  EXPECT_TRUE(can.config.can.filter);
  const CheckedConfig udp = check_config(
      "[[axis]]\nname = \"X\"\nsource = \"udp\"\n[source.dds]\n[source.udp]\nmap = \"/m.toml\"\n"
      "listen = \"0.0.0.0:4\"\npeer = \"plc:5\"\n",
      "a.toml");
  EXPECT_TRUE(udp.problems.empty());
  EXPECT_EQ(udp.config.source, SourceKind::kUdp);
  EXPECT_EQ(udp.config.udp.map, "/m.toml");
  EXPECT_EQ(udp.config.udp.peer, "plc:5");
}

TEST(Config, AnEncoderFromElsewhereMakesTwoSources) {
  const CheckedConfig two = check_config(
      "[[axis]]\nname = \"X\"\nencoder = \"can\"\n[source.can]\nmap = \"m.toml\"\n", "a.toml");
  EXPECT_TRUE(two.problems.empty());
  EXPECT_EQ(two.config.source, SourceKind::kDds);
  EXPECT_EQ(two.config.second, SourceKind::kCan);
  EXPECT_EQ(two.config.axes[0].command, SourceKind::kDds);
  EXPECT_EQ(two.config.axes[0].encoder, SourceKind::kCan);
}

TEST(Config, MistakesOfTheBusesAreNamed) {
  EXPECT_THAT(problem_of("[source.can]\n"), HasSubstr("source.can.map: is missing"));
  EXPECT_THAT(problem_of("[source.udp]\n"), HasSubstr("source.udp.map: is missing"));
  EXPECT_THAT(problem_of("[source.can]\nmap = \"m\"\ninterface = [\"a\"]\n"),
              HasSubstr("did you mean 'interfaces'?"));
  EXPECT_THAT(problem_of("[source.can]\nmap = \"m\"\ninterfaces = \"a\"\n"),
              HasSubstr("a list of 1 to 8 names"));
  EXPECT_THAT(problem_of("[source.can]\nmap = \"m\"\n[source.udp]\nmap = \"m\"\n"),
              HasSubstr("there is a source.can as well"));
  EXPECT_THAT(problem_of("[[axis]]\nname = \"X\"\nsource = \"can\"\n"),
              HasSubstr("there is no [source.can]"));
}

}  // namespace
}  // namespace servotwin::daemon
