#include "tests/hidden_effects/score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iomanip>
#include <map>
#include <sstream>

namespace servotwin::hidden_effects {
namespace {

bool has(const std::vector<std::string>& all, const std::string& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const auto above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

std::string shares(int count, int of) {
  std::ostringstream text;
  text << count << " of " << of;
  if (of > 0) {
    text << " (" << std::fixed << std::setprecision(1) << 100.0 * count / of << " %)";
  }
  return text.str();
}

std::vector<const Outcome*> of_kind(const std::vector<Outcome>& outcomes, Kind kind) {
  std::vector<const Outcome*> out;
  for (const Outcome& o : outcomes) {
    if (o.kind == kind) out.push_back(&o);
  }
  return out;
}

const NamedCause* find(const Outcome& outcome, const std::string& id) {
  for (const NamedCause& cause : outcome.answer.causes) {
    if (cause.id == id) return &cause;
  }
  return nullptr;
}

bool first_is_right(const Outcome& o) { return o.first() == o.made.hidden.front().id; }

bool first_is_rival(const Outcome& o) {
  const std::vector<NamedCause> named = o.named();
  return !named.empty() && has(named.front().ambiguous_with, o.made.hidden.front().id);
}

int count_if(const std::vector<const Outcome*>& all,
             const std::function<bool(const Outcome&)>& holds) {
  return static_cast<int>(
      std::count_if(all.begin(), all.end(), [&](const Outcome* o) { return holds(*o); }));
}

int size_of(const std::vector<const Outcome*>& all) { return static_cast<int>(all.size()); }

void print_singles(const std::vector<const Outcome*>& singles, std::ostream& out) {
  if (singles.empty()) return;
  out << "clear single effects: named first    "
      << shares(count_if(singles, first_is_right), size_of(singles)) << '\n'
      << "  first is ambiguous with it         "
      << shares(count_if(singles,
                         [](const Outcome& o) { return !first_is_right(o) && first_is_rival(o); }),
                size_of(singles))
      << '\n'
      << "  named first and not called ambiguous "
      << shares(count_if(singles,
                         [](const Outcome& o) {
                           return first_is_right(o) && o.named().front().ambiguous_with.empty();
                         }),
                size_of(singles))
      << '\n'
      << "  named, and others with it          "
      << shares(count_if(singles,
                         [](const Outcome& o) {
                           return o.named().size() > 1 && find(o, o.made.hidden.front().id);
                         }),
                size_of(singles))
      << '\n';
  std::map<std::string, std::vector<const Outcome*>> by_id;
  for (const Outcome* o : singles) by_id[o->made.hidden.front().id].push_back(o);
  for (const auto& [id, all] : by_id) {
    out << "    " << std::left << std::setw(30) << id
        << shares(count_if(all, first_is_right), size_of(all)) << '\n';
  }
}

/// With and without torque told apart, and what the torque alone named that is not there.
void print_by_torque(const std::vector<Outcome>& outcomes, std::ostream& out) {
  if (std::none_of(outcomes.begin(), outcomes.end(),
                   [](const Outcome& o) { return o.made.torque; }))
    return;
  for (const bool torque : {true, false}) {
    std::vector<const Outcome*> singles, clean;
    for (const Outcome& o : outcomes) {
      if (o.made.torque != torque) continue;
      if (o.kind == Kind::kSingle) singles.push_back(&o);
      if (o.kind == Kind::kClean) clean.push_back(&o);
    }
    const auto alone = [](const Outcome& o) { return first_is_right(o) && o.named().size() == 1; };
    out << (torque ? "with" : "without") << " torque: named first "
        << shares(count_if(singles, first_is_right), size_of(singles)) << ", and nothing else "
        << shares(count_if(singles, alone), size_of(singles)) << "; false alarms "
        << shares(count_if(clean, [](const Outcome& o) { return !o.named().empty(); }),
                  size_of(clean))
        << '\n';
  }
  std::map<std::string, int> wrong;
  int right = 0, all = 0;
  for (const Outcome& o : outcomes) {
    for (const NamedCause& cause : o.named()) {
      if (!cause.by_torque) continue;
      ++all;
      o.made.hides(cause.id) ? ++right : ++wrong[cause.id];
    }
  }
  out << "causes named by torque alone: right   " << shares(right, all);
  for (const auto& [id, count] : wrong) out << ", wrong " << id << ' ' << count;
  out << '\n';
}

void print_clean(const std::vector<const Outcome*>& clean, std::ostream& out) {
  if (clean.empty()) return;
  const int alarms = count_if(clean, [](const Outcome& o) { return !o.named().empty(); });
  out << "clean machines: false alarms         " << shares(alarms, size_of(clean))
      << ", 95 % below " << std::fixed << std::setprecision(1)
      << 100.0 * upper_bound(alarms, size_of(clean)) << " %\n"
      << "  called unexplained                 "
      << shares(count_if(clean, [](const Outcome& o) { return o.first() == "unexplained"; }),
                size_of(clean))
      << '\n';
}

void print_pairs(const std::vector<const Outcome*>& pairs, std::ostream& out) {
  if (pairs.empty()) return;
  const auto found = [](const Outcome& o) {
    return std::count_if(o.made.hidden.begin(), o.made.hidden.end(),
                         [&](const Truth& truth) { return find(o, truth.id) != nullptr; });
  };
  out << "pairs: both named                    "
      << shares(count_if(pairs, [&](const Outcome& o) { return found(o) == 2; }), size_of(pairs))
      << '\n'
      << "  one of them                        "
      << shares(count_if(pairs, [&](const Outcome& o) { return found(o) == 1; }), size_of(pairs))
      << '\n';
}

void print_calibration(const std::vector<Outcome>& outcomes, std::ostream& out) {
  constexpr std::array<double, 8> kEdges{0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9};
  struct Bin {
    int count = 0, right = 0;
    double confidence = 0.0;
  };
  std::array<Bin, kEdges.size() - 1> bins{};
  int all = 0;
  for (const Outcome& o : outcomes) {
    if (o.kind == Kind::kOutside || o.kind == Kind::kChanged) continue;
    for (const NamedCause& cause : o.named()) {
      const auto above = std::upper_bound(kEdges.begin() + 1, kEdges.end() - 1, cause.confidence);
      Bin& bin = bins[static_cast<std::size_t>(above - kEdges.begin()) - 1];
      ++bin.count;
      ++all;
      bin.confidence += cause.confidence;
      bin.right += o.kind != Kind::kBlind && o.made.hides(cause.id);
    }
  }
  if (all == 0) return;
  double error = 0.0;
  out << "mean confidence of named causes, and how many of them were right\n";
  for (const Bin& bin : bins) {
    if (bin.count == 0) continue;
    error += std::abs(bin.confidence - bin.right) / all;
    out << "    " << std::fixed << std::setprecision(2) << bin.confidence / bin.count << "   "
        << shares(bin.right, bin.count) << '\n';
  }
  out << "  expected calibration error         " << std::setprecision(3) << error << '\n';
}

/// Explained share (before^2 - after^2) / (before^2 - noise^2) of cases whose error exceeds the
/// noise.
void print_explained(const std::vector<const Outcome*>& singles, std::ostream& out) {
  std::vector<double> share;
  double sum = 0.0;
  for (const Outcome* o : singles) {
    const double before = o->answer.before_rms, after = o->answer.after_rms;
    const double noise = o->made.noise_rms;
    if (!o->answer.failure.empty() || before < 1.5 * noise) continue;
    share.push_back((before * before - after * after) / (before * before - noise * noise));
    sum += std::clamp(share.back(), 0.0, 1.0);
  }
  if (share.empty()) return;
  out << "explained share of the excess        median " << std::fixed << std::setprecision(3)
      << quantile(share, 0.5) << ", mean " << sum / static_cast<double>(share.size())
      << ", 10 % quantile " << quantile(share, 0.1) << " (" << share.size() << " cases)\n";
}

void print_parameters(const std::vector<const Outcome*>& singles, std::ostream& out) {
  std::map<std::string, std::vector<double>> errors;
  for (const Outcome* o : singles) {
    const Truth& truth = o->made.hidden.front();
    const NamedCause* named = find(*o, truth.id);
    if (named == nullptr) continue;
    for (const auto& [key, value] : truth.parameters) {
      const auto found = named->parameters.find(key);
      if (found == named->parameters.end()) continue;
      // Errors of times are absolute in seconds, all others are relative.
      const double scale = key == "time_s" ? 1.0 : std::abs(value);
      errors[truth.id + ' ' + key].push_back(std::abs(found->second - value) / scale);
    }
  }
  if (errors.empty()) return;
  out << "errors of the parameters, median (relative; time_s in s)\n";
  for (const auto& [key, all] : errors) {
    out << "    " << std::left << std::setw(46) << key << std::setprecision(3) << std::defaultfloat
        << quantile(all, 0.5) << "   (" << all.size() << ")\n";
  }
}

void print_time(const std::vector<Outcome>& outcomes, std::ostream& out) {
  std::vector<double> seconds, wall;
  int failed = 0;
  for (const Outcome& o : outcomes) {
    if (!o.answer.failure.empty()) {
      ++failed;
      continue;
    }
    seconds.push_back(o.answer.seconds);
    wall.push_back(o.answer.wall_seconds);
  }
  out << std::fixed << std::setprecision(2) << "time of a diagnosis, CPU             median "
      << quantile(seconds, 0.5) << " s, 90 % " << quantile(seconds, 0.9) << " s; wall time "
      << quantile(wall, 0.5) << " s\n"
      << "failed                               "
      << shares(failed, static_cast<int>(outcomes.size())) << '\n';
}

void print_confusion(const std::vector<const Outcome*>& singles, std::ostream& out) {
  std::map<std::string, std::map<std::string, int>> rows;
  for (const Outcome* o : singles) ++rows[o->made.hidden.front().id][o->first()];
  if (rows.empty()) return;
  out << "confusions: hidden, and what was named first\n";
  for (const auto& [id, answers] : rows) {
    std::vector<std::pair<int, std::string>> sorted;
    for (const auto& [answer, count] : answers) sorted.emplace_back(-count, answer);
    std::sort(sorted.begin(), sorted.end());
    out << "    " << std::left << std::setw(30) << id;
    for (const auto& [count, answer] : sorted) out << ' ' << answer << ' ' << -count << ',';
    out << '\n';
  }
}

/// An effect outside the catalogue must not be named as another cause with high confidence.
void print_outside(const std::vector<const Outcome*>& outside, std::ostream& out) {
  if (outside.empty()) return;
  const auto unexplained = [](const Outcome& o) {
    return o.first() == "unexplained" || o.answer.verdict == "unexplained";
  };
  const auto unsure = [&](const Outcome& o) {
    const std::vector<NamedCause> all = o.named();
    return !unexplained(o) && !all.empty() &&
           (!all.front().ambiguous_with.empty() || all.front().confidence < 0.5);
  };
  out << "effects outside the catalogue: unexplained "
      << shares(count_if(outside, unexplained), size_of(outside))
      << ", named as ambiguous or with less than 0.5 "
      << shares(count_if(outside, unsure), size_of(outside)) << '\n';
}

/// Changes between two recordings.
void print_changed(const std::vector<const Outcome*>& changed, std::ostream& out) {
  std::vector<const Outcome*> same, moved;
  for (const Outcome* o : changed) (o->made.hidden.empty() ? same : moved).push_back(o);
  if (changed.empty()) return;
  const auto right = [](const Outcome& o) { return o.first() == o.made.hidden.front().id; };
  const auto alone = [&](const Outcome& o) { return right(o) && o.named().size() == 1; };
  out << "changed machines: named first        " << shares(count_if(moved, right), size_of(moved))
      << ", alone " << shares(count_if(moved, alone), size_of(moved)) << '\n'
      << "unchanged machines: a change is named "
      << shares(count_if(same, [](const Outcome& o) { return !o.named().empty(); }), size_of(same))
      << '\n';
}

/// The same for effects that the user left out of the catalogue.
void print_left_out(const std::vector<const Outcome*>& singles,
                    const std::vector<std::string>& left_out, std::ostream& out) {
  for (const std::string& id : left_out) {
    std::vector<const Outcome*> all;
    for (const Outcome* o : singles) {
      if (o->made.hides(id)) all.push_back(o);
    }
    if (all.empty()) continue;
    out << "left out " << id << ": unexplained "
        << shares(count_if(all, [](const Outcome& o) { return o.first() == "unexplained"; }),
                  size_of(all))
        << ", named as ambiguous "
        << shares(count_if(all,
                           [](const Outcome& o) {
                             return !o.named().empty() && !o.named().front().ambiguous_with.empty();
                           }),
                  size_of(all))
        << '\n';
  }
}

}  // namespace

std::vector<NamedCause> Outcome::named() const {
  std::vector<NamedCause> out;
  for (const NamedCause& cause : answer.causes) {
    if (!made.owns(cause.id) || made.hides(cause.id)) out.push_back(cause);
  }
  return out;
}

std::string Outcome::first() const {
  if (!answer.failure.empty()) return "failed";
  const std::vector<NamedCause> all = named();
  if (!all.empty()) return all.front().id;
  return answer.verdict == "unexplained" ? "unexplained" : "none";
}

double upper_bound(int count, int of) {
  if (count >= of) return 1.0;
  // The share for which `count` or fewer are observed with a probability of 5 %.
  const auto at_most = [&](double p) {
    double sum = 0.0;
    for (int k = 0; k <= count; ++k) {
      sum += std::exp(std::lgamma(of + 1.0) - std::lgamma(k + 1.0) - std::lgamma(of - k + 1.0) +
                      k * std::log(p) + (of - k) * std::log1p(-p));
    }
    return sum;
  };
  double low = 1e-12, high = 1.0 - 1e-12;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (at_most(middle) > 0.05 ? low : high) = middle;
  }
  return high;
}

void print_scores(const std::vector<Outcome>& outcomes, const std::vector<std::string>& left_out,
                  std::ostream& out) {
  const auto singles = of_kind(outcomes, Kind::kSingle), faint = of_kind(outcomes, Kind::kFaint),
             blind = of_kind(outcomes, Kind::kBlind);
  print_singles(singles, out);
  print_clean(of_kind(outcomes, Kind::kClean), out);
  print_by_torque(outcomes, out);
  print_pairs(of_kind(outcomes, Kind::kPair), out);
  if (!faint.empty()) {
    out << "faint effects: named first           "
        << shares(count_if(faint, first_is_right), size_of(faint)) << '\n'
        << "  another one                        "
        << shares(
               count_if(faint,
                        [](const Outcome& o) { return !o.named().empty() && !first_is_right(o); }),
               size_of(faint))
        << '\n';
  }
  if (!blind.empty()) {
    out << "effects that are not observable: none named "
        << shares(count_if(blind, [](const Outcome& o) { return o.first() == "none"; }),
                  size_of(blind))
        << '\n';
  }
  print_left_out(singles, left_out, out);
  print_outside(of_kind(outcomes, Kind::kOutside), out);
  print_changed(of_kind(outcomes, Kind::kChanged), out);
  print_calibration(outcomes, out);
  print_explained(singles, out);
  print_parameters(singles, out);
  print_time(outcomes, out);
  print_confusion(singles, out);
}

void print_gaps(const std::vector<Outcome>& outcomes, std::ostream& out) {
  struct Row {
    int cases = 0, represented = 0, right = 0, representation = 0, search = 0, decision = 0;
  };
  std::map<std::string, Row> rows;
  for (const Outcome& o : outcomes) {
    if (!o.gaps) continue;
    const bool represented = o.gaps->represented(o.made.noise_rms), right = first_is_right(o);
    for (const std::string& name : {o.made.hidden.front().id, std::string("~ all")}) {
      Row& row = rows[name];
      ++row.cases;
      row.represented += represented;
      row.right += right;
      row.representation += !right && !represented;
      row.search += !right && represented && !o.gaps->found();
      row.decision += !right && represented && o.gaps->found();
    }
  }
  if (rows.empty()) return;
  out << "effect                       cases  represented  named first  missed by: representation  "
         "search  decision\n";
  for (const auto& [name, row] : rows) {
    out << std::left << std::setw(28) << (name == "~ all" ? "all" : name) << std::right
        << std::setw(6) << row.cases << std::setw(13) << row.represented << std::setw(13)
        << row.right << std::setw(27) << row.representation << std::setw(8) << row.search
        << std::setw(10) << row.decision << '\n';
  }
}

void print_line(const Outcome& o, std::ostream& out) {
  std::ostringstream line;
  line.precision(3);
  line << o.made.name << (o.made.torque ? " torque" : "") << " seed " << o.made.seed << " truth";
  for (const Truth& truth : o.made.hidden) {
    line << ' ' << truth.id << " x" << truth.contribution_rms / o.made.noise_rms << " (";
    for (const auto& [key, value] : truth.parameters) line << ' ' << key << ' ' << value;
    line << " )";
  }
  if (o.made.hidden.empty()) line << " none";
  line << " | " << o.first() << ':';
  for (const NamedCause& cause : o.answer.causes) {
    line << (cause.by_torque ? " by torque " : " ") << cause.id << ' ' << cause.confidence
         << (o.made.owns(cause.id) ? " own" : "");
    for (const std::string& rival : cause.ambiguous_with) line << " or " << rival;
    line << " (";
    for (const auto& [key, value] : cause.parameters) line << ' ' << key << ' ' << value;
    line << " )";
  }
  for (const NamedCause& cause : o.answer.suspected)
    line << " suspected " << (cause.by_torque ? "by torque " : "") << cause.id << ' '
         << cause.confidence << (o.made.owns(cause.id) ? " own" : "");
  line << " | rms " << 1e6 * o.answer.before_rms << " -> " << 1e6 * o.answer.after_rms
       << " um, noise " << 1e6 * o.made.noise_rms << " | " << o.answer.seconds << " s | "
       << o.made.machine;
  if (o.gaps) {
    const auto size = [](double rms) {
      return rms < 1.0 ? std::to_string(1e6 * rms) + " um" : std::string("no fit");
    };
    line << " | true structure " << o.gaps->structure << ": " << size(o.gaps->represented_rms)
         << ", from the screen " << size(o.gaps->searched_rms);
  }
  if (!o.answer.failure.empty()) line << " | failed: " << o.answer.failure;
  out << line.str() << '\n';
}

}  // namespace servotwin::hidden_effects
