// servotwin export: its files, output and refusals. The content of a unit is tested in
// tests/cli/export, the matrices in tests/twin and tests/octave.
#include <gmock/gmock.h>
#include <matio.h>

#include <cmath>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

class Export : public testing::Test {
 protected:
  void SetUp() override { write_model(model_, known_axis()); }

  void expect_refused(int status, const std::vector<std::string>& words,
                      const std::string& complaint) {
    std::vector<std::string> all{"export"};
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = servotwin_says(all);
    EXPECT_EQ(answer.status, status) << answer;
    ASSERT_EQ(answer.complaints().size(), 1U) << answer;
    EXPECT_THAT(answer.err, HasSubstr("servotwin export: "));
    EXPECT_THAT(answer.err, HasSubstr(complaint));
    EXPECT_THAT(folder_.list(), ElementsAre("model.json")) << "nothing is left behind";
  }

  Folder folder_;
  std::string model_ = folder_ / "model.json";
};

TEST_F(Export, SaysWhatTheUnitHas) {
  const Answer answer = servotwin_says({"export", model_, "--fmu", folder_ / "x.fmu"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_EQ(answer.out,
            "unit        axis X, order 2: coulomb_friction, gravity_offset, sample time 0.001 s\n"
            "input       command [m]\n"
            "output      tracking_error [m]\n"
            "output      position [m]\n"
            "output      velocity [m/s]\n"
            "parameters  4\n"
            "written     " +
                (folder_ / "x.fmu") + "\n");
  EXPECT_THAT(content_of(folder_ / "x.fmu"), testing::StartsWith("PK\x03\x04"));
}

TEST_F(Export, SaysTheSameForPrograms) {
  const Answer answer = servotwin_says(
      {"export", model_, "--fmu", folder_ / "x.fmu", "--mat", folder_ / "x.mat", "--json", "-"});
  ASSERT_EQ(answer.status, 0) << answer;
  const json said = json::parse(answer.out);
  EXPECT_EQ(said["schema"], "servotwin.export/1");
  EXPECT_EQ(said["axis"], "X");
  EXPECT_EQ(said["model_version"], 1);
  EXPECT_EQ(said["sample_time_s"], 0.001);
  EXPECT_EQ(said["unit"]["model_identifier"], "servotwin_X");
  EXPECT_EQ(said["unit"]["bytes"], content_of(folder_ / "x.fmu").size());
  EXPECT_EQ(said["unit"]["variables"][0]["name"], "command");
  EXPECT_EQ(said["unit"]["variables"].size(), 8U);
  EXPECT_EQ(said["matrices"]["outputs"][0], "tracking_error [m]");
  EXPECT_THAT(answer.err, HasSubstr("note: the matrices contain the linear loop only, without: "
                                    "coulomb_friction, gravity_offset\n"));
}

TEST_F(Export, AUnitCanGoToStandardOutput) {
  ASSERT_EQ(servotwin_says({"export", model_, "--fmu", folder_ / "x.fmu"}).status, 0);
  const Answer answer = servotwin_says({"export", model_, "--fmu", "-"});
  ASSERT_EQ(answer.status, 0) << answer.err;
  EXPECT_EQ(answer.out, content_of(folder_ / "x.fmu"));
}

TEST_F(Export, WritesTheMatricesWithTheirNames) {
  const std::string file = folder_ / "x.mat";
  const Answer answer = servotwin_says({"export", model_, "--mat", file});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(folder_.list(), ElementsAre("model.json", "x.mat"));
  const std::unique_ptr<mat_t, decltype(&Mat_Close)> mat(Mat_Open(file.c_str(), MAT_ACC_RDONLY),
                                                         &Mat_Close);
  ASSERT_NE(mat, nullptr);
  const auto read = [&](const char* name) {
    return std::shared_ptr<matvar_t>(Mat_VarRead(mat.get(), name), &Mat_VarFree);
  };
  const auto shape = [&](const char* name) {
    const auto variable = read(name);
    return variable ? std::vector<std::size_t>(variable->dims, variable->dims + 2)
                    : std::vector<std::size_t>();
  };
  EXPECT_THAT(shape("A"), ElementsAre(3, 3));
  EXPECT_THAT(shape("B"), ElementsAre(3, 2));
  EXPECT_THAT(shape("C"), ElementsAre(3, 3));
  EXPECT_THAT(shape("D"), ElementsAre(3, 2));
  EXPECT_THAT(shape("Phi"), ElementsAre(3, 3));
  EXPECT_THAT(shape("Gamma"), ElementsAre(3, 5));
  EXPECT_THAT(shape("states"), ElementsAre(3, 1));
  // By columns: the first is -a1, -a2, 0.
  const auto a = read("A");
  const auto* values = static_cast<const double*>(a->data);
  EXPECT_EQ(values[0], -known_axis().model.loop.denominator[0]);
  EXPECT_EQ(values[1], -known_axis().model.loop.denominator[1]);
  EXPECT_EQ(*static_cast<const double*>(read("sample_time_s")->data), 0.001);
}

// A mode that varies with position: the matrices are those at one position, a unit contains the
// law.
TEST_F(Export, AModeThatMovesIsTakenAtOnePlaceByTheMatricesAlone) {
  ModelRecord moving = known_axis();
  moving.model.loop.modes = {{280.0, 0.03, 0.1, 20.0, 0.0, 0.5, 0.2}};
  moving.model.loop.travel = {-0.1, 0.3};
  moving.mode_deviations.resize(1);
  write_model(model_, moving);
  const Answer unit = servotwin_says({"export", model_, "--fmu", folder_ / "x.fmu"});
  EXPECT_EQ(unit.status, 0) << unit;
  EXPECT_THAT(unit.out, HasSubstr("1 mode of vibration that moves with position"));
  // -omega^2 of the mode, whose states are the third and fourth.
  const auto stiffness = [&](const std::vector<std::string>& words, const std::string& said) {
    const std::string file = folder_ / "x.mat";
    std::vector<std::string> all{"export", model_, "--mat", file};
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = servotwin_says(all);
    EXPECT_EQ(answer.status, 0) << answer;
    EXPECT_THAT(answer.out, HasSubstr(said));
    const std::unique_ptr<mat_t, decltype(&Mat_Close)> mat(Mat_Open(file.c_str(), MAT_ACC_RDONLY),
                                                           &Mat_Close);
    const std::shared_ptr<matvar_t> a(Mat_VarRead(mat.get(), "A"), &Mat_VarFree);
    const std::shared_ptr<matvar_t> names(Mat_VarRead(mat.get(), "states"), &Mat_VarFree);
    EXPECT_EQ(a->dims[0], names->dims[0]);
    return static_cast<const double*>(a->data)[2 * a->dims[0] + 3];
  };
  EXPECT_NEAR(stiffness({}, "those at 0.1 m, the middle of the travel"), -280.0 * 280.0, 1e-6);
  EXPECT_NEAR(stiffness({"--at", "0.3"}, "those at 0.3 m"), -280.0 * 280.0 * std::exp(0.4), 1e-6);
}

// Two masses: another form of the matrices, and no parameters of the unit.
TEST_F(Export, OfTwoMassesHasBothInUnitAndMatrices) {
  ModelRecord two = known_axis();
  two.model.effects.push_back(make_effect<PlayLoadEncoder>());
  two.effect_deviations.resize(two.model.effects.size());
  write_model(model_, two);
  const std::string file = folder_ / "x.mat";
  const Answer answer =
      servotwin_says({"export", model_, "--fmu", folder_ / "x.fmu", "--mat", file});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("parameters  4\n"));
  EXPECT_THAT(answer.out, HasSubstr("two masses, without the play between them"));
  EXPECT_THAT(answer.out, HasSubstr("only, without: coulomb_friction, gravity_offset\n"));
  const std::unique_ptr<mat_t, decltype(&Mat_Close)> mat(Mat_Open(file.c_str(), MAT_ACC_RDONLY),
                                                         &Mat_Close);
  const auto shape = [&](const char* name) {
    const std::shared_ptr<matvar_t> variable(Mat_VarRead(mat.get(), name), &Mat_VarFree);
    return std::vector<std::size_t>(variable->dims, variable->dims + 2);
  };
  EXPECT_THAT(shape("A"), ElementsAre(5, 5));
  EXPECT_THAT(shape("C"), ElementsAre(5, 5));
  EXPECT_THAT(shape("D"), ElementsAre(5, 3));
  EXPECT_THAT(shape("Gamma"), ElementsAre(5, 7));
  for (const char* name : {"states", "outputs"}) EXPECT_EQ(shape(name)[0], 5U) << name;
  EXPECT_EQ(shape("inputs")[0], 3U);
  EXPECT_EQ(shape("cycle_inputs")[0], 7U);
}

TEST_F(Export, OfARotaryAxisIsInRadians) {
  ModelRecord rotary = known_axis("C");
  rotary.rotary = true;
  write_model(model_, rotary);
  const Answer answer = servotwin_says({"export", model_, "--fmu", folder_ / "c.fmu"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("command [rad]"));
  EXPECT_THAT(answer.out, HasSubstr("velocity [rad/s]"));
}

TEST_F(Export, NothingToWriteIsWrongUsage) {
  expect_refused(2, {model_}, "nothing to write: give --fmu OUT.fmu, --mat OUT.mat or both");
  expect_refused(2, {model_, "--json", "-"}, "nothing to write");
  expect_refused(2, {"--fmu", folder_ / "x.fmu"}, "MODEL is required");
  expect_refused(2, {model_, "--mat", "-"}, "cannot go to standard output");
  expect_refused(2, {model_, "--fmu", "-", "--json", "-"}, "only one result");
  expect_refused(2, {model_, "--fmu", folder_ / "x", "--mat", folder_ / "x"}, "named for two");
}

TEST_F(Export, AModelThatCannotBeReadIsNamed) {
  expect_refused(1, {folder_ / "none.json", "--fmu", folder_ / "x.fmu"}, "none.json");
  std::ofstream(model_) << "{\"schema\": ";
  expect_refused(1, {model_, "--fmu", folder_ / "x.fmu"}, "model.json");
  json broken = to_json(known_axis());
  broken["loop"]["denominator"][0] = -1.0;
  std::ofstream(model_) << broken;
  expect_refused(1, {model_, "--mat", folder_ / "x.mat"}, "model.json");
}

TEST_F(Export, AFolderThatIsNotThereIsNamed) {
  expect_refused(1, {model_, "--fmu", folder_ / "no/x.fmu"}, "no/x.fmu");
  expect_refused(1, {model_, "--mat", folder_ / "no/x.mat"}, "no/x.mat");
  expect_refused(1, {model_, "--fmu", folder_ / "x.fmu", "--json", folder_ / "no/x"}, "no/x");
}

}  // namespace
}  // namespace servotwin
