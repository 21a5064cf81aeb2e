// A request and its answer, as the endpoints see them.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace servotwin {

struct HttpRequest {
  std::string method;  ///< GET, HEAD or POST
  std::string path;    ///< decoded, without the query
  std::map<std::string, std::string> query;
  std::string authorization, if_none_match;  ///< header fields; empty: not given
};

struct HttpResponse {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers{};
  bool stream = false;  ///< the live stream follows in place of the body
};

/// {"schema":"servotwin.error/1","status":..,"error":".."}
[[nodiscard]] HttpResponse http_error(int status, const std::string& error);

}  // namespace servotwin
