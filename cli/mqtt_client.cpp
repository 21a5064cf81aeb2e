#include "cli/mqtt_client.h"

#include <mosquitto.h>

#include <stdexcept>

namespace servotwin::cli {
namespace {

// Between attempts to connect; doubled from the first to the longest.
constexpr unsigned kFirstDelay_s = 1, kLongestDelay_s = 30;
constexpr int kKeepAlive_s = 15;  // silence after which the broker publishes the will, and a half
constexpr int kAtLeastOnce = 1, kAtMostOnce = 0;

void require(int code, const std::string& what) {
  if (code != MOSQ_ERR_SUCCESS) throw std::runtime_error(what + ": " + mosquitto_strerror(code));
}

}  // namespace

MqttClient::MqttClient(const MqttBroker& broker, const std::string& will_topic,
                       const std::string& will)
    : client_(nullptr), will_topic_(will_topic), will_(will) {
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
    // A broker that is not there yet is no error; the thread tries again.
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
    send(will_topic_, will_, true);
    mosquitto_disconnect(client_);
  }
  // With a connection the thread ends once everything is sent.
  mosquitto_loop_stop(client_, !linked);
  mosquitto_destroy(client_);
  mosquitto_lib_cleanup();
}

void MqttClient::on_connect(int code) {
  const std::lock_guard lock(mutex_);
  if (code != 0) {
    refusal_ = mosquitto_connack_string(code);
    return;
  }
  connected_ = true;
  problem_.clear();
  for (const auto& [topic, payload] : retained_) send(topic, payload, true);
}

void MqttClient::on_disconnect(int code) {
  const std::lock_guard lock(mutex_);
  connected_ = false;
  problem_ = mosquitto_strerror(code);
}

void MqttClient::publish(const std::string& topic, const std::string& payload) {
  const std::lock_guard lock(mutex_);
  if (connected_) send(topic, payload, false);
}

void MqttClient::retain(const std::string& topic, const std::string& payload) {
  const std::lock_guard lock(mutex_);
  std::string& known = retained_[topic];
  if (known == payload) return;
  known = payload;
  if (connected_) send(topic, payload, true);
}

void MqttClient::send(const std::string& topic, const std::string& payload, bool retained) {
  // What fails here fails with the connection: on_connect() sends what is retained again.
  (void)mosquitto_publish(client_, nullptr, topic.c_str(), static_cast<int>(payload.size()),
                          payload.data(), retained ? kAtLeastOnce : kAtMostOnce, retained);
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
