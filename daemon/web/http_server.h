// HTTP/1.1 on one socket: GNU libmicrohttpd, turned by poll() in one thread of the caller.
//
// What is limited: connections (all, and of one address), the size of a request, the time that a
// connection may be silent, live streams, and how far a stream may fall behind. What is refused
// before an endpoint sees it: methods other than GET, HEAD and POST, bodies, and a Host that is
// neither a number, localhost, this host nor among `names` (a page elsewhere could make its own
// name point here). Every answer carries the headers that keep a browser from doing more with it
// than show it.
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

/// One line; what to do is in it where that is known.
struct CannotListen : std::runtime_error {
  CannotListen(const ListenAddress& address, int the_error);
  int error;  ///< errno
};

class HttpServer {
 public:
  static constexpr unsigned kMostConnections = 64;
  static constexpr unsigned kMostPerAddress = 48;
  static constexpr unsigned kMostStreams = 16;
  static constexpr unsigned kSilence_s = 10;
  static constexpr std::size_t kRequestBytes = 32 * 1024;

  using Handler = std::function<HttpResponse(const HttpRequest&)>;

  /// `names`: what else this host is called. `handler` must not throw.
  HttpServer(const ListenAddress& address, std::vector<std::string> names, Handler handler);
  /// Throws CannotListen where nobody could listen now; takes nothing.
  static void try_listening(const ListenAddress& address);
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;
  ~HttpServer();

  /// Answers what is asked, for about this long at most.
  void poll(int timeout_ms);
  /// A message to all streams.
  void send(std::string_view event, std::string_view json);

  /// With the port that was taken.
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
