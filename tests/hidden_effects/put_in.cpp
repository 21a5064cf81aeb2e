#include "tests/hidden_effects/put_in.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servotwin::hidden_effects::put_in {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

/// Adds a force on the table; `at` is called once per control period.
void push(Rig& rig, double duration, const std::function<double(double)>& at) {
  const auto periods = static_cast<std::size_t>(duration * kControlRate) + 1;
  rig.external_force.resize(std::max(periods, rig.external_force.size()));
  for (std::size_t k = 0; k < periods; ++k) {
    rig.external_force[k] += at(static_cast<double>(k) / kControlRate);
  }
}

/// A time within a rest: a payload is not mounted during motion.
double change_at_rest(const Scene& s, Random& random) {
  const double duration = s.command.duration();
  const double wanted = random.between(s.first_change, s.last_change) * duration;
  double best = wanted, least = duration;  // during motion if there is no rest in that interval
  for (const Interval& rest : rests(s.command)) {
    const double middle = 0.5 * (rest.begin + rest.end);
    if (middle < s.first_change * duration || middle > s.last_change * duration) continue;
    if (std::abs(middle - wanted) < least) least = std::abs(middle - wanted), best = middle;
  }
  return best;
}

double change_at_any_time(const Scene& s, Random& random) {
  return random.between(s.first_change, s.last_change) * s.command.duration();
}

/// A frequency below the Nyquist frequency of the record.
double tone(const Scene& s, Random& random, double low, double high) {
  return random.log_between(low, std::min(high, 0.4 / s.rig.reading.sample_time));
}

}  // namespace

Hidden stribeck(const Scene&, Random& random) {
  const double velocity = random.log_between(2e-3, 2e-2);
  return {"stribeck", 0.02, 1.0,
          [=](Rig& rig, double rise) {
            rig.friction.stribeck_rise = rise;
            rig.friction.stribeck_velocity = velocity;
          },
          [=](double rise) {
            return Parameters{{"rise", rise}, {"stribeck_velocity_mps", velocity}};
          }};
}

Hidden presliding(const Scene&, Random& random) {
  const double curve = random.between(2.0, 5.0);
  return {"presliding", 2e-6, 2e-4,
          [=](Rig& rig, double distance) {
            rig.friction.family = Friction::Family::kMaxwell;
            rig.friction.presliding_distance = distance;
            rig.friction.curve = curve;
          },
          [](double distance) {
            return Parameters{{"distance_m", distance}};
          }};
}

Hidden asymmetric_friction(const Scene&, Random& random) {
  const double sign = random.sign();
  return {"asymmetric_friction", 0.02, 0.8,
          [=](Rig& rig, double size) { rig.friction.direction_ratio = std::exp(sign * size); },
          [=](double size) {
            return Parameters{{"ratio", std::exp(sign * size)}};
          }};
}

Hidden position_dependent_friction(const Scene& s, Random& random) {
  const double place = s.command.at(0.0).position + random.between(-0.35, 0.35) * s.stroke;
  const double width = random.between(0.08, 0.25) * s.stroke;
  const double level = s.rig.friction.level / s.rig.body.mass;
  return {"position_dependent_friction", 0.03, 1.2,
          [=](Rig& rig, double wear) {
            rig.friction.wear = wear;
            rig.friction.wear_place = place;
            rig.friction.wear_width = width;
          },
          [=](double wear) {
            return Parameters{{"amplitude_mps2", wear * level}, {"place_m", place}};
          }};
}

Hidden added_friction(const Scene& s, Random& random) {
  const double time = change_at_any_time(s, random);
  const double drag = random.uniform();
  const Friction own = s.rig.friction;
  const double mass = s.rig.body.mass;
  return {"added_friction", 0.02, 3.0,
          [=](Rig& rig, double share) {
            rig.friction.added_time = time;
            rig.friction.added_level = share * own.level;
            rig.friction.added_viscous = share * drag * own.viscous;
          },
          [=](double share) {
            return Parameters{{"time_s", time}, {"coulomb_mps2", share * own.level / mass}};
          }};
}

/// The contact is stiff, so that the gap dominates.
Hidden backlash(const Scene&, Random&) {
  return {"backlash", 2e-7, 1e-4, [](Rig& rig, double width) { rig.body.gap = width; },
          [](double width) {
            return Parameters{{"width_m", width}};
          }};
}

/// The size is the compliance relative to that of a 20 Hz mode.
Hidden compliance(const Scene&, Random& random) {
  const double damping = random.log_between(0.01, 0.06);
  return {"compliance", 0.005, 1.0,
          [=](Rig& rig, double size) {
            rig.body.spring_frequency_hz = 20.0 / std::sqrt(size);
            rig.body.damping_ratio = damping;
          },
          [=](double size) {
            return Parameters{{"frequency_hz", 20.0 / std::sqrt(size)}, {"damping_ratio", damping}};
          }};
}

Hidden cogging(const Scene& s, Random& random) {
  const double period = random.log_between(1e-3, 1.2e-2);
  const double phase = random.between(0.0, kTurn);
  const double mass = s.rig.body.mass;
  return {"cogging", 5e-4, 0.3,
          [=](Rig& rig, double size) {
            rig.body.cogging = size * mass;
            rig.body.cogging_period = period;
            rig.body.cogging_phase = phase;
          },
          [=](double size) {
            return Parameters{{"period_m", period}, {"amplitude_mps2", size}};
          }};
}

Hidden lead_error(const Scene&, Random& random) {
  const double period = random.log_between(4e-3, 2e-2);
  const double phase = random.between(0.0, kTurn);
  const double slope = random.sign() * random.between(0.0, 8.0);  // per metre and amplitude
  return {"lead_error", 5e-8, 4e-5,
          [=](Rig& rig, double amplitude) {
            rig.reading.lead_error = amplitude;
            rig.reading.lead_period = period;
            rig.reading.lead_phase = phase;
            rig.reading.lead_slope = slope * amplitude;
          },
          [=](double amplitude) {
            return Parameters{
                {"period_m", period}, {"amplitude_m", amplitude}, {"slope", slope * amplitude}};
          }};
}

Hidden encoder_error(const Scene&, Random& random) {
  const double period = random.log_between(5e-4, 1e-2);
  const double phase = random.between(0.0, kTurn);
  return {"encoder_error", 5e-8, 3e-5,
          [=](Rig& rig, double amplitude) {
            rig.reading.cyclic_error = amplitude;
            rig.reading.cyclic_period = period;
            rig.reading.cyclic_phase = phase;
          },
          [=](double amplitude) {
            return Parameters{{"period_m", period}, {"amplitude_m", amplitude}};
          }};
}

Hidden gravity_offset(const Scene& s, Random& random) {
  const double sign = random.sign();
  const double mass = s.rig.body.mass;
  return {"gravity_offset", 1e-3, 9.8,
          [=](Rig& rig, double size) { rig.body.constant_force = sign * size * mass; },
          [=](double size) {
            return Parameters{{"offset_mps2", sign * size}};
          }};
}

Hidden inertia_change(const Scene& s, Random& random) {
  const double time = change_at_rest(s, random);
  const bool heavier = random.chance(0.7);
  const auto ratio = [heavier](double size) { return heavier ? 1.0 + size : 1.0 / (1.0 + size); };
  return {"inertia_change", 0.01, 2.0,
          [=](Rig& rig, double size) {
            rig.body.mass_ratio = ratio(size);
            rig.body.mass_time = time;
          },
          [=](double size) {
            return Parameters{{"ratio", ratio(size)}, {"time_s", time}};
          }};
}

Hidden viscous_drift(const Scene&, Random& random) {
  const double time = random.log_between(3.0, 15.0);
  return {"viscous_drift", 0.03, 3.0,
          [=](Rig& rig, double excess) {
            rig.friction.viscous_excess = excess;
            rig.friction.viscous_time = time;
          },
          [=](double excess) {
            return Parameters{{"excess", excess}, {"time_constant_s", time}};
          }};
}

Hidden time_delay(const Scene&, Random&) {
  return {"time_delay", 2e-5, 1e-2, [](Rig& rig, double delay) { rig.reading.delay = delay; },
          [](double delay) {
            return Parameters{{"delay_s", delay}};
          }};
}

Hidden gain_change(const Scene& s, Random& random) {
  const double time = change_at_any_time(s, random);
  const double sign = random.sign();
  return {"gain_change", 1e-3, 0.7,
          [=](Rig& rig, double size) {
            rig.drive.gain_ratio = std::exp(sign * size);
            rig.drive.gain_time = time;
          },
          [=](double size) {
            return Parameters{{"ratio", std::exp(sign * size)}, {"time_s", time}};
          }};
}

/// The size is the missing share of the peak force.
Hidden torque_saturation(const Scene& s, Random&) {
  const double peak = s.peak_force, mass = s.rig.body.mass;
  return {"torque_saturation", 0.005, 0.6,
          [=](Rig& rig, double size) { rig.drive.force_limit = (1.0 - size) * peak; },
          [=](double size) {
            return Parameters{{"limit_mps2", (1.0 - size) * peak / mass}};
          }};
}

Hidden periodic_disturbance(const Scene& s, Random& random) {
  const double frequency = tone(s, random, 3.0, 90.0);
  const double phase = random.between(0.0, kTurn);
  const double mass = s.rig.body.mass, duration = s.command.duration();
  return {"periodic_disturbance", 1e-3, 1.0,
          [=](Rig& rig, double size) {
            push(rig, duration,
                 [=](double t) { return size * mass * std::sin(kTurn * frequency * t + phase); });
          },
          [=](double size) {
            return Parameters{{"frequency_hz", frequency}, {"amplitude_mps2", size}};
          }};
}

Hidden impulse_disturbance(const Scene& s, Random& random) {
  const double duration = s.command.duration(), mass = s.rig.body.mass;
  const int count = 4 + random.below(5);
  std::vector<double> begin, length, share;
  for (int i = 0; i < count; ++i) {
    begin.push_back(duration * (i + random.between(0.2, 0.8)) / count);
    length.push_back(random.log_between(4e-3, 2e-2));
    share.push_back(random.sign() * random.between(0.6, 1.0));
  }
  return {"impulse_disturbance", 0.02, 20.0,
          [=](Rig& rig, double size) {
            for (std::size_t i = 0; i < begin.size(); ++i) {
              push(rig, duration, [&](double t) {
                const double at = (t - begin[i]) / length[i];
                return at <= 0.0 || at >= 1.0
                           ? 0.0
                           : size * mass * share[i] * std::sin(std::numbers::pi * at);
              });
            }
          },
          [=](double size) {
            return Parameters{{"count", static_cast<double>(count)}, {"amplitude_mps2", size}};
          }};
}

Hidden cutting_force(const Scene& s, Random& random) {
  const double frequency = tone(s, random, 20.0, 200.0);
  const double ripple = random.between(0.4, 1.0), sign = random.sign();
  const double mass = s.rig.body.mass, duration = s.command.duration();
  // Every cut begins and ends within a move, since the tool approaches the part.
  std::vector<Interval> cuts;
  for (const Interval& move : moves(s.command)) {
    const double length = move.end - move.begin;
    if (length < 0.2 || random.chance(0.5)) continue;
    cuts.push_back({move.begin + random.between(0.05, 0.2) * length,
                    move.end - random.between(0.05, 0.2) * length});
  }
  return {"cutting_force", 2e-3, 2.0,
          [=](Rig& rig, double mean) {
            for (const Interval& cut : cuts) {
              push(rig, duration, [&](double t) {
                if (t < cut.begin || t > cut.end) return 0.0;
                const double entry = std::min({1.0, (t - cut.begin) / 0.01, (cut.end - t) / 0.01});
                return sign * mean * mass * entry *
                       (1.0 + ripple * std::sin(kTurn * frequency * t));
              });
            }
          },
          [=](double mean) {
            return Parameters{{"tooth_frequency_hz", frequency}, {"mean_mps2", mean}};
          }};
}

Hidden cross_coupling(const Scene& s, Random& random) {
  const double sign = random.sign(), mass = s.rig.body.mass;
  const std::vector<double>& other = s.other_acceleration;
  return {"cross_coupling", 2e-3, 0.5,
          [=](Rig& rig, double share) {
            rig.external_force.resize(std::max(other.size(), rig.external_force.size()));
            for (std::size_t k = 0; k < other.size(); ++k) {
              rig.external_force[k] += sign * share * mass * other[k];
            }
          },
          [=](double share) {
            return Parameters{{"coupling", sign * share}};
          }};
}

Hidden dwell_stiction(const Scene& s, Random& random) {
  const double distance = random.log_between(1e-5, 1e-4);
  const double level = s.rig.friction.level, mass = s.rig.body.mass;
  return {"dwell_stiction", 0.01, 0.6,
          [=](Rig& rig, double share) {
            rig.friction.dwell_growth = share * level;
            rig.friction.dwell_distance = distance;
          },
          [=](double share) {
            return Parameters{{"growth_mps2", share * level / mass}, {"distance_m", distance}};
          }};
}

Hidden thermal_growth(const Scene& s, Random& random) {
  const double time = random.log_between(4.0, 40.0);
  const double fixed = s.command.at(0.0).position + random.sign() * random.between(0.15, 0.6);
  return {"thermal_growth", 5e-7, 3e-4,
          [=](Rig& rig, double growth) {
            rig.reading.growth = growth;
            rig.reading.growth_time = time;
            rig.reading.fixed_end = fixed;
          },
          [=](double growth) {
            return Parameters{{"growth", growth}, {"time_constant_s", time}};
          }};
}

/// The size is the share of the rows in motion that repeat the one before.
Hidden dropped_samples(const Scene& s, Random& random) {
  const double sample_time = s.rig.reading.sample_time;
  const auto rows = static_cast<std::size_t>(s.command.duration() / sample_time) + 1;
  struct Drop {
    double rank;  // the row is lost if the size is at least this
    std::size_t row;
    int length;
  };
  std::vector<Drop> drops;
  for (std::size_t row = 10; row < rows; row += 10) {
    const double v = s.command.at(static_cast<double>(row) * sample_time).velocity;
    if (std::abs(v) < 1e-3) continue;
    drops.push_back({random.uniform() * 5.0, row + static_cast<std::size_t>(random.below(5)),
                     1 + random.below(3)});
  }
  const auto stuck = [=](double size) {
    std::vector<bool> out(rows + 10);
    for (const Drop& drop : drops) {
      if (drop.rank > size) continue;
      for (int i = 0; i < drop.length; ++i) out[drop.row + static_cast<std::size_t>(i)] = true;
    }
    return out;
  };
  return {"dropped_samples", 5e-3, 0.5,
          [=](Rig& rig, double size) { rig.reading.stuck = stuck(size); },
          [=](double size) {
            const auto flags = stuck(size);
            return Parameters{
                {"rows", static_cast<double>(std::count(flags.begin(), flags.end(), true))}};
          }};
}

}  // namespace servotwin::hidden_effects::put_in
