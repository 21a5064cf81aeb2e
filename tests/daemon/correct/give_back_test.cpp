// Corrections given back: the real-time loop, the worker and a machine that shares no code with the
// twin (tests/daemon/stepped_machine.h), driven cycle by cycle.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "daemon/between/clock.h"
#include "daemon/correct/learning_worker.h"
#include "daemon/loop/live_offsets.h"
#include "daemon/loop/real_time_loop.h"
#include "tests/daemon/stepped_machine.h"
#include "twin/program_error.h"

namespace servotwin::daemon {
namespace {

using testing::IsEmpty;
using testing::SizeIs;
using Path = std::array<Eigen::ArrayXd, 2>;

constexpr double kNothing = 1e-9;  // what a few cycles of fading in may leave [m]
constexpr OffsetLimits kLimits{3e-3, 0.2, 200.0};

class GiveBack : public testing::Test {
 protected:
  GiveBack() {
    const Model model = model_of(stepped_axis());
    // Residual of the model for this machine on another path, as on held-out data.
    missed_ = missed_of(model);
    for (const char* name : {"X", "Y"}) store(model, name);
  }

  static double missed_of(const Model& model) {
    SteppedAxis axis(stepped_axis());
    Twin twin(model);
    twin.start(0.0);
    double squares = 0.0;
    constexpr int kRows = 6000;
    for (int k = 1; k <= kRows; ++k) {
      const double command = command_at(kCycle_s * k) - command_at(0.0);
      squares += std::pow(command - axis.cycle(command) - twin.follow(command), 2);
    }
    return std::sqrt(squares / kRows);
  }
  ModelRecord store(const Model& model, const std::string& axis) {
    ModelRecord record = record_of(model, axis);
    record.created = iso_time(wall_ns());
    record.holdout = {missed_, 4.0 * missed_};
    store_.promote(record, {record.created, axis, "model_promoted", "made for this test", ""});
    return record;
  }
  void put_in_force(const ModelRecord& record) {
    models_[record.axis == "X" ? 0 : 1].publish(
        {Twin(record.model), record.version, missed_, settling_cycles(record.model)});
  }
  void start() {
    Config config;
    config.ilc = ilc_;
    for (const char* name : {"X", "Y"}) {
      config.axes.push_back({name, false, ""});
      config.axes.back().correction = kLimits;
    }
    const LearningRules rules =
        learning_rules(config, {kCycle_s, {{"X", false, ""}, {"Y", false, ""}}});
    hand_over_ = std::make_unique<OffsetHandOver>();
    loop_ = std::make_unique<RealTimeLoop>(kCycle_s, models_, predictions_, rows_, wake_up_,
                                           std::vector<std::vector<std::size_t>>{{0, 1}});
    live_ = std::make_unique<LiveOffsets>(offset_rules(rules, *ilc_.in_command, 0.0), *hand_over_);
    loop_->give_back(*live_, said_ring_);
    worker_ = std::make_unique<LearningWorker>(
        rules, store_, events_, *hand_over_,
        [this](const CorrectionChunk& chunk) { announced_.push_back(chunk); });
    for (const StoredModel& model : store_.in_force()) put_in_force(model.record);
    run(Path{Eigen::ArrayXd::Zero(500), Eigen::ArrayXd::Zero(500)});  // the twins settle
  }
  void learn(const Path& path) {
    ProgramChunk chunk;
    chunk.program = "part";
    chunk.learn = true;
    chunk.axes = {"X", "Y"};
    const Eigen::Index rows = path[0].size(), most = 1000;
    chunk.chunks = static_cast<std::uint32_t>((rows + most - 1) / most);
    for (Eigen::Index from = 0; from < rows; from += most, ++chunk.chunk) {
      const Eigen::Index count = std::min(most, rows - from);
      chunk.time_s.clear();
      chunk.command.clear();
      for (Eigen::Index k = from; k < from + count; ++k)
        chunk.time_s.push_back(kCycle_s * static_cast<double>(k));
      for (const Eigen::ArrayXd& axis : path)
        chunk.command.insert(chunk.command.end(), &axis[from], &axis[from] + count);
      worker_->take(chunk, 1);
    }
    ASSERT_THAT(worker_->kept(), SizeIs(1)) << said_.str();
    ASSERT_EQ(worker_->kept()[0]->why_not_live, "");
  }

  /// The errors of one run of the path.
  struct Left {
    std::vector<Eigen::ArrayXd> actual;
    double tracking_rms = 0.0, contour_rms = 0.0;  ///< of both axes; of the path
    double sent_peak = 0.0, advised_peak = 0.0;    ///< of the offsets
    Eigen::ArrayXd contour;
  };
  /// `at`: called before each cycle. `lost`: the cycle whose frame does not come; none: -1.
  Left run(const Path& path, const std::function<void(Eigen::Index)>& at = {},
           Eigen::Index lost = -1) {
    Left out;
    out.actual.assign(2, Eigen::ArrayXd(path[0].size()));
    // Then the axes stand for a moment, so that the end is detected.
    for (Eigen::Index cycle = 0; cycle < path[0].size() + 20; ++cycle) {
      const Eigen::Index k = std::min(cycle, path[0].size() - 1);
      if (at) at(cycle);
      MachineFrame frame;
      frame.sequence = ++cycles_;
      frame.time_ns = static_cast<std::int64_t>(cycles_) * 1'000'000 + 77 - back_ns_;
      frame.axis_count = 2;
      for (std::size_t i = 0; i < 2; ++i) {
        const AxisOffset& offset = applied_.axes[i];
        const double added =
            offset.send && frame.time_ns <= offset.expires_ns ? offset.offset : 0.0;
        const double demand = path[i](k) + added;
        out.sent_peak = std::max(out.sent_peak, std::abs(added));
        const double actual = axes_[i].cycle(demand);
        if (cycle == k) out.actual[i](k) = actual;
        frame.axes[i] = {*ilc_.in_command ? demand : path[i](k), actual, kAbsent};
      }
      if (cycle == lost) continue;
      const MachineOffset* answer =
          loop_->on_frame(frame, {static_cast<std::int64_t>(cycles_) * 1'000'000, 0});
      if (answer != nullptr) applied_ = *answer;  // a drive keeps it until it is over
      for (const AxisOffset& offset : applied_.axes)
        out.advised_peak = std::max(out.advised_peak, std::abs(offset.offset));
      drain();
    }
    worker_->judge_runs();
    out.tracking_rms =
        std::hypot(size_of(path[0] - out.actual[0]).rms, size_of(path[1] - out.actual[1]).rms);
    if (path[0].abs().maxCoeff() > 0.0) out.contour = program_error(path, out.actual).distance;
    out.contour_rms = size_of(out.contour).rms;
    return out;
  }
  void drain() {
    for (MachinePrediction prediction; predictions_.pop(prediction);) {
    }
    for (CycleRow row; rows_.pop(row);) {
    }
    for (DatedOffset offset; said_ring_.pop(offset);) {
    }
  }
  /// The same path on the same kind of plant, without a daemon.
  static Left uncorrected(const Path& path, const virtual_machine::Axis& plant) {
    Left out;
    out.actual.assign(2, Eigen::ArrayXd(path[0].size()));
    for (std::size_t i = 0; i < 2; ++i) {
      SteppedAxis axis(plant);
      for (Eigen::Index k = 0; k < path[i].size(); ++k) out.actual[i](k) = axis.cycle(path[i](k));
    }
    out.tracking_rms =
        std::hypot(size_of(path[0] - out.actual[0]).rms, size_of(path[1] - out.actual[1]).rms);
    out.contour = program_error(path, out.actual).distance;
    out.contour_rms = size_of(out.contour).rms;
    return out;
  }
  void change(const virtual_machine::Axis& plant) {
    for (SteppedAxis& axis : axes_) axis.change(plant);
  }
  [[nodiscard]] std::vector<Event> events(const std::string& kind) const {
    std::vector<Event> out;
    for (const Event& event : store_.events(1000)) {
      if (event.kind == kind) out.push_back(event);
    }
    return out;
  }
  [[nodiscard]] nlohmann::json last_use() const {
    const std::vector<Event> used = events("correction_used");
    return used.empty() ? nlohmann::json() : nlohmann::json::parse(used.front().detail);
  }

  TemporaryDirectory directory_;
  Store store_{directory_.path(), "mill"};
  std::ostringstream said_;
  EventLog events_{store_, said_};
  IlcConfig ilc_ = [] {
    IlcConfig out;
    out.live = true;
    out.in_command = true;
    return out;
  }();
  double missed_ = 0.0;
  std::vector<LatestValue<TwinInForce>> models_{2};
  Ring<MachinePrediction> predictions_{16};
  Ring<CycleRow> rows_{16};
  Ring<DatedOffset> said_ring_{16};
  WakeUp wake_up_;
  std::unique_ptr<OffsetHandOver> hand_over_;
  std::unique_ptr<RealTimeLoop> loop_;
  std::unique_ptr<LiveOffsets> live_;
  std::unique_ptr<LearningWorker> worker_;
  std::vector<CorrectionChunk> announced_;
  std::array<SteppedAxis, 2> axes_{SteppedAxis(stepped_axis()), SteppedAxis(stepped_axis())};
  MachineOffset applied_;
  std::uint64_t cycles_ = 0;
  std::int64_t back_ns_ = 0;  ///< that the clock of the frames has gone back
};

TEST_F(GiveBack, ArmedTheRepeatedProgramIsFollowedAsWasPredictedAndTheGainIsKept) {
  for (const bool in_command : {true, false}) {
    ilc_.in_command = in_command;
    start();
    hand_over_->armed = true;
    const Path path = circle_program();
    learn(path);
    const Left before = uncorrected(path, stepped_axis()), after = run(path);
    // The largest remaining error is in the part where the correction is faded in.
    EXPECT_LT(after.tracking_rms, before.tracking_rms / 3.0);
    EXPECT_LT(after.contour.tail(1200).abs().maxCoeff(),
              before.contour.tail(1200).abs().maxCoeff() / 3.0);
    EXPECT_GT(after.sent_peak, 1e-4);
    EXPECT_LE(after.sent_peak, kLimits.peak);
    const nlohmann::json use = last_use();
    EXPECT_EQ(use["ruling"], "keep") << use;
    EXPECT_EQ(use["ended"], "finished");
    EXPECT_EQ(use["live"], true);
    for (const nlohmann::json& axis : use["axes"]) {
      EXPECT_LT(axis["measured_rms_m"], axis["before_rms_m"].get<double>() / 20.0) << use;
    }
    EXPECT_LT(use["contour"]["measured_rms_m"], use["contour"]["before_rms_m"]);
    EXPECT_THAT(worker_->kept(), SizeIs(1));
    run(Path{Eigen::ArrayXd::Zero(200), Eigen::ArrayXd::Zero(200)});
    EXPECT_LT(run(path).tracking_rms, before.tracking_rms / 3.0) << "and once more";
  }
}

TEST_F(GiveBack, NotArmedOrNotLiveNothingIsSentAndTheAdviceIsTheSame) {
  for (const bool live : {true, false}) {
    ilc_.live = live;
    start();
    hand_over_->armed = !live;
    const Path path = circle_program();
    learn(path);
    const Left before = uncorrected(path, stepped_axis()), dry = run(path);
    EXPECT_EQ(dry.sent_peak, 0.0);
    EXPECT_GT(dry.advised_peak, 1e-4);
    EXPECT_NEAR(dry.tracking_rms, before.tracking_rms, 1e-9);
    const nlohmann::json use = last_use();
    EXPECT_EQ(use["live"], false);
    EXPECT_EQ(use["ruling"], "keep") << use;
  }
}

TEST_F(GiveBack, ArmingInTheMiddleOfARunWaitsForTheNext) {
  start();
  const Path path = circle_program();
  learn(path);
  EXPECT_EQ(run(path, [&](Eigen::Index k) { hand_over_->armed = k > 800; }).sent_peak, 0.0);
  run(Path{Eigen::ArrayXd::Zero(200), Eigen::ArrayXd::Zero(200)});
  EXPECT_GT(run(path).sent_peak, 1e-4);
}

/// The offset that was applied in every cycle must obey the axis' limits, whatever happens.
void expect_within_limits(const std::vector<double>& applied) {
  for (std::size_t k = 1; k < applied.size(); ++k) {
    ASSERT_LE(std::abs(applied[k]), kLimits.peak);
    ASSERT_LE(std::abs(applied[k] - applied[k - 1]), kLimits.rate * kCycle_s * (1.0 + 1e-9)) << k;
  }
}

TEST_F(GiveBack, DisarmingAPauseAndAnotherPathFadeTheOffsetOutWithinItsLimits) {
  for (const std::string what : {"disarm", "pause", "other path"}) {
    start();
    hand_over_->armed = true;
    Path path = circle_program();
    learn(path);
    const auto end = path[0].size();
    if (what == "pause") {
      for (Eigen::ArrayXd& axis : path) axis.segment(900, end - 900).setConstant(axis(899));
    } else if (what == "other path") {
      for (Eigen::ArrayXd& axis : path) {
        const double step = axis(899) - axis(898);
        for (Eigen::Index k = 900; k < end; ++k)
          axis(k) =
              axis(k - 1) + step * (k < 1100 ? 1.0 - static_cast<double>(k - 900) / 200.0 : 0.0);
      }
    }
    std::vector<double> applied;
    run(path, [&](Eigen::Index k) {
      if (what == "disarm" && k == 900) hand_over_->armed = false;
      applied.push_back(applied_.axes[0].send ? applied_.axes[0].offset : 0.0);
    });
    expect_within_limits(applied);
    EXPECT_GT(std::abs(applied[898]), 1e-4) << what;
    for (std::size_t k = 1010; k < applied.size(); ++k) ASSERT_EQ(applied[k], 0.0) << what << k;
    EXPECT_EQ(last_use()["ended"], what == "disarm" ? "disarmed" : "left") << what;
  }
}

TEST_F(GiveBack, ALostCycleEndsARun) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  run(path, {}, 900);
  EXPECT_EQ(last_use()["ended"], "gap");
}

// The drive still has the offset: taking it back at once would be a jump.
TEST_F(GiveBack, WhereTheClockGoesBackTheOffsetFadesOutAndTheNextRunIsCorrectedAgain) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  std::vector<double> applied;
  run(path, [&](Eigen::Index k) {
    if (k == 900) back_ns_ = 3'600'000'000'000;
    applied.push_back(applied_.axes[0].send ? applied_.axes[0].offset : 0.0);
  });
  expect_within_limits(applied);
  EXPECT_GT(std::abs(applied[900]), 1e-4);
  for (std::size_t k = 1010; k < applied.size(); ++k) ASSERT_EQ(applied[k], 0.0) << k;
  EXPECT_EQ(last_use()["ended"], "gap");
  run(Path{Eigen::ArrayXd::Zero(500), Eigen::ArrayXd::Zero(500)});
  EXPECT_GT(run(path).sent_peak, 1e-4);
  EXPECT_EQ(last_use()["ended"], "finished") << last_use();
}

TEST_F(GiveBack, AnotherModelInForceIsAnotherCorrection) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  const auto first = worker_->kept()[0];
  put_in_force(store(model_of(stepped_axis()), "X"));
  run(Path{Eigen::ArrayXd::Zero(500), Eigen::ArrayXd::Zero(500)});
  EXPECT_EQ(run(path).sent_peak, 0.0) << "learned with a model that is not in force any more";
  EXPECT_EQ(last_use()["ruling"], "learn_anew");
  ASSERT_THAT(worker_->kept(), SizeIs(1));
  EXPECT_NE(worker_->kept()[0], first);
  EXPECT_EQ(worker_->kept()[0]->axes[0].model_version, 2);
  run(Path{Eigen::ArrayXd::Zero(200), Eigen::ArrayXd::Zero(200)});
  EXPECT_GT(run(path).sent_peak, 1e-4);
}

struct Change {
  const char* name;
  std::function<void(virtual_machine::Axis&)> make;
};
class PlantChange : public GiveBack, public testing::WithParamInterface<Change> {};

// The plant has changed when the correction is used: it is withdrawn before the path error is
// larger than without it, and no more offsets are sent.
TEST_P(PlantChange, WithdrawsTheCorrectionBeforeThePathIsWorseThanWithout) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  virtual_machine::Axis plant = stepped_axis();
  GetParam().make(plant);
  change(plant);
  const Left without = uncorrected(path, plant), with = run(path);
  EXPECT_THAT(worker_->kept(), IsEmpty()) << said_.str();
  EXPECT_THAT(events("correction_withdrawn"), SizeIs(1));
  EXPECT_EQ(announced_.back().state, CorrectionState::kWithdrawn);
  EXPECT_LE(with.contour_rms, without.contour_rms + kNothing);
  // Nowhere on the path either, over a tenth of a second.
  for (Eigen::Index k = 0; k + 100 <= with.contour.size(); k += 50) {
    EXPECT_LE(
        size_of(with.contour.segment(k, 100)).rms,
        std::max(size_of(without.contour.segment(k, 100)).rms, without.contour_rms) + kNothing)
        << GetParam().name << " at " << k;
  }
  run(Path{Eigen::ArrayXd::Zero(200), Eigen::ArrayXd::Zero(200)});
  EXPECT_EQ(run(path).advised_peak, 0.0) << "there is none any more";
}

INSTANTIATE_TEST_SUITE_P(
    , PlantChange,
    testing::Values(Change{"Payload", [](virtual_machine::Axis& a) { a.body.mass *= 1.5; }},
                    Change{"Friction",
                           [](virtual_machine::Axis& a) {
                             std::get<virtual_machine::SaturatedCoulomb>(a.body.friction).coulomb *=
                                 2.0;
                           }},
                    Change{"LoopGain",
                           [](virtual_machine::Axis& a) { a.drive.position_gain *= 0.8; }}),
    [](const auto& one) { return one.param.name; });

// With a band so wide that no residual leaves it, the path error is still watched: the gain of one
// axis falls, and the correction of the other one increases the path error.
TEST_F(GiveBack, ThePathItselfEndsARunToo) {
  ilc_.residual_band = 1000.0;
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  virtual_machine::Axis weaker = stepped_axis();
  weaker.drive.position_gain *= 0.8;
  axes_[0].change(weaker);
  const Left with = run(path);
  SteppedAxis x(weaker), y(stepped_axis());
  std::vector<Eigen::ArrayXd> alone(2, Eigen::ArrayXd(path[0].size()));
  for (Eigen::Index k = 0; k < path[0].size(); ++k) {
    alone[0](k) = x.cycle(path[0](k));
    alone[1](k) = y.cycle(path[1](k));
  }
  EXPECT_EQ(last_use()["ended"], "contour");
  EXPECT_THAT(worker_->kept(), IsEmpty());
  EXPECT_LT(with.contour_rms, size_of(program_error(path, alone).distance).rms);
}

// After a small change of the machine the correction is kept, because it still reduces the error.
TEST_F(GiveBack, ASmallChangeOfFrictionKeepsTheCorrection) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  virtual_machine::Axis plant = stepped_axis();
  std::get<virtual_machine::SaturatedCoulomb>(plant.body.friction).coulomb *= 1.02;
  change(plant);
  const Left without = uncorrected(path, plant), with = run(path);
  EXPECT_LT(with.contour_rms, without.contour_rms);
  EXPECT_THAT(worker_->kept(), SizeIs(1)) << said_.str();
}

// The plant changes in the middle of a run.
TEST_F(GiveBack, AChangeInTheMiddleOfARunEndsIt) {
  start();
  hand_over_->armed = true;
  const Path path = circle_program();
  learn(path);
  virtual_machine::Axis plant = stepped_axis();
  plant.drive.position_gain *= 0.8;
  const Left with = run(path, [&](Eigen::Index k) {
    if (k == 900) change(plant);
  });
  EXPECT_THAT(worker_->kept(), IsEmpty());
  EXPECT_LE(with.contour_rms, uncorrected(path, plant).contour_rms);
  const double at_s = last_use()["cycles"].get<double>() * kCycle_s;
  EXPECT_LT(at_s, 0.9) << "it was noticed within the run";
}

}  // namespace
}  // namespace servotwin::daemon
