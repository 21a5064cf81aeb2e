#include "cli/live/shdr.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "daemon/web/listening_socket.h"

namespace servotwin::cli {
namespace {

// An agent sends "* PING" and short commands only. No more is taken from it at a time, so that one
// that sends without end waits for its turn as the others do.
constexpr std::size_t kMaxRequest_bytes = 4096;

std::string name_of_peer(const sockaddr_storage& peer, socklen_t size) {
  char host[NI_MAXHOST] = "", port[NI_MAXSERV] = "";
  getnameinfo(reinterpret_cast<const sockaddr*>(&peer), size, host, sizeof host, port, sizeof port,
              NI_NUMERICHOST | NI_NUMERICSERV);
  return std::string(host) + " port " + port;
}

}  // namespace

std::string shdr_word(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7f') c = ' ';
    if (c == '|') c = '/';
    if (c == '"') c = '\'';
  }
  // An agent would wait for the end of a text of several lines, and take no other line until then.
  for (std::size_t at = 0; (at = out.find("--multiline--", at)) != out.npos;)
    out.replace(at, 2, "- ");
  return out;
}

std::string shdr_name(std::string_view text) {
  std::string out(text);
  std::replace_if(
      out.begin(), out.end(),
      [](char c) {
        return !((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                 c == '.' || c == '-');
      },
      '_');
  return out;
}

struct ShdrServer::Agent {
  Agent(int the_socket, std::string the_name) : socket(the_socket), name(std::move(the_name)) {}
  Agent(const Agent&) = delete;
  Agent& operator=(const Agent&) = delete;
  ~Agent() { close(socket); }

  int socket;
  std::string name;
  std::string received, unsent;
  bool beats = false;  // has sent a sign of life
  double heard_s = 0.0;
};

ShdrServer::ShdrServer(const daemon::ListenAddress& address) : address_(address) {
  socket_ = daemon::listening_socket(address, address_.port);
  if (socket_ < 0)
    throw std::runtime_error(address.text() + ": " + daemon::listening_problem(errno, "--port"));
}

ShdrServer::~ShdrServer() { close(socket_); }

void ShdrServer::set(const std::string& time, const std::string& key, const std::string& words) {
  Value& value = values_[key];
  if (value.words == words) return;
  value = {words, time + "|" + key + "|" + words + "\n"};
  for (const auto& agent : agents_) agent->unsent += value.line;
}

void ShdrServer::serve(double now_s) {
  accept_agents();
  std::erase_if(agents_, [&](const std::unique_ptr<Agent>& agent) {
    const std::string reason = attend(*agent, now_s);
    if (!reason.empty()) on_news("agent " + agent->name + " " + reason);
    return !reason.empty();
  });
}

void ShdrServer::accept_agents() {
  sockaddr_storage peer{};
  for (std::size_t turn = 0; turn < kMaxAgents; ++turn) {  // the rest in the next call
    socklen_t size = sizeof peer;
    const int socket =
        accept4(socket_, reinterpret_cast<sockaddr*>(&peer), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (socket < 0) return;
    if (agents_.size() >= kMaxAgents) {
      close(socket);
      on_news("agent " + name_of_peer(peer, size) + " refused: there are " +
              std::to_string(kMaxAgents) + " already");
      continue;
    }
    auto agent = std::make_unique<Agent>(socket, name_of_peer(peer, size));
    for (const auto& [key, value] : values_) agent->unsent += value.line;
    on_news("agent " + agent->name + " connected");
    agents_.push_back(std::move(agent));
  }
}

std::string ShdrServer::attend(Agent& agent, double now_s) {
  const auto is_over = [] { return errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR; };
  char part[kMaxRequest_bytes];
  ssize_t size = recv(agent.socket, part, sizeof part, 0);
  if (size == 0 || (size < 0 && is_over())) return "gone";
  if (size > 0) agent.received.append(part, static_cast<std::size_t>(size));
  for (std::size_t end; (end = agent.received.find('\n')) != std::string::npos;) {
    if (agent.received.starts_with("* PING")) {
      agent.unsent += "* PONG " + std::to_string(kHeartbeat_ms) + "\n";
      agent.beats = true;
      agent.heard_s = now_s;
    }
    agent.received.erase(0, end + 1);
  }
  if (agent.received.size() > kMaxRequest_bytes) return "cut off: it speaks no SHDR";
  if (agent.beats && now_s - agent.heard_s > 2e-3 * kHeartbeat_ms)
    return "cut off: no PING for " + std::to_string(2 * kHeartbeat_ms / 1000) + " s";
  while (!agent.unsent.empty()) {
    size = send(agent.socket, agent.unsent.data(), agent.unsent.size(), MSG_NOSIGNAL);
    if (size < 0) break;
    agent.unsent.erase(0, static_cast<std::size_t>(size));
  }
  if (size < 0 && is_over()) return "gone";
  return agent.unsent.size() > kMaxUnsent_bytes ? "cut off: it does not take what is sent" : "";
}

}  // namespace servotwin::cli
