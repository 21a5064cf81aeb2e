#include "tests/hidden_effects/answer.h"

#include <chrono>
#include <ctime>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "diagnosis/diagnose.h"
#include "diagnosis/diagnosis_file.h"
#include "drivers/recording_file.h"
#include "identification/segments.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {
namespace {

/// The one place that knows how diagnose is called.
Diagnosis diagnosis_of(const SegmentedAxis& axis, const std::vector<std::string>& leave_out) {
  DiagnoseOptions options;
  options.leave_out = leave_out;
  return diagnose(axis, options);
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
  for (const nlohmann::json& cause : file.at("causes")) {
    NamedCause named;
    named.id = cause.at("id").get<std::string>();
    named.confidence = number(cause.at("confidence"));
    named.ambiguous_with = cause.at("ambiguous_with").get<std::vector<std::string>>();
    for (const auto& [key, value] : cause.at("parameters").items()) {
      if (value.is_number()) named.parameters[key] = value.get<double>();
    }
    answer.causes.push_back(named);
  }
}

}  // namespace

Answer ask(const std::string& csv, const std::vector<std::string>& leave_out) {
  Answer answer;
  try {
    const test::TemporaryDirectory directory;
    const SegmentedAxis axis =
        segment_axis(read_recording(directory.file("recording.csv", csv)), "X");
    const double start = processor_seconds();
    const auto clock = std::chrono::steady_clock::now();
    const Diagnosis diagnosis = diagnosis_of(axis, leave_out);
    answer.seconds = processor_seconds() - start;
    answer.wall_seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - clock).count();
    read(to_json(diagnosis, ""), answer);
  } catch (const std::exception& error) {
    answer.failure = error.what();
  }
  return answer;
}

}  // namespace servotwin::hidden_effects
