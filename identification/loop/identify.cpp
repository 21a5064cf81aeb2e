#include "identification/loop/identify.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "identification/loop/deviations.h"
#include "identification/loop/full_ls.h"
#include "identification/loop/joint.h"
#include "identification/loop/message.h"
#include "identification/loop/moving_modes.h"
#include "identification/loop/structure_choice.h"
#include "identification/loop/torque_output.h"
#include "identification/loop/two_mass_choice.h"
#include "identification/recording/evidence.h"
#include "identification/recording/excitation.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/positions.h"
#include "twin/linear_algebra.h"
#include "twin/shown_units.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {

namespace {

// A parameter whose standard deviation exceeds this share of its value is not excited.
constexpr double kMaxRelativeDeviation = 0.5;

double span_s(const std::vector<Segment>& segments) {
  double sum = 0.0;
  for (const Segment& s : segments) sum += s.sample_time_s * static_cast<double>(s.size());
  return sum;
}

Eigen::Index rows_of(const std::vector<Segment>& segments) {
  Eigen::Index rows = 0;
  for (const Segment& s : segments) rows += s.size();
  return rows;
}

/// The assignment of the loop's poles to (real, omega, zeta) that is nearest to `like`.
PoleSet named_as(const PoleSet& like, const Loop& loop) {
  const PoleLabels labels = labels_of(loop);
  const auto apart = [&](const PoleSet& set) {
    return std::abs(set.real - like.real) + std::abs(set.omega - like.omega);
  };
  return *std::min_element(labels.set.begin(), labels.set.begin() + labels.count,
                           [&](const auto& l, const auto& r) { return apart(l) < apart(r); });
}

/// The parameters that the data do not determine, each with the motion that would determine it.
std::vector<std::string> loosely_known(const ModelRecord& record, const PoleSet& poles) {
  std::vector<std::string> out;
  const auto check = [&](const std::string& name, double value, double sd, double unit,
                         const char* motion) {
    if (!(sd > kMaxRelativeDeviation * std::abs(value))) return;
    out.push_back(
        message(name, " is not excited: ", value / unit, " +- ", sd / unit, "; ", motion));
  };
  const char* faster = "needs moves whose acceleration changes faster than this frequency";
  if (record.model.loop.order == 3) {
    check("real pole [Hz]", poles.real, record.pole_deviation.real, kTwoPi,
          "needs moves that change speed within 0.1 s");
  }
  check("natural frequency [Hz]", poles.omega, record.pole_deviation.omega, kTwoPi, faster);
  check("damping ratio", poles.zeta, record.pole_deviation.zeta, 1.0, faster);
  for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
    const Effect& effect = record.model.effects[i];
    const auto kinds = friction_kinds();
    if (std::find(kinds.begin(), kinds.end(), effect.kind) == kinds.end()) continue;
    // Of laws with free elements only the sum of the levels is determined, not each level.
    double variance = 0.0;
    for (std::size_t k = 0; k < std::max<std::size_t>(1, free_elements_of(effect.kind)); ++k)
      variance += std::pow(record.effect_deviations[i].coefficient[k], 2.0);
    const std::string force =
        effect.kind == kind_of<Presliding>() ? "breakaway force" : "Coulomb friction";
    check(force + (record.rotary ? " [rad/s^2]" : " [m/s^2]"), level_of(effect),
          std::sqrt(variance), 1.0, "needs reversals at low and at high speed");
  }
  return out;
}

/// The tracking error itself: the residual of a model that predicts none of it.
ErrorFigures unpredicted(const std::vector<Segment>& segments) {
  ErrorFigures out{0.0, 0.0};
  for (const Segment& s : segments) {
    out.rms += (s.command - s.actual).square().sum();
    out.max = std::max(out.max, (s.command - s.actual).abs().maxCoeff());
  }
  out.rms = std::sqrt(out.rms / static_cast<double>(std::max<Eigen::Index>(rows_of(segments), 1)));
  return out;
}

/// Mean square of command less encoder `lead` samples earlier, without its mean, over rows that are
/// `stride` apart; infinite without rows.
double mean_square_at(const std::vector<Segment>& segments, Eigen::Index lead,
                      Eigen::Index stride) {
  double sum = 0.0, count = 0.0;
  for (const Segment& s : segments) {
    const Eigen::Index rows = (s.size() - lead + stride - 1) / stride;
    if (rows <= 0) continue;
    const auto every = [&](const Eigen::ArrayXd& values, Eigen::Index from) {
      return values.segment(from, s.size() - lead)(Eigen::seqN(0, rows, stride));
    };
    const Eigen::ArrayXd error = every(s.command, lead) - every(s.actual, 0);
    sum += (error - error.mean()).square().sum(), count += static_cast<double>(rows);
  }
  return count > 0.0 ? sum / count : HUGE_VAL;
}

/// Whether the encoder agrees much better with a later command than with the present one.
bool encoder_leads(const std::vector<Segment>& segments) {
  constexpr double kLongest_s = 0.25;
  constexpr Eigen::Index kMaxRows = 100'000;  // a mean square needs no more of a long recording
  constexpr Eigen::Index kPartOfLead = 16;    // the best one leaves 3 % of the lead at most
  const Eigen::Index stride = 1 + rows_of(segments) / kMaxRows;
  const auto longest = static_cast<Eigen::Index>(kLongest_s / segments.front().sample_time_s);
  double later = HUGE_VAL;
  for (Eigen::Index lead = 1; lead <= longest; lead += 1 + lead / kPartOfLead)
    later = std::min(later, mean_square_at(segments, lead, stride));
  constexpr double kMaxErrorRatio = 0.5;  // of the mean square; exchanged columns leave less
  return later < kMaxErrorRatio * mean_square_at(segments, 0, stride);
}

/// Reasons why the two signals cannot be the command and the encoder of one axis (exchanged
/// columns, other unit or sign), independent of how well the model fits.
std::vector<std::string> exchanged_or_scaled(const Model& model,
                                             const std::vector<Segment>& segments,
                                             std::string& exchanged) {
  std::vector<std::string> out;
  // First, because a model of channels in unlike units means nothing.
  if (std::string scaled = why_scaled(segments); !scaled.empty()) out.push_back(std::move(scaled));
  const auto last = static_cast<std::size_t>(model.loop.order - 1);
  double lag = model.loop.numerator[last] / model.loop.denominator[last] + model.command_delay_s();
  for (const Mode& mode : model.loop.modes) lag += mode.beta / (mode.omega * mode.omega);
  if (lag < -model.sample_time_s) {
    if (encoder_leads(segments)) {
      exchanged = message("the encoder leads its command by ", -1e3 * lag,
                          " ms: the two columns may be exchanged");
      out.push_back(exchanged);
    } else {
      out.emplace_back(
          "the model that fits best moves before its command, but the encoder does not: it is no "
          "model of this axis. Check that both columns are positions of this axis, in the same "
          "unit and stamped by one clock, and that the sensor is fine enough; if they are, "
          "something moves the axis that this model lacks, as play, a limit or a load on a spring "
          "do, which servotwin diagnose seeks");
    }
  }
  return out;
}

/// Where the steps of the encoder are a good part of this error: how large they are.
std::string coarse_encoder(double step, double rms, bool rotary) {
  constexpr double kMinShare = 0.2;  // of the error, by its rounding
  const double rounding = step / std::sqrt(12.0);
  if (!(rounding > kMinShare * rms)) return {};
  return message("; the encoder has steps of ", micro_text(step, rotary),
                 ", whose rounding alone is ", micro_text(rounding, rotary), " RMS");
}

/// "outside of the search bounds (damping 0.056, not 0.2 to 2)"; empty: all poles are inside.
std::string outside_of(const Loop& loop, const PoleSet& poles, const PoleBounds& bounds) {
  if (inside(loop, bounds)) return {};
  std::string out;
  const auto check = [&](const char* name, double value, double low, double high,
                         const char* unit) {
    if (value >= low && value <= high) return;
    out += message(out.empty() ? "" : ", ", name, " ", value, unit, ", not ", low, " to ", high);
  };
  if (loop.order == 3)
    check("real pole", poles.real / kTwoPi, bounds.real_min_hz, bounds.real_max_hz, " Hz");
  check("pair", poles.omega / kTwoPi, bounds.omega_min_hz, bounds.omega_max_hz, " Hz");
  check("damping", poles.zeta, bounds.zeta_min, bounds.zeta_max, "");
  return "outside of the search bounds (" + out + ")";
}

}  // namespace

std::vector<double> squared_acceleration(const std::vector<Segment>& segments) {
  // Over a shorter time the rounding of the command would count as acceleration.
  constexpr double kStep_s = 0.01;
  std::vector<double> squares;
  for (const Segment& s : segments) {
    const auto step = std::max<Eigen::Index>(
        1, static_cast<Eigen::Index>(std::lround(kStep_s / s.sample_time_s)));
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      const double change = k < step || k + step >= s.size()
                                ? 0.0
                                : s.command(k + step) - 2.0 * s.command(k) + s.command(k - step);
      squares.push_back(change * change);
    }
  }
  // Where samples are lost the command jumps, by far more than it ever accelerates.
  constexpr double kQuantile = 0.99, kMaxOverQuantile = 4.0;
  std::vector<double> sorted;
  std::copy_if(squares.begin(), squares.end(), std::back_inserter(sorted),
               [](double square) { return square > 0.0; });
  double most = 0.0;
  if (!sorted.empty()) {
    const auto at = sorted.begin() +
                    static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), at, sorted.end());
    most = kMaxOverQuantile * *at;
  }
  std::vector<double> sums{0.0};
  for (const double square : squares) sums.push_back(sums.back() + std::min(square, most));
  return sums;
}

double training_share_of(const std::vector<Segment>& segments) {
  constexpr double kShare = 0.6, kMaxShare = 0.85;
  // Of the squared acceleration, in the training data.
  constexpr double kMinAccelerationShare = 0.3;
  const std::vector<double> sums = squared_acceleration(segments);
  const auto n = static_cast<double>(sums.size() - 1);
  if (!(sums[static_cast<std::size_t>(kShare * n)] < kMinAccelerationShare * sums.back()))
    return kShare;
  const auto at = std::lower_bound(sums.begin(), sums.end(), kShare * sums.back());
  return std::clamp(static_cast<double>(at - sums.begin()) / n, kShare, kMaxShare);
}

std::pair<std::vector<Segment>, std::vector<Segment>> split(const std::vector<Segment>& segments,
                                                            double share, bool each) {
  std::vector<Segment> first, rest;
  double left = share * span_s(segments);
  for (const Segment& s : segments) {
    const double h = s.sample_time_s, length = h * static_cast<double>(s.size());
    const double taken = each ? share * length : std::clamp(left, 0.0, length);
    left -= length;
    const double at = s.start_s + taken - 0.5 * h;
    for (Segment& part : cut({s}, -1e300, at)) first.push_back(std::move(part));
    for (Segment& part : cut({s}, at, 1e300)) {
      // A remainder that begins within slow reversals needs its own lead-in.
      if (s.lead > 0 && taken > 0.0) part.lead = std::max(part.lead, lead_in(part));
      rest.push_back(std::move(part));
    }
  }
  return {std::move(first), std::move(rest)};
}

std::string why_scaled(const std::vector<Segment>& segments) {
  double product = 0.0, square = 0.0;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd command = s.command - s.command.mean();
    product += (command * (s.actual - s.actual.mean())).sum();
    square += command.square().sum();
  }
  const double slope = product / square;
  if (!(square > 0.0) || (slope * kMaxEncoderRatio > 1.0 && slope < kMaxEncoderRatio)) return {};
  return message("the encoder moves ", slope,
                 " times as far as its command: check the units and signs of both columns, and "
                 "that they are of one axis");
}

ErrorFigures judge(const Model& model, const std::vector<Segment>& segments, double skip_s) {
  double sum = 0.0;
  ErrorFigures out;
  Eigen::Index count = 0;
  double most = 0.0;
  std::vector<double> at_motor;
  for (const Segment& s : segments) {
    const auto skipped = static_cast<Eigen::Index>(std::ceil(skip_s / s.sample_time_s));
    const Eigen::Index used = std::max({s.lead, skipped, starting_state_samples(model, s)});
    if (s.size() <= used + 10) continue;
    const bool both = two_mass_of(model) != nullptr && s.actual_motor.size() == s.size();
    const Outputs outputs{.motor = both};
    const Eigen::ArrayXd simulated = simulate(model, s, outputs);
    const Eigen::ArrayXd recorded = simulated(Eigen::seqN(0, s.size(), outputs.per_sample()));
    const Eigen::ArrayXd left = ((s.command - s.actual) - recorded).tail(s.size() - used);
    for (Eigen::Index k = used; both && k < s.size(); ++k) {
      const double missed = s.command(k) - s.actual_motor(k) - simulated(2 * k + 1);
      if (std::isfinite(missed)) at_motor.push_back(missed);
    }
    sum += left.square().sum();
    most = std::max(most, left.abs().maxCoeff());
    count += left.size();
  }
  if (count > 0) out = {std::sqrt(sum / static_cast<double>(count)), most};
  if (!at_motor.empty()) {
    // The zeros of the two encoders are not the same.
    const Eigen::Map<const Eigen::ArrayXd> missed(at_motor.data(), std::ssize(at_motor));
    out.motor_rms = std::sqrt((missed - missed.mean()).square().mean());
  }
  return out;
}

void require_usable(const SegmentedAxis& axis, const IdentifyOptions& options) {
  require_motion(axis);
  const auto [training, holdout] =
      split(axis.segments, options.training_share.value_or(training_share_of(axis.segments)),
            options.split_each);
  if (rows_of(training) < 300 || rows_of(holdout) < 100) {
    throw std::runtime_error(message(
        axis.axis, ": ", rows_of(axis.segments), " samples (", span_s(axis.segments),
        " s) are too few to identify and validate a model; record at least 500 samples with "
        "motion"));
  }
  if (std::all_of(axis.segments.begin(), axis.segments.end(),
                  [](const Segment& s) { return (s.actual == s.command).all(); }))
    throw std::runtime_error(axis.axis +
                             ".actual is equal to the command in every sample: record the encoder, "
                             "not a copy of the command");
}

Identified identify(const SegmentedAxis& axis, const IdentifyOptions& options) {
  if (auto why = why_invalid(options.bounds); !why.empty()) throw std::invalid_argument(why);
  const double share = options.training_share.value_or(training_share_of(axis.segments));
  if (!(share >= 0.1 && share <= 0.95)) {
    throw std::invalid_argument(message("training share = ", share, " must be from 0.1 to 0.95"));
  }
  if (options.masses != Masses::kRigid &&
      (options.method != Method::kJoint || options.modes > 0 || options.start))
    throw std::invalid_argument(
        "two masses are identified by the joint method, without modes and without an earlier "
        "model");
  require_usable(axis, options);
  if (options.coupling && axis.segments.front().neighbour.size() == 0)
    throw std::runtime_error(
        axis.axis +
        ": no other axis in the recording has segments with the same sample times, so that no "
        "coupling can be identified");
  const auto [training, holdout] = split(axis.segments, share, options.split_each);

  const std::vector<Segment> judged_on = with_lead_in(holdout, axis.segments);

  Identified out;
  ModelRecord& record = out.record;
  record.axis = axis.axis;
  record.neighbour = axis.neighbour;
  record.rotary = axis.rotary;
  record.rows = static_cast<long>(rows_of(axis.segments));
  record.from_s = axis.segments.front().start_s;
  record.to_s = axis.segments.back().end_s();
  record.training_to_s = training.back().end_s();
  const NoiseFloor floor = noise_floor(axis.segments);
  record.noise_floor = floor;
  const Excitation excitation = excitation_of(training);
  record.excitation = missing_motion(excitation, axis.rotary);

  if (options.method == Method::kFullLs) {
    record.method = "full-ls";
    auto fit = full_ls(training, options.bounds, options.pole_constraints);
    if (!fit)
      throw std::runtime_error(axis.axis +
                               ": full least squares has no finite solution on this data");
    record.model = fit->model;
    record.condition_number = fit->condition_number;
    record.effect_deviations.assign(record.model.effects.size(), {});
    if (auto why = why_invalid(record.model); !why.empty()) {
      out.refusals.push_back(why);
      return out;
    }
    record.training = judge(record.model, training);
    record.holdout = judge(record.model, judged_on);
    return out;
  }

  record.method = "pole-search";
  const double encoder_step = floor.encoder_step;
  PoleSearchOptions search;
  Structure structure;
  Loop moving;
  if (options.start) {
    structure = structure_of(*options.start);
    search.from = {point_of(*options.start)};
    moving = options.start->loop;
    out.trials.push_back(
        {structure.order, structure.effects, kAbsent, true, structure.modes, "", structure.moving});
  } else {
    ChosenStructure chosen =
        chosen_structure(axis.axis, axis.rotary, training, options, encoder_step, out.trials);
    structure = std::move(chosen.structure);
    search.from = std::move(chosen.from);
    moving = std::move(chosen.moving);
  }
  search.bounds = options.bounds;
  const bool polish = options.method == Method::kJoint;
  if (polish) record.method = "joint";
  Structure standing = structure;
  standing.moving = false;
  const auto fit = joint_fit(training, standing, search, encoder_step, polish);
  if (!fit)
    throw std::runtime_error(axis.axis +
                             ": the pole search found no finite solution on the training data");
  record.model = fit->model;
  Eigen::MatrixXd covariance = fit->covariance;
  if (structure.moving) {
    const auto moved = with_moving_modes(training, structure,
                                         with_modes_moving_as(moving, fit->model), encoder_step);
    if (!moved)
      throw std::runtime_error(
          axis.axis +
          ": modes that change with position have no valid fit to the training "
          "data; identify without a start model, or with fixed modes");
    record.model = moved->model;
    covariance = moved->covariance;
  }
  Eigen::Index nonlinear = fit->linear;
  const std::vector<StructureTrial> rigid_trials = out.trials;
  const auto two =
      options.masses == Masses::kRigid
          ? std::nullopt
          : chosen_masses(axis.axis, training, standing, search, options, encoder_step, out.trials);
  if (two) {
    const auto refined = output_error(training, two->structure, two->model, {encoder_step});
    if (refined) {
      record.model = refined->model;
      covariance = refined->covariance;
      nonlinear = two->structure.order + two->structure.coefficient_count();
    } else if (options.masses == Masses::kChosen) {
      out.trials = rigid_trials;
    } else {
      throw std::runtime_error(axis.axis +
                               ": two masses have no valid fit to the training data; identify a "
                               "rigid axis");
    }
  }
  if (options.with_torque && why_invalid(record.model).empty()) {
    const TorqueData data = torque_data(axis, share, options.split_each);
    const auto both = polish ? fitted_with_torque(record.model, data, floor) : std::nullopt;
    if (both) {
      record.model = both->model;
      covariance = both->covariance;
    }
    TorqueOutput torque = motor_torque(record.model, data);
    record.torque = std::move(torque.torque);
    if (record.torque) record.torque->fitted_together = both.has_value();
    if (has_torque(axis)) out.no_torque = std::move(torque.why_not);
  }
  record.condition_number = fit->condition_number;
  // Of the possible assignments of the poles, the one nearest to that of the projected fit.
  const PoleSet poles = named_as(fit->fit.poles, record.model.loop);
  set_deviations(record, poles, covariance, nonlinear);
  if (auto why = why_invalid(record.model); !why.empty()) {
    out.refusals.push_back("the model that fits best is none of an axis (" + why +
                           "): command and encoder are not those of one servo loop by one clock");
    return out;
  }
  record.training = judge(record.model, training);
  record.holdout = judge(record.model, judged_on);
  // A pair at the bound that was asked for was not found there.
  constexpr double kAtBound = 0.99;
  if (std::string why = why_too_few_samples(poles.omega, axis.sample_time_s);
      options.must_predict && !why.empty() &&
      poles.omega < kAtBound * kTwoPi * options.bounds.omega_max_hz)
    out.refusals.push_back(std::move(why));
  if (std::string where = polish ? outside_of(record.model.loop, poles, options.bounds)
                                 : (fit->fit.on_bound ? "on the search bounds" : "");
      !where.empty()) {
    record.excitation.push_back(
        message("poles lie ", where, ": this motion does not determine them; ",
                "widen the bounds, or add moves with faster changes of acceleration"));
  }
  for (std::string& line : loosely_known(record, poles))
    record.excitation.push_back(std::move(line));
  for (std::string& line : exchanged_or_scaled(record.model, training, out.exchanged))
    out.refusals.push_back(std::move(line));
  if (!std::isfinite(record.holdout.rms)) {
    out.refusals.push_back(
        "the held-out segments are too short to validate a model; record longer segments");
  } else if (const double before = unpredicted(holdout).rms;
             options.must_predict && !(record.holdout.rms < before)) {
    out.refusals.push_back(message(
        "on the held-out data the residual of the model is ",
        micro_text(record.holdout.rms, axis.rotary), " RMS, not below the tracking error of ",
        micro_text(before, axis.rotary), " RMS: the model predicts nothing",
        coarse_encoder(encoder_step, before, axis.rotary)));
  }
  return out;
}

std::string why_too_few_samples(double omega, double sample_time_s) {
  // Of the sampling rate. A fit to every 20th and 40th row of a loop of 30 Hz ends at 0.49 and 0.50
  // of it (docs/measurements.md, 21); at 0.3 and below it finds the loop.
  constexpr double kMaxFrequency = 0.4;
  constexpr double kEnough_hz = 1000.0, kEnoughPerPeriod = 20.0;
  const double frequency_hz = omega / kTwoPi;
  if (!(frequency_hz * sample_time_s > kMaxFrequency)) return {};
  return message("the pole pair is found at ", frequency_hz, " Hz, and ") +
         message("", 1.0 / sample_time_s,
                 " samples per second do not show whether it is faster: record at least ") +
         message("", std::ceil(std::min(kEnoughPerPeriod * frequency_hz, kEnough_hz)),
                 " samples per second");
}

}  // namespace servotwin
