// The HTTP endpoints: the page, /healthz, /metrics and /api/v1 (docs/reference.md).
//
// Every JSON document has a schema. A request that cannot be answered gets a servotwin.error/1 with
// the reason. One thread.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/correct/arming.h"
#include "daemon/correct/program_inbox.h"
#include "daemon/record/residual_watch.h"
#include "daemon/store/store.h"
#include "daemon/web/health.h"
#include "daemon/web/http_message.h"
#include "daemon/web/metrics.h"
#include "daemon/web/slow_answer.h"

namespace servotwin::daemon {

/// The data sources of the endpoints.
struct ApiSources {
  std::string machine, token;  ///< empty token: changes are not allowed
  Store& store;                ///< opened for reading
  Health& health;
  std::function<MetricsInput()> now;
  /// Requests a diagnosis of an axis, by its index; false if no machine is known.
  std::function<bool(std::size_t)> ask_diagnosis;
  /// The arming of live offsets; null if no machine is known.
  std::function<Arming*()> arming;
  /// Where programs are put; null if no machine is known.
  std::function<std::shared_ptr<ProgramInbox>()> programs;
};

class Api {
 public:
  explicit Api(ApiSources sources) : sources_(std::move(sources)) {}

  [[nodiscard]] HttpResponse answer(const HttpRequest& request);
  /// Why the body of this request is not read; nothing if it is.
  [[nodiscard]] std::optional<HttpResponse> refuse_body(const HttpRequest& request);
  /// From now on changes need this token; empty: they are not allowed.
  void use_token(std::string token) { sources_.token = std::move(token); }
  /// The JSON that /api/v1/status answers and the live stream sends, in one line.
  [[nodiscard]] std::string status();

 private:
  [[nodiscard]] HttpResponse get(const HttpRequest& request);
  [[nodiscard]] HttpResponse change(const HttpRequest& request);
  [[nodiscard]] HttpResponse healthz();
  [[nodiscard]] HttpResponse metrics();
  [[nodiscard]] HttpResponse models();
  [[nodiscard]] HttpResponse versions(const std::string& axis, const HttpRequest& request);
  [[nodiscard]] HttpResponse diagnoses(const std::string& axis, const HttpRequest& request);
  [[nodiscard]] HttpResponse events(const HttpRequest& request);
  [[nodiscard]] HttpResponse report(const std::string& axis);
  [[nodiscard]] HttpResponse ask(const std::string& axis);
  [[nodiscard]] HttpResponse offsets();
  [[nodiscard]] HttpResponse arm(bool wanted);
  [[nodiscard]] HttpResponse programs();
  [[nodiscard]] HttpResponse change_program(const std::string& name, const HttpRequest& request);
  /// Throw if the request cannot change anything, or this program.
  void require_permission(const HttpRequest& request) const;
  [[nodiscard]] std::shared_ptr<ProgramInbox> inbox_for(const std::string& name) const;

  ApiSources sources_;
  SlowAnswer slow_;  // of a program that is put or removed
};

}  // namespace servotwin::daemon
