// Invalid input files: exit status 1 and one line that names the file and the fault.
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using namespace std::string_literals;
using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

std::string moving(int k) { return cell(1e3 * rich_motion(k / 1000.0)); }

void expect_one_complaint(const Answer& answer, const std::string& complaint) {
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr(complaint));
}

struct BadRecording {
  std::string name, content, complaint;
};
void PrintTo(const BadRecording& bad, std::ostream* out) { *out << bad.name; }

class ABadRecording : public testing::TestWithParam<BadRecording> {};

TEST_P(ABadRecording, IsRefusedByIdentifyAndPredict) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", GetParam().content);
  write_model(folder / "model.json", known_axis());
  const std::string out = folder / "out.json";
  const Answer identified = servotwin_says({"identify", file, "--axis", "X", "--model", out});
  expect_one_complaint(identified, GetParam().complaint);
  EXPECT_THAT(identified.err, HasSubstr("servotwin identify: "));
  EXPECT_THAT(folder.list(), Not(Contains("out.json")));
}

const std::vector<BadRecording> kBadRecordings{
    {"empty", "", "rec.csv: "},
    {"header_only", "time[s],X.command[mm],X.actual[mm]\n", "rec.csv: "},
    {"text", "This is a letter.\nIt has two lines.\n", "line 1"},
    {"binary",
     "\x7f"
     "ELF\x02\x01\x01\0\0\0\0\n\x01\x02"s,
     "rec.csv: "},
    {"one_row", "time[s],X.command[mm],X.actual[mm]\n0,1,1\n", "only one row"},
    {"no_encoder", command_table(2.0), "X.actual"},
    {"no_command", "time[s],X.actual[mm]\n0,1\n0.001,2\n", "X.command"},
    {"no_time", "X.command[mm],X.actual[mm]\n1,1\n2,2\n", "--rate"},
    {"no_unit", "time[s],X.command,X.actual[mm]\n0,1,1\n", "'X.command' has no unit"},
    {"unknown_unit", "time[s],X.command[ell],X.actual[mm]\n0,1,1\n", "[ell]"},
    {"other_axis", "time[s],Q.command[mm],Q.actual[mm]\n0,1,1\n0.001,2,2\n",
     "no axis 'X'; it has Q"},
    {"no_number", "time[s],X.command[mm],X.actual[mm]\n0,1,1\n0.001,two,2\n", "line 3"},
    {"ragged", "time[s],X.command[mm],X.actual[mm]\n0,1,1\n0.001,2\n0.002,3,3\n", "line 3"},
    {"constant",
     recording(
         3000, [](int) { return "5"; }, [](int) { return "5"; }),
     "X.command does not move"},
    {"encoder_stuck", recording(3000, moving, [](int) { return "5"; }), "X.actual does not move"},
    {"all_nan",
     recording(
         3000, [](int) { return "nan"; }, [](int) { return "nan"; }),
     "X.command has no values"},
    {"too_short", recording(200, moving, moving), "too few"},
};
INSTANTIATE_TEST_SUITE_P(Of, ABadRecording, testing::ValuesIn(kBadRecordings),
                         [](const auto& one) { return one.param.name; });

TEST(BadRecording, AFileThatIsNotThere) {
  expect_one_complaint(servotwin_says({"identify", "/there/is/none.csv", "--axis", "X"}),
                       "/there/is/none.csv");
}

TEST(BadRecording, AFolder) {
  const Folder folder;
  expect_one_complaint(servotwin_says({"identify", folder / "", "--axis", "X"}), folder / "");
}

TEST(BadRecording, APartBesideTheRecording) {
  const Folder folder;
  const std::string file = folder.write("rec.csv", recording(3000, moving, moving));
  expect_one_complaint(servotwin_says({"identify", file, "--axis", "X", "--from", "100"}),
                       "no rows between 100 s");
}

TEST(BadRecording, NanAndInfinityAreCountedAndBridged) {
  const Folder folder;
  const auto with_holes = [](int k) {
    return k == 1000 || k == 2000 ? std::string("nan") : k == 3000 ? "inf" : moving(k);
  };
  write_model(folder / "model.json", known_axis());
  const std::string file = folder.write("rec.csv", recording(6000, moving, with_holes));
  const Answer answer = servotwin_says(
      {"predict", file, "--axis", "X", "--model", folder / "model.json", "--json", "-"});
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, HasSubstr("empty, NaN or infinite in 3 of 6000 rows"));
  EXPECT_THAT(answer.err, HasSubstr("3 rows without a value bridged"));
  EXPECT_EQ(json::parse(answer.out)["segments"].size(), 1U);
}

class ABadModel : public testing::Test {
 protected:
  void SetUp() override {
    write_model(folder_ / "good.json", known_axis());
    good_ = json::parse(content_of(folder_ / "good.json"));
  }
  void expect_refused(const std::string& content, const std::string& complaint) {
    const std::string model = folder_.write("bad.json", content);
    const Answer predicted =
        servotwin_says({"predict", recording_, "--axis", "X", "--model", model});
    expect_one_complaint(predicted, complaint);
    EXPECT_THAT(predicted.err, HasSubstr("bad.json"));
    const Answer simulated = servotwin_says({"simulate", recording_, "--model", model});
    expect_one_complaint(simulated, complaint);
  }

  Folder folder_;
  std::string recording_ = folder_.write("rec.csv", recording(3000, moving, moving));
  json good_;
};

TEST_F(ABadModel, GoodIsAccepted) {
  const Answer answer =
      servotwin_says({"predict", recording_, "--axis", "X", "--model", folder_ / "good.json"});
  EXPECT_EQ(answer.status, 0) << answer;
}
TEST_F(ABadModel, Truncated) {
  const std::string whole = good_.dump();
  expect_refused(whole.substr(0, whole.size() / 2), "no complete JSON");
}
TEST_F(ABadModel, Empty) { expect_refused("", "no complete JSON"); }
TEST_F(ABadModel, OfAnotherSchema) {
  good_["schema"] = "servotwin.diagnosis/1";
  expect_refused(good_.dump(), "servotwin.diagnosis/1");
}
TEST_F(ABadModel, NotAnObject) { expect_refused("[1, 2]", "schema"); }
TEST_F(ABadModel, WithoutAField) {
  good_["loop"].erase("denominator");
  expect_refused(good_.dump(), "loop.denominator");
}
TEST_F(ABadModel, OfAnotherType) {
  good_["loop"]["denominator"][0] = "fast";
  expect_refused(good_.dump(), "loop.denominator[0]");
}
TEST_F(ABadModel, Unstable) {
  good_["loop"]["denominator"][0] = -5.0;
  good_["loop"].erase("poles");
  expect_refused(good_.dump(), "stable");
}
TEST_F(ABadModel, OutOfBounds) {
  good_["effects"][0]["parameters"]["coulomb"]["value"] = -3.0;
  good_["loop"].erase("disturbance_gain");
  expect_refused(good_.dump(), "coulomb");
}
TEST_F(ABadModel, WithAnUnknownEffect) {
  good_["effects"][0]["id"] = "magic";
  expect_refused(good_.dump(), "magic");
}
TEST_F(ABadModel, OfARotaryAxis) {
  ModelRecord record = known_axis();
  record.rotary = true;
  expect_refused(to_json(record).dump(), "the model is of a rotary axis");
}
TEST_F(ABadModel, InAnotherUnit) {
  good_["effects"][0]["parameters"]["coulomb"]["unit"] = "mm/s^2";
  expect_refused(good_.dump(), "parameters.coulomb.unit: must be \"m/s^2\", is \"mm/s^2\"");
}
TEST_F(ABadModel, NotThere) {
  expect_one_complaint(
      servotwin_says({"predict", recording_, "--axis", "X", "--model", folder_ / "none.json"}),
      "none.json");
}

class AnUnwritableResult : public ABadModel {};

TEST_F(AnUnwritableResult, IsFoundBeforeTheWork) {
  const std::string nowhere = folder_ / "no/such/folder/out";
  const std::string good = folder_ / "good.json";
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"identify", recording_, "--axis", "X", "--model", nowhere},
           {"identify", recording_, "--axis", "X", "--json", nowhere},
           {"predict", recording_, "--axis", "X", "--model", good, "--json", nowhere},
           {"predict", recording_, "--axis", "X", "--model", good, "--out", nowhere},
           {"predict", recording_, "--axis", "X", "--model", good, "--plot", nowhere},
           {"identify", recording_, "--axis", "X", "--plot", nowhere},
           {"simulate", recording_, "--model", good, "--out", nowhere}}) {
    const Answer answer = servotwin_says(words);
    expect_one_complaint(answer, nowhere + ": cannot be written");
    EXPECT_THAT(answer.out, IsEmpty());
  }
}

TEST_F(AnUnwritableResult, AFullDiskBehindStandardOutput) {
  const Answer answer = servotwin_says(
      {"predict", recording_, "--axis", "X", "--model", folder_ / "good.json", "--json", "-"},
      "/dev/full");
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.complaints().back(),
              HasSubstr("standard output cannot be written: No space left on device"));
}

TEST_F(AnUnwritableResult, LeavesNothingBehind) {
  const auto before = folder_.list();
  (void)servotwin_says({"identify", recording_, "--axis", "Q", "--model", folder_ / "out.json"});
  EXPECT_EQ(folder_.list(), before);
}

TEST(CheckConfig, SaysWhatItFound) {
  const Folder folder;
  const Answer good =
      servotwin_says({"check-config", folder.write("good.toml", "[machine]\nname = \"mill\"\n")});
  EXPECT_EQ(good.status, 0) << good;
  EXPECT_THAT(good.err, IsEmpty());
  EXPECT_THAT(good.out, HasSubstr("valid"));
  EXPECT_THAT(good.out, HasSubstr("mill"));

  const Answer unknown =
      servotwin_says({"check-config", folder.write("bad.toml", "[machine]\nnam = \"mill\"\n")});
  expect_one_complaint(unknown, "bad.toml:2:1");
  EXPECT_THAT(unknown.err, HasSubstr("'name'"));

  const Answer two =
      servotwin_says({"check-config", folder.write("two.toml", "[machine]\nnam = 1\nname = 2\n")});
  EXPECT_EQ(two.status, 1);
  ASSERT_EQ(two.complaints().size(), 3U) << two;  // one line each, and what it means
  EXPECT_THAT(two.err, HasSubstr("2 problems"));

  (void)folder.write("map.toml",
                     "cycle_s = 0.001\n[[axis]]\nname = \"X\"\n"
                     "command = {id = 0x181, start_bit = 0, length = 32, unit = \"nm*10\"}\n"
                     "actual = {id = 0x181, start_bit = 32, length = 32, unit = \"nm*10\"}\n");
  const Answer places =
      servotwin_says({"check-config", folder.write("udp.toml",
                                                   "[source.udp]\nmap = \"map.toml\"\nlisten = "
                                                   "\"127.0.0.1:99999\"\npeer = \"no port\"\n")});
  EXPECT_EQ(places.status, 1) << places;
  EXPECT_THAT(places.err, HasSubstr("source.udp.listen: '127.0.0.1:99999': the port must be"));
  EXPECT_THAT(places.err, HasSubstr("source.udp.peer: 'no port': must be ADDRESS:PORT"));

  expect_one_complaint(servotwin_says({"check-config", folder / "none.toml"}), "none.toml");
  expect_one_complaint(servotwin_says({"check-config", folder.write("no.toml", "[machine\n")}),
                       "no.toml:1");
}

}  // namespace
}  // namespace servotwin
