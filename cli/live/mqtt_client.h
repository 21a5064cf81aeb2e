// A connection to an MQTT broker that comes back by itself. Everything is retained by the broker,
// and published again after every reconnection.
//
// A cover over libmosquitto, whose thread does the network; the members may be called from any
// other thread. Errors: std::runtime_error.
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <string>

struct mosquitto;  // NOLINT(readability-identifier-naming): the name of the library

namespace servotwin::cli {

struct MqttBroker {
  std::string host;
  int port = 1883;
  std::string user, password;     ///< empty: none
  bool tls = false;               ///< encrypted, the broker's certificate and name are checked
  std::filesystem::path ca_file;  ///< PEM; empty: the authorities that the system trusts
};

class MqttClient {
 public:
  /// Begins to connect. When this client is gone, the broker publishes `will` on `will_topic`.
  /// Throws if ca_file has no certificate.
  MqttClient(const MqttBroker& broker, const std::string& will_topic, const std::string& will);
  /// Publishes the will itself, and ends the connection.
  ~MqttClient();
  MqttClient(const MqttClient&) = delete;
  MqttClient& operator=(const MqttClient&) = delete;

  /// A payload that the topic has already is not sent again.
  void publish(const std::string& topic, const std::string& payload);
  /// Sends what the topic has already: another client may have published there.
  void repeat(const std::string& topic);

  [[nodiscard]] bool connected() const;
  /// Why the broker refuses this client, which trying again does not change; empty: it does not.
  [[nodiscard]] std::string refusal() const;
  /// The last reason why a connection ended or was not made; empty if the library gave none.
  [[nodiscard]] std::string problem() const;

 private:
  void on_connect(int code);
  void on_disconnect(int code);
  void send(const std::string& topic, const std::string& payload);

  mosquitto* client_;
  std::string will_topic_, will_;
  mutable std::mutex mutex_;  // protects the members below
  bool connected_ = false;
  std::string refusal_, problem_;
  std::map<std::string, std::string> published_;  // payloads by topic
};

}  // namespace servotwin::cli
