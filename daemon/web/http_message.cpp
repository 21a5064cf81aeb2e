#include "daemon/web/http_message.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>

namespace servotwin::daemon {
namespace {

/// "host:8402", "[::1]:8402" without the port and the brackets.
std::string name_in(const std::string& host) {
  if (!host.empty() && host.front() == '[') {
    const std::size_t end = host.find(']');
    return end == host.npos ? "" : host.substr(1, end - 1);
  }
  return host.substr(0, host.find(':'));
}

bool is_number(const std::string& host) {
  if (host.find('\0') != host.npos) return false;  // inet_pton would stop there
  unsigned char bytes[sizeof(in6_addr)];
  return inet_pton(AF_INET, host.c_str(), bytes) == 1 ||
         inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

}  // namespace

HttpResponse http_error(int status, const std::string& error) {
  const nlohmann::json body{{"schema", "servotwin.error/1"}, {"status", status}, {"error", error}};
  // The message may quote bytes of the request that are not UTF-8: they are replaced.
  return {status, "application/json",
          body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
}

std::string in_lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool is_for(const std::string& host, const std::vector<std::string>& names) {
  const std::string name = in_lower_case(name_in(host));
  return is_number(name) || std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace servotwin::daemon
