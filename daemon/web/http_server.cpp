#include "daemon/web/http_server.h"

#include <gnutls/abstract.h>
#include <microhttpd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/web/listening_socket.h"

namespace servotwin::daemon {
namespace {

// Somewhat more than a batch of 8000 points per second; longer messages are sent in parts.
constexpr std::size_t kStreamBlock = 32 * 1024;

// What the kernel keeps for a stream: little, so that a reader who takes nothing is soon noticed.
constexpr int kStreamSendBuffer = 128 * 1024;

// Those that Callers allows, and as many that are just being closed.
constexpr unsigned kMaxSockets = 2 * (Callers::kMaxConnections + Callers::kMaxStreams);

constexpr int kMaxClosingPolls = 10;

// Of a turn, for requests that read: as long as the thread waits for the network otherwise.
constexpr std::int64_t kReading_ns = 20'000'000;

// TLS 1.2 and 1.3 only.
constexpr const char* kTlsPriorities = "NORMAL:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2";

constexpr const char* kMethods[] = {"GET", "HEAD", "POST", "PUT", "DELETE"};

constexpr const char* kPageSecurity =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src "
    "'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::string header(MHD_Connection* connection, const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value == nullptr ? "" : value;
}

bool announces_body(MHD_Connection* connection) {
  return header(connection, "Content-Length").find_first_not_of("0 ") != std::string::npos ||
         !header(connection, "Transfer-Encoding").empty();
}

/// The length of the body; nothing if it is not announced, or not as a number.
std::optional<std::size_t> body_bytes(MHD_Connection* connection) {
  const std::string text = header(connection, "Content-Length");
  if (!header(connection, "Transfer-Encoding").empty()) return std::nullopt;
  std::size_t bytes = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), bytes);
  // A number that is too large for the type is too large for the limit.
  if (read.ec == std::errc::result_out_of_range) return std::numeric_limits<std::size_t>::max();
  if (read.ec != std::errc{} || read.ptr != text.data() + text.size()) return std::nullopt;
  return bytes;
}

int socket_of(MHD_Connection* connection) {
  return MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
}

Caller& caller_of(MHD_Connection* connection) {
  return *static_cast<Caller*>(
      MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context);
}

MHD_Result add_argument(void* to, MHD_ValueKind, const char* key, const char* value) {
  (*static_cast<std::map<std::string, std::string>*>(to))[key] = value == nullptr ? "" : value;
  return MHD_YES;
}

HttpRequest request_of(MHD_Connection* connection, const char* method, const char* url) {
  HttpRequest request{
      method, url, {}, header(connection, "Authorization"), header(connection, "If-None-Match")};
  MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, add_argument, &request.query);
  return request;
}

int require_socket(const ListenAddress& address, std::uint16_t& port) {
  const int socket = listening_socket(address, port);
  if (socket < 0) throw CannotListen(address, errno);
  return socket;
}

}  // namespace

CannotListen::CannotListen(const ListenAddress& address, int the_error)
    : std::runtime_error("http.listen = '" + address.text() +
                         "': " + listening_problem(the_error, "--http")),
      error(the_error) {}

void HttpServer::try_listening(const ListenAddress& address) {
  std::uint16_t port = 0;
  close(require_socket(address, port));
}

struct HttpServer::Callbacks {
  /// The server that polls in this thread: GnuTLS asks for a certificate without saying whose.
  static thread_local HttpServer* polling;
  static int on_handshake(gnutls_session_t, const gnutls_cert_retr_st*, gnutls_pcert_st** chain,
                          unsigned* count, gnutls_ocsp_data_st**, unsigned*, gnutls_privkey_t* key,
                          unsigned* flags) {
    const std::lock_guard lock(polling->tls_mutex_);
    *flags |= GNUTLS_CERT_RETR_DEINIT_ALL;
    return offer(polling->tls_, chain, count, key);
  }
  static void on_connection(void* self, MHD_Connection* connection, void** context,
                            MHD_ConnectionNotificationCode code) {
    auto& server = *static_cast<HttpServer*>(self);
    if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
      server.callers_.close(*static_cast<Caller*>(*context));
      return;
    }
    Caller& caller = server.callers_.open(connection, steady_ns());
    *context = &caller;
    server.accept(caller);
  }
  /// Called when the header is complete, with every part of the body, when the request is complete,
  /// and again when a held connection is resumed.
  static MHD_Result on_request(void* self, MHD_Connection* connection, const char* url,
                               const char* method, const char*, const char* part, std::size_t* size,
                               void** state) {
    auto& server = *static_cast<HttpServer*>(self);
    Caller& caller = caller_of(connection);
    if (caller.dropped || server.closing_) return MHD_NO;
    if (caller.later.valid()) {
      caller.enter(Caller::Phase::kAnswer, steady_ns());
      return static_cast<MHD_Result>(server.respond(caller, *caller.later.get()));
    }
    if (*size > 0) {
      if (caller.body == nullptr || caller.body->size() + *size > kMaxBody_bytes) return MHD_NO;
      caller.body->append(part, *size);
      *size = 0;
      return MHD_YES;
    }
    const bool has_body = announces_body(connection);
    if (*state == nullptr) {
      *state = &caller;
      caller.enter(Caller::Phase::kAnswer, steady_ns());
      if (!has_body) return MHD_YES;
    }
    HttpRequest request = request_of(connection, method, url);
    if (has_body && caller.body == nullptr)
      return static_cast<MHD_Result>(server.admit_body(caller, request));
    return static_cast<MHD_Result>(server.answer(caller, std::move(request)));
  }
  static void on_end(void*, MHD_Connection* connection, void** state, MHD_RequestTerminationCode) {
    Caller& caller = caller_of(connection);
    caller.enter(Caller::Phase::kRequest, steady_ns());
    caller.body = nullptr;
    caller.later = {};
    *state = nullptr;
  }
  static ssize_t on_read(void* reader, std::uint64_t, char* to, std::size_t room) {
    auto& [server, caller] = *static_cast<Reader*>(reader);
    return static_cast<ssize_t>(server.read_stream(caller, to, room));
  }
  static void on_stream_end(void* reader) { delete static_cast<Reader*>(reader); }

  struct Reader {
    HttpServer& server;
    Caller& caller;
  };
};

thread_local HttpServer* HttpServer::Callbacks::polling = nullptr;

HttpServer::HttpServer(const ListenAddress& address, std::vector<std::string> names,
                       Handler handler, const TlsPair& tls, Warn warn, Refusal refuse_body)
    : address_(address),
      names_(std::move(names)),
      handler_(std::move(handler)),
      tls_(tls),
      warn_(std::move(warn)),
      refuse_body_(std::move(refuse_body)) {
  for (std::string& name : names_) name = in_lower_case(name);
  char host[256] = "";
  if (gethostname(host, sizeof host - 1) == 0 && host[0] != '\0')
    names_.push_back(in_lower_case(host));
  names_.emplace_back("localhost");
  listen_on(address);
}

bool HttpServer::use_tls(const TlsPair& tls) {
  const std::lock_guard lock(tls_mutex_);
  if (tls_.certificate == tls.certificate && tls_.key == tls.key) return false;
  tls_ = tls;
  return true;
}

void HttpServer::listen_on(const ListenAddress& address) {
  const int socket = require_socket(address, address_.port);
  std::vector<MHD_OptionItem> secure;
  if (tls_.given()) {
    secure = {
        {MHD_OPTION_HTTPS_CERT_CALLBACK2, 0, reinterpret_cast<void*>(&Callbacks::on_handshake)},
        {MHD_OPTION_HTTPS_PRIORITIES, 0, const_cast<char*>(kTlsPriorities)}};
  }
  secure.push_back({MHD_OPTION_END, 0, nullptr});
  daemon_ = MHD_start_daemon(
      MHD_USE_EPOLL | MHD_USE_ITC | MHD_ALLOW_SUSPEND_RESUME |
          static_cast<unsigned>(tls_.given() ? MHD_USE_TLS : 0),
      0, nullptr, nullptr, Callbacks::on_request, this, MHD_OPTION_LISTEN_SOCKET, socket,
      MHD_OPTION_CONNECTION_LIMIT, kMaxSockets, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
      kMaxRequestBytes, MHD_OPTION_NOTIFY_CONNECTION, Callbacks::on_connection, this,
      MHD_OPTION_NOTIFY_COMPLETED, Callbacks::on_end, nullptr, MHD_OPTION_STRICT_FOR_CLIENT, 1,
      MHD_OPTION_ARRAY, secure.data(), MHD_OPTION_END);
  if (daemon_ == nullptr) {
    close(socket);
    throw std::runtime_error("http.listen = '" + address.text() +
                             "': the server cannot be started");
  }
}

HttpServer::~HttpServer() {
  closing_ = true;
  for (Caller& caller : callers_) resume(caller);
  // Gives the readers a regular end of their streams.
  for (int turn = 0; turn < kMaxClosingPolls && streams() > 0; ++turn) poll(10);
  MHD_stop_daemon(daemon_);
}

void HttpServer::poll(int timeout_ms) {
  Callbacks::polling = this;
  MHD_run_wait(daemon_, timeout_ms);
  const std::int64_t now_ns = steady_ns();
  keep_deadlines(now_ns);
  resume_held(now_ns);
}

void HttpServer::send(std::string_view event, std::string_view data) {
  stream_.add(event, data, steady_ns());
  for (Caller& caller : callers_) {
    if (caller.phase == Caller::Phase::kStream) resume(caller);
  }
}

void HttpServer::accept(Caller& caller) {
  set_address(
      caller,
      *MHD_get_connection_info(caller.connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS)->client_addr);
  while (Caller* one = callers_.surplus()) drop(*one);
}

void HttpServer::resume(Caller& caller) {
  if (!caller.suspended) return;
  caller.suspended = false;
  if (caller.phase == Caller::Phase::kStream) caller.since_ns = steady_ns();
  MHD_resume_connection(caller.connection);
}

void HttpServer::drop(Caller& caller) {
  caller.dropped = true;
  resume(caller);
  // libmicrohttpd finds the end of the connection in its next turn and closes it.
  shutdown(socket_of(caller.connection), SHUT_RDWR);
}

void HttpServer::keep_deadlines(std::int64_t now_ns) {
  for (Caller& caller : callers_) {
    if (caller.dropped) continue;
    if (!Callers::is_overdue(caller, now_ns)) continue;
    if (caller.phase == Caller::Phase::kStream) ++slow_;
    drop(caller);
  }
}

void HttpServer::resume_held(std::int64_t now_ns) {
  reading_ns_ = 0;
  Caller* next = nullptr;  // of those that read
  for (Caller& caller : callers_) {
    if (caller.phase != Caller::Phase::kHeld || !caller.suspended) continue;
    if (caller.later.valid()) {
      if (caller.later.wait_for(std::chrono::seconds(0)) == std::future_status::ready)
        resume(caller);
    } else if (caller.hold_ns == 0) {
      if (next == nullptr || caller.since_ns < next->since_ns) next = &caller;
    } else if (now_ns - caller.since_ns >= caller.hold_ns) {
      resume(caller);
    }
  }
  if (next != nullptr) resume(*next);
}

std::optional<HttpResponse> HttpServer::refusal(Caller& caller, const HttpRequest& request,
                                                bool has_body) const {
  if (const std::string host = header(caller.connection, "Host"); !is_for(host, names_)) {
    return http_error(
        421, "unknown host name '" + host + "'; use the IP address, or add the name to http.names");
  }
  if (std::find(std::begin(kMethods), std::end(kMethods), request.method) == std::end(kMethods)) {
    HttpResponse refused = http_error(405, "only GET, HEAD, POST, PUT and DELETE are supported");
    refused.headers.emplace_back("Allow", "GET, HEAD, POST, PUT, DELETE");
    return refused;
  }
  if (has_body && (request.method != "PUT" || refuse_body_ == nullptr))
    return http_error(413, "requests with a body are not accepted");
  return std::nullopt;
}

int HttpServer::admit_body(Caller& caller, const HttpRequest& request) {
  if (const auto refused = refusal(caller, request, true)) return respond(caller, *refused);
  const std::int64_t now_ns = steady_ns();
  if (caller.phase != Caller::Phase::kHeld && must_wait(caller, request, now_ns))
    return hold(caller, TokenGuesses::kHold_ns, now_ns);
  if (const auto refused = refuse_body_(request)) {
    count_guess(caller, request, *refused);
    return respond(caller, *refused);
  }
  const std::optional<std::size_t> bytes = body_bytes(caller.connection);
  if (!bytes) return respond(caller, http_error(411, "needs a Content-Length"));
  if (*bytes > kMaxBody_bytes)
    return respond(
        caller, http_error(413, "the body has " + std::to_string(*bytes) + " bytes, and at most " +
                                    std::to_string(kMaxBody_bytes) + " are accepted"));
  if (callers_.count(Caller::Phase::kBody) > 0)
    return respond(caller,
                   http_error(503, "another program is being put or removed; try again later"));
  caller.enter(Caller::Phase::kBody, now_ns);
  caller.body = std::make_shared<std::string>();
  caller.body->reserve(*bytes);
  return MHD_YES;
}

bool HttpServer::must_wait(const Caller& caller, const HttpRequest& request,
                           std::int64_t now_ns) const {
  return !request.authorization.empty() && guesses_.must_wait(caller.address, now_ns);
}

void HttpServer::count_guess(const Caller& caller, const HttpRequest& request,
                             const HttpResponse& response) {
  if (response.status != 401 || request.authorization.empty()) return;
  if (const auto message = guesses_.add(caller.address, steady_ns()); message && warn_)
    warn_(*message);
}

int HttpServer::answer(Caller& caller, HttpRequest request) {
  if (const auto refused = refusal(caller, request, false)) return respond(caller, *refused);
  const std::int64_t now_ns = steady_ns();
  const bool reads = request.method == "GET" || request.method == "HEAD";
  // With a body it has been held before that was read.
  if (caller.phase != Caller::Phase::kHeld && caller.body == nullptr) {
    if (must_wait(caller, request, now_ns)) return hold(caller, TokenGuesses::kHold_ns, now_ns);
    if (reads && reading_ns_ > kReading_ns) return hold(caller, 0, now_ns);
  }
  caller.enter(Caller::Phase::kAnswer, now_ns);
  request.body = std::move(caller.body);
  HttpResponse response = handler_(request);
  if (reads) reading_ns_ += steady_ns() - now_ns;
  count_guess(caller, request, response);
  if (response.later.valid()) {
    caller.later = std::move(response.later);
    return hold(caller, 0, now_ns);
  }
  if (!response.stream || request.method != "GET") return respond(caller, response);
  if (streams() >= Callers::kMaxStreams)
    return respond(caller, http_error(503, "there are " + std::to_string(Callers::kMaxStreams) +
                                               " live streams already; no more are served"));
  return open_stream(caller);
}

int HttpServer::hold(Caller& caller, std::int64_t hold_ns, std::int64_t now_ns) {
  caller.enter(Caller::Phase::kHeld, now_ns);
  caller.hold_ns = hold_ns;
  caller.suspended = true;
  MHD_suspend_connection(caller.connection);
  return MHD_YES;  // the request comes again when the connection is resumed
}

int HttpServer::respond(Caller& caller, const HttpResponse& response) {
  MHD_Response* out = MHD_create_response_from_buffer(
      response.body.size(), const_cast<char*>(response.body.data()), MHD_RESPMEM_MUST_COPY);
  const auto add = [&](const char* name, const std::string& value) {
    if (MHD_get_response_header(out, name) == nullptr)
      MHD_add_response_header(out, name, value.c_str());
  };
  for (const auto& [name, value] : response.headers) add(name.c_str(), value);
  add("Content-Type", response.type);
  add("Content-Security-Policy", kPageSecurity);
  add("Cache-Control", "no-store");
  add("X-Content-Type-Options", "nosniff");
  add("X-Frame-Options", "DENY");
  add("Referrer-Policy", "no-referrer");
  add("Cross-Origin-Resource-Policy", "same-origin");
  add("Cross-Origin-Opener-Policy", "same-origin");
  const MHD_Result queued =
      MHD_queue_response(caller.connection, static_cast<unsigned>(response.status), out);
  MHD_destroy_response(out);
  return queued;
}

int HttpServer::open_stream(Caller& caller) {
  caller.enter(Caller::Phase::kStream, steady_ns());
  caller.next = stream_.start(caller.since_ns);
  caller.offset = 0;
  setsockopt(socket_of(caller.connection), SOL_SOCKET, SO_SNDBUF, &kStreamSendBuffer,
             sizeof kStreamSendBuffer);
  MHD_Response* out = MHD_create_response_from_callback(
      MHD_SIZE_UNKNOWN, kStreamBlock, Callbacks::on_read, new Callbacks::Reader{*this, caller},
      Callbacks::on_stream_end);
  MHD_add_response_header(out, "Content-Type", "text/event-stream");
  MHD_add_response_header(out, "Cache-Control", "no-store");
  MHD_add_response_header(out, "X-Content-Type-Options", "nosniff");
  MHD_add_response_header(out, "Cross-Origin-Resource-Policy", "same-origin");
  const MHD_Result queued = MHD_queue_response(caller.connection, MHD_HTTP_OK, out);
  MHD_destroy_response(out);
  return queued;
}

std::int64_t HttpServer::read_stream(Caller& caller, char* to, std::size_t room) {
  if (closing_) return MHD_CONTENT_READER_END_OF_STREAM;
  if (caller.dropped) return MHD_CONTENT_READER_END_WITH_ERROR;
  caller.since_ns = steady_ns();
  std::size_t written = 0;
  while (written < room && caller.next < stream_.end()) {
    const std::string* message = stream_.at(caller.next);
    if (message == nullptr) {
      ++slow_;
      return MHD_CONTENT_READER_END_WITH_ERROR;
    }
    const std::size_t count = message->copy(to + written, room - written, caller.offset);
    written += count;
    caller.offset += count;
    if (caller.offset < message->size()) break;
    caller.offset = 0;
    ++caller.next;
  }
  if (written == 0) {
    caller.suspended = true;
    MHD_suspend_connection(caller.connection);
  }
  return static_cast<std::int64_t>(written);
}

}  // namespace servotwin::daemon
