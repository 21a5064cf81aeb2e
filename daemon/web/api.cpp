#include "daemon/web/api.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string_view>

#include "daemon/between/clock.h"
#include "daemon/publish/status_figures.h"
#include "daemon/store/report_file.h"
#include "daemon/web/live_json.h"
#include "daemon/web/page.h"
#include "drivers/common/text.h"
#include "identification/model/json_number.h"
#include "identification/model/model_file.h"

namespace servotwin::daemon {
namespace {

using nlohmann::json;

constexpr std::string_view kPrograms = "/api/v1/programs/";
constexpr int kMaxVersions = 1000, kMaxDiagnoses = 1000, kMaxEvents = 10'000;

/// What the index names; where it leads is in get() and change().
struct IndexedPath {
  const char *method, *path, *what;
};
constexpr IndexedPath kIndex[] = {
    {"GET", "/healthz", "whether the daemon works, with its problems"},
    {"GET", "/metrics", "metrics for Prometheus"},
    {"GET", "/api/v1", "this index"},
    {"GET", "/api/v1/status", "counters, versions, alarms, and the errors of the last second"},
    {"GET", "/api/v1/models", "the model in force of every axis"},
    {"GET", "/api/v1/models/AXIS", "versions of the model of an axis, newest first (?most=100)"},
    {"GET", "/api/v1/diagnoses/AXIS", "diagnoses of an axis, newest first (?most=10)"},
    {"POST", "/api/v1/diagnoses/AXIS", "requests a diagnosis"},
    {"GET", "/api/v1/report/AXIS", "the last diagnosis as a page"},
    {"GET", "/api/v1/events", "events, newest first (?most=100)"},
    {"GET", "/api/v1/offsets", "whether offsets are live and armed"},
    {"POST", "/api/v1/offsets/arm", "arms live offsets"},
    {"POST", "/api/v1/offsets/disarm", "disarms live offsets"},
    {"GET", "/api/v1/programs", "the programs and what is learned of them"},
    {"PUT", "/api/v1/programs/NAME", "puts a program, a commanded path as CSV, and has it learned"},
    {"DELETE", "/api/v1/programs/NAME", "removes a program and its correction"},
    {"GET", "/api/v1/stream", "the live stream (server-sent events)"},
};

json index_json() {
  json paths = json::array();
  for (const auto& [method, path, what] : kIndex)
    paths.push_back({{"path", path}, {"method", method}, {"what", what}});
  return {{"schema", "servotwin.index/1"}, {"paths", paths}};
}

/// A wrong request, with the HTTP status of the answer and, where it has one, a header field.
struct Refused : std::runtime_error {
  Refused(int the_status, const std::string& what) : std::runtime_error(what), status(the_status) {}
  int status;
  std::vector<std::pair<std::string, std::string>> headers;
};

/// The answer that `make` gives, or that to what it throws.
template <class Make>
HttpResponse answer_of(const Make& make) {
  try {
    return make();
  } catch (const Refused& refused) {
    HttpResponse out = http_error(refused.status, refused.what());
    out.headers = refused.headers;
    return out;
  } catch (const std::exception& error) {
    return http_error(500, error.what());
  }
}

/// In one line; a name that is no UTF-8 does not make the answer fail.
std::string text_of(const json& body) {
  return body.dump(-1, ' ', false, json::error_handler_t::replace);
}

HttpResponse answer_json(const json& body, int status = 200) {
  return {status, "application/json", text_of(body) + "\n"};
}

/// The whole number `name` of the query, 1 to `most`; `otherwise` if it is not given.
int whole_number(const HttpRequest& request, const std::string& name, int otherwise, int most) {
  const auto found = request.query.find(name);
  if (found == request.query.end()) return otherwise;
  const std::string& text = found->second;
  int value = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  if (read.ec != std::errc{} || read.ptr != text.data() + text.size() || value < 1 || value > most)
    throw Refused(400, name + " = " + in_quotes(text) + ": must be a whole number from 1 to " +
                           std::to_string(most));
  return value;
}

void know_only(const HttpRequest& request, const std::vector<std::string>& names) {
  for (const auto& [name, value] : request.query) {
    if (std::find(names.begin(), names.end(), name) == names.end())
      throw Refused(400, "there is no parameter " + in_quotes(name) +
                             (names.empty() ? std::string() : did_you_mean(name, names)));
  }
}

HttpResponse page_file(const HttpRequest& request, const PageFile& file) {
  HttpResponse out{200, std::string(file.type), {}};
  out.headers = {{"ETag", std::string(file.tag)}, {"Cache-Control", "no-cache"}};
  if (request.if_none_match == file.tag) {
    out.status = 304;
  } else {
    out.body = file.content;
  }
  return out;
}

/// Compares in constant time, wherever the texts differ.
bool same_secret(const std::string& a, const std::string& b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < a.size(); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^
                  static_cast<unsigned char>(b.empty() ? 0 : b[i % b.size()]);
  return difference == 0;
}

json version_json(const StoredModel& model) {
  const ModelRecord& record = model.record;
  json out = to_json(record);
  return {{"version", record.version}, {"parent", record.parent}, {"created", record.created},
          {"reason", model.reason},    {"fit", out["fit"]},       {"loop", out["loop"]},
          {"effects", out["effects"]}};
}

/// A diagnosis as it was published, with time and reason.
json diagnosis_json(const StoredDiagnosis& diagnosis) {
  json out{{"time", diagnosis.time}, {"reason", diagnosis.reason}, {"verdict", diagnosis.verdict}};
  out["diagnosis"] = json::parse(diagnosis.json);
  return out;
}

/// The rest of `path` after `prefix` if it is a single name; nothing otherwise.
std::optional<std::string> rest(const std::string& path, std::string_view prefix) {
  if (!path.starts_with(prefix) || path.size() == prefix.size()) return std::nullopt;
  std::string name = path.substr(prefix.size());
  if (name.find('/') != name.npos) return std::nullopt;
  return name;
}

std::vector<std::string> names_of(const std::vector<AxisDescription>& axes) {
  std::vector<std::string> out;
  for (const AxisDescription& axis : axes) out.push_back(axis.name);
  return out;
}

/// The index of an axis; throws if there is no such axis. Names are used in file names, so they
/// must be checked.
std::size_t number_of(const std::string& axis, const MachineDescription& machine) {
  const std::vector<std::string> names = names_of(machine.axes);
  const auto found = std::find(names.begin(), names.end(), axis);
  if (found == names.end())
    throw Refused(
        404, "there is no axis " + in_quotes(axis) +
                 (names.empty() ? "; no machine is known yet" : "; there are " + listed(names)));
  return static_cast<std::size_t>(found - names.begin());
}

const char* name_of(ProgramState::What what) {
  switch (what) {
    case ProgramState::What::kWaiting:
      return "waiting";
    case ProgramState::What::kLearning:
      return "learning";
    case ProgramState::What::kLearned:
      return "learned";
    case ProgramState::What::kNotLearned:
      return "not_learned";
    case ProgramState::What::kRecognised:
      return "recognised";
    case ProgramState::What::kRemoved:
      return "removed";
  }
  return "";
}

int status_of(ProgramInbox::Outcome::What what) {
  switch (what) {
    case ProgramInbox::Outcome::What::kDone:
      return 202;
    case ProgramInbox::Outcome::What::kRefused:
      return 400;
    case ProgramInbox::Outcome::What::kNotThere:
      return 404;
    case ProgramInbox::Outcome::What::kFailed:
      return 500;
  }
  return 500;
}

json repeats_json(const std::optional<MotionRepeats>& repeats) {
  if (!repeats) return nullptr;
  return {{"programs", repeats->programs},
          {"repetitions", repeats->repetitions},
          {"shortest_period_s", repeats->shortest_period_s},
          {"longest_period_s", repeats->longest_period_s}};
}

json arming_json(Arming* arming) {
  return {{"live", arming != nullptr && arming->live()},
          {"armed", arming != nullptr && arming->armed()}};
}

}  // namespace

HttpResponse Api::answer(const HttpRequest& request) {
  const bool reads = request.method == "GET" || request.method == "HEAD";
  return answer_of([&] { return reads ? get(request) : change(request); });
}

std::optional<HttpResponse> Api::refuse_body(const HttpRequest& request) {
  const auto program = rest(request.path, kPrograms);
  HttpResponse refused = answer_of([&] {
    if (request.method != "PUT" || !program)
      throw Refused(405, in_quotes(request.path) + " cannot be changed");
    require_permission(request);
    (void)inbox_for(*program);
    return HttpResponse();
  });
  if (refused.status == 200) return std::nullopt;
  return refused;
}

HttpResponse Api::get(const HttpRequest& request) {
  const std::string& path = request.path;
  for (const PageFile& file : page_files()) {
    if (file.path == path) return page_file(request, file);
  }
  if (path == "/api/v1/models") return know_only(request, {}), models();
  if (path == "/api/v1/events") return events(request);
  if (const auto axis = rest(path, "/api/v1/models/")) return versions(*axis, request);
  if (const auto axis = rest(path, "/api/v1/diagnoses/")) return diagnoses(*axis, request);
  if (const auto axis = rest(path, "/api/v1/report/"))
    return know_only(request, {"of"}), report(*axis);
  know_only(request, {});
  if (path == "/healthz") return healthz();
  if (path == "/api/v1" || path == "/api/v1/") return answer_json(index_json());
  if (path == "/metrics") return metrics();
  if (path == "/api/v1/status") return {200, "application/json", status() + "\n"};
  if (path == "/api/v1/offsets") return offsets();
  if (path == "/api/v1/programs") return programs();
  if (path == "/api/v1/stream") {
    HttpResponse out;
    out.stream = true;
    return out;
  }
  return http_error(404, "there is nothing at " + in_quotes(path));
}

HttpResponse Api::change(const HttpRequest& request) {
  const bool posts = request.method == "POST";
  const auto axis = rest(request.path, "/api/v1/diagnoses/");
  const auto program = rest(request.path, kPrograms);
  const bool arms = request.path == "/api/v1/offsets/arm";
  const bool disarms = request.path == "/api/v1/offsets/disarm";
  if (!(posts ? axis || arms || disarms : program.has_value()))
    throw Refused(405, in_quotes(request.path) + " cannot be changed" +
                           (posts ? "" : " by " + request.method));
  require_permission(request);
  know_only(request, {});
  if (program) return change_program(*program, request);
  return axis ? ask(*axis) : arm(arms);
}

void Api::require_permission(const HttpRequest& request) const {
  if (sources_.token.empty())
    throw Refused(
        403,
        "nothing can be changed over HTTP: neither http.token nor http.token_file is configured");
  if (same_secret(request.authorization, "Bearer " + sources_.token)) return;
  Refused refused(401, "needs Authorization: Bearer with the http.token");
  refused.headers.emplace_back("WWW-Authenticate", "Bearer");
  throw refused;
}

HttpResponse Api::healthz() {
  const std::vector<std::string> problems = sources_.health.problems(steady_ns());
  return answer_json({{"schema", "servotwin.health/1"},
                      {"status", problems.empty() ? "ok" : "ill"},
                      {"problems", problems},
                      {"notes", sources_.health.notes()}},
                     problems.empty() ? 200 : 503);
}

HttpResponse Api::metrics() {
  MetricsInput now = sources_.now();
  const StoreCheck::Seen store = sources_.health.store(steady_ns());
  now.healthy = sources_.health.problems(steady_ns()).empty();
  now.store_lost = !sources_.health.notes().empty();
  now.store_damaged = !store.damage.empty();
  now.recordings_bytes = store.recordings_bytes;
  now.recordings_files = store.recordings_files;
  return {200, "text/plain; version=0.0.4; charset=utf-8", metrics_text(now)};
}

std::string Api::status() {
  const MetricsInput now = sources_.now();
  json out = status_json(now.live, now.description, now.alarms);
  if (now.published != nullptr) out["publish_octaves"] = octaves_json(*now.published);
  out["machine"] = now.machine;
  out["version"] = now.version;
  out["uptime_s"] = now.uptime_s;
  out["silent_s"] = number_or_null(now.silent_s);
  out["offsets"] = arming_json(sources_.arming());
  const auto inbox = sources_.programs();
  out["repeats"] = repeats_json(inbox == nullptr ? std::nullopt : inbox->list().repeats());
  return text_of(out);
}

HttpResponse Api::models() {
  json axes = json::array();
  for (const StoredModel& model : sources_.store.in_force()) {
    axes.push_back(version_json(model));
    axes.back()["axis"] = model.record.axis;
  }
  return answer_json(
      {{"schema", "servotwin.models/1"}, {"machine", sources_.machine}, {"axes", axes}});
}

HttpResponse Api::versions(const std::string& axis, const HttpRequest& request) {
  know_only(request, {"most"});
  const int most = whole_number(request, "most", 100, kMaxVersions);
  number_of(axis, sources_.now().description);
  json versions = json::array();
  for (const StoredModel& model : sources_.store.versions(axis, most))
    versions.push_back(version_json(model));
  return answer_json({{"schema", "servotwin.versions/1"}, {"axis", axis}, {"versions", versions}});
}

HttpResponse Api::diagnoses(const std::string& axis, const HttpRequest& request) {
  know_only(request, {"most"});
  const int most = whole_number(request, "most", 10, kMaxDiagnoses);
  number_of(axis, sources_.now().description);
  json diagnoses = json::array();
  for (const StoredDiagnosis& diagnosis : sources_.store.diagnoses(axis, most))
    diagnoses.push_back(diagnosis_json(diagnosis));
  return answer_json(
      {{"schema", "servotwin.diagnoses/1"}, {"axis", axis}, {"diagnoses", diagnoses}});
}

HttpResponse Api::events(const HttpRequest& request) {
  know_only(request, {"most"});
  const int most = whole_number(request, "most", 100, kMaxEvents);
  json events = json::array();
  for (const Event& event : sources_.store.events(most)) {
    json detail;
    if (!event.detail.empty()) detail = json::parse(event.detail, nullptr, false);
    events.push_back({{"time", event.time},
                      {"axis", event.axis},
                      {"kind", event.kind},
                      {"text", event.text},
                      {"detail", detail.is_discarded() ? json(event.detail) : detail}});
  }
  return answer_json({{"schema", "servotwin.events/1"}, {"events", events}});
}

HttpResponse Api::report(const std::string& axis) {
  number_of(axis, sources_.now().description);
  const std::optional<std::string> html =
      read_report(sources_.store.directory(), sources_.machine, axis);
  if (!html) return http_error(404, "axis " + in_quotes(axis) + " has not been diagnosed yet");
  HttpResponse out{200, "text/html; charset=utf-8", *html};
  // The report is shown inside the page; it has an inline style and loads nothing.
  out.headers = {{"Content-Security-Policy",
                  "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action "
                  "'none'; frame-ancestors 'self'"},
                 {"X-Frame-Options", "SAMEORIGIN"}};
  return out;
}

HttpResponse Api::ask(const std::string& axis) {
  if (!sources_.ask_diagnosis(number_of(axis, sources_.now().description)))
    throw Refused(409, "no machine is known yet");
  return answer_json({{"schema", "servotwin.request/1"},
                      {"axis", axis},
                      {"text", "a diagnosis is made as soon as there is enough motion"}},
                     202);
}

HttpResponse Api::offsets() {
  json out = arming_json(sources_.arming());
  out["schema"] = "servotwin.offsets/1";
  return answer_json(out);
}

HttpResponse Api::arm(bool wanted) {
  Arming* arming = sources_.arming();
  if (arming == nullptr) throw Refused(409, "no machine is known yet");
  if (!wanted) {
    arming->disarm();
  } else if (const std::string why = arming->arm(); !why.empty()) {
    throw Refused(409, why);
  }
  return offsets();
}

HttpResponse Api::programs() {
  json programs = json::array();
  if (const auto inbox = sources_.programs()) {
    for (const auto& [program, state] : inbox->list().states())
      programs.push_back({{"program", program},
                          {"state", name_of(state.what)},
                          {"revision", state.revision},
                          {"text", state.text}});
  }
  return answer_json({{"schema", "servotwin.programs/1"}, {"programs", programs}});
}

std::shared_ptr<ProgramInbox> Api::inbox_for(const std::string& name) const {
  if (!usable_name(name))
    throw Refused(400, "program = " + in_quotes(name) + ": " + std::string(kUsableNameRule));
  std::shared_ptr<ProgramInbox> inbox = sources_.programs();
  if (inbox == nullptr) throw Refused(409, "no machine is known yet");
  if (!inbox->has_folder())
    throw Refused(409,
                  "there is no folder for programs: configure ilc.programs and restart the daemon");
  if (slow_.busy()) throw Refused(503, "another program is being put or removed; try again later");
  return inbox;
}

HttpResponse Api::change_program(const std::string& name, const HttpRequest& request) {
  const std::shared_ptr<ProgramInbox> inbox = inbox_for(name);
  const std::shared_ptr<const std::string> csv = request.body;
  const bool puts = request.method == "PUT";
  return slow_.begin([inbox, name, csv, puts] {
    return answer_of([&] {
      const ProgramInbox::Outcome outcome = !puts            ? inbox->remove(name)
                                            : csv == nullptr ? inbox->accept(name)
                                                             : inbox->put(name, *csv);
      if (outcome.what != ProgramInbox::Outcome::What::kDone)
        throw Refused(status_of(outcome.what), outcome.text);
      return answer_json(
          {{"schema", "servotwin.request/1"}, {"program", name}, {"text", outcome.text}}, 202);
    });
  });
}

}  // namespace servotwin::daemon
