// Frame in to prediction out: the round trip through the daemon, eight axes at 1 kHz.
//
//   bench_dds prepare STORE            a store with a model in force for every axis
//   bench_dds measure DOMAIN SECONDS   against a daemon on that store; prints one JSON object
//
// Measured from before a frame is encoded and written until its prediction has been received and
// decoded, by one clock in one process; the daemon is another process. The first three seconds are
// not counted: the processes find each other, and the twins settle. What is not back half a second
// after the last frame is lost. `run` starts the daemon and compares.
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/clock.h"
#include "daemon/store.h"
#include "drivers/dds.h"
#include "servotwin.h"  // generated from msgs/servotwin.idl
#include "tests/bench/record.h"

namespace {

using namespace servotwin;

constexpr const char* kMachine = "bench";
constexpr int kAxes = 8;  // at most 9: axis_name
constexpr double kCycle_s = 1e-3;
constexpr std::int64_t kCycle_ns = 1'000'000;
constexpr int kCyclesPerSecond = 1000;
constexpr std::int64_t kWarmUp = 3 * kCyclesPerSecond;
constexpr std::int64_t kNever = 0;

std::string axis_name(int axis) { return {'A', static_cast<char>('1' + axis)}; }

void prepare(const char* directory) {
  Store store(directory, kMachine);
  for (int axis = 0; axis < kAxes; ++axis) {
    ModelRecord record;
    record.axis = axis_name(axis);
    record.created = iso_time(wall_ns());
    record.model = bench::production_model();
    record.method = "pole-search";
    record.training = record.holdout = {1.2e-6, 6.2e-6};  // of the bench's record, free simulation
    record.source = "bench";
    store.promote(record, {record.created, record.axis, "model_promoted", "for the bench", {}});
  }
}

/// The record again and again, every time from where it ended; each axis somewhere else in it.
class Motion {
 public:
  [[nodiscard]] AxisSample at(int axis, std::int64_t cycle) const {
    const std::int64_t row = cycle + 1357 * axis;
    const Eigen::Index k = row % record_.size();
    const double offset = travel_ * static_cast<double>(row / record_.size());
    return {.command = record_.command(k) + offset, .actual = record_.actual(k) + offset};
  }

 private:
  Segment record_ = bench::production_record();
  double travel_ = record_.command(record_.size() - 1) - record_.command(0);
};

DdsEntity read(const DdsNode& node, const Topic& topic, const dds_listener_t* listener = nullptr) {
  const dds_entity_t entity =
      dds_create_topic(node.participant(), topic.type, topic.name, nullptr, nullptr);
  return {dds_create_reader(node.subscriber(), entity, topic.qos().get(), listener),
          std::string("read ") + topic.name};
}

/// A reader beside the others that tells how long a message is on the wire.
class SizeProbe {
 public:
  SizeProbe(const DdsNode& node, const Topic& topic) : reader_(read(node, topic)) {}
  [[nodiscard]] std::uint32_t bytes() const {
    ddsi_serdata* data = nullptr;
    dds_sample_info_t info;
    if (dds_takecdr(reader_.get(), &data, 1, &info, DDS_ANY_STATE) != 1) return 0;
    const std::uint32_t size = ddsi_serdata_size(data);
    ddsi_serdata_unref(data);
    return size;
  }

 private:
  DdsEntity reader_;
};

struct RoundTrip {
  std::int64_t sent_ns = kNever;
  std::int64_t received_ns = kNever;
  bool predicted = false;  // by a settled model of every axis

  [[nodiscard]] bool lost() const { return received_ns == kNever; }
  [[nodiscard]] double us() const { return 1e-3 * static_cast<double>(received_ns - sent_ns); }
};

/// The smallest value that the share `q` of all values does not exceed.
double quantile(const std::vector<double>& sorted, double q) {
  if (sorted.empty()) return kAbsent;
  const auto n = static_cast<double>(sorted.size());
  const auto at = static_cast<std::size_t>(std::max(0.0, std::ceil(q * n) - 1.0));
  return sorted[at];
}

nlohmann::json figures(const RoundTrip* begin, const RoundTrip* end) {
  std::vector<double> us;
  for (const RoundTrip* trip = begin; trip != end; ++trip) {
    if (!trip->lost()) us.push_back(trip->us());
  }
  std::sort(us.begin(), us.end());
  return {{"sent", end - begin},          {"lost", (end - begin) - std::ssize(us)},
          {"p50_us", quantile(us, 0.5)},  {"p90_us", quantile(us, 0.9)},
          {"p99_us", quantile(us, 0.99)}, {"p999_us", quantile(us, 0.999)},
          {"max_us", quantile(us, 1.0)}};
}

void sleep_until(std::int64_t steady) {
  const timespec until{steady / 1'000'000'000, steady % 1'000'000'000};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// Takes predictions as they come, in Cyclone's receiving thread: where ddsperf takes its pongs.
class Predictions {
 public:
  Predictions(const DdsNode& node, std::vector<RoundTrip>& trips)
      : trips_(trips),
        listener_(dds_create_listener(&trips_), &dds_delete_listener),
        reader_(read(node, topics::kPrediction, on_data(listener_.get()))) {}

 private:
  static dds_listener_t* on_data(dds_listener_t* listener) {
    dds_lset_data_available(listener, [](dds_entity_t reader, void* trips) {
      take(reader, *static_cast<std::vector<RoundTrip>*>(trips));
    });
    return listener;
  }

  static void take(dds_entity_t reader, std::vector<RoundTrip>& trips) {
    void* loan[1] = {nullptr};
    dds_sample_info_t info;
    while (dds_take(reader, loan, &info, 1, 1) == 1) {
      const std::int64_t now_ns = steady_ns();
      const auto& prediction = *static_cast<const servotwin_msgs_Prediction*>(loan[0]);
      if (info.valid_data && prediction.sequence_number < trips.size()) {
        RoundTrip& trip = trips[prediction.sequence_number];
        const auto* axes = prediction.axes._buffer;
        trip.received_ns = now_ns;
        trip.predicted =
            prediction.axes._length == kAxes && std::all_of(axes, axes + kAxes, [](const auto& a) {
              return a.state == servotwin_msgs_kPredicting;
            });
      }
      dds_return_loan(reader, loan, 1);
    }
  }

  std::vector<RoundTrip>& trips_;
  std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener_;
  DdsEntity reader_;
};

/// Writes `cycles` frames, one per millisecond; returns how long a frame and a prediction are.
std::array<std::uint32_t, 2> send_frames(const DdsNode& node, DdsWriter<MachineFrame>& out,
                                         std::vector<RoundTrip>& trips) {
  const Motion motion;
  std::array<std::uint32_t, 2> bytes{};
  auto probes = std::make_unique<std::array<SizeProbe, 2>>(
      std::array{SizeProbe(node, topics::kMachineFrame), SizeProbe(node, topics::kPrediction)});
  auto frame = std::make_unique<MachineFrame>();
  frame->axis_count = kAxes;
  const std::int64_t start_ns = steady_ns() + 10 * kCycle_ns;
  for (std::int64_t cycle = 0; cycle < std::ssize(trips); ++cycle) {
    if (cycle == kWarmUp / 2) {
      bytes = {(*probes)[0].bytes(), (*probes)[1].bytes()};
      probes.reset();
    }
    frame->sequence = static_cast<std::uint64_t>(cycle);
    frame->time_ns = cycle * kCycle_ns;
    for (int axis = 0; axis < kAxes; ++axis) {
      frame->axes[static_cast<std::size_t>(axis)] = motion.at(axis, cycle);
    }
    sleep_until(start_ns + cycle * kCycle_ns);
    trips[static_cast<std::size_t>(cycle)].sent_ns = steady_ns();
    out.write(*frame);
  }
  return bytes;
}

nlohmann::json measure(std::uint32_t domain, int seconds) {
  const DdsNode node({kMachine, domain, ""});
  DdsWriter<MachineDescription> describe(node);
  MachineDescription machine{.cycle_s = kCycle_s, .axes = {}};
  for (int axis = 0; axis < kAxes; ++axis) machine.axes.push_back({axis_name(axis), false, ""});
  describe.write(machine);
  DdsWriter<MachineFrame> out(node);
  DdsReader<MachineStatus> status_reader(node);
  if (!out.wait_for_readers(1, 20.0)) throw std::runtime_error("no daemon came within 20 s");

  // The receiving thread writes other members than this one, which reads them when it is through.
  std::vector<RoundTrip> trips(static_cast<std::size_t>(kWarmUp + seconds * kCyclesPerSecond));
  std::array<std::uint32_t, 2> bytes{};
  {
    const Predictions receiving(node, trips);
    bytes = send_frames(node, out, trips);
    dds_sleepfor(DDS_MSECS(500));
  }
  MachineStatus status;
  while (status_reader.receive(status, 0.0)) {
  }

  const RoundTrip* first = trips.data() + kWarmUp;
  const RoundTrip* last = trips.data() + trips.size();
  nlohmann::json result = figures(first, last);
  result["predicted_share"] =
      static_cast<double>(std::count_if(first, last, [](const auto& t) { return t.predicted; })) /
      static_cast<double>(last - first);
  result["frame_bytes"] = bytes[0];
  result["prediction_bytes"] = bytes[1];
  result["daemon"] = {{"wake_p50_us", 1e6 * status.wake_p50_s},
                      {"wake_p99_us", 1e6 * status.wake_p99_s},
                      {"work_p50_us", 1e6 * status.work_p50_s},
                      {"work_p99_us", 1e6 * status.work_p99_s},
                      {"frames_lost", status.lost},
                      {"predictions_dropped", status.predictions_dropped}};
  result["seconds"] = nlohmann::json::array();
  for (const RoundTrip* second = first; second < last; second += kCyclesPerSecond) {
    result["seconds"].push_back(figures(second, second + kCyclesPerSecond));
  }
  return result;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc == 3 && std::strcmp(argv[1], "prepare") == 0) {
      prepare(argv[2]);
      return 0;
    }
    if (argc == 4 && std::strcmp(argv[1], "measure") == 0) {
      const auto result =
          measure(static_cast<std::uint32_t>(std::atoi(argv[2])), std::atoi(argv[3]));
      std::printf("%s\n", result.dump().c_str());
      return 0;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_dds: %s\n", error.what());
    return 1;
  }
  std::fprintf(stderr, "usage: bench_dds prepare STORE | measure DOMAIN SECONDS\n");
  return 2;
}
