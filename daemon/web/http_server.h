// HTTP/1.1 on one socket with GNU libmicrohttpd, driven by poll() in one thread of the caller.
//
// Limited are the connections and the time that a request, its answer and a stalled stream may take
// (callers.h), the size of a request, the live streams, and how far a stream may fall behind.
// Refused before an endpoint sees them are methods other than GET, HEAD, POST, PUT and DELETE, and
// a Host field that is neither an IP address, localhost, this host nor one of `names` (protection
// against DNS rebinding). A body is read only of a PUT that the endpoints admit, one at a time, and
// is kept in memory; all others are refused without reading it. Requests with a token from an
// address that has sent wrong ones are held (token_guesses.h). Requests that read (GET, HEAD) share
// a part of every turn; where that is used up, one of them is answered a turn, in their order, so
// that many large answers do not delay a change. Every response has headers that restrict what a
// browser may do with it.
//
// Errors: the constructor throws CannotListen. One thread, except use_tls().
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/config/listen_address.h"
#include "daemon/web/callers.h"
#include "daemon/web/event_stream.h"
#include "daemon/web/http_message.h"
#include "daemon/web/tls_pair.h"
#include "daemon/web/token_guesses.h"

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
  static constexpr std::size_t kMaxRequestBytes = 32 * 1024;
  /// Of a body: the largest program (2^21 positions at 2^18 times) at 24 bytes a number takes 57
  /// MB.
  static constexpr std::size_t kMaxBody_bytes = 64'000'000;

  using Handler = std::function<HttpResponse(const HttpRequest&)>;
  using Refusal = std::function<std::optional<HttpResponse>(const HttpRequest&)>;
  using Warn = std::function<void(const std::string&)>;

  /// `names`: further names of this host. `handler`: the answer, 401 where the token is wrong; must
  /// not throw. `tls`: HTTPS instead of HTTP, if it is given. `warn`: logs wrong tokens, at most
  /// one line a minute. `refuse_body`: why the body of a PUT is not read, nothing if it is; null:
  /// none is read.
  HttpServer(const ListenAddress& address, std::vector<std::string> names, Handler handler,
             const TlsPair& tls = {}, Warn warn = nullptr, Refusal refuse_body = nullptr);
  /// Throws CannotListen if the address cannot be used now; does not keep it.
  static void try_listening(const ListenAddress& address);
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;
  ~HttpServer();

  /// From now on new connections get this certificate; open ones stay. False if it is the one that
  /// they get already. Only for a server that was made with one. Any thread.
  bool use_tls(const TlsPair& tls);
  /// Answers requests for about `timeout_ms` at most.
  void poll(int timeout_ms);
  /// Sends a message to all streams.
  void send(std::string_view event, std::string_view data);

  /// The address with the actual port.
  [[nodiscard]] const ListenAddress& address() const noexcept { return address_; }
  [[nodiscard]] std::size_t streams() const { return callers_.streams(); }
  /// Streams that were ended because their reader was too slow.
  [[nodiscard]] std::uint64_t slow_streams() const noexcept { return slow_; }

 private:
  struct Callbacks;

  void listen_on(const ListenAddress& address);
  void accept(Caller& caller);
  void resume(Caller& caller);
  void drop(Caller& caller);
  void keep_deadlines(std::int64_t now_ns);
  void resume_held(std::int64_t now_ns);
  [[nodiscard]] std::optional<HttpResponse> refusal(Caller& caller, const HttpRequest& request,
                                                    bool has_body) const;
  int admit_body(Caller& caller, const HttpRequest& request);
  int answer(Caller& caller, HttpRequest request);
  [[nodiscard]] bool must_wait(const Caller& caller, const HttpRequest& request,
                               std::int64_t now_ns) const;
  void count_guess(const Caller& caller, const HttpRequest& request, const HttpResponse& response);
  int hold(Caller& caller, std::int64_t hold_ns, std::int64_t now_ns);
  int respond(Caller& caller, const HttpResponse& response);
  int open_stream(Caller& caller);
  std::int64_t read_stream(Caller& caller, char* to, std::size_t room);

  ListenAddress address_;
  std::vector<std::string> names_;
  Handler handler_;
  std::mutex tls_mutex_;
  TlsPair tls_;
  Warn warn_;
  Refusal refuse_body_;
  EventStream stream_;
  Callers callers_;
  TokenGuesses guesses_;
  std::int64_t reading_ns_ = 0;  // time spent on requests that read, in this turn
  std::uint64_t slow_ = 0;
  bool closing_ = false;
  MHD_Daemon* daemon_ = nullptr;
};

}  // namespace servotwin::daemon
