// An HTTP request and its response as the endpoints see them, and the check of the Host field. Any
// thread; errors: none.
#pragma once

#include <future>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace servotwin::daemon {

struct HttpRequest {
  std::string method;  ///< GET, HEAD, POST, PUT or DELETE
  std::string path;    ///< decoded, without the query
  std::map<std::string, std::string> query;
  std::string authorization, if_none_match;   ///< header fields; empty: not given
  std::shared_ptr<const std::string> body{};  ///< null: none
};

struct HttpResponse;
/// A response that is being made in another thread.
using LaterResponse = std::shared_future<std::shared_ptr<const HttpResponse>>;

struct HttpResponse {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers{};
  bool stream = false;    ///< the live stream follows instead of the body
  LaterResponse later{};  ///< valid: this is sent instead, once it is ready
};

/// The response {"schema":"servotwin.error/1","status":..,"error":".."}.
[[nodiscard]] HttpResponse http_error(int status, const std::string& error);

/// Whether a Host field ("mill:8402", "[::1]:8402") is an IP address or one of `names`, which must
/// be in lower case.
[[nodiscard]] bool is_for(const std::string& host, const std::vector<std::string>& names);
[[nodiscard]] std::string in_lower_case(std::string text);

}  // namespace servotwin::daemon
