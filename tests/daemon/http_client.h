// What a browser or a script sends and gets, over a real socket.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

namespace servotwin::daemon {

struct HttpAnswer {
  int status = 0;
  std::string head, body;
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(body); }
};

class HttpConnection {
 public:
  /// `from`: an address of this host, such as "127.0.0.2", that the other side sees; empty: the
  /// usual one.
  explicit HttpConnection(std::uint16_t port, const std::string& from = "")
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in place{};
    place.sin_family = AF_INET;
    if (inet_pton(AF_INET, from.c_str(), &place.sin_addr) == 1) {
      EXPECT_EQ(bind(socket_, reinterpret_cast<sockaddr*>(&place), sizeof place), 0);
    }
    place.sin_port = htons(port);
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = connect(socket_, reinterpret_cast<sockaddr*>(&place), sizeof place) == 0;
  }
  HttpConnection(const HttpConnection&) = delete;
  HttpConnection& operator=(const HttpConnection&) = delete;
  ~HttpConnection() { close(socket_); }

  [[nodiscard]] bool connected() const { return connected_; }
  void send(const std::string& text) const {
    EXPECT_EQ(::send(socket_, text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
  }
  /// Sends what the other side still takes; false if it has ended the connection.
  [[nodiscard]] bool try_sending(const std::string& text) const {
    char nothing = 0;
    if (recv(socket_, &nothing, 1, MSG_PEEK | MSG_DONTWAIT) == 0) return false;
    return ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT) > 0;
  }
  /// Reads on until `text` is there; false if the connection ends before or is silent for long.
  bool has_sent(const std::string& text) {
    while (received_.find(text) == std::string::npos) {
      if (!read_more()) return false;
    }
    return true;
  }
  /// Everything until the other side ends it.
  std::string rest() {
    while (read_more()) {
    }
    return received_;
  }
  [[nodiscard]] const std::string& received() const { return received_; }
  /// Reads what is there; does not wait.
  void drain() {
    char block[65536];
    for (ssize_t count = 1; count > 0;) {
      count = recv(socket_, block, sizeof block, MSG_DONTWAIT);
      if (count > 0) received_.append(block, static_cast<std::size_t>(count));
    }
  }

 private:
  bool read_more() {
    pollfd waiting{socket_, POLLIN, 0};
    if (poll(&waiting, 1, 30'000) <= 0) return false;
    char block[65536];
    const ssize_t count = recv(socket_, block, sizeof block, 0);
    if (count <= 0) return false;
    received_.append(block, static_cast<std::size_t>(count));
    return true;
  }

  int socket_;
  bool connected_ = false;
  std::string received_;
};

/// One request on a connection of its own; `more`: header lines, each with its \r\n; `from`: as
/// above.
inline HttpAnswer ask(std::uint16_t port, const std::string& method, const std::string& target,
                      const std::string& more = "", const std::string& body = "",
                      const std::string& host = "localhost", const std::string& from = "") {
  HttpConnection connection(port, from);
  EXPECT_TRUE(connection.connected());
  const std::string length =
      body.empty() ? "" : "Content-Length: " + std::to_string(body.size()) + "\r\n";
  connection.send(method + " " + target + " HTTP/1.1\r\nHost: " + host +
                  "\r\nConnection: close\r\n" + length + more + "\r\n" + body);
  const std::string all = connection.rest();
  HttpAnswer answer;
  const std::size_t end = all.find("\r\n\r\n");
  if (end == all.npos || all.size() < 12) {
    ADD_FAILURE() << "no answer to " << method << " " << target << ": " << all;
    return answer;
  }
  answer.status = std::stoi(all.substr(9, 3));
  answer.head = all.substr(0, end);
  answer.body = all.substr(end + 4);
  return answer;
}

}  // namespace servotwin::daemon
