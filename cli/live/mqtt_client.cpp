#include "cli/live/mqtt_client.h"

#include <mosquitto.h>

#include <fstream>
#include <iterator>
#include <stdexcept>

namespace servotwin::cli {
namespace {

// Between attempts to connect; doubled from the first to the longest.
constexpr unsigned kFirstDelay_s = 1, kLongestDelay_s = 30;
constexpr int kKeepAlive_s = 15;  // silence after which the broker publishes the will, and a half
constexpr int kAtLeastOnce = 1;   // the will, which the broker publishes itself
// Everything else: the library would send what is not acknowledged again after a reconnection,
// behind what is newer. TCP keeps the order, and on_connect() sends everything again.
constexpr int kAtMostOnce = 0;

void require(int code, const std::string& what) {
  if (code != MOSQ_ERR_SUCCESS) throw std::runtime_error(what + ": " + mosquitto_strerror(code));
}

/// The library's sentence, as the middle of one.
std::string clause(std::string sentence) {
  while (sentence.ends_with('.')) sentence.pop_back();
  return sentence;
}

void require_certificate(const std::filesystem::path& file) {
  std::ifstream in(file);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  if (text.find("-----BEGIN CERTIFICATE-----") == text.npos)
    throw std::runtime_error(file.string() + ": cannot be read, or has no certificate (PEM)");
}

}  // namespace

MqttClient::MqttClient(const MqttBroker& broker, const std::string& will_topic,
                       const std::string& will)
    : client_(nullptr), will_topic_(will_topic), will_(will) {
  if (!broker.ca_file.empty()) require_certificate(broker.ca_file);
  mosquitto_lib_init();
  client_ = mosquitto_new(nullptr, true, this);
  if (client_ == nullptr) throw std::runtime_error("MQTT: not enough memory");
  try {
    mosquitto_connect_callback_set(client_, [](mosquitto*, void* self, int code) {
      static_cast<MqttClient*>(self)->on_connect(code);
    });
    mosquitto_disconnect_callback_set(client_, [](mosquitto*, void* self, int code) {
      static_cast<MqttClient*>(self)->on_disconnect(code);
    });
    require(mosquitto_will_set(client_, will_topic.c_str(), static_cast<int>(will.size()),
                               will.data(), kAtLeastOnce, true),
            "topic '" + will_topic + "'");
    if (!broker.user.empty())
      require(mosquitto_username_pw_set(client_, broker.user.c_str(), broker.password.c_str()),
              "user");
    if (broker.tls) {
      const bool own = !broker.ca_file.empty();
      require(mosquitto_tls_set(client_, own ? broker.ca_file.c_str() : nullptr,
                                own ? nullptr : "/etc/ssl/certs", nullptr, nullptr, nullptr),
              "certificates of " + (own ? broker.ca_file.string() : "the system"));
    }
    mosquitto_reconnect_delay_set(client_, kFirstDelay_s, kLongestDelay_s, true);
    require(mosquitto_loop_start(client_), "thread");
    // The broker may start later: the thread tries again.
    const int code =
        mosquitto_connect_async(client_, broker.host.c_str(), broker.port, kKeepAlive_s);
    if (code == MOSQ_ERR_INVAL) require(code, broker.host);
    if (code != MOSQ_ERR_SUCCESS) on_disconnect(code);
  } catch (...) {
    mosquitto_loop_stop(client_, true);
    mosquitto_destroy(client_);
    mosquitto_lib_cleanup();
    throw;
  }
}

MqttClient::~MqttClient() {
  const bool linked = connected();
  if (linked) {
    send(will_topic_, will_);
    mosquitto_disconnect(client_);
  }
  // With a connection the thread ends once these two are sent.
  mosquitto_loop_stop(client_, !linked);
  mosquitto_destroy(client_);
  mosquitto_lib_cleanup();
}

void MqttClient::on_connect(int code) {
  constexpr int kAccepted = 0, kUnavailable = 3;  // MQTT 3.1.1, 3.2.2.3
  const std::lock_guard lock(mutex_);
  if (code == kUnavailable) {  // for now: the thread tries again
    problem_ = clause(mosquitto_connack_string(code));
    return;
  }
  if (code != kAccepted) {
    refusal_ = clause(mosquitto_connack_string(code));
    return;
  }
  connected_ = true;
  problem_.clear();
  for (const auto& [topic, payload] : published_) send(topic, payload);
}

void MqttClient::on_disconnect(int code) {
  const std::lock_guard lock(mutex_);
  connected_ = false;
  problem_ = clause(mosquitto_strerror(code));
}

void MqttClient::publish(const std::string& topic, const std::string& payload) {
  const std::lock_guard lock(mutex_);
  std::string& known = published_[topic];
  if (known == payload) return;
  known = payload;
  if (connected_) send(topic, payload);
}

void MqttClient::repeat(const std::string& topic) {
  const std::lock_guard lock(mutex_);
  if (const auto known = published_.find(topic); known != published_.end() && connected_)
    send(topic, known->second);
}

void MqttClient::send(const std::string& topic, const std::string& payload) {
  // What fails here fails with the connection, after which everything is sent again.
  (void)mosquitto_publish(client_, nullptr, topic.c_str(), static_cast<int>(payload.size()),
                          payload.data(), kAtMostOnce, true);
}

bool MqttClient::connected() const {
  const std::lock_guard lock(mutex_);
  return connected_;
}

std::string MqttClient::refusal() const {
  const std::lock_guard lock(mutex_);
  return refusal_;
}

std::string MqttClient::problem() const {
  const std::lock_guard lock(mutex_);
  return problem_;
}

}  // namespace servotwin::cli
