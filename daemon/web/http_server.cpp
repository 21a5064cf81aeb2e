#include "daemon/web/http_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

// Somewhat more than a batch of 8000 points per second; longer messages are sent in parts.
constexpr std::size_t kStreamBlock = 32 * 1024;

constexpr int kMaxClosingPolls = 10;

constexpr const char* kPageSecurity =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src "
    "'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::string header(MHD_Connection* connection, const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value == nullptr ? "" : value;
}

MHD_Result add_argument(void* to, MHD_ValueKind, const char* key, const char* value) {
  (*static_cast<std::map<std::string, std::string>*>(to))[key] = value == nullptr ? "" : value;
  return MHD_YES;
}

const char* what_to_do(int error) {
  switch (error) {
    case EADDRINUSE:
      return "; give another address with --http";
    case EADDRNOTAVAIL:
      return "; this host has no such address: give one of its own, 0.0.0.0 for all of them or "
             "127.0.0.1 for this host alone";
    case EACCES:
      return "; ports below 1024 need CAP_NET_BIND_SERVICE";
    default:
      return "";
  }
}

int listening_socket(const ListenAddress& address, std::uint16_t& port) {
  const auto fail = [&](int socket) {
    const int error = errno;
    if (socket >= 0) close(socket);
    throw CannotListen(address, error);
  };
  sockaddr_in6 six{};
  sockaddr_in four{};
  six.sin6_family = AF_INET6;
  four.sin_family = AF_INET;
  six.sin6_port = four.sin_port = htons(address.port);
  inet_pton(address.ipv6 ? AF_INET6 : AF_INET, address.host.c_str(),
            address.ipv6 ? static_cast<void*>(&six.sin6_addr) : &four.sin_addr);
  auto* place =
      address.ipv6 ? reinterpret_cast<sockaddr*>(&six) : reinterpret_cast<sockaddr*>(&four);
  socklen_t length = address.ipv6 ? sizeof six : sizeof four;
  const int socket =
      ::socket(address.ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket < 0) fail(socket);
  const int yes = 1;  // after a restart the old connections still linger
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (bind(socket, place, length) != 0 || listen(socket, 64) != 0) fail(socket);
  if (getsockname(socket, place, &length) != 0) fail(socket);
  port = ntohs(address.ipv6 ? six.sin6_port : four.sin_port);
  return socket;
}

}  // namespace

CannotListen::CannotListen(const ListenAddress& address, int the_error)
    : std::runtime_error("http.listen = '" + address.text() + "': " + std::strerror(the_error) +
                         what_to_do(the_error)),
      error(the_error) {}

void HttpServer::try_listening(const ListenAddress& address) {
  std::uint16_t port = 0;
  close(listening_socket(address, port));
}

/// A reader of the live stream.
struct HttpServer::Reader {
  HttpServer* server = nullptr;
  MHD_Connection* connection = nullptr;
  std::uint64_t next = 0;  // message
  std::size_t offset = 0;  // in it
  bool suspended = false;
};

/// A request whose body may still come.
struct HttpServer::Incoming {
  bool has_body = false;
};

struct HttpServer::Callbacks {
  static MHD_Result on_request(void* self, MHD_Connection* connection, const char* url,
                               const char* method, const char*, const char*,
                               std::size_t* body_bytes, void** state) {
    auto& server = *static_cast<HttpServer*>(self);
    if (*state == nullptr) {  // the header alone; the body, if any, comes next
      *state = new Incoming;
      return MHD_YES;
    }
    auto& incoming = *static_cast<Incoming*>(*state);
    if (*body_bytes > 0) {
      incoming.has_body = true;
      *body_bytes = 0;
      return MHD_YES;
    }
    HttpRequest request{
        method, url, {}, header(connection, "Authorization"), header(connection, "If-None-Match")};
    MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, add_argument, &request.query);
    const HttpResponse response = server.answer(connection, request, incoming.has_body);
    return static_cast<MHD_Result>(response.stream ? server.open_stream(connection)
                                                   : server.respond(connection, response));
  }
  static void on_end(void*, MHD_Connection*, void** state, MHD_RequestTerminationCode) {
    delete static_cast<Incoming*>(*state);
    *state = nullptr;
  }
  static ssize_t on_read(void* reader, std::uint64_t, char* to, std::size_t room) {
    auto& one = *static_cast<Reader*>(reader);
    return static_cast<ssize_t>(one.server->read_stream(one, to, room));
  }
  static void on_stream_end(void* reader) {
    HttpServer& server = *static_cast<Reader*>(reader)->server;
    std::erase_if(server.readers_, [&](const auto& one) { return one.get() == reader; });
  }
};

HttpServer::HttpServer(const ListenAddress& address, std::vector<std::string> names,
                       Handler handler)
    : address_(address), names_(std::move(names)), handler_(std::move(handler)) {
  for (std::string& name : names_) name = in_lower_case(name);
  char host[256] = "";
  if (gethostname(host, sizeof host - 1) == 0 && host[0] != '\0')
    names_.push_back(in_lower_case(host));
  names_.emplace_back("localhost");
  listen_on(address);
}

void HttpServer::listen_on(const ListenAddress& address) {
  const int socket = listening_socket(address, address_.port);
  daemon_ = MHD_start_daemon(
      MHD_USE_EPOLL | MHD_USE_ITC | MHD_ALLOW_SUSPEND_RESUME, 0, nullptr, nullptr,
      Callbacks::on_request, this, MHD_OPTION_LISTEN_SOCKET, socket, MHD_OPTION_CONNECTION_LIMIT,
      kMaxConnections, MHD_OPTION_PER_IP_CONNECTION_LIMIT, kMaxConnectionsPerAddress,
      MHD_OPTION_CONNECTION_TIMEOUT, kConnectionTimeout_s, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
      kMaxRequestBytes, MHD_OPTION_NOTIFY_COMPLETED, Callbacks::on_end, nullptr,
      MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_END);
  if (daemon_ == nullptr) {
    close(socket);
    throw std::runtime_error("http.listen = '" + address.text() +
                             "': the server cannot be started");
  }
}

HttpServer::~HttpServer() {
  closing_ = true;
  for (const auto& reader : readers_) {
    if (reader->suspended) MHD_resume_connection(reader->connection);
    reader->suspended = false;
  }
  // Gives the readers a regular end of their streams.
  for (int turn = 0; turn < kMaxClosingPolls && !readers_.empty(); ++turn) poll(10);
  MHD_stop_daemon(daemon_);
}

void HttpServer::poll(int timeout_ms) { MHD_run_wait(daemon_, timeout_ms); }

void HttpServer::send(std::string_view event, std::string_view json) {
  stream_.add(event, json, steady_ns());
  for (const auto& reader : readers_) {
    if (reader->suspended) MHD_resume_connection(reader->connection);
    reader->suspended = false;
  }
}

HttpResponse HttpServer::answer(MHD_Connection* connection, const HttpRequest& request,
                                bool has_body) {
  if (const std::string host = header(connection, "Host"); !is_for(host, names_)) {
    return http_error(
        421, "unknown host name '" + host + "'; use the IP address, or add the name to http.names");
  }
  if (request.method != "GET" && request.method != "HEAD" && request.method != "POST") {
    HttpResponse refused = http_error(405, "only GET, HEAD and POST are supported");
    refused.headers.emplace_back("Allow", "GET, HEAD, POST");
    return refused;
  }
  if (has_body) return http_error(413, "requests with a body are not accepted");
  HttpResponse response = handler_(request);
  if (response.stream && request.method != "GET") {
    response.stream = false;
  } else if (response.stream && readers_.size() >= kMaxStreams) {
    return http_error(503, "there are " + std::to_string(kMaxStreams) +
                               " live streams already; no more are served");
  }
  return response;
}

int HttpServer::respond(MHD_Connection* connection, const HttpResponse& response) {
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
      MHD_queue_response(connection, static_cast<unsigned>(response.status), out);
  MHD_destroy_response(out);
  return queued;
}

int HttpServer::open_stream(MHD_Connection* connection) {
  readers_.push_back(
      std::make_unique<Reader>(Reader{this, connection, stream_.start(steady_ns()), 0, false}));
  MHD_Response* out =
      MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, kStreamBlock, Callbacks::on_read,
                                        readers_.back().get(), Callbacks::on_stream_end);
  MHD_add_response_header(out, "Content-Type", "text/event-stream");
  MHD_add_response_header(out, "Cache-Control", "no-store");
  MHD_add_response_header(out, "X-Content-Type-Options", "nosniff");
  MHD_add_response_header(out, "Cross-Origin-Resource-Policy", "same-origin");
  const MHD_Result queued = MHD_queue_response(connection, MHD_HTTP_OK, out);
  MHD_destroy_response(out);
  return queued;
}

std::int64_t HttpServer::read_stream(Reader& reader, char* to, std::size_t room) {
  if (closing_) return MHD_CONTENT_READER_END_OF_STREAM;
  std::size_t written = 0;
  while (written < room && reader.next < stream_.end()) {
    const std::string* message = stream_.at(reader.next);
    if (message == nullptr) {
      ++slow_;
      return MHD_CONTENT_READER_END_WITH_ERROR;
    }
    const std::size_t count = message->copy(to + written, room - written, reader.offset);
    written += count;
    reader.offset += count;
    if (reader.offset < message->size()) break;
    reader.offset = 0;
    ++reader.next;
  }
  if (written == 0) {
    MHD_suspend_connection(reader.connection);
    reader.suspended = true;
  }
  return static_cast<std::int64_t>(written);
}

}  // namespace servotwin::daemon
