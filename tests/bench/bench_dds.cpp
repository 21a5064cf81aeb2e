// Frame in to prediction out: the round trip through the daemon, of so many axes at such a rate,
// with the commands of so many cycles ahead in every frame.
//
//   bench_dds prepare STORE AXES HZ                    a store with a model in force for every axis
//   bench_dds measure DOMAIN SECONDS AXES HZ [AHEAD]   against a daemon on that store; prints JSON
//
// Measured from before a frame is encoded and written until its prediction has been received and
// decoded, by one clock in one process; the daemon is another process. The first three seconds are
// not counted: the processes find each other, and the twins settle. What is not back half a second
// after the last frame is lost. `run` and `dds.py` start the daemon and compare.
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

#include "daemon/between/clock.h"
#include "daemon/store/store.h"
#include "drivers/dds/dds.h"
#include "servotwin.h"  // generated from msgs/servotwin.idl
#include "tests/bench/record.h"

namespace {

using namespace servotwin;

constexpr const char* kMachine = "bench";
constexpr int kWarmUp_s = 3;
constexpr std::int64_t kNever = 0;

/// What the machine is like.
struct Load {
  int axes = 8;   ///< 1..kMaxAxes
  int hz = 1000;  ///< cycles per second
  int ahead = 0;  ///< cycles whose commands are known ahead of time, 0..kMaxLookAhead

  [[nodiscard]] std::int64_t at_ns(std::int64_t cycle) const { return cycle * 1'000'000'000 / hz; }
};

/// The first three are linear, so that there is a path to predict the contour error of.
bool is_rotary(int axis) { return axis >= 3; }

std::string axis_name(int axis) { return "A" + std::to_string(axis + 1); }

void prepare(const char* directory, const Load& load) {
  daemon::Store store(directory, kMachine);
  for (int axis = 0; axis < load.axes; ++axis) {
    ModelRecord record;
    record.axis = axis_name(axis);
    record.rotary = is_rotary(axis);
    record.created = daemon::iso_time(daemon::wall_ns());
    record.model = bench::production_model();
    record.model.sample_time_s = 1.0 / load.hz;
    record.method = "pole-search";
    record.training = record.holdout = {1.2e-6, 6.2e-6};  // of the bench's record, free simulation
    record.source = "bench";
    store.promote(record, {record.created, record.axis, "model_promoted", "for the bench", {}});
  }
}

/// The record again and again, every time from where it ended; each axis somewhere else in it.
/// Straight lines between its samples, where the machine is faster.
class Motion {
 public:
  explicit Motion(const Load& load) : load_(load) {}

  [[nodiscard]] AxisSample at(int axis, std::int64_t cycle) const {
    const double position = static_cast<double>(cycle) / (record_.sample_time_s * load_.hz);
    const auto row = static_cast<std::int64_t>(position);
    const double share = position - static_cast<double>(row);
    const AxisSample from = row_of(row + 1357 * axis), to = row_of(row + 1357 * axis + 1);
    return {.command = std::lerp(from.command, to.command, share),
            .actual = std::lerp(from.actual, to.actual, share)};
  }

 private:
  [[nodiscard]] AxisSample row_of(std::int64_t row) const {
    const Eigen::Index k = row % record_.size();
    const Eigen::Index passes = row / record_.size();
    const double offset = travel_ * static_cast<double>(passes);
    return {.command = record_.command(k) + offset, .actual = record_.actual(k) + offset};
  }

  Load load_;
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
  Predictions(const DdsNode& node, int axes, std::vector<RoundTrip>& trips)
      : axes_(static_cast<std::uint32_t>(axes)),
        trips_(trips),
        listener_(dds_create_listener(this), &dds_delete_listener),
        reader_(read(node, topics::kPrediction, on_data(listener_.get()))) {}
  Predictions(const Predictions&) = delete;
  Predictions& operator=(const Predictions&) = delete;

 private:
  static dds_listener_t* on_data(dds_listener_t* listener) {
    dds_lset_data_available(listener, [](dds_entity_t reader, void* self) {
      static_cast<Predictions*>(self)->take(reader);
    });
    return listener;
  }

  void take(dds_entity_t reader) {
    void* loan[1] = {nullptr};
    dds_sample_info_t info;
    while (dds_take(reader, loan, &info, 1, 1) == 1) {
      const std::int64_t now_ns = daemon::steady_ns();
      const auto& prediction = *static_cast<const servotwin_msgs_Prediction*>(loan[0]);
      if (info.valid_data && prediction.sequence_number < trips_.size()) {
        RoundTrip& trip = trips_[prediction.sequence_number];
        const auto* axes = prediction.axes._buffer;
        trip.received_ns = now_ns;
        trip.predicted =
            prediction.axes._length == axes_ && std::all_of(axes, axes + axes_, [](const auto& a) {
              return a.state == servotwin_msgs_kPredicting;
            });
      }
      dds_return_loan(reader, loan, 1);
    }
  }

  std::uint32_t axes_;
  std::vector<RoundTrip>& trips_;
  std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener_;
  DdsEntity reader_;
};

struct Sent {
  std::uint32_t frame_bytes = 0, prediction_bytes = 0;
  std::int64_t late = 0;  ///< frames that were written more than a cycle after they were due
};

/// Writes the frames, each when it is due.
Sent send_frames(const DdsNode& node, DdsWriter<MachineFrame>& out, const Load& load,
                 std::vector<RoundTrip>& trips) {
  const Motion motion(load);
  Sent sent;
  auto probes = std::make_unique<std::array<SizeProbe, 2>>(
      std::array{SizeProbe(node, topics::kMachineFrame), SizeProbe(node, topics::kPrediction)});
  auto frame = std::make_unique<MachineFrame>();
  frame->axis_count = load.axes;
  frame->ahead_count = load.ahead;
  const std::int64_t warm_up = kWarmUp_s * load.hz;
  const std::int64_t start_ns = daemon::steady_ns() + 10'000'000;
  for (std::int64_t cycle = 0; cycle < std::ssize(trips); ++cycle) {
    if (cycle == warm_up / 2) {
      sent.frame_bytes = (*probes)[0].bytes();
      sent.prediction_bytes = (*probes)[1].bytes();
      probes.reset();
    }
    frame->sequence = static_cast<std::uint64_t>(cycle);
    frame->time_ns = load.at_ns(cycle);
    for (int axis = 0; axis < load.axes; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      frame->axes[i] = motion.at(axis, cycle);
      for (int k = 0; k < load.ahead; ++k)
        frame->ahead[i][static_cast<std::size_t>(k)] = motion.at(axis, cycle + k + 1).command;
    }
    const std::int64_t due_ns = start_ns + load.at_ns(cycle);
    sleep_until(due_ns);
    RoundTrip& trip = trips[static_cast<std::size_t>(cycle)];
    trip.sent_ns = daemon::steady_ns();
    if (cycle >= warm_up && trip.sent_ns - due_ns > load.at_ns(1)) ++sent.late;
    out.write(*frame);
  }
  return sent;
}

nlohmann::json measure(std::uint32_t domain, int seconds, const Load& load) {
  const DdsNode node({kMachine, domain, ""});
  DdsWriter<MachineDescription> describe(node);
  MachineDescription machine{.cycle_s = 1.0 / load.hz, .axes = {}};
  for (int axis = 0; axis < load.axes; ++axis)
    machine.axes.push_back({axis_name(axis), is_rotary(axis), ""});
  describe.write(machine);
  DdsWriter<MachineFrame> out(node);
  DdsReader<MachineStatus> status_reader(node);
  if (!out.wait_for_readers(1, 20.0)) throw std::runtime_error("no daemon came within 20 s");

  // The receiving thread writes other members than this one, which reads them when it is through.
  std::vector<RoundTrip> trips(static_cast<std::size_t>((kWarmUp_s + seconds) * load.hz));
  Sent sent;
  {
    const Predictions receiving(node, load.axes, trips);
    sent = send_frames(node, out, load, trips);
    dds_sleepfor(DDS_MSECS(500));
  }
  MachineStatus status;
  while (status_reader.receive(status, 0.0)) {
  }

  const RoundTrip* first = trips.data() + kWarmUp_s * load.hz;
  const RoundTrip* last = trips.data() + trips.size();
  nlohmann::json result = figures(first, last);
  result["predicted_share"] =
      static_cast<double>(std::count_if(first, last, [](const auto& t) { return t.predicted; })) /
      static_cast<double>(last - first);
  result["cycles"] = trips.size();  // with those of the warm-up
  result["late"] = sent.late;
  result["frame_bytes"] = sent.frame_bytes;
  result["prediction_bytes"] = sent.prediction_bytes;
  result["daemon"] = {{"wake_p50_us", 1e6 * status.wake_p50_s},
                      {"wake_p99_us", 1e6 * status.wake_p99_s},
                      {"work_p50_us", 1e6 * status.work_p50_s},
                      {"work_p99_us", 1e6 * status.work_p99_s},
                      {"frames_lost", status.lost},
                      {"predictions_dropped", status.predictions_dropped}};
  result["seconds"] = nlohmann::json::array();
  for (const RoundTrip* second = first; second < last; second += load.hz) {
    result["seconds"].push_back(figures(second, second + load.hz));
  }
  return result;
}

/// AXES HZ [AHEAD]
Load load_of(int count, char** words) {
  const Load load{std::atoi(words[0]), std::atoi(words[1]), count > 2 ? std::atoi(words[2]) : 0};
  if (load.axes < 1 || load.axes > kMaxAxes || load.hz < 1 || load.hz > 100'000 || load.ahead < 0 ||
      load.ahead > kMaxLookAhead)
    throw std::invalid_argument("1 to 32 axes, 1 to 100000 Hz and 0 to 32 cycles ahead, please");
  return load;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc == 5 && std::strcmp(argv[1], "prepare") == 0) {
      prepare(argv[2], load_of(2, argv + 3));
      return 0;
    }
    if ((argc == 6 || argc == 7) && std::strcmp(argv[1], "measure") == 0) {
      const auto result = measure(static_cast<std::uint32_t>(std::atoi(argv[2])),
                                  std::atoi(argv[3]), load_of(argc - 4, argv + 4));
      std::printf("%s\n", result.dump().c_str());
      return 0;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_dds: %s\n", error.what());
    return 1;
  }
  std::fprintf(stderr,
               "usage: bench_dds prepare STORE AXES HZ | measure DOMAIN SECONDS AXES HZ [AHEAD]\n");
  return 2;
}
