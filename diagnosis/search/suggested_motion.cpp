#include "diagnosis/search/suggested_motion.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "diagnosis/search/cause_nature.h"
#include "diagnosis/search/diagnose.h"
#include "diagnosis/statistics/text.h"
#include "identification/recording/excitation.h"
#include "identification/recording/noise_floor.h"

namespace servotwin {

namespace {

/// The entry for this pair of causes; nullptr where the pair needs nothing special.
const PairNature* special_of(const Doubt& doubt) {
  for (const PairNature& s : kPairNatures) {
    if ((s.a == doubt.cause && s.b == doubt.rival) || (s.b == doubt.cause && s.a == doubt.rival))
      return &s;
  }
  return nullptr;
}

const char* description(TestPart part) {
  switch (part) {
    case kStandstill:
      return "a rest of 10 s";
    case kReversals:
      return "slow reversals of increasing amplitude, with a low and a high acceleration";
    case kRests:
      return "the same move after rests of 0.1 to 10 s";
    case kSpeeds:
      return "constant speeds from creeping to the maximum in both directions";
    case kTwoSpeeds:
      return "two constant speeds over several periods";
    case kStrokes:
      return "slow full strokes in both directions";
    case kAccelerations:
      return "the same move with three accelerations";
    case kSweep:
      return "oscillation of increasing frequency and decreasing amplitude";
    case kRepeats:
      return "the same cycle, fast and slow, six times with pauses";
  }
  return "";
}

/// Assembles a test motion from elementary motions within the limits of the recording.
class Builder {
 public:
  Builder(const SeenMotion& seen, const TestSizes& sizes) : seen_(seen), sizes_(sizes) {
    // kPeakShare: of the recorded peaks that the test uses, since in a coarsely rounded command
    // they are not known more exactly.
    constexpr double kPeakShare = 0.97, kMinSmoothing_s = 0.02, kMaxSmoothing_s = 0.2;
    v_ = kPeakShare * seen.velocity;
    a_ = kPeakShare * seen.acceleration;
    // A recording at one speed shows no acceleration but the rounding of its command: no axis takes
    // longer than kLongestRamp_s to its speed. With that acceleration a stroke takes minutes.
    constexpr double kLongestRamp_s = 30.0, kGentleRamp_s = 1.0;
    motion_.accelerates_more = a_ * kLongestRamp_s < v_;
    if (motion_.accelerates_more) a_ = v_ / kGentleRamp_s;
    motion_.start = seen.start;
    motion_.smoothing_s = std::clamp(seen.jerk > 0.0 ? 2.0 * a_ / seen.jerk : kMinSmoothing_s,
                                     kMinSmoothing_s, kMaxSmoothing_s);
    settle_ = motion_.smoothing_s + 0.1;
    stroke_ = seen.high - seen.low;
    centre_ = 0.5 * (seen.low + seen.high);
  }

  TestMotion of(unsigned parts) {
    for (unsigned bit = kStandstill; bit <= kRepeats; bit <<= 1u) {
      if ((parts & bit) == 0) continue;
      begins_ = description(static_cast<TestPart>(bit));
      add(static_cast<TestPart>(bit));
    }
    begins_.clear();
    go(seen_.start, v_, a_, settle_);
    return motion_;
  }

 private:
  void go(double to, double velocity, double acceleration, double rest) {
    const double place = std::clamp(to, seen_.low, seen_.high);
    if (place == motion_.end() && rest <= 0.0) return;
    motion_.legs.push_back({place, std::min(velocity, v_), std::min(acceleration, a_), rest,
                            std::exchange(begins_, {})});
  }
  /// A stroke of this length about the middle of the travel, forwards and back.
  void lap(double way, double velocity, double acceleration, double rest) {
    go(centre_ - 0.5 * way, v_, a_, rest);
    go(centre_ + 0.5 * way, velocity, acceleration, rest);
    go(centre_ - 0.5 * way, velocity, acceleration, rest);
  }

  void add(TestPart part) {
    switch (part) {
      case kStandstill:
        go(motion_.end(), v_, a_, 10.0);
        break;
      case kReversals:
        reversals();
        break;
      case kRests:
        for (const double rest : {0.1, 0.3, 1.0, 3.0, 10.0}) {
          go(centre_ - 0.1 * stroke_, 0.2 * v_, a_, rest);
          go(centre_ + 0.1 * stroke_, 0.2 * v_, a_, rest);
        }
        break;
      case kSpeeds:
        for (const double share : {1.0, 0.3, 0.1, 0.03, 0.01, 0.003}) {
          constexpr double kMaxTimePerSpeed_s = 2.0;
          const double v = share * v_;
          lap(std::min(stroke_, v * kMaxTimePerSpeed_s + v * v / a_), v, a_, settle_);
        }
        break;
      case kTwoSpeeds:
        two_speeds();
        break;
      case kStrokes: {
        constexpr double kStrokeTime_s = 6.0;
        for (int i = 0; i < 2; ++i) lap(stroke_, stroke_ / kStrokeTime_s, a_, settle_);
        break;
      }
      case kAccelerations:
        for (const double share : {1.0, 1.0 / 3.0, 1.0 / 9.0}) {
          // The stroke is the same for all three. Its length leaves a part at constant speed at
          // the highest acceleration.
          const double way = std::min(stroke_, 2.0 * v_ * v_ / a_);
          for (int i = 0; i < 2; ++i) lap(way, v_, share * a_, settle_);
        }
        break;
      case kSweep:
        sweep();
        break;
      case kRepeats:
        for (int i = 0; i < 6; ++i) {
          lap(stroke_, v_, a_, settle_);
          lap(stroke_, std::max(0.2 * v_, stroke_ / 5.0), a_, 2.0);
        }
        break;
    }
  }

  void reversals() {
    // Amplitudes from the encoder resolution to well beyond the travel at which friction slides.
    const double least = std::max(4.0 * sizes_.encoder_step, 1e-6);
    const double from = sizes_.travel > 0.0 ? std::max(least, 0.1 * sizes_.travel) : least;
    const double to =
        std::min(0.25 * stroke_, sizes_.travel > 0.0 ? 30.0 * sizes_.travel : 1000.0 * from);
    for (const double share : {0.05, 1.0}) {
      // A long travel in one direction resets the memory of the friction.
      go(centre_ - 0.25 * stroke_, v_, a_, settle_);
      go(centre_, v_, a_, settle_);
      for (double way = from; way <= to; way *= 2.5) {
        go(centre_ - way, std::max(0.1 * share * v_, way / 0.5), share * a_, settle_);
        go(centre_, std::max(0.1 * share * v_, way / 0.5), share * a_, settle_);
      }
    }
  }

  void two_speeds() {
    const double way = sizes_.period > 0.0 ? std::min(stroke_, 8.0 * sizes_.period) : stroke_;
    // At this speed half of the stroke is at constant speed.
    const double fast = std::min(v_, std::sqrt(0.5 * a_ * way));
    for (const double v : {fast, fast / 5.0}) {
      for (int i = 0; i < 2; ++i) lap(way, v, a_, settle_);
    }
  }

  void sweep() {
    const double least =
        std::max(20.0 * sizes_.encoder_step, a_ * std::pow(motion_.smoothing_s, 2));
    go(centre_, v_, a_, settle_);
    for (double way = std::min(0.5 * stroke_, v_ * v_ / a_); way > least; way *= 0.75) {
      for (int i = 0; i < 3; ++i) {
        go(centre_ + 0.5 * way, v_, a_, 0.0);
        go(centre_ - 0.5 * way, v_, a_, 0.0);
      }
    }
    go(centre_, v_, a_, settle_);
  }

  const SeenMotion& seen_;
  TestSizes sizes_;
  TestMotion motion_;
  double v_ = 0.0, a_ = 0.0, settle_ = 0.0, stroke_ = 0.0, centre_ = 0.0;
  std::string begins_;
};

std::string described(unsigned parts) {
  std::string out;
  for (unsigned bit = kStandstill; bit <= kRepeats; bit <<= 1u) {
    if ((parts & bit) == 0) continue;
    out += (out.empty() ? "" : "; ") + std::string(description(static_cast<TestPart>(bit)));
  }
  return out;
}

std::string one_shows(const CauseNature& nature) {
  return std::string(nature.id) + " " + nature.shows + ".";
}

}  // namespace

std::vector<std::string_view> contract_ids() {
  std::vector<std::string_view> out;
  for (const CauseNature& nature : kNatures) out.push_back(nature.id);
  return out;
}

std::optional<SuggestedTest> suggested_test(const std::vector<Doubt>& doubts,
                                            const SeenMotion& seen, const TestSizes& sizes) {
  if (doubts.empty()) return {};
  constexpr unsigned kPartsOfSurvey =
      kStandstill | kReversals | kSpeeds | kStrokes | kAccelerations;
  unsigned parts = 0;
  std::string words;
  std::set<std::string> said;
  const auto add = [&](const std::string& sentence) {
    if (said.insert(sentence).second) words += (words.empty() ? "" : " ") + sentence;
  };
  for (const Doubt& doubt : doubts) {
    if (doubt.cause.empty()) {
      parts |= kPartsOfSurvey;
      add("In this motion everything that an error can depend on changes separately.");
      continue;
    }
    const CauseNature& one = nature_of(doubt.cause);
    if (doubt.rival.empty()) {
      parts |= one.parts;
      add(one_shows(one));
    } else {
      const CauseNature& other = nature_of(doubt.rival);
      const PairNature* special = special_of(doubt);
      if (special != nullptr && special->parts == 0) {
        add(doubt.cause + " and " + doubt.rival +
            " cannot be distinguished with these sensors: " + special->words + ".");
        continue;
      }
      parts |= special != nullptr ? special->parts : one.parts | other.parts;
      add(one_shows(one));
      add(one_shows(other));
      if (special != nullptr)
        add("Between " + doubt.cause + " and " + doubt.rival + ": " + special->words + ".");
      if (*other.besides != '\0') add("For " + doubt.rival + ": " + other.besides + ".");
    }
    if (*one.besides != '\0') add("For " + doubt.cause + ": " + one.besides + ".");
  }
  if (parts == 0) return SuggestedTest{words, {}};
  if (!(seen.high > seen.low) || !(seen.velocity > 0.0) || !(seen.acceleration > 0.0))
    return SuggestedTest{words + " The recording contains no motion that a test could stay within.",
                         {}};
  constexpr double kMinPeriods = 3.0;
  if ((parts & kTwoSpeeds) != 0 && seen.high - seen.low < kMinPeriods * sizes.period)
    add(text("The travel of this recording covers %.1f periods: a longer travel decides better.",
             (seen.high - seen.low) / sizes.period));
  SuggestedTest out;
  out.motion = Builder(seen, sizes).of(parts);
  out.words =
      "Run " + described(parts) +
      text(" (%.0f s, within the recorded travel%s), record it and diagnose the recording. ",
           out.motion->duration_s(),
           out.motion->accelerates_more
               ? " and speed; the recording hardly accelerates, and the test reaches its "
                 "speed within 1 s"
               : ", speed and acceleration") +
      words;
  return out;
}

std::optional<SuggestedTest> suggested_test(const Diagnosis& diagnosis, const SegmentedAxis& axis) {
  // A cause of lower confidence is tested even without a rival. Above kMinConfidenceToName, so that
  // a cause named by a small margin is tested as well.
  constexpr double kMinConfidenceWithoutTest = 0.6;
  std::vector<Doubt> doubts;
  TestSizes sizes;
  sizes.encoder_step = noise_floor(axis.segments).encoder_step;
  std::vector<Cause> all = diagnosis.causes;
  all.insert(all.end(), diagnosis.suspected.begin(), diagnosis.suspected.end());
  for (const Cause& cause : all) {
    for (const std::string& rival : cause.ambiguous_with) doubts.push_back({cause.id, rival});
    if (cause.ambiguous_with.empty() && cause.confidence < kMinConfidenceWithoutTest)
      doubts.push_back({cause.id, ""});
    if (cause.place >= diagnosis.extended.model.effects.size()) continue;
    const Effect& effect = diagnosis.extended.model.effects[cause.place];
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      if (p.scan == Scan::kPeriod && p.name == "period") sizes.period = effect.shape[i];
      if (p.name == "width" || p.name == "breakaway_displacement" || p.name == "deflection")
        sizes.travel = effect.shape[i];
      ++i;
    }
  }
  // What the recorded motion does not contain, rather than what the fit leaves uncertain: a model
  // that lacks a cause has no reliable uncertainties.
  const std::vector<std::string> missing =
      missing_motion(excitation_of(axis.segments), axis.rotary);
  if (diagnosis.verdict == Verdict::kUnexplained || !missing.empty()) doubts.push_back({});
  auto test = suggested_test(doubts, seen_motion(axis.segments), sizes);
  for (const std::string& one : missing) test->words += " In the recording, " + one + ".";
  return test;
}

}  // namespace servotwin
