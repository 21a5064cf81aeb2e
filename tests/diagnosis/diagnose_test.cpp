// Diagnosis: names the causes that are present, and none on a machine without any.
#include "diagnosis/search/diagnose.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/report.h"
#include "drivers/recordings/recording_file.h"
#include "identification/least_squares/interruption.h"
#include "identification/least_squares/parallel.h"
#include "identification/loop/identify.h"
#include "identification/loop/output_error.h"
#include "identification/loop/structure_choice.h"
#include "identification/recording/segments.h"
#include "tests/support/real_data.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"

namespace servotwin {
namespace {

namespace vm = virtual_machine;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSupersetOf;
using testing::Not;

std::vector<std::string> ids(const Diagnosis& diagnosis) {
  std::vector<std::string> out;
  for (const Cause& cause : diagnosis.causes) out.push_back(cause.id);
  return out;
}

const Cause* find(const Diagnosis& diagnosis, const std::string& id) {
  for (const Cause& cause : diagnosis.causes) {
    if (cause.id == id) return &cause;
  }
  return nullptr;
}

/// 16 s of production-like moves of a ball-screw axis without integrator, with this friction.
SegmentedAxis recorded(const vm::Friction& friction, std::uint64_t seed) {
  vm::Axis axis;
  axis.body.mass = 100.0;
  axis.body.viscous = 240.0;
  axis.body.friction = friction;
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 20'000.0;
  axis.recorder.position_step = 1e-8;
  axis.recorder.position_noise = 2e-8;
  axis.recorder.seed = seed;
  vm::MoveMix mix;
  mix.duration = 16.0;
  const vm::AxisRecord record = vm::record(axis, vm::moves(mix, seed));
  SegmentedAxis out;
  out.axis = "X";
  out.sample_time_s = record.sample_time;
  Segment segment;
  segment.sample_time_s = record.sample_time;
  segment.command = record.command;
  segment.actual = record.actual;
  out.segments = {segment};
  return out;
}

class ACleanMachine : public testing::TestWithParam<std::uint64_t> {};

TEST_P(ACleanMachine, GetsNoCause) {
  const Diagnosis diagnosis = diagnose(recorded(vm::SaturatedCoulomb{20.0, 1e-3}, GetParam()));
  EXPECT_THAT(ids(diagnosis), IsEmpty()) << testing::PrintToString(diagnosis.steps);
  EXPECT_EQ(diagnosis.verdict, Verdict::kNothingSignificant);
  EXPECT_EQ(diagnosis.extended.holdout.rms, diagnosis.baseline.holdout.rms);
}
INSTANTIATE_TEST_SUITE_P(Seeds, ACleanMachine, testing::Values(3, 4, 5, 6));

TEST(Diagnosis, ThatIsStoppedIsGivenUp) {
  const SegmentedAxis axis = segment_axis(
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {}), "X");
  std::stop_source source;
  std::vector<std::string> begun;
  DiagnoseOptions options;
  options.progress = [&](std::string_view what) {
    begun.emplace_back(what);
    source.request_stop();
  };
  const Interruptible until(source.get_token());
  EXPECT_THROW(static_cast<void>(diagnose(axis, options)), Interrupted);
  EXPECT_THAT(begun, ElementsAre("the loop and its friction"));
}

// The example machine: GMS friction of 0.524 m/s^2 that all slides after 20 um, made by other code.
TEST(Diagnosis, NamesPreslidingOnTheExampleMachine) {
  const SegmentedAxis axis = segment_axis(
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {}), "X");
  std::mutex mutex;
  std::set<std::string> tried;
  DiagnoseOptions options;
  options.progress = [&](std::string_view what) {
    const std::lock_guard lock(mutex);
    tried.emplace(what);
  };
  const Diagnosis diagnosis = diagnose(axis, options);
  EXPECT_THAT(tried, IsSupersetOf({"the loop and its friction", "presliding", "compliance",
                                   "each cause left out"}));
  EXPECT_THAT(ids(diagnosis), ElementsAre("presliding"));
  EXPECT_EQ(diagnosis.verdict, Verdict::kExplained);
  EXPECT_LT(diagnosis.extended.holdout.rms, 0.07e-6);  // of an encoder of 0.1 um
  EXPECT_GT(diagnosis.baseline.holdout.rms, 0.7e-6);
  // Without the cause the model is no worse than the baseline, which never had it.
  EXPECT_LT(diagnosis.causes.front().gain.before, 1.1 * diagnosis.baseline.holdout.rms);
  EXPECT_LT(diagnosis.unexplained_share, 0.01);
  const Cause& cause = diagnosis.causes.front();
  EXPECT_NEAR(diagnosis.extended.model.effects[cause.place].coefficient[0], 0.524, 0.02);
  EXPECT_GT(cause.gain.low, 0.0);
  // Its parameters are no more certain than the fit: 0 would read as exact.
  ASSERT_EQ(diagnosis.extended.effect_deviations.size(), diagnosis.extended.model.effects.size());
  const double deviation = diagnosis.extended.effect_deviations[cause.place].coefficient[0];
  EXPECT_GT(deviation, 1e-5);
  EXPECT_LT(deviation, 0.01);
  EXPECT_GT(diagnosis.extended.pole_deviation.omega, 0.0);
  EXPECT_TRUE(diagnosis.extended.loop_covariance.has_value());
}

// 50 samples per second of a loop of 30 Hz.
TEST(LongDiagnosis, OfTooFewSamplesForTheLoopIsRefused) {
  SegmentedAxis axis = segment_axis(
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {}), "X");
  constexpr Eigen::Index kEvery = 20;
  axis.sample_time_s *= kEvery;
  for (Segment& s : axis.segments) {
    Segment thin;
    thin.start_s = s.start_s;
    thin.sample_time_s = axis.sample_time_s;
    const auto rows = Eigen::seqN(0, (s.size() - 1) / kEvery + 1, kEvery);
    thin.command = s.command(rows);
    thin.actual = s.actual(rows);
    s = std::move(thin);
  }
  try {
    (void)diagnose(axis);
    FAIL() << "not refused";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("samples per second do not show whether it is faster"));
  }
}

TEST(Diagnosis, IsTheSameOnAnyNumberOfThreads) {
  SegmentedAxis axis = segment_axis(
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {}), "X");
  axis.segments = cut(axis.segments, 0.0, 3.0);
  std::vector<std::string> files;
  for (const std::size_t threads : {1U, 3U}) {
    use_threads(threads);
    const Diagnosis diagnosis = diagnose(axis);
    files.push_back(to_json(diagnosis, "").dump());
    for (const std::string& step : diagnosis.steps) files.back() += step;
  }
  use_threads(1);
  EXPECT_EQ(files[0], files[1]);
}

// A law of friction that falls with speed implies the Stribeck effect, whatever it is called.
TEST(LongDiagnosis, LeavesACauseOutOfTheLawsThatSayItWithAnother) {
  const SegmentedAxis axis = segment_axis(
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {}), "Y");
  DiagnoseOptions options;
  options.leave_out = {"stribeck"};
  const Diagnosis diagnosis = diagnose(axis, options);
  EXPECT_THAT(ids(diagnosis), ElementsAre("presliding"));
  EXPECT_THAT(cause_text(diagnosis, diagnosis.causes.front()), Not(HasSubstr("stribeck")));
}

// What the published symmetric model of this axis gets wrong, each with its gain on
// the half that was not fitted.
TEST(LongDiagnosis, NamesWhatThePublishedModelOfEmpsGetsWrong) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  ReadOptions read;
  read.columns = "X.command=qg[m],X.actual=qm[m],X.torque=vir[V]";
  const SegmentedAxis axis = segment_axis(read_recording(file, read), "X");
  DiagnoseOptions options;
  options.identify.training_share = 0.5;
  const Diagnosis diagnosis = diagnose(axis, options);
  EXPECT_THAT(ids(diagnosis), Contains("asymmetric_friction"));
  EXPECT_THAT(ids(diagnosis), Contains("stribeck"));
  EXPECT_NEAR(diagnosis.baseline.holdout.rms, 1.53e-6, 0.02e-6);
  EXPECT_LT(diagnosis.extended.holdout.rms, 0.7e-6);
  ASSERT_NE(find(diagnosis, "asymmetric_friction"), nullptr);
  // The confidence of the ripple is close to the limit for naming it: the last digit of an
  // exponential function decides.
  const auto& suspected = diagnosis.suspected;
  const auto doubted = std::find_if(suspected.begin(), suspected.end(),
                                    [](const Cause& cause) { return cause.id == "cogging"; });
  const Cause* of_screw = doubted != suspected.end() ? &*doubted : find(diagnosis, "cogging");
  ASSERT_NE(of_screw, nullptr);
  const Cause& unlike = *find(diagnosis, "asymmetric_friction");
  // 166.7 and 240.4 N s/m are published, on 95.1 kg.
  EXPECT_NEAR(diagnosis.extended.model.effects[unlike.place].coefficient[1],
              0.5 * (166.7 - 240.4) / 95.1, 0.08);
  const Effect& ripple = diagnosis.extended.model.effects[of_screw->place];
  EXPECT_NEAR(ripple.shape[0], 2.5e-3, 0.01e-3);
  EXPECT_NEAR(std::hypot(ripple.coefficient[0], ripple.coefficient[1]) * 95.1, 1.08, 0.2);  // [N]
  for (const Cause& cause : diagnosis.causes) {
    EXPECT_LT(cause.gain.after, cause.gain.before) << cause.id;
    EXPECT_GT(cause.gain.low, 0.0) << cause.id;
    // What the other parameters can take over is none of its gain: a fit in free simulation that
    // begins with the model without it hardly finds a better one.
    ASSERT_TRUE(cause.without.has_value()) << cause.id;
    const std::vector<Segment> training =
        cut(axis.segments, -1e300, diagnosis.baseline.training_to_s);
    const auto again = output_error(training, structure_of(*cause.without), *cause.without,
                                    {.encoder_step = 1e-9});
    ASSERT_TRUE(again.has_value()) << cause.id;
    EXPECT_GT(judge(again->model, training).rms, 0.9 * judge(*cause.without, training).rms)
        << cause.id;
  }

  const nlohmann::json file_of = to_json(diagnosis, "m2.json");
  EXPECT_EQ(file_of["schema"], "servotwin.diagnosis/1");
  EXPECT_EQ(file_of["verdict"], "explained");
  EXPECT_EQ(file_of["causes"].size(), diagnosis.causes.size());
  const std::string page = report_html(diagnosis, axis.segments, "DATA_EMPS.mat");
  EXPECT_THAT(page, HasSubstr("asymmetric_friction"));
  EXPECT_THAT(page, HasSubstr("<svg"));
  EXPECT_THAT(page, testing::Not(HasSubstr("http-equiv")));
}

}  // namespace
}  // namespace servotwin
