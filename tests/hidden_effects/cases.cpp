#include "tests/hidden_effects/cases.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <optional>
#include <stdexcept>

#include "tests/hidden_effects/absorbed.h"
#include "tests/hidden_effects/machine.h"

namespace servotwin::hidden_effects {
namespace {

constexpr int kMaxMachines = 300;            // draws until a machine reaches the class
constexpr double kContactFrequency = 400.0;  // of the stiff contact at a gap [Hz]

/// The size with a contribution of about `target`; nothing where no plausible size reaches it.
std::optional<double> size_for(const Hidden& hidden, double target,
                               const std::function<double(double)>& contribution) {
  constexpr int kTries = 9;
  constexpr double kTolerance = 1.12;  // ratio to the target
  double low = hidden.smallest, high = hidden.largest;
  double size = std::sqrt(low * high);
  for (int i = 0; i < kTries; ++i) {
    const double is = contribution(size);
    if (is > target / kTolerance && is < target * kTolerance) return size;
    if (size == hidden.largest && is < target) return {};
    if (size == hidden.smallest && is > target) return {};
    (is < target ? low : high) = size;
    // Next try in proportion; outside the bracket, bisection of the logarithm.
    const double next = is > 0.0 && std::isfinite(is) ? size * target / is : 0.0;
    if (next > low && next < high) {
      size = next;
    } else if (next >= hidden.largest && high == hidden.largest) {
      size = high;
    } else {
      size = std::sqrt(low * high);
    }
  }
  return {};
}

void append(std::string& text, double value, int decimals) {
  std::array<char, 64> digits{};
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value,
                                 std::chars_format::fixed, decimals);
  text.append(digits.data(), end.ptr);
}

struct NamedTrace {
  const char* name;
  const Trace* trace;
  std::vector<double> motor = {};  ///< as recorded; empty where it is not
};

/// `lost`: rows that are not written.
std::string csv_of(const std::vector<NamedTrace>& axes, double sample_time,
                   const std::vector<bool>& lost, const std::string& torque_unit) {
  constexpr double kMillimetres = 1e3;
  std::string text = "time[s]";
  for (const auto& [name, trace, motor] : axes) {
    text += std::string(",") + name + ".command[mm]," + name + ".actual[mm]";
    if (!motor.empty()) text += std::string(",") + name + ".actual_motor[mm]";
    if (!trace->torque.empty()) text += std::string(",") + name + ".torque[" + torque_unit + ']';
  }
  text += '\n';
  for (std::size_t row = 0; row < axes.front().trace->command.size(); ++row) {
    if (row < lost.size() && lost[row]) continue;
    append(text, static_cast<double>(row) * sample_time, 4);
    for (const auto& [name, trace, motor] : axes) {
      text += ',';
      append(text, kMillimetres * trace->command[row], 9);
      text += ',';
      append(text, kMillimetres * trace->actual[row], 9);
      if (!motor.empty()) {
        text += ',';
        append(text, kMillimetres * motor[row], 9);
      }
      if (trace->torque.empty()) continue;
      text += ',';
      append(text, trace->torque[row], 9);
    }
    text += '\n';
  }
  return text;
}

struct Wish {
  std::vector<std::string> ids;
  Class size = Class::kClear;
  bool blind = false;
  bool torque = false, motor = false, filtered = false, windups = false;
};

/// The motor's encoder as the other one reads; empty where the other one is the motor's.
std::vector<double> motor_reading(const Trace& trace, const Reading& reading, Random random) {
  std::vector<double> out;
  if (reading.recorded == Encoder::kMotor) return out;
  for (const double x : trace.motor) {
    const double noisy = x + reading.noise * random.normal();
    out.push_back(reading.step > 0.0 ? std::nearbyint(noisy / reading.step) * reading.step : noisy);
  }
  return out;
}

/// As a drive gives it: force, torque behind a screw, or current, counted either way.
void record_torque(Rig& rig, Random random) {
  struct Unit {
    const char* name;
    double low, high;  // per newton
  };
  constexpr Unit kUnits[] = {{"N", 1.0, 1.0}, {"Nm", 8e-4, 6e-3}, {"A", 2e-3, 5e-2}};
  const Unit& unit = kUnits[random.below(3)];
  Reading& r = rig.reading;
  r.torque_unit = unit.name;
  r.torque_per_newton = random.log_between(unit.low, unit.high) * random.sign();
  r.torque_lag = random.log_between(1e-4, 2e-3);
  r.torque_noise = rig.friction.level * random.log_between(2e-3, 5e-2);
}

/// Beside the loop itself, as every control has it; no fault.
void filter_control(Drive& drive, double mass, Random random) {
  const double velocity_loop = drive.velocity_gain / mass;  // [1/s]
  const bool command = random.chance(0.5), current = !command || random.chance(0.5);
  const double frequency_hz = random.log_between(8.0, 60.0), lag = random.log_between(0.02, 0.25);
  if (command) drive.command_filter_hz = frequency_hz;
  if (current) drive.current_lag = lag / velocity_loop;
}

Needs needs_of(const Wish& wish) {
  Needs needs;
  for (const std::string& id : wish.ids)
    needs = needs.with(hidden_effects::needs_of(id, wish.blind));
  return needs;
}

double target_of(Part part, Class size, Random& random) {
  if (size == Class::kFaint) return random.log_between(1.2, 2.6);
  if (size == Class::kLarge) return random.log_between(60.0, 300.0);
  return random.log_between(6.0, part == Part::kDev ? 30.0 : 40.0);
}

bool in_class(Class size, double ratio) {
  if (size == Class::kFaint) return ratio >= kFaintFrom && ratio <= kFaintTo;
  return ratio >= (size == Class::kLarge ? kLargeFrom : kClearFrom) && std::isfinite(ratio);
}

/// One drawn machine; nothing if its effects do not reach the wanted class.
std::optional<Case> try_machine(Part part, const Wish& wish, Random& random, std::uint64_t seed) {
  Machine machine = draw_machine(ranges_of(part), needs_of(wish), random);
  Scene& scene = machine.scene;
  const auto hides = [&](const char* id) {
    return std::find(wish.ids.begin(), wish.ids.end(), id) != wish.ids.end();
  };
  if (hides("backlash"))
    scene.rig.body.spring_frequency_hz = kContactFrequency, scene.rig.body.damping_ratio = 0.1;

  if (wish.windups && hides("torque_saturation")) {
    Random windup(seed + 3);
    scene.rig.drive.anti_windup = static_cast<IntegratorAtLimit>(windup.below(3));
    // Between a few cycles of the control and the integrator's own time.
    scene.rig.drive.tracking_time = windup.log_between(2e-3, 0.1);
  }
  if (wish.filtered) filter_control(scene.rig.drive, scene.rig.body.mass, Random(seed + 2));

  const Trace clean = simulate(scene.rig, scene.command);
  if (clean.runaway) return {};
  for (const double force : clean.force) {
    scene.peak_force = std::max(scene.peak_force, std::abs(force));
  }
  Rig noisy = scene.rig;
  noisy.external_force = machine.torque_noise;
  Case out;
  {
    Trace trace = simulate(noisy, scene.command);
    trace.exact = clean.exact;  // so that noise_rms includes the torque noise
    out.noise_rms = noise_rms(trace);
  }
  Trace other;
  if (machine.records_other) {
    other = simulate(machine.other, machine.other_command);
    if (other.runaway) return {};
    scene.other_acceleration = other.acceleration;
  }

  std::optional<Absorbed> absorbed;
  std::vector<Hidden> hidden;
  std::vector<double> sizes;
  Rig with_all = noisy, without_noise = scene.rig;
  for (const std::string& id : wish.ids) {
    hidden.push_back(hide(id, scene, random));
    const Hidden& one = hidden.back();
    const double target = out.noise_rms * target_of(part, wish.size, random);
    const auto with = [&](double size) {
      Rig rig = scene.rig;
      one.put(rig, size);
      return simulate(rig, scene.command);
    };
    // Quick rejection of most machines that cannot reach the target.
    if (!wish.blind && rms_apart(with(one.largest), clean) < target) return {};
    if (!absorbed) absorbed.emplace(scene.rig, scene.command, clean);
    const auto contribution = [&](double size) { return absorbed->left_rms(with(size), clean); };
    const std::optional<double> size =
        wish.blind ? std::sqrt(one.smallest * one.largest) : size_for(one, target, contribution);
    if (!size) return {};
    sizes.push_back(*size);
    one.put(with_all, *size);
    one.put(without_noise, *size);
  }

  if (wish.torque) record_torque(with_all, Random(~seed));
  const Trace exact = simulate(without_noise, scene.command);
  const Trace recorded = simulate(with_all, scene.command);
  if (exact.runaway || recorded.runaway) return {};
  for (std::size_t i = 0; i < hidden.size(); ++i) {
    Rig without = scene.rig;
    for (std::size_t j = 0; j < hidden.size(); ++j) {
      if (j != i) hidden[j].put(without, sizes[j]);
    }
    const Trace others = simulate(without, scene.command);
    const double contribution = absorbed->left_rms(exact, others);
    if (!wish.blind && !in_class(wish.size, contribution / out.noise_rms)) return {};
    out.hidden.push_back({.id = hidden[i].id,
                          .parameters = hidden[i].parameters(sizes[i]),
                          .contribution_rms = contribution,
                          .difference_rms = rms_apart(exact, others),
                          .clear = wish.size != Class::kFaint,
                          .observable = !wish.blind});
  }

  out.reading_rms = noise_rms(recorded);
  out.own = own_effects(scene.rig);
  out.sample_time_s = scene.rig.reading.sample_time;
  out.machine = describe(scene.rig);
  std::vector<NamedTrace> axes{{"X", &recorded}};
  if (wish.motor) axes[0].motor = motor_reading(recorded, with_all.reading, Random(seed + 1));
  if (machine.records_other) axes.push_back({"Y", &other});
  // A recorder that loses samples repeats the last value or omits the rows.
  const bool lose_rows = hides("dropped_samples") && random.chance(0.3);
  out.torque = wish.torque;
  out.csv =
      csv_of(axes, out.sample_time_s, lose_rows ? with_all.reading.stuck : std::vector<bool>{},
             with_all.reading.torque_unit);
  out.rig = std::move(with_all);
  out.rig.external_force.clear();
  return out;
}

Case make_case(Part part, Wish wish, const Recorded& recorded, const std::string& kind, int index) {
  const std::string name =
      std::string(part == Part::kDev ? "dev/" : "test/") + kind + '/' + std::to_string(index);
  const std::uint64_t seed = seed_of(name);
  wish.torque =
      recorded.torque == Torque::kAll || (recorded.torque == Torque::kHalf && seed % 2 == 1);
  wish.motor = recorded.motor;
  wish.filtered = recorded.filtered;
  wish.windups = recorded.windups;
  Random random(seed);
  for (int i = 0; i < kMaxMachines; ++i) {
    if (std::optional<Case> found = try_machine(part, wish, random, seed)) {
      found->name = name;
      found->seed = seed;
      found->draws = i + 1;
      return *found;
    }
  }
  throw std::runtime_error("hidden effects: no machine reaches the class of " + name + " in " +
                           std::to_string(kMaxMachines) + " draws");
}

}  // namespace

const Ranges& ranges_of(Part part) {
  static const Ranges dev{.mass = {30.0, 400.0},
                          .position_loop_hz = {8.0, 40.0},
                          .velocity_loop_ratio = {3.0, 6.0},
                          .friction_mps2 = {0.05, 0.6},
                          .drag_per_s = {0.5, 5.0},
                          .presliding_m = {5e-6, 6e-5},
                          .encoder_step_m = {1e-8, 1e-6},
                          .noise_to_step = {0.1, 1.0},
                          .velocity = {0.08, 0.4},
                          .acceleration = {1.0, 5.0},
                          .jerk = {20.0, 150.0},
                          .stroke = {0.08, 0.3},
                          .torque_noise = 0.5,
                          .first_change = 0.15,
                          .last_change = 0.45};
  static const Ranges test{.mass = {15.0, 800.0},
                           .position_loop_hz = {6.0, 50.0},
                           .velocity_loop_ratio = {2.5, 7.0},
                           .friction_mps2 = {0.03, 0.8},
                           .drag_per_s = {0.3, 8.0},
                           .presliding_m = {4e-6, 1e-4},
                           .encoder_step_m = {5e-9, 2e-6},
                           .noise_to_step = {0.05, 2.0},
                           .velocity = {0.05, 0.6},
                           .acceleration = {0.7, 8.0},
                           .jerk = {15.0, 250.0},
                           .stroke = {0.05, 0.4},
                           .torque_noise = 0.8,
                           .first_change = 0.1,
                           .last_change = 0.5};
  return part == Part::kDev ? dev : test;
}

/// FNV-1a.
std::uint64_t seed_of(const std::string& name) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return hash;
}

std::string csv_of(const Trace& trace, double sample_time) {
  return csv_of({{"X", &trace}}, sample_time, {}, {});
}

bool Case::hides(const std::string& id) const {
  return std::any_of(hidden.begin(), hidden.end(), [&](const Truth& t) { return t.id == id; });
}

bool Case::owns(const std::string& id) const {
  return std::find(own.begin(), own.end(), id) != own.end();
}

Case clean_case(Part part, int index, const Recorded& recorded) {
  return make_case(part, {}, recorded, "clean", index);
}

Case single_case(Part part, const std::string& id, Class size, int index,
                 const Recorded& recorded) {
  const std::string prefix = size == Class::kFaint   ? "faint-"
                             : size == Class::kLarge ? "large-"
                                                     : "";
  return make_case(part, {{id}, size}, recorded, prefix + id, index);
}

Case pair_case(Part part, int index, const Recorded& recorded) {
  // The choice of the pair has its own seed, independent of the machines drawn for it.
  Random random(seed_of((part == Part::kDev ? "dev/pair/" : "test/pair/") + std::to_string(index)));
  const std::vector<std::string>& ids = effect_ids();
  for (;;) {
    const std::string& a =
        ids[static_cast<std::size_t>(random.below(static_cast<int>(ids.size())))];
    const std::string& b =
        ids[static_cast<std::size_t>(random.below(static_cast<int>(ids.size())))];
    if (may_pair(a, b)) return make_case(part, {{a, b}}, recorded, a + '+' + b, index);
  }
}

Case blind_case(Part part, const std::string& id, int index, const Recorded& recorded) {
  return make_case(part, {{id}, Class::kClear, true}, recorded, "blind-" + id, index);
}

}  // namespace servotwin::hidden_effects
