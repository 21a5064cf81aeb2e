#include "tests/hidden_effects/answer.h"

#include <chrono>
#include <ctime>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/search/comparison.h"
#include "diagnosis/search/diagnose.h"
#include "diagnosis/torque/torque.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/segments.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {
namespace {

SegmentedAxis axis_of(const std::string& csv) {
  const test::TemporaryDirectory directory;
  return segment_axis(read_recording(directory.file("recording.csv", csv)), "X");
}

double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double number(const nlohmann::json& value) { return value.is_number() ? value.get<double>() : 0.0; }

void read(const nlohmann::json& file, Answer& answer) {
  answer.verdict = file.at("verdict").get<std::string>();
  answer.before_rms = number(file.at("baseline").at("rms_m"));
  answer.after_rms = number(file.at("extended").at("rms_m"));
  const auto one = [](const nlohmann::json& cause) {
    NamedCause named;
    named.id = cause.at("id").get<std::string>();
    named.confidence = number(cause.at("confidence"));
    named.ambiguous_with = cause.at("ambiguous_with").get<std::vector<std::string>>();
    named.by_torque = !cause.contains("gain") || cause["gain"]["holdout_rms_before_m"].is_null();
    if (!cause.contains("parameters")) return named;
    for (const auto& [key, value] : cause["parameters"].items()) {
      if (value.is_number()) named.parameters[key] = value.get<double>();
    }
    return named;
  };
  for (const nlohmann::json& cause : file.at("causes")) answer.causes.push_back(one(cause));
  for (const nlohmann::json& cause : file.at("suspected")) answer.suspected.push_back(one(cause));
}

/// Calls `diagnosis`, measures its time, and reads its result.
template <class Diagnosing>
Answer answer_of(const Diagnosing& diagnosis) {
  Answer answer;
  const double start = processor_seconds();
  const auto clock = std::chrono::steady_clock::now();
  const nlohmann::json result = diagnosis();
  answer.seconds = processor_seconds() - start;
  answer.wall_seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - clock).count();
  read(result, answer);
  return answer;
}

Answer failed(const std::exception& error) {
  Answer answer;
  answer.failure = error.what();
  return answer;
}

}  // namespace

Answer ask(const std::string& csv, const std::vector<std::string>& leave_out) {
  try {
    const SegmentedAxis axis = axis_of(csv);
    DiagnoseOptions options;
    options.leave_out = leave_out;
    return answer_of([&] {
      Diagnosis diagnosis = diagnose(axis, options);
      if (!has_torque(axis)) return to_json(diagnosis, "");
      TorqueDiagnosis torque = diagnose_torque(axis, options);
      heed(torque, diagnosis);
      nlohmann::json file = to_json(diagnosis, "");
      add_torque(file, torque);
      return file;
    });
  } catch (const std::exception& error) {
    return failed(error);
  }
}

Answer ask_what_changed(const std::string& before_csv, const std::string& after_csv) {
  try {
    const ModelRecord earlier = diagnose(axis_of(before_csv)).extended;
    const SegmentedAxis axis = axis_of(after_csv);
    return answer_of([&] { return to_json(compare(axis, earlier), ""); });
  } catch (const std::exception& error) {
    return failed(error);
  }
}

}  // namespace servotwin::hidden_effects
