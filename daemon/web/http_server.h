// HTTP/1.1 on one socket with GNU libmicrohttpd, driven by poll() in one thread of the caller.
//
// Limited are the connections (all, and per address), the size of a request, the time that a
// connection may be silent, the live streams, and how far a stream may fall behind. Refused before
// an endpoint sees them are methods other than GET, HEAD and POST, requests with a body, and a Host
// field that is neither an IP address, localhost, this host nor one of `names` (protection against
// DNS rebinding). Every response has headers that restrict what a browser may do with it.
//
// Errors: the constructor throws CannotListen. One thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/config/listen_address.h"
#include "daemon/web/event_stream.h"
#include "daemon/web/http_message.h"

struct MHD_Connection;
struct MHD_Daemon;

namespace servotwin::daemon {

/// One line, with advice where there is some.
struct CannotListen : std::runtime_error {
  CannotListen(const ListenAddress& address, int the_error);
  int error;  ///< errno
};

class HttpServer {
 public:
  static constexpr unsigned kMaxConnections = 64;
  static constexpr unsigned kMaxConnectionsPerAddress = 48;
  static constexpr unsigned kMaxStreams = 16;
  static constexpr unsigned kConnectionTimeout_s = 10;
  static constexpr std::size_t kMaxRequestBytes = 32 * 1024;

  using Handler = std::function<HttpResponse(const HttpRequest&)>;

  /// `names`: further names of this host. `handler` must not throw.
  HttpServer(const ListenAddress& address, std::vector<std::string> names, Handler handler);
  /// Throws CannotListen if the address cannot be used now; does not keep it.
  static void try_listening(const ListenAddress& address);
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;
  ~HttpServer();

  /// Answers requests for about `timeout_ms` at most.
  void poll(int timeout_ms);
  /// Sends a message to all streams.
  void send(std::string_view event, std::string_view json);

  /// The address with the actual port.
  [[nodiscard]] const ListenAddress& address() const noexcept { return address_; }
  [[nodiscard]] std::size_t streams() const noexcept { return readers_.size(); }
  /// Streams that were ended because their reader was too slow.
  [[nodiscard]] std::uint64_t slow_streams() const noexcept { return slow_; }

 private:
  struct Reader;
  struct Incoming;
  struct Callbacks;

  void listen_on(const ListenAddress& address);
  [[nodiscard]] HttpResponse answer(MHD_Connection* connection, const HttpRequest& request,
                                    bool has_body);
  int respond(MHD_Connection* connection, const HttpResponse& response);
  int open_stream(MHD_Connection* connection);
  std::int64_t read_stream(Reader& reader, char* to, std::size_t room);

  ListenAddress address_;
  std::vector<std::string> names_;
  Handler handler_;
  EventStream stream_;
  std::vector<std::unique_ptr<Reader>> readers_;
  std::uint64_t slow_ = 0;
  bool closing_ = false;
  MHD_Daemon* daemon_ = nullptr;
};

}  // namespace servotwin::daemon
