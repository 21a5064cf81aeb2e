// hidden_effects [dev|test]: hides effects in recordings, diagnoses them, and prints how often the
// diagnosis was right. `--help` lists the options.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "identification/least_squares/parallel.h"
#include "tests/hidden_effects/by_torque.h"
#include "tests/hidden_effects/changes.h"
#include "tests/hidden_effects/floors.h"
#include "tests/hidden_effects/score.h"

namespace {

using namespace servotwin::hidden_effects;

struct Options {
  std::string part = "dev";
  int cases = 4, clean = 20, pairs = 20, faint = 1, blind = 2, outside = 0, changed = 0, first = 0;
  std::vector<std::string> effects;
  std::vector<std::string> leave_out;
  int jobs = 1, floor = 0, by_torque = 0;
  bool gaps = false;
  Class size = Class::kClear;
  Recorded recorded = Torque::kHalf;
  std::string list, write;
};

struct Job {
  Kind kind;
  std::function<Case()> make;
  std::string left_out = {};            ///< of the catalogue, in addition to the options
  std::function<Outcome()> whole = {};  ///< if set, called instead of all this
};

/// A machine before and after a change, and the changes that the comparison names.
Outcome changed_outcome(Part part, const std::string& id, int index) {
  const ChangedMachine machine = changed_machine(part, id, index);
  Outcome out;
  out.kind = Kind::kChanged;
  out.made.name = "changed-" + (id.empty() ? "nothing" : id) + '/' + std::to_string(index);
  out.made.own = machine.own;
  out.made.noise_rms = machine.noise_rms;
  out.made.machine = machine.machine;
  if (!id.empty()) out.made.hidden.push_back({.id = id, .parameters = {{"ratio", machine.ratio}}});
  out.answer = ask_what_changed(machine.before_csv, machine.after_csv);
  return out;
}

std::vector<Job> jobs_of(const Options& options) {
  const Part part = options.part == "dev" ? Part::kDev : Part::kTest;
  const auto wanted = [&](const std::string& id) {
    return options.effects.empty() ||
           std::find(options.effects.begin(), options.effects.end(), id) != options.effects.end();
  };
  std::vector<Job> out;
  const auto add = [&](Kind kind, int count, const std::function<Case(int)>& make) {
    for (int i = options.first; i < options.first + count; ++i) {
      out.push_back({kind, [=] { return make(i); }});
    }
  };
  for (const std::string& id : effect_ids()) {
    if (!wanted(id)) continue;
    add(Kind::kSingle, options.cases,
        [=, &options](int i) { return single_case(part, id, options.size, i, options.recorded); });
    add(Kind::kFaint, options.faint,
        [=, &options](int i) { return single_case(part, id, Class::kFaint, i, options.recorded); });
  }
  for (const std::string& id : effect_ids()) {
    if (!wanted(id)) continue;
    for (int i = options.first; i < options.first + options.outside; ++i)
      out.push_back(
          {Kind::kOutside,
           [=, &options] { return single_case(part, id, Class::kClear, i, options.recorded); },
           id});
  }
  for (const std::string& id : blind_ids()) {
    if (wanted(id))
      add(Kind::kBlind, options.blind,
          [=, &options](int i) { return blind_case(part, id, i, options.recorded); });
  }
  std::vector<std::string> changes = change_ids();
  changes.emplace_back();
  for (const std::string& id : changes) {
    for (int i = options.first; i < options.first + options.changed; ++i)
      out.push_back({Kind::kChanged, {}, {}, [=] { return changed_outcome(part, id, i); }});
  }
  add(Kind::kPair, options.pairs,
      [=, &options](int i) { return pair_case(part, i, options.recorded); });
  add(Kind::kClean, options.clean,
      [=, &options](int i) { return clean_case(part, i, options.recorded); });
  return out;
}

/// Writes the recording and a text file with the effects hidden in it.
void write(const Case& made, const std::filesystem::path& directory) {
  std::string name = made.name;
  std::replace(name.begin(), name.end(), '/', '-');
  std::ofstream(directory / (name + ".csv")) << made.csv;
  Outcome truth;
  truth.made = made;
  std::ofstream note(directory / (name + ".txt"));
  print_line(truth, note);
}

std::vector<Outcome> run(const Options& options) {
  const std::vector<Job> jobs = jobs_of(options);
  std::vector<Outcome> outcomes(jobs.size());
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr failure;
  std::size_t done = 0;
  std::ofstream list;
  if (!options.list.empty()) {
    list.open(options.list);
    if (!list) throw std::runtime_error("cannot write " + options.list);
  }
  const auto work = [&] {
    for (std::size_t i; (i = next++) < jobs.size();) {
      try {
        Outcome& outcome = outcomes[i];
        if (jobs[i].whole) {
          outcome = jobs[i].whole();
          const std::scoped_lock lock(mutex);
          if (list.is_open()) print_line(outcome, list), list.flush();
          continue;
        }
        outcome.kind = jobs[i].kind;
        outcome.made = jobs[i].make();
        if (!options.write.empty()) write(outcome.made, options.write);
        std::vector<std::string> left_out = options.leave_out;
        if (!jobs[i].left_out.empty()) left_out.push_back(jobs[i].left_out);
        outcome.answer = ask(outcome.made.csv, left_out);
        if (options.gaps && outcome.kind == Kind::kSingle) outcome.gaps = gaps_of(outcome.made);
        outcome.made.csv = {};
        const std::scoped_lock lock(mutex);
        if (list.is_open()) print_line(outcome, list), list.flush();
        if (isatty(STDERR_FILENO)) std::cerr << '\r' << ++done << " of " << jobs.size();
      } catch (...) {
        const std::scoped_lock lock(mutex);
        failure = std::current_exception();
        next = jobs.size();
      }
    }
  };
  std::vector<std::jthread> others;
  for (int i = 1; i < options.jobs; ++i) others.emplace_back(work);
  work();
  others.clear();  // waits for them
  if (isatty(STDERR_FILENO)) std::cerr << '\n';
  if (failure) std::rethrow_exception(failure);
  return outcomes;
}

/// The noise floors of that many machines.
void print_noise_floors(const Options& options) {
  const Part part = options.part == "dev" ? Part::kDev : Part::kTest;
  std::vector<FloorOfCase> floors;
  for (int i = 0; i < options.floor; ++i) {
    const Case made = case_of_floor(part, options.first + i);
    if (!options.write.empty()) write(made, options.write);
    floors.push_back(floor_of(made));
  }
  print_floors(floors, std::cout);
}

/// What the torque alone names on that many machines of every effect, and five times as many clean
/// ones.
void print_causes_by_torque(const Options& options) {
  const Part part = options.part == "dev" ? Part::kDev : Part::kTest;
  constexpr int kCleanPerCase = 5;
  std::vector<CauseByTorque> named;
  const auto take = [&](const Case& made) {
    for (CauseByTorque& one : named_by_torque(made)) named.push_back(std::move(one));
  };
  for (int i = options.first; i < options.first + options.by_torque; ++i) {
    for (const std::string& id : options.effects.empty() ? effect_ids() : options.effects)
      take(single_case(part, id, options.size, i, Torque::kAll));
  }
  const int clean = kCleanPerCase * options.by_torque;
  for (int i = options.first; i < options.first + clean; ++i)
    take(clean_case(part, i, Torque::kAll));
  print_by_torque(named, std::cout);
}

int run(int argc, char** argv) {
  CLI::App app{"Hides effects in recordings and counts how often the diagnosis names them."};
  Options options;
  const auto count = CLI::Range(0, 100'000);
  app.add_option("part", options.part, "dev: for development; test: for measurements")
      ->check(CLI::IsMember({"dev", "test"}));
  app.add_option("--cases", options.cases, "clear cases of every effect")->check(count);
  app.add_option("--size", options.size,
                 "of these: clear (default), or large: at least 50 times the noise")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Class>{{"clear", Class::kClear}, {"large", Class::kLarge}}));
  app.add_option("--clean", options.clean, "clean machines")->check(count);
  app.add_option("--pairs", options.pairs, "machines with two effects")->check(count);
  app.add_option("--faint", options.faint, "faint cases of every effect")->check(count);
  app.add_option("--blind", options.blind,
                 "cases of every effect that can be unobservable, where it is")
      ->check(count);
  app.add_option("--outside", options.outside,
                 "clear cases of every effect, with the effect left out of the catalogue")
      ->check(count);
  app.add_option("--changed", options.changed,
                 "machines before and after a change, for every kind of change")
      ->check(count);
  app.add_option("--first", options.first, "index of the first case of every kind")->check(count);
  app.add_option("--effect", options.effects, "effects of the cases with one effect (default: all)")
      ->delimiter(',')
      ->check(CLI::IsMember(effect_ids()));
  app.add_option("--leave-out", options.leave_out, "effects left out of the catalogue")
      ->delimiter(',');
  app.add_option("--jobs", options.jobs, "number of cases diagnosed at the same time")
      ->check(CLI::Range(1, 256));
  app.add_flag("--gaps", options.gaps,
               "for every clear case also: does the twin represent it, does the search find it");
  app.add_option("--floor", options.floor,
                 "instead: the noise floors found on so many machines of all kinds")
      ->check(count);
  app.add_option("--by-torque", options.by_torque,
                 "instead: how often what the torque alone names is there, on so many machines of "
                 "every effect and five times as many clean ones")
      ->check(count);
  app.add_option("--torque", options.recorded.torque,
                 "recordings that contain the torque: none, half (default) or all")
      ->transform(CLI::CheckedTransformer(std::map<std::string, Torque>{
          {"none", Torque::kNone}, {"half", Torque::kHalf}, {"all", Torque::kAll}}));
  app.add_flag("--motor-encoder", options.recorded.motor,
               "recordings of an encoder at the load also contain that of the motor");
  app.add_flag("--windups", options.recorded.windups,
               "at its force limit the control treats its integrator in one of three ways");
  app.add_flag("--filtered", options.recorded.filtered,
               "the control of every machine has a filter or a current loop that lags");
  app.add_option("--list", options.list, "file for one line about every case");
  app.add_option("--write", options.write, "directory for the recordings and their hidden effects");
  CLI11_PARSE(app, argc, argv);
  if (!options.write.empty()) std::filesystem::create_directories(options.write);
  if (options.floor > 0) {
    print_noise_floors(options);
    return 0;
  }
  if (options.by_torque > 0) {
    print_causes_by_torque(options);
    return 0;
  }
  const std::vector<Outcome> outcomes = run(options);
  print_scores(outcomes, options.leave_out, std::cout);
  print_gaps(outcomes, std::cout);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    servotwin::keep_freed_memory();
    return run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "hidden_effects: %s\n", error.what());
    return 1;
  }
}
