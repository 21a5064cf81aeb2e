// The C of a unit against the C++ that it was translated from (docs/decisions/0009): every effect
// of the catalogue along the same random motions, and whole axes along the same random commands.
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <string>

#include "cli/export/unit.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"
#include "twin/twin.h"

extern "C" {
#include "cli/export/sources/axis.h"
#include "cli/export/sources/model_text.h"
}

namespace servotwin {
namespace {

constexpr double kSame = 1e-12;

/// Effects that are not exported. A new effect must be translated, or listed here with the reason.
const std::set<std::string_view> kDeclined{};

const ::EffectKind* translated(std::size_t kind) {
  const int place = servotwin_find_effect(std::string(identity_of(kind).id).c_str());
  int count = 0;
  return place < 0 ? nullptr : &servotwin_effects(&count)[place];
}

::Acts acts_of(std::size_t kind) {
  if (is_friction_law(kind)) return kActsAsFriction;
  const Acts acts = identity_of(kind).acts;
  if (acts == Acts::kForce) return kActsAsForce;
  return acts == Acts::kReading ? kActsOnReading : kDelaysCommand;
}

::ActsOn body_of(std::size_t kind) {
  if (identity_of(kind).acts != Acts::kForce) return kOnLoad;  // not used
  switch (acts_on(kind)) {
    case ActsOn::kMotor:
      return kOnMotor;
    case ActsOn::kLoad:
      return kOnLoad;
    case ActsOn::kBoth:
      break;
  }
  return kOnBoth;
}

/// All but two masses, which are the axis itself: TwoMasses below.
std::vector<std::size_t> all_kinds() {
  std::vector<std::size_t> kinds;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (!acts_on_axis(kind)) kinds.push_back(kind);
  }
  return kinds;
}

std::vector<std::size_t> translated_kinds() {
  std::vector<std::size_t> kinds = all_kinds();
  std::erase_if(kinds, [](std::size_t kind) { return kDeclined.contains(identity_of(kind).id); });
  return kinds;
}

std::string name_of_kind(const testing::TestParamInfo<std::size_t>& one) {
  return std::string(identity_of(one.param).id);
}

class EveryEffect : public testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(OfTheCatalogue, EveryEffect, testing::ValuesIn(all_kinds()), name_of_kind);
class EveryTranslatedEffect : public testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(OfTheCatalogue, EveryTranslatedEffect,
                         testing::ValuesIn(translated_kinds()), name_of_kind);

TEST_P(EveryEffect, IsTranslatedOrDeclined) {
  const std::size_t kind = GetParam();
  const auto id = identity_of(kind).id;
  const ::EffectKind* c = translated(kind);
  ASSERT_NE(c != nullptr, kDeclined.contains(id))
      << id << ": translate it in cli/export/sources, or add it to kDeclined here";
  if (c == nullptr) {
    test::expect_error<std::runtime_error>([&] { require_translated(id); }, {"cannot be exported"});
    return;
  }
  require_translated(id);
  EXPECT_EQ(c->acts, acts_of(kind));
  EXPECT_EQ(c->body, body_of(kind));
  EXPECT_EQ(static_cast<std::size_t>(c->shapes), shapes_of(kind).size());
  EXPECT_EQ(static_cast<std::size_t>(c->coefficients), coefficients_of(kind).size());
  EXPECT_LE(c->memory, sizeof(::EffectMemory));
}

TEST(TranslatedEffects, AreOfTheCatalogue) {
  int count = 0;
  const ::EffectKind* effects = servotwin_effects(&count);
  for (int i = 0; i < count; ++i)
    EXPECT_LT(kind_of(std::string_view(effects[i].id)), kEffectKinds) << effects[i].id;
}

TEST(TranslatedEffects, OneThatIsNotIsNamed) {
  test::expect_error<std::runtime_error>([] { require_translated("squeak"); },
                                         {"'squeak'", "no C translation"});
}

/// A value within the bounds and near the start value, to which the motion below is scaled.
double random_shape(const Parameter& p, std::mt19937_64& random) {
  std::uniform_real_distribution<double> factor(0.7, 1.4), off(-0.2, 0.2);
  const double start = p.start == 0.0 ? off(random) * std::min(p.upper, 1.0) : p.start;
  return std::clamp(start * factor(random), p.lower, p.upper);
}

/// There and back with rests and creeping, 3 s at 1 kHz; random, and the same for the same seed.
class RandomMotion {
 public:
  explicit RandomMotion(std::uint64_t seed) : random_(seed) {
    std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
    for (double& one : phase_) one = phase(random_);
  }
  [[nodiscard]] double at(double t) const {
    // A rest at every second zero of the slow swell.
    const double swell = std::max(0.0, std::sin(2.0 * std::numbers::pi * 0.8 * t + 0.3));
    return swell * swell * swell *
           (0.02 * std::sin(2.0 * std::numbers::pi * 1.7 * t + phase_[0]) +
            0.001 * std::sin(2.0 * std::numbers::pi * 7.0 * t + phase_[1]) +
            2e-5 * std::sin(2.0 * std::numbers::pi * 31.0 * t + phase_[2]));
  }

 private:
  std::mt19937_64 random_;
  std::array<double, 3> phase_{};
};

TEST_P(EveryTranslatedEffect, HasTheSameUnitForcesAlongTheSameMotion) {
  const std::size_t kind = GetParam();
  const ::EffectKind* c = translated(kind);
  ASSERT_NE(c, nullptr);
  double largest = 0.0;
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    std::mt19937_64 random(seed);
    std::array<double, kMaxShapes> shape{};
    std::size_t k = 0;
    for (const Parameter& p : shapes_of(kind)) shape[k++] = random_shape(p, random);
    EffectMemory<double> memory;
    start_memory<double>(kind, shape.data(), memory);
    ::EffectMemory c_memory{};
    if (c->start != nullptr) c->start(shape.data(), &c_memory);

    const RandomMotion path(seed);
    std::normal_distribution<double> normal;
    const double h = 1e-3;
    double before = path.at(0.0);
    for (int i = 1; i < 4500; ++i) {
      Motion m;
      m.step_s = h;
      m.time_s = i * h;
      m.position = path.at(m.time_s);
      m.displacement = m.position - before;
      m.velocity = m.displacement / h;
      m.acceleration = normal(random);
      m.command_velocity = m.velocity * (1.0 + 0.01 * normal(random));
      m.command_acceleration = normal(random);
      m.tracking_error = 1e-4 * normal(random);
      m.neighbour_acceleration = m.neighbour_motion_acceleration = normal(random);
      m.in_cut = i % 1000 < 500 ? 1.0 : 0.0;
      m.demand = 3.0 * normal(random);
      m.demand_rate = 10.0 * normal(random);
      m.demand_damping = 0.1 * normal(random);
      if (i % 700 < 350) m.friction = std::sin(0.01 * i);
      before = m.position;
      const ::Motion c_m{m.step_s,
                         m.position,
                         m.velocity,
                         m.displacement,
                         m.acceleration,
                         m.command_velocity,
                         m.command_acceleration,
                         m.tracking_error,
                         m.time_s,
                         m.neighbour_acceleration,
                         m.in_cut,
                         m.demand,
                         m.friction,
                         m.demand_rate,
                         m.demand_damping};
      std::array<double, kMaxCoefficients> force{}, c_force{};
      unit_forces<double>(kind, shape.data(), memory, m, force.data());
      c->unit_forces(shape.data(), &c_memory, &c_m, c_force.data());
      for (std::size_t j = 0; j < coefficients_of(kind).size(); ++j) {
        ASSERT_NEAR(c_force[j], force[j], kSame * (1.0 + std::abs(force[j])))
            << coefficients_of(kind)[j].name << " at sample " << i << ", seed " << seed;
        largest = std::max(largest, std::abs(force[j]));
      }
      if (is_friction_law(kind)) {
        Effect effect;
        effect.kind = kind;
        for (std::size_t j = 0; j < kMaxCoefficients; ++j)
          effect.coefficient[j] = 0.1 * static_cast<double>(j + 1);
        const double c_friction = c->friction != nullptr
                                      ? c->friction(effect.coefficient.data(), c_force.data())
                                      : c_force[0];
        ASSERT_NEAR(c_friction, friction_of(effect, force.data()), kSame);
      }
    }
  }
  if (coefficients_of(kind).empty()) return;
  EXPECT_GT(largest, 1e-6) << "the motion does not show it";
}

/// An axis in C, by the text that a unit has of it.
class CAxis {
 public:
  explicit CAxis(const Model& model) {
    const test::TemporaryDirectory folder;
    const std::filesystem::path file = folder.path() / "model.txt";
    std::ofstream(file) << model_text(model, "{guid}");
    std::string why(kMessage, '\0');
    if (servotwin_read_model(file.c_str(), &unit_, why.data()) == 0) throw std::runtime_error(why);
  }
  void start(double command, double time_s) {
    servotwin_start(&unit_.model, &state_, command, time_s);
  }
  double follow(double command) {
    return servotwin_follow(&unit_.model, &state_, command, 0.0, 0.0);
  }
  double step(const CommandPiece& p) {
    const ::CommandPiece piece{
        p.velocity,         p.acceleration,           p.jerk,  p.end_position, p.end_velocity,
        p.end_acceleration, p.neighbour_acceleration, p.in_cut};
    return servotwin_step(&unit_.model, &state_, &piece);
  }
  [[nodiscard]] double position() const { return state_.position + state_.reading; }
  [[nodiscard]] double velocity() const { return state_.velocity; }

 private:
  ::UnitModel unit_{};
  ::AxisState state_{};
};

/// A coefficient that affects the error visibly and leaves the axis stable.
double telling(const Parameter& p, std::size_t place) {
  const double more = 1.0 + 0.3 * static_cast<double>(place);
  double value = 0.1;  // m/s^2 and 1
  if (p.unit == "m") value = 2e-5;
  if (p.unit == "1/s") value = 0.5;
  if (p.unit == "1/s^2") value = 5.0;
  if (p.unit == "1/s^3") value = 50.0;
  if (p.unit == "1/(m s^2)") value = 20.0;
  return std::clamp(value * more, p.lower, p.upper);
}

Model axis_with(std::size_t kind, int order, double sample_time_s) {
  Model model;
  model.sample_time_s = sample_time_s;
  model.loop.order = order;
  model.loop.denominator = denominator_of({62.0, 2.0 * std::numbers::pi * 30.0, 0.45}, order);
  model.loop.numerator =
      order == 3 ? std::array{1.0, 230.0, 29000.0} : std::array{0.98, 120.0, 0.0};
  if (sample_time_s > 2e-3)
    model.loop.modes = {{280.0, 0.04, -0.05, 20.0, 2e-4, 0.6}, {150.0, 0.1, 0.02, -5.0, 0.0, 0.1}};
  Effect effect;
  effect.kind = kind;
  std::size_t k = 0;
  for (const Parameter& p : shapes_of(kind)) effect.shape[k++] = p.start;
  if (identity_of(kind).acts == Acts::kCommandDelay) effect.shape[0] = 3.7e-3;
  k = 0;
  for (const Parameter& p : coefficients_of(kind)) {
    effect.coefficient[k] = telling(p, k);
    ++k;
  }
  model.effects = {effect};
  if (!is_friction_law(kind)) {
    Effect friction = make_effect<Presliding>();
    friction.coefficient[0] = 0.3;
    model.effects.push_back(friction);  // behind it, and still simulated before it
  }
  return model;
}

TEST_P(EveryTranslatedEffect, MovesTheWholeAxisAsInCpp) {
  ASSERT_NE(translated(GetParam()), nullptr);
  for (const int order : {2, 3}) {
    for (const double h : {1e-3, 2.5e-3}) {
      const Model model = axis_with(GetParam(), order, h);
      Model without = model;
      without.effects.erase(without.effects.begin());
      Twin twin(model), plain(without);
      CAxis c(model);
      const RandomMotion path(7);
      const double begin_s = 0.5;
      twin.start(path.at(0.0), begin_s);
      plain.start(path.at(0.0), begin_s);
      c.start(path.at(0.0), begin_s);
      ASSERT_NEAR(c.position(), twin.position(), kSame);
      double difference = 0.0;
      for (int i = 1; i * h < 4.5; ++i) {
        const double command = path.at(i * h);
        const double error = twin.follow(command);
        ASSERT_NEAR(c.follow(command), error, kSame) << "order " << order << ", cycle " << i;
        ASSERT_NEAR(c.position(), twin.position(), kSame);
        ASSERT_NEAR(c.velocity(), twin.velocity(), kSame);
        difference = std::max(difference, std::abs(error - plain.follow(command)));
      }
      // What needs more than a command is below; an integrator has no error by a constant force.
      const std::size_t kind = GetParam();
      if (couples(kind) || kind == kind_of<CuttingForce>()) continue;
      if (kind == kind_of<ConstantForce>() && order == 3) continue;
      EXPECT_GT(difference, 1e-9) << "the effect does not show";
    }
  }
}

TEST(TranslatedAxis, KnowsItsNeighbourAndTheCut) {
  for (const std::size_t kind :
       {kind_of<CrossCoupling>(), kind_of<CrossCouplingByMotion>(), kind_of<CuttingForce>()}) {
    const Model model = axis_with(kind, 3, 2.5e-3);
    Twin twin(model);
    CAxis c(model);
    twin.start(0.1, 0.0);
    c.start(0.1, 0.0);
    double largest = 0.0;
    for (int i = 1; i < 2000; ++i) {
      CommandPiece piece;
      piece.end_position = 0.1;
      piece.neighbour_acceleration = piece.neighbour_motion_acceleration = std::sin(0.05 * i);
      piece.in_cut = i > 500 ? 1.0 : 0.0;
      const double error = twin.step(piece);
      ASSERT_NEAR(c.step(piece), error, kSame) << i;
      largest = std::max(largest, std::abs(error));
    }
    EXPECT_GT(largest, 1e-7);
  }
}

TEST(TranslatedAxis, StepsAlongAKnownMotionInParts) {
  const Model model = axis_with(kind_of<Stribeck>(), 3, 4e-3);
  Twin twin(model);
  CAxis c(model);
  twin.start(0.0);
  c.start(0.0, 0.0);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  CommandPiece piece;
  for (int i = 1; i < 2000; ++i) {
    const double h = model.sample_time_s;
    piece.velocity = piece.end_velocity;
    piece.acceleration = piece.end_acceleration;
    // Back to the middle, with noise.
    piece.jerk = 50.0 * normal(random) - 30.0 * piece.acceleration - 300.0 * piece.velocity -
                 1000.0 * piece.end_position;
    piece.end_position += h * (piece.velocity + h * (piece.acceleration / 2 + h * piece.jerk / 6));
    piece.end_velocity = piece.velocity + h * (piece.acceleration + h * piece.jerk / 2);
    piece.end_acceleration = piece.acceleration + h * piece.jerk;
    ASSERT_NEAR(c.step(piece), twin.step(piece), kSame) << i;
  }
}

TEST(TranslatedAxis, ReachesBackAsFarAsADelayMay) {
  Model model = axis_with(kind_of<TimeDelay>(), 2, 1e-4);
  for (const double delay_s : {0.05, 0.04996, 1e-4, 3e-5, 2.5e-4}) {
    model.effects[0].shape[0] = delay_s;
    Twin twin(model);
    CAxis c(model);
    const RandomMotion path(3);
    twin.start(path.at(0.0));
    c.start(path.at(0.0), 0.0);
    for (int i = 1; i < 3000; ++i) {
      const double command = path.at(3e-4 * i);
      ASSERT_NEAR(c.follow(command), twin.follow(command), kSame) << delay_s << " s, cycle " << i;
    }
  }
}

/// With friction or bare, and with one mode or two that move over the path of RandomMotion, beside
/// one that stands.
Model moving_axis(int order, double sample_time_s, int moving, bool friction) {
  // Beside presliding what goes by the acceleration, so that all three readings of the modes count.
  Model model = axis_with(kind_of<InertiaChange>(), order, sample_time_s);
  if (!friction) model.effects.clear();
  // One of the two crosses the frequency of the loop itself, below which its delta cannot move.
  model.loop.modes = {{280.0, 0.04, -0.05, 20.0, 2e-4, 0.6, 0.3, -0.12, 0.4}};
  if (moving > 1) model.loop.modes.push_back({190.0, 0.1, 0.02, -5.0, -1e-4, 0.1, -0.2, 0.1, -0.3});
  model.loop.modes.push_back({420.0, 0.08, 0.01, -3.0, 0.0, 0.05});
  model.loop.travel = {-0.012, 0.009};  // the path goes beyond both ends
  return model;
}

class MovingModes : public testing::TestWithParam<std::tuple<int, double, int, bool>> {
 protected:
  [[nodiscard]] static Model model() {
    const auto [order, sample_time_s, moving, friction] = GetParam();
    return moving_axis(order, sample_time_s, moving, friction);
  }
};
INSTANTIATE_TEST_SUITE_P(Axes, MovingModes,
                         testing::Combine(testing::Values(2, 3), testing::Values(1e-3, 2.5e-3),
                                          testing::Values(1, 2), testing::Bool()));

TEST_P(MovingModes, MoveTheWholeAxisAsInCpp) {
  const Model axis = model();
  Model standing = axis;
  for (Mode& mode : standing.loop.modes) mode.slope = mode.curve = mode.zeta_slope = 0.0;
  for (const std::uint64_t seed : {7U, 8U, 9U}) {
    const RandomMotion path(seed);
    Twin twin(axis), still(standing);
    CAxis c(axis);
    twin.start(path.at(0.0));
    still.start(path.at(0.0));
    c.start(path.at(0.0), 0.0);
    double difference = 0.0, least = 0.0, most = 0.0;
    for (int i = 1; i * axis.sample_time_s < 4.5; ++i) {
      const double command = path.at(i * axis.sample_time_s);
      const double error = twin.follow(command);
      ASSERT_NEAR(c.follow(command), error, kSame) << "seed " << seed << ", cycle " << i;
      ASSERT_NEAR(c.position(), twin.position(), kSame);
      ASSERT_NEAR(c.velocity(), twin.velocity(), kSame);
      difference = std::max(difference, std::abs(error - still.follow(command)));
      least = std::min(least, command);
      most = std::max(most, command);
    }
    EXPECT_GT(difference, 1e-6) << "that they move does not show";
    EXPECT_LT(least, axis.loop.travel.from);
    EXPECT_GT(most, axis.loop.travel.to);
  }
}

// A command at rest determines the modes before any motion; a force that acts then shows them.
TEST_P(MovingModes, StartAnywhere) {
  Model axis = model();
  Effect force = make_effect<ConstantForce>();
  force.coefficient[0] = 0.4;
  axis.effects.push_back(force);
  for (const double place : {-1.0, -0.011, 0.0, 0.004, 0.009, 3.0}) {
    Twin twin(axis);
    CAxis c(axis);
    twin.start(place);
    c.start(place, 0.0);
    ASSERT_NEAR(c.position(), twin.position(), kSame);
    for (int i = 1; i < 200; ++i) {
      const double command = place + 1e-3 * std::sin(0.05 * i) * std::sin(0.05 * i);
      ASSERT_NEAR(c.follow(command), twin.follow(command), kSame) << place << ", cycle " << i;
    }
  }
}

// The delayed command is used, except along a known motion, where the given one is used.
TEST_P(MovingModes, GoByTheCommandThatTheLoopHas) {
  Model axis = model();
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 3.7e-3;
  axis.effects.push_back(delay);
  Twin twin(axis), known(model());
  CAxis c(axis), c_known(model());
  const RandomMotion path(11);
  const double h = axis.sample_time_s;
  for (Twin* one : {&twin, &known}) one->start(path.at(0.0));
  for (CAxis* one : {&c, &c_known}) one->start(path.at(0.0), 0.0);
  for (int i = 1; i * h < 2.5; ++i) {
    ASSERT_NEAR(c.follow(path.at(i * h)), twin.follow(path.at(i * h)), kSame) << i;
    // Any cubic will do.
    CommandPiece piece;
    piece.velocity = (path.at(i * h) - path.at((i - 1) * h)) / h;
    piece.jerk = 20.0 * std::sin(0.1 * i);
    piece.end_position = path.at(i * h);
    piece.end_velocity = piece.velocity + h * h * piece.jerk / 2;
    piece.end_acceleration = h * piece.jerk;
    ASSERT_NEAR(c_known.step(piece), known.step(piece), kSame) << i;
  }
}

/// Two masses whose encoder, play and friction are those of this kind, beside one more effect.
Model two_masses(std::size_t axis, int order, double friction_share, std::size_t more) {
  Model model = axis_with(more, order, 1.5e-3);
  if (!is_friction_law(more)) model.effects[1].coefficient[0] = 0.3;
  Effect effect;
  effect.kind = axis;
  std::size_t k = 0;
  for (const Parameter& p : shapes_of(axis)) effect.shape[k++] = p.start;
  effect.shape[3] = friction_share;
  model.effects.insert(model.effects.begin(), effect);
  return model;
}

std::vector<std::size_t> two_mass_kinds() {
  std::vector<std::size_t> kinds;
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (acts_on_axis(kind)) kinds.push_back(kind);
  }
  return kinds;
}

class TwoMasses : public testing::TestWithParam<std::tuple<std::size_t, int, double>> {};
INSTANTIATE_TEST_SUITE_P(Axes, TwoMasses,
                         testing::Combine(testing::ValuesIn(two_mass_kinds()),
                                          testing::Values(2, 3), testing::Values(0.0, 0.6, 1.0)));

TEST_P(TwoMasses, MoveAsInCpp) {
  const auto [axis, order, friction_share] = GetParam();
  for (const std::size_t more : {kind_of<Gms>(), kind_of<Cogging>(), kind_of<ConstantForce>(),
                                 kind_of<Backlash>(), kind_of<TimeDelay>()}) {
    const Model model = two_masses(axis, order, friction_share, more);
    ASSERT_EQ(why_invalid(model), "");
    Model rigid = model;
    rigid.effects.erase(rigid.effects.begin());
    Twin twin(model), one(rigid);
    CAxis c(model);
    const RandomMotion path(7);
    twin.start(path.at(0.0), 0.5);
    one.start(path.at(0.0), 0.5);
    c.start(path.at(0.0), 0.5);
    ASSERT_NEAR(c.position(), twin.position(), kSame);
    double difference = 0.0;
    for (int i = 1; i * 1.5e-3 < 3.0; ++i) {
      const double command = path.at(i * 1.5e-3);
      const double error = twin.follow(command);
      ASSERT_NEAR(c.follow(command), error, kSame) << identity_of(more).id << ", cycle " << i;
      ASSERT_NEAR(c.position(), twin.position(), kSame);
      ASSERT_NEAR(c.velocity(), twin.velocity(), kSame * 1e3);
      difference = std::max(difference, std::abs(error - one.follow(command)));
    }
    EXPECT_GT(difference, 1e-6) << "that there are two does not show";
  }
}

// A copy of the state is all that a host needs to go back (fmi2SetFMUstate).
TEST(TwoMassState, IsTheWholeState) {
  CAxis c(two_masses(kind_of<PlayLoadEncoder>(), 3, 0.6, kind_of<Gms>()));
  const RandomMotion path(7);
  c.start(path.at(0.0), 0.0);
  for (int i = 1; i < 400; ++i) (void)c.follow(path.at(i * 1.5e-3));
  CAxis back = c;
  for (int i = 400; i < 800; ++i)
    ASSERT_EQ(c.follow(path.at(i * 1.5e-3)), back.follow(path.at(i * 1.5e-3))) << i;
}

/// Whether the numbers of a unit of this model can be read when they are changed so.
std::string why_not_read(const Model& model, const std::function<void(std::string&)>& change) {
  std::string text = model_text(model, "{guid}");
  change(text);
  const test::TemporaryDirectory folder;
  const std::filesystem::path file = folder.path() / "model.txt";
  std::ofstream(file, std::ios::binary) << text;
  ::UnitModel unit;
  std::string why(kMessage, '\0');
  const bool read = servotwin_read_model(file.c_str(), &unit, why.data()) != 0;
  why.resize(std::string_view(why.c_str()).size());
  EXPECT_EQ(read, why.empty());
  return why;
}

std::string why_not_read(const std::function<void(std::string&)>& change) {
  return why_not_read(axis_with(kind_of<Presliding>(), 3, 1e-3), change);
}

TEST(ModelText, HasTheLawOfModesOnlyWhereTheyMove) {
  using testing::AllOf;
  using testing::HasSubstr;
  using testing::Not;
  Model model = moving_axis(3, 1e-3, 2, true);
  EXPECT_THAT(model_text(model, "{guid}"), HasSubstr("\nmoving_modes 3 "));
  for (Mode& mode : model.loop.modes) mode.slope = mode.curve = mode.zeta_slope = 0.0;
  EXPECT_THAT(model_text(model, "{guid}"),
              AllOf(Not(HasSubstr("moving")), Not(HasSubstr("mode "))));
  model.loop.modes[1].zeta_slope = 0.1;
  EXPECT_THAT(model_text(model, "{guid}"), HasSubstr("\nmoving_modes 3 "));
}

TEST(ModelText, OfModesThatMoveIsRefusedWhereItIsDamaged) {
  using testing::HasSubstr;
  const Model model = moving_axis(3, 1e-3, 1, true);
  const auto replaced = [&](const std::string& what, const std::string& with) {
    return why_not_read(model, [&](std::string& text) {
      ASSERT_NE(text.find(what), std::string::npos);
      text.replace(text.find(what), what.size(), with);
    });
  };
  EXPECT_EQ(replaced("moving_modes", "moving_modes"), "");
  EXPECT_THAT(replaced("moving_modes 2", "moving_modes 1"), HasSubstr("line 21"));
  EXPECT_THAT(replaced("moving_modes 2", "moving_modes 3"), HasSubstr("line 21"));
  EXPECT_THAT(replaced("moving_modes 2", "moving_modes 2 nan"), HasSubstr("line 21"));
  EXPECT_THAT(replaced("mode 0x", "node 0x"), HasSubstr("line 22"));
  EXPECT_THAT(replaced("\nmode 0x", "\nmode 0x1p0 0x"), HasSubstr("line 22"));
  EXPECT_THAT(replaced("effect inertia_change", "mode 0x0p0"), HasSubstr("line 24"));
  EXPECT_THAT(replaced("end\n", "moving_modes 2\n"), HasSubstr("line 32"));
  // One of them left out.
  EXPECT_THAT(why_not_read(model,
                           [](std::string& text) {
                             const std::size_t at = text.find("\nmode ");
                             text.erase(at, text.find('\n', at + 1) - at);
                           }),
              HasSubstr("line 23"));
}

TEST(ModelText, OfTwoMassesIsRefusedWhereItIsDamaged) {
  using testing::HasSubstr;
  const Model model = two_masses(kind_of<TwoMassMotorEncoder>(), 2, 0.6, kind_of<Presliding>());
  const auto replaced = [&](const std::string& what, const std::string& with) {
    return why_not_read(model, [&](std::string& text) {
      ASSERT_NE(text.find(what), std::string::npos);
      text.replace(text.find(what), what.size(), with);
    });
  };
  EXPECT_EQ(replaced("two_masses 0", "two_masses 2"), "");
  EXPECT_THAT(replaced("two_masses 0", "two_masses 3"), HasSubstr("line 15"));
  EXPECT_THAT(replaced("two_masses 0", "two_masses 0 nan"), HasSubstr("line 15"));
  EXPECT_THAT(replaced("\nmass_state ", "\nmass "), HasSubstr("line 16"));
  EXPECT_THAT(replaced("\nmass_state ", "\nmass_state 0x1p0 "), HasSubstr("line 16"));
  EXPECT_THAT(replaced("effect presliding", "mass_state 0x0p0"), HasSubstr("line 20"));
}

TEST(ModelText, HasNoDecimalPointThatALocaleCouldChange) {
  for (const std::size_t kind : all_kinds()) {
    std::string text = model_text(axis_with(kind, 3, 1e-3), "{guid}");
    text.erase(0, text.find("servotwin_unit"));
    EXPECT_EQ(text.find_first_of(".,"), std::string::npos) << identity_of(kind).id;
  }
  std::string text = model_text(moving_axis(2, 1e-3, 2, false), "{guid}");
  text.erase(0, text.find("servotwin_unit"));
  EXPECT_EQ(text.find_first_of(".,"), std::string::npos);
}

TEST(ModelText, IsRefusedWhereItIsDamaged) {
  using testing::HasSubstr;
  EXPECT_EQ(why_not_read([](std::string&) {}), "");
  EXPECT_THAT(why_not_read([](std::string& text) { text.resize(text.size() - 4); }),
              HasSubstr("is incomplete"));
  EXPECT_THAT(why_not_read([](std::string& text) { text.clear(); }), HasSubstr("is incomplete"));
  const auto replaced = [](const std::string& what, const std::string& with) {
    return why_not_read([&](std::string& text) {
      ASSERT_NE(text.find(what), std::string::npos);
      text.replace(text.find(what), what.size(), with);
    });
  };
  EXPECT_THAT(replaced("servotwin_unit 1", "servotwin_unit 2"), HasSubstr("line 2"));
  EXPECT_THAT(replaced("order 3", "order 4"), HasSubstr("line 6"));
  EXPECT_THAT(replaced("parts 1", "parts 0"), HasSubstr("line 5"));
  EXPECT_THAT(replaced("by_force", "by_forces"), HasSubstr("line 9"));
  EXPECT_THAT(replaced("effect presliding", "effect squeak"), HasSubstr("line 17"));
  EXPECT_THAT(replaced("shape shape_factor", "effect presliding\nshape shape_factor"),
              HasSubstr("line 19"));
  EXPECT_THAT(replaced("states 6", "states 5"), HasSubstr("line 10"));
  EXPECT_THAT(replaced("states 6", "states 8"), HasSubstr("line 17"));
  EXPECT_THAT(replaced("state 3 3", "state 4 3"), HasSubstr("line 14"));
  EXPECT_THAT(replaced("end\n", "end 1\n"), HasSubstr("line 22"));
  for (const char* no_number : {" nan", " inf", " 0x1p", " 1,5"}) {
    EXPECT_THAT(why_not_read([&](std::string& text) {
                  const std::size_t at = text.find("\nby_force") + 9;
                  text.replace(at, text.find(' ', at + 1) - at, no_number);
                }),
                HasSubstr("line 9"))
        << no_number;
  }
}

}  // namespace
}  // namespace servotwin
