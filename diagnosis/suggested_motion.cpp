#include "diagnosis/suggested_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "diagnosis/diagnose.h"
#include "diagnosis/text.h"
#include "identification/excitation.h"
#include "identification/noise_floor.h"

namespace servotwin {

namespace {

/// Pieces of motion, in the order in which a test runs them: what is gentle first.
enum Piece : unsigned {
  kStandstill = 1u << 0,
  kReversals = 1u << 1,
  kRests = 1u << 2,
  kSpeeds = 1u << 3,
  kTwoSpeeds = 1u << 4,
  kStrokes = 1u << 5,
  kAccelerations = 1u << 6,
  kSweep = 1u << 7,
  kRepeats = 1u << 8,
};

/// What a cause depends on, and where that shows alone.
struct Nature {
  std::string_view id;
  unsigned pieces;
  const char* shows;         // continues "<cause> "
  const char* besides = "";  // what the path alone does not do
};

constexpr const char* kPast =
    "it has happened: give the model from before with --model, or the new one shows it all along";
constexpr const char* kLoadEncoder =
    "it needs a record of an encoder at the load or of a laser: one at the motor cannot see it";

constexpr std::array<Nature, 24> kNatures{{
    {"stribeck", kSpeeds | kReversals,
     "follows the speed: it differs between creeping and feed, wherever and however long"},
    {"presliding", kReversals,
     "follows the way since the reversal and turns with it, at any acceleration"},
    {"asymmetric_friction", kSpeeds, "differs between the directions, at rest not at all"},
    {"position_dependent_friction", kStrokes,
     "comes back at the same place with the sign of the direction, smoothly"},
    {"added_friction", kRepeats | kSpeeds,
     "begins at a moment or place and stays, at all speeds alike", kPast},
    {"backlash", kReversals | kAccelerations,
     "is a step of one width at every reversal, whatever the force"},
    {"compliance", kAccelerations | kSweep,
     "grows in proportion to the acceleration and rings at its own frequency"},
    {"cogging", kTwoSpeeds,
     "is a force by the place that keeps its size at any speed, and vanishes in no direction"},
    {"lead_error", kTwoSpeeds, "is an error by the place of one size at any speed", kLoadEncoder},
    {"encoder_error", kTwoSpeeds,
     "is by the place as well, but the loop follows it: what it does grows with the speed"},
    {"gravity_offset", kSpeeds | kStandstill, "is there at rest and at all speeds alike"},
    {"inertia_change", kAccelerations,
     "goes with the acceleration, and leaves constant speed and reversals as they are", kPast},
    {"viscous_drift", kRepeats | kSpeeds,
     "is in proportion to the speed and fades from one cycle to the next as the axis warms: begin "
     "cold"},
    {"time_delay", kAccelerations | kSweep,
     "shifts everything by one time, so that its phase grows in proportion to the frequency"},
    {"feedforward_mismatch", kAccelerations | kSweep,
     "is in proportion to the commanded speed or acceleration up to the bandwidth of the loop and "
     "no further",
     "an earlier model of the axis to compare with (--model)"},
    {"gain_change", kAccelerations | kSweep | kReversals,
     "scales every error, that of friction at reversals too, and moves the bandwidth", kPast},
    {"torque_saturation", kAccelerations,
     "is there at the largest acceleration and gone at a third of it"},
    {"periodic_disturbance", kStandstill | kTwoSpeeds,
     "keeps its frequency at any speed and at rest"},
    {"impulse_disturbance", kRepeats, "does not come back at the same place or moment of a cycle"},
    {"cutting_force", kRepeats, "is gone when the same motion runs in air",
     "run it without cutting, and once more in the cut"},
    {"cross_coupling", kStandstill | kAccelerations,
     "is there only while the other axis accelerates",
     "let the other axis move during the first rest and stand afterwards, and record both"},
    {"dwell_stiction", kRests, "grows with the logarithm of the rest before the move"},
    {"thermal_growth", kRepeats,
     "grows from cycle to cycle with the way from the fixed bearing: begin cold", kLoadEncoder},
    {"dropped_samples", kRepeats,
     "is in the record and not in the machine: it does not come back when the motion is recorded "
     "again"},
}};

const Nature& nature_of(std::string_view id) {
  const auto found =
      std::find_if(kNatures.begin(), kNatures.end(), [&](const Nature& n) { return n.id == id; });
  if (found == kNatures.end())
    throw std::invalid_argument("suggested test: there is no cause '" + std::string(id) + "'");
  return *found;
}

/// Pairs that need more, or other, motion than the pieces of both, or that nothing decides.
struct Special {
  std::string_view a, b;
  unsigned pieces;  // 0: nothing decides
  const char* words;
};
constexpr std::array<Special, 11> kSpecials{{
    {"asymmetric_friction", "gravity_offset", 0,
     "a weight and unlike friction in the two directions are the same constant force on one axis "
     "in one attitude, and what friction holds at rest is not known; what changes when the "
     "counterbalance or the load changes is the weight"},
    {"lead_error", "thermal_growth", kStrokes | kRepeats,
     "over one stroke both are a length that is wrong; only from cycle to cycle does one of them "
     "grow"},
    {"time_delay", "gain_change", kAccelerations | kSweep,
     "at low frequency both are an error in proportion to the speed; above the bandwidth of the "
     "loop only the delay's phase goes on growing"},
    {"time_delay", "feedforward_mismatch", kAccelerations | kSweep,
     "at low frequency both are an error in proportion to the speed; above the bandwidth of the "
     "loop only the delay's phase goes on growing"},
    {"gain_change", "feedforward_mismatch", kAccelerations | kSweep | kReversals,
     "both are an error in proportion to the speed; only the gain changes what a reversal of "
     "friction does"},
    {"backlash", "compliance", kReversals | kAccelerations | kSweep,
     "under rising acceleration the gap stays a step of one width, the spring gives in a straight "
     "line"},
    {"backlash", "presliding", kReversals,
     "small reversals are lost in a gap altogether and return nothing; presliding gives a closed "
     "loop that grows with them"},
    {"compliance", "presliding", kReversals | kAccelerations | kSweep,
     "at a slow reversal of small amplitude the spring does nothing, and presliding all it does"},
    {"stribeck", "presliding", kSpeeds | kReversals,
     "creeping at one speed over a long way shows the one, tiny reversals the other"},
    {"stribeck", "dwell_stiction", kSpeeds | kRests,
     "creeping without a stop shows the one; moves of one kind after unlike rests the other"},
    {"position_dependent_friction", "added_friction", kStrokes | kRepeats,
     "a cover segment or clamp is a step at a place or moment, unlike on the way out and back; "
     "wear is smooth and the same on both"},
}};

const Special* special_of(const Doubt& doubt) {
  for (const Special& s : kSpecials) {
    if ((s.a == doubt.cause && s.b == doubt.rival) || (s.b == doubt.cause && s.a == doubt.rival))
      return &s;
  }
  return nullptr;
}

const char* description(Piece piece) {
  switch (piece) {
    case kStandstill:
      return "a rest of 10 s";
    case kReversals:
      return "slow reversals of growing amplitude under a small and a large acceleration";
    case kRests:
      return "one move after rests of 0.1 to 10 s";
    case kSpeeds:
      return "constant speeds from creeping to the fastest in both directions";
    case kTwoSpeeds:
      return "two constant speeds over several periods";
    case kStrokes:
      return "slow full strokes in both directions";
    case kAccelerations:
      return "one move under three accelerations";
    case kSweep:
      return "to and fro faster and faster over a shrinking way";
    case kRepeats:
      return "one cycle, fast and slow, six times with pauses";
  }
  return "";
}

/// Puts pieces together within the limits.
class Builder {
 public:
  Builder(const SeenMotion& seen, const TestSizes& sizes) : seen_(seen), sizes_(sizes) {
    // Between the samples of a command that was written with few digits the peaks are not known to
    // more than this.
    constexpr double kWithin = 0.97, kLeast_s = 0.02, kMost_s = 0.2;
    v_ = kWithin * seen.velocity;
    a_ = kWithin * seen.acceleration;
    motion_.start = seen.start;
    motion_.smoothing_s =
        std::clamp(seen.jerk > 0.0 ? 2.0 * a_ / seen.jerk : kLeast_s, kLeast_s, kMost_s);
    settle_ = motion_.smoothing_s + 0.1;
    stroke_ = seen.high - seen.low;
    centre_ = 0.5 * (seen.low + seen.high);
  }

  TestMotion of(unsigned pieces) {
    for (unsigned bit = kStandstill; bit <= kRepeats; bit <<= 1u) {
      if ((pieces & bit) == 0) continue;
      begins_ = description(static_cast<Piece>(bit));
      add(static_cast<Piece>(bit));
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
  /// There and back over this way about the middle.
  void lap(double way, double velocity, double acceleration, double rest) {
    go(centre_ - 0.5 * way, v_, a_, rest);
    go(centre_ + 0.5 * way, velocity, acceleration, rest);
    go(centre_ - 0.5 * way, velocity, acceleration, rest);
  }

  void add(Piece piece) {
    switch (piece) {
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
          constexpr double kEach_s = 2.0;
          const double v = share * v_;
          lap(std::min(stroke_, v * kEach_s + v * v / a_), v, a_, settle_);
        }
        break;
      case kTwoSpeeds:
        two_speeds();
        break;
      case kStrokes: {
        constexpr double kEach_s = 6.0;
        for (int i = 0; i < 2; ++i) lap(stroke_, stroke_ / kEach_s, a_, settle_);
        break;
      }
      case kAccelerations:
        for (const double share : {1.0, 1.0 / 3.0, 1.0 / 9.0}) {
          // Slow enough for the hardest to have a steady middle on the same way.
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
    // From what the encoder can just resolve to well beyond where friction slides.
    const double least = std::max(4.0 * sizes_.encoder_step, 1e-6);
    const double from = sizes_.travel > 0.0 ? std::max(least, 0.1 * sizes_.travel) : least;
    const double to =
        std::min(0.25 * stroke_, sizes_.travel > 0.0 ? 30.0 * sizes_.travel : 1000.0 * from);
    for (const double share : {0.05, 1.0}) {
      // A long way in one direction wipes out what friction remembers.
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
    // Half of the way at constant speed.
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

std::string described(unsigned pieces) {
  std::string out;
  for (unsigned bit = kStandstill; bit <= kRepeats; bit <<= 1u) {
    if ((pieces & bit) == 0) continue;
    out += (out.empty() ? "" : "; ") + std::string(description(static_cast<Piece>(bit)));
  }
  return out;
}

std::string one_shows(const Nature& nature) {
  return std::string(nature.id) + " " + nature.shows + ".";
}

}  // namespace

std::vector<std::string_view> contract_ids() {
  std::vector<std::string_view> out;
  for (const Nature& nature : kNatures) out.push_back(nature.id);
  return out;
}

std::optional<SuggestedTest> suggested_test(const std::vector<Doubt>& doubts,
                                            const SeenMotion& seen, const TestSizes& sizes) {
  if (doubts.empty()) return {};
  constexpr unsigned kSurvey = kStandstill | kReversals | kSpeeds | kStrokes | kAccelerations;
  unsigned pieces = 0;
  std::string words;
  std::set<std::string> said;
  const auto add = [&](const std::string& sentence) {
    if (said.insert(sentence).second) words += (words.empty() ? "" : " ") + sentence;
  };
  for (const Doubt& doubt : doubts) {
    if (doubt.cause.empty()) {
      pieces |= kSurvey;
      add("In it everything that an error can depend on changes by itself.");
      continue;
    }
    const Nature& one = nature_of(doubt.cause);
    if (doubt.rival.empty()) {
      pieces |= one.pieces;
      add(one_shows(one));
    } else {
      const Nature& other = nature_of(doubt.rival);
      const Special* special = special_of(doubt);
      if (special != nullptr && special->pieces == 0) {
        add(doubt.cause + " and " + doubt.rival +
            " cannot be told apart with these sensors: " + special->words + ".");
        continue;
      }
      pieces |= special != nullptr ? special->pieces : one.pieces | other.pieces;
      add(one_shows(one));
      add(one_shows(other));
      if (special != nullptr)
        add("Between " + doubt.cause + " and " + doubt.rival + ": " + special->words + ".");
      if (*other.besides != '\0') add("For " + doubt.rival + ": " + other.besides + ".");
    }
    if (*one.besides != '\0') add("For " + doubt.cause + ": " + one.besides + ".");
  }
  if (pieces == 0) return SuggestedTest{words, {}};
  if (!(seen.high > seen.low) || !(seen.velocity > 0.0) || !(seen.acceleration > 0.0))
    return SuggestedTest{words + " The recording holds no motion within which a test could stay.",
                         {}};
  constexpr double kLeastPeriods = 3.0;
  if ((pieces & kTwoSpeeds) != 0 && seen.high - seen.low < kLeastPeriods * sizes.period)
    add(text("The way of this recording is %.1f periods long: a longer one decides better.",
             (seen.high - seen.low) / sizes.period));
  SuggestedTest out;
  out.motion = Builder(seen, sizes).of(pieces);
  out.words = "Run " + described(pieces) +
              text(
                  " (%.0f s, within the recorded way, speed and acceleration), record it and "
                  "diagnose it. ",
                  out.motion->duration_s()) +
              words;
  return out;
}

std::optional<SuggestedTest> suggested_test(const Diagnosis& diagnosis, const SegmentedAxis& axis) {
  constexpr double kUnsure = 0.9;  // confidence below which a cause is in doubt
  std::vector<Doubt> doubts;
  TestSizes sizes;
  sizes.encoder_step = noise_floor(axis.segments).encoder_step;
  for (const Cause& cause : diagnosis.causes) {
    for (const std::string& rival : cause.ambiguous_with) doubts.push_back({cause.id, rival});
    if (cause.ambiguous_with.empty() && cause.confidence < kUnsure)
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
  // Not what a model that lacks a cause leaves uncertain, but what the motion does not contain.
  const std::vector<std::string> missing =
      missing_motion(excitation_of(axis.segments), axis.rotary);
  if (diagnosis.verdict == Verdict::kUnexplained || !missing.empty()) doubts.push_back({});
  auto test = suggested_test(doubts, seen_motion(axis.segments), sizes);
  for (const std::string& one : missing) test->words += " In the recording, " + one + ".";
  return test;
}

}  // namespace servotwin
