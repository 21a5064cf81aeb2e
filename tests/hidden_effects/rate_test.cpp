// A fixed set of recordings of the development part, diagnosed as a user would: how many of the
// hidden effects are named first. Chosen are, of the indices 200 to 206, those that are diagnosed
// in the shortest time, whatever the answer. The rate on machines that were never seen before is
// measured by the program hidden_effects (docs/measurements.md 11).
#include <gmock/gmock.h>

#include <atomic>
#include <functional>
#include <map>
#include <thread>

#include "tests/hidden_effects/answer.h"
#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {
namespace {

/// Of every effect.
const std::map<std::string, int> kSingles{{"added_friction", 201},
                                          {"asymmetric_friction", 201},
                                          {"backlash", 202},
                                          {"cogging", 201},
                                          {"compliance", 205},
                                          {"cross_coupling", 200},
                                          {"cutting_force", 200},
                                          {"dropped_samples", 201},
                                          {"dwell_stiction", 200},
                                          {"encoder_error", 200},
                                          {"gain_change", 201},
                                          {"gravity_offset", 201},
                                          {"impulse_disturbance", 201},
                                          {"inertia_change", 200},
                                          {"lead_error", 200},
                                          {"periodic_disturbance", 200},
                                          {"presliding", 201},
                                          {"position_dependent_friction", 203},
                                          {"stribeck", 203},
                                          {"thermal_growth", 201},
                                          {"time_delay", 200},
                                          {"torque_saturation", 201},
                                          {"viscous_drift", 200}};
constexpr int kFirstClean = 200, kCleans = 9, kFirstPair = 200, kPairs = 5;

struct Asked {
  std::function<Case()> make;
  Case made;
  Answer answer;
};

/// The causes that are named, without the machine's own friction where that is not what is hidden.
std::vector<std::string> named(const Asked& one) {
  std::vector<std::string> out;
  for (const NamedCause& cause : one.answer.causes) {
    if (!one.made.owns(cause.id) || one.made.hides(cause.id)) out.push_back(cause.id);
  }
  return out;
}

void ask_all(std::vector<Asked>& all) {
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i; (i = next++) < all.size();) {
      all[i].made = all[i].make();
      all[i].answer = ask(all[i].made.csv, {});
      all[i].made.csv.clear();
    }
  };
  std::vector<std::jthread> others;
  for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) others.emplace_back(work);
  work();
}

TEST(TheFixedSet, OfHiddenEffectsIsNamedAtTheRateThatWasReached) {
  std::vector<Asked> singles, cleans, pairs;
  for (const std::string& id : effect_ids()) {
    ASSERT_TRUE(kSingles.contains(id)) << id << " is hidden nowhere";
    const int index = kSingles.at(id);
    for (const Torque torque : {Torque::kNone, Torque::kAll})
      singles.push_back(
          {[=] { return single_case(Part::kDev, id, Class::kClear, index, torque); }, {}, {}});
  }
  for (int i = 0; i < kCleans; ++i)
    cleans.push_back(
        {[=] { return clean_case(Part::kDev, kFirstClean + i, Torque::kHalf); }, {}, {}});
  for (int i = 0; i < kPairs; ++i)
    pairs.push_back({[=] { return pair_case(Part::kDev, kFirstPair + i, Torque::kHalf); }, {}, {}});
  ASSERT_GE(singles.size() + cleans.size() + pairs.size(), 60U);

  std::size_t first = 0, alone = 0;
  ask_all(singles);
  for (const Asked& one : singles) {
    const std::vector<std::string> causes = named(one);
    const bool right = !causes.empty() && one.made.hides(causes.front());
    first += right;
    alone += right && causes.size() == 1;
    if (!right)
      std::cout << one.made.name << (one.made.torque ? " with torque" : "") << ": "
                << one.answer.verdict << one.answer.failure << ' ' << testing::PrintToString(causes)
                << '\n';
  }
  // When the set was chosen: 44 and 41 of 46, and five of five pairs.
  EXPECT_GE(static_cast<double>(first), 0.85 * static_cast<double>(singles.size()));
  EXPECT_GE(static_cast<double>(alone), 0.85 * static_cast<double>(singles.size()));
  std::cout << first << " of " << singles.size() << " named first, " << alone << " of them alone\n";

  ask_all(cleans);
  for (const Asked& one : cleans) {
    EXPECT_EQ(one.answer.failure, "") << one.made.name;
    EXPECT_THAT(named(one), testing::IsEmpty()) << one.made.name << ' ' << one.made.machine;
  }

  ask_all(pairs);
  std::size_t both = 0;
  for (const Asked& one : pairs) {
    const std::vector<std::string> causes = named(one);
    const bool right =
        std::all_of(one.made.hidden.begin(), one.made.hidden.end(), [&](const Truth& truth) {
          return std::find(causes.begin(), causes.end(), truth.id) != causes.end();
        });
    both += right;
    if (!right)
      std::cout << one.made.name << ": " << one.answer.verdict << ' '
                << testing::PrintToString(causes) << '\n';
  }
  EXPECT_GE(static_cast<double>(both), 0.8 * static_cast<double>(pairs.size()));
  std::cout << both << " of " << pairs.size() << " pairs\n";
}

}  // namespace
}  // namespace servotwin::hidden_effects
