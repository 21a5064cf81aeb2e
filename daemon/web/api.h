// What is asked over HTTP, and what is answered: the page, /healthz, /metrics and /api/v1
// (docs/reference.md).
//
// Every JSON has a schema. What cannot be answered is a servotwin.error/1 that says why. One
// thread.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "daemon/correct/arming.h"
#include "daemon/record/residual_watch.h"
#include "daemon/store/store.h"
#include "daemon/web/health.h"
#include "daemon/web/http_message.h"
#include "daemon/web/metrics.h"

namespace servotwin::daemon {

/// What the endpoints answer from.
struct ApiSources {
  std::string machine, token;  ///< an empty token: nothing may be changed
  Store& store;                ///< opened to be read
  Health& health;
  std::function<MetricsInput()> now;
  /// Asks for a diagnosis of an axis, by its number; false where no machine is known.
  std::function<bool(std::size_t)> ask_diagnosis;
  /// What arms live offsets; null where no machine is known.
  std::function<Arming*()> arming;
};

class Api {
 public:
  explicit Api(ApiSources sources) : sources_(std::move(sources)) {}

  [[nodiscard]] HttpResponse answer(const HttpRequest& request);
  /// The JSON that /api/v1/status answers and the live stream sends, in one line.
  [[nodiscard]] std::string status();

 private:
  [[nodiscard]] HttpResponse get(const HttpRequest& request);
  [[nodiscard]] HttpResponse post(const HttpRequest& request);
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

  ApiSources sources_;
};

}  // namespace servotwin::daemon
