// A request over HTTP as the endpoints get it: whatever is asked, the answer is whole, and nothing
// is changed or told without the token. What libmicrohttpd does before is done here as far as it
// matters: lines, fields, percent signs; its own faults are not ours.
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "daemon/web/api.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace servotwin;

constexpr const char* kToken = "a token for this";
const std::vector<std::string> kNames{"localhost", "mill"};

/// A service with an axis, a model, an event and no diagnosis, in a directory of its own.
class Service {
 public:
  Service() {
    store.add(
        daemon::Event{"2026-01-31T12:00:00.000Z", "X", "noted", "an event", R"({"a":[1,2]})"});
  }
  test::TemporaryDirectory directory;
  daemon::Store store{directory.path(), "mill"};
  daemon::StoreCheck check{store, store};
  daemon::Health health{check};
  int asked = 0;
  daemon::Api api{{"mill", kToken, store, health,
                   [] {
                     daemon::MetricsInput now;
                     now.machine = "mill";
                     now.version = "1";
                     now.description = {0.001, {{"X", false, "Nm"}}};
                     return now;
                   },
                   [this](std::size_t axis) {
                     fuzz::require(axis == 0);
                     ++asked;
                     return true;
                   },
                   [] { return nullptr; }, [] { return nullptr; }}};
};

std::string unescaped(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto digit = [&](std::size_t at) {
      return at < text.size() && std::isxdigit(static_cast<unsigned char>(text[at])) != 0;
    };
    if (text[i] == '%' && digit(i + 1) && digit(i + 2)) {
      out += static_cast<char>(std::stoi(std::string(text.substr(i + 1, 2)), nullptr, 16));
      i += 2;
    } else {
      out += text[i];
    }
  }
  // A C string, as it comes from there.
  return out.c_str();
}

std::string_view cut(std::string_view& text, char at) {
  const std::size_t end = text.find(at);
  const std::string_view head = text.substr(0, end);
  text.remove_prefix(end == text.npos ? text.size() : end + 1);
  return head;
}

/// "GET /path?name=value HTTP/1.1", and "Field: value" on every line after it.
daemon::HttpRequest request_of(std::string_view text, std::string& host) {
  std::string_view line = cut(text, '\n');
  daemon::HttpRequest request;
  request.method = cut(line, ' ');
  std::string_view target = cut(line, ' ');
  request.path = unescaped(cut(target, '?'));
  while (!target.empty()) {
    std::string_view value = cut(target, '&');
    const std::string name = unescaped(cut(value, '='));
    request.query[name] = unescaped(value);
  }
  while (!text.empty()) {
    line = cut(text, '\n');
    const std::string_view field = cut(line, ':');
    while (line.starts_with(' ')) line.remove_prefix(1);
    if (field == "Authorization") request.authorization = line;
    if (field == "If-None-Match") request.if_none_match = line;
    if (field == "Host") host = line;
  }
  return request;
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Service service;
  std::string host;
  const daemon::HttpRequest request = request_of(fuzz::text(data, size), host);

  // Another host's name is never taken for ours.
  if (daemon::is_for(host, kNames)) {
    std::string rest = daemon::in_lower_case(host);
    for (const std::string& name : kNames) {
      if (rest.starts_with(name)) rest = rest.substr(name.size());
    }
    const std::string number = rest.substr(0, rest.find(rest.starts_with('[') ? ']' : ':'));
    fuzz::require(number.find_first_not_of("[0123456789abcdef.:") == number.npos);
  }

  service.asked = 0;
  const daemon::HttpResponse response = service.api.answer(request);
  fuzz::require(response.status == 200 || response.status == 202 || response.status == 304 ||
                (response.status >= 400 && response.status <= 405) || response.status == 409 ||
                response.status == 503);
  fuzz::require(response.stream == (request.path == "/api/v1/stream" && response.status == 200));
  for (const auto& [name, value] : response.headers)
    fuzz::require(value.find_first_of("\r\n") == value.npos);
  if (response.type == "application/json" && !response.stream) {
    const auto json = nlohmann::json::parse(response.body);  // throws where it is none
    fuzz::require(json.at("schema").is_string());
    if (response.status >= 400 && response.status != 503)
      fuzz::require(json.at("status") == response.status && !json.at("error").empty());
  }
  const bool may = request.method == "POST" &&
                   request.authorization == std::string("Bearer ") + kToken &&
                   request.path == "/api/v1/diagnoses/X" && request.query.empty();
  fuzz::require((service.asked == 1) == may && (response.status == 202) == may);
  fuzz::require(response.body.find(kToken) == response.body.npos ||
                request.path.find(kToken) != request.path.npos || !request.query.empty());
  return 0;
}
