#include "drivers/dds/dds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "servotwin.h"
#include "tests/drivers/dds_place.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

MachineFrame frame_with(int axes, int ahead) {
  MachineFrame frame;
  frame.sequence = 1'234'567'890'123ULL;
  frame.time_ns = 1'769'860'800'123'456'789;
  frame.axis_count = axes;
  frame.ahead_count = ahead;
  for (std::size_t i = 0; i < static_cast<std::size_t>(axes); ++i) {
    const auto a = static_cast<double>(i);
    frame.axes[i] = {0.1 * a + 1.0 / 3.0, 0.2 * a, i % 2 == 0 ? kAbsent : -a};
    for (std::size_t k = 0; k < static_cast<std::size_t>(ahead); ++k) {
      frame.ahead[i][k] = 100.0 * a + static_cast<double>(k);
    }
  }
  return frame;
}

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

TEST(Dds, FramesArriveAsTheyWereSentWhateverTheirSize) {
  const DdsNode node(place("frames"));
  DdsReader<MachineFrame> reader(node);
  DdsWriter<MachineFrame> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  // Large, small, large again: reused memory contains nothing of the frame before.
  for (const auto& [axes, ahead] : {std::pair{32, 32}, {1, 0}, {8, 0}, {3, 5}, {32, 32}}) {
    const MachineFrame sent = frame_with(axes, ahead);
    ASSERT_TRUE(writer.write(sent));
    MachineFrame came;
    ASSERT_TRUE(reader.receive(came, kPatience_s));
    EXPECT_EQ(came.sequence, sent.sequence);
    EXPECT_EQ(came.time_ns, sent.time_ns);
    ASSERT_EQ(came.axis_count, axes);
    ASSERT_EQ(came.ahead_count, ahead);
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes); ++i) {
      EXPECT_TRUE(same(came.axes[i].command, sent.axes[i].command));
      EXPECT_TRUE(same(came.axes[i].actual, sent.axes[i].actual));
      EXPECT_TRUE(same(came.axes[i].torque, sent.axes[i].torque));
      for (std::size_t k = 0; k < static_cast<std::size_t>(ahead); ++k) {
        ASSERT_EQ(came.ahead[i][k], sent.ahead[i][k]);
      }
    }
  }
  EXPECT_EQ(reader.counts().received, 5U);
  EXPECT_EQ(reader.counts().malformed, 0U);
  EXPECT_GT(reader.written_ns(), 0);
}

// Half a second at 1 kHz: a reader is kept from the processor for as long on a busy host.
TEST(Dds, AReaderMayFallBehindByHundredsOfFrames) {
  const DdsNode node(place("behind"));
  DdsReader<MachineFrame> reader(node);
  DdsWriter<MachineFrame> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  MachineFrame frame = frame_with(2, 0);
  for (frame.sequence = 0; frame.sequence < 500; ++frame.sequence) ASSERT_TRUE(writer.write(frame));
  for (std::uint64_t sequence = 0; sequence < 500; ++sequence) {
    ASSERT_TRUE(reader.receive(frame, kPatience_s));
    ASSERT_EQ(frame.sequence, sequence);
  }
}

TEST(Dds, NothingComesWhereNobodySends) {
  // Matching knows topics and partitions, not machines: other tests may be writing at the same
  // time.
  DdsPlace alone = place("silence");
  alone.partition = alone.machine;
  const DdsNode node(alone);
  DdsReader<MachineFrame> reader(node);
  MachineFrame frame;
  EXPECT_FALSE(reader.receive(frame, 0.02));
  EXPECT_FALSE(reader.matched());
}

TEST(Dds, ReadersTakeTheirOwnMachineOnly) {
  const DdsNode mine(place("mine")), other(place("other"));
  DdsReader<MachineFrame> reader(mine);
  DdsWriter<MachineFrame> my_writer(mine), other_writer(other);
  ASSERT_TRUE(my_writer.wait_for_readers(1, kPatience_s));
  ASSERT_TRUE(other_writer.wait_for_readers(1, kPatience_s));
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(other_writer.write(frame_with(1, 0)));
  ASSERT_TRUE(other_writer.wait_for_delivery(kPatience_s));
  MachineFrame sent = frame_with(1, 0);
  sent.sequence = 42;
  ASSERT_TRUE(my_writer.write(sent));
  MachineFrame came;
  while (reader.counts().received == 0) ASSERT_TRUE(reader.receive(came, kPatience_s));
  EXPECT_EQ(came.sequence, 42U);
  EXPECT_FALSE(reader.receive(came, 0.02));
  EXPECT_EQ(reader.counts().received, 1U);
  EXPECT_EQ(reader.counts().foreign, 3U);
}

TEST(Dds, PartitionsKeepCellsApart) {
  DdsPlace one = place("cells"), two = place("cells");
  one.partition = "cell-1";
  two.partition = "cell-2";
  const DdsNode here(one), there(two);
  DdsReader<MachineFrame> reader(here);
  DdsWriter<MachineFrame> same_cell(here), other_cell(there);
  ASSERT_TRUE(same_cell.wait_for_readers(1, kPatience_s));
  EXPECT_FALSE(other_cell.wait_for_readers(1, 0.1));
}

/// Sends messages that DdsWriter would not send.
class RawWriter {
 public:
  explicit RawWriter(const DdsNode& node)
      : machine_(node.place().machine),
        writer_(dds_create_writer(node.publisher(),
                                  dds_create_topic(node.participant(), topics::kMachineFrame.type,
                                                   topics::kMachineFrame.name, nullptr, nullptr),
                                  topics::kMachineFrame.qos().get(), nullptr),
                "write") {}
  void write(std::uint32_t axes, std::uint32_t ahead, std::uint32_t ahead_values,
             std::uint32_t flags = 0) {
    servotwin_msgs_MachineFrame sample{};
    std::memcpy(sample.machine, machine_.c_str(), machine_.size() + 1);
    servotwin_msgs_AxisSample axis_samples[32]{};
    for (auto& sample_of_axis : axis_samples) sample_of_axis = {1.0, 2.0, 3.0, flags};
    double values[1024]{};
    sample.axes = {32, axes, axis_samples, false};
    sample.ahead_count = ahead;
    sample.ahead_m = {1024, ahead_values, values, false};
    ASSERT_EQ(dds_write(writer_.get(), &sample), DDS_RETCODE_OK);
  }

 private:
  std::string machine_;
  DdsEntity writer_;
};

TEST(Dds, AFrameThatContradictsItselfIsCountedAndNotGiven) {
  const DdsNode node(place("malformed"));
  DdsReader<MachineFrame> reader(node);
  RawWriter raw(node);
  MachineFrame frame;
  raw.write(0, 0, 0);    // no axis
  raw.write(2, 3, 5);    // 2 axes, 3 cycles ahead, 5 values
  raw.write(1, 33, 33);  // further ahead than there is room for
  raw.write(32, 0xffffffff, 0);
  raw.write(2, 0x80000000, 0);  // 2 * 2^31 is 0 in 32 bits
  raw.write(1, 0, 0);
  ASSERT_TRUE(reader.receive(frame, kPatience_s));
  EXPECT_FALSE(reader.receive(frame, 0.02));
  EXPECT_EQ(reader.counts().received, 1U);
  EXPECT_EQ(reader.counts().malformed, 5U);
}

TEST(Dds, ValuesThatMustNotBeBelievedAreAbsent) {
  const DdsNode node(place("flags"));
  DdsReader<MachineFrame> reader(node);
  RawWriter raw(node);
  MachineFrame frame;
  raw.write(1, 0, 0, servotwin_msgs_kActualInvalid);
  ASSERT_TRUE(reader.receive(frame, kPatience_s));
  EXPECT_EQ(frame.axes[0].command, 1.0);
  EXPECT_TRUE(std::isnan(frame.axes[0].actual));
  raw.write(1, 0, 0, servotwin_msgs_kCommandInvalid);
  ASSERT_TRUE(reader.receive(frame, kPatience_s));
  EXPECT_TRUE(std::isnan(frame.axes[0].command));
  EXPECT_EQ(frame.axes[0].actual, 2.0);
}

TEST(Dds, PredictionsArriveAsTheyWereSent) {
  const DdsNode node(place("predictions"));
  DdsReader<MachinePrediction> reader(node);
  DdsWriter<MachinePrediction> writer(node, 0.001);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  MachinePrediction sent;
  sent.sequence = 7;
  sent.time_ns = -1;
  sent.axis_count = 2;
  sent.ahead_count = 3;
  sent.contour_error = 1e-6;
  sent.measured_contour_error = 2e-6;
  sent.axes[0] = {1e-6, 2e-6, 3e-6, 4e-6, 12, AxisState::kPredicting};
  sent.axes[1].state = AxisState::kBadSample;
  sent.ahead[1][2] = 5e-6;
  ASSERT_TRUE(writer.write(sent));
  MachinePrediction came;
  ASSERT_TRUE(reader.receive(came, kPatience_s));
  EXPECT_EQ(came.sequence, 7U);
  EXPECT_EQ(came.time_ns, -1);
  EXPECT_EQ(came.contour_error, 1e-6);
  EXPECT_EQ(came.measured_contour_error, 2e-6);
  EXPECT_EQ(came.axes[0].predicted_error, 1e-6);
  EXPECT_EQ(came.axes[0].standard_deviation, 2e-6);
  EXPECT_EQ(came.axes[0].measured_error, 3e-6);
  EXPECT_EQ(came.axes[0].residual, 4e-6);
  EXPECT_EQ(came.axes[0].model_version, 12);
  EXPECT_EQ(came.axes[0].state, AxisState::kPredicting);
  EXPECT_TRUE(std::isnan(came.axes[1].predicted_error));
  EXPECT_EQ(came.axes[1].state, AxisState::kBadSample);
  EXPECT_EQ(came.ahead[1][2], 5e-6);
}

MachineOffset offset_of(int axes) {
  MachineOffset offset;
  offset.sequence = 11;
  offset.time_ns = 1'769'860'800'123'456'789;
  offset.axis_count = axes;
  for (std::size_t i = 0; i < static_cast<std::size_t>(axes); ++i) {
    const auto a = static_cast<double>(i);
    offset.axes[i] = {1e-6 * a - 1.0 / 3.0, offset.time_ns + static_cast<std::int64_t>(i),
                      i % 2 == 0, static_cast<std::uint32_t>(i % 11)};
  }
  return offset;
}

/// Best effort: a lost message is written again.
bool exchange(DdsWriter<MachineOffset>& writer, DdsReader<MachineOffset>& reader,
              const MachineOffset& sent, MachineOffset& came) {
  for (int attempt = 0; attempt < 20; ++attempt) {
    if (!writer.write(sent)) return false;
    if (reader.receive(came, 0.5)) return true;
  }
  return false;
}

TEST(Dds, OffsetsArriveAsTheyWereSentWhateverTheirSize) {
  const DdsNode node(place("offsets"));
  DdsReader<MachineOffset> reader(node);
  DdsWriter<MachineOffset> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  for (const int axes : {32, 1, 3}) {
    const MachineOffset sent = offset_of(axes);
    MachineOffset came;
    ASSERT_TRUE(exchange(writer, reader, sent, came));
    EXPECT_EQ(came.sequence, sent.sequence);
    EXPECT_EQ(came.time_ns, sent.time_ns);
    ASSERT_EQ(came.axis_count, axes);
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes); ++i) {
      EXPECT_EQ(came.axes[i].offset, sent.axes[i].offset);
      EXPECT_EQ(came.axes[i].expires_ns, sent.axes[i].expires_ns);
      EXPECT_EQ(came.axes[i].send, sent.axes[i].send);
      EXPECT_EQ(came.axes[i].refusal, sent.axes[i].refusal);
    }
  }
}

TEST(Dds, AnOffsetThatIsNoNumberIsCountedAndNotGiven) {
  const DdsNode node(place("wild-offsets"));
  DdsReader<MachineOffset> reader(node);
  DdsWriter<MachineOffset> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  for (const double wild : {kAbsent, std::numeric_limits<double>::infinity()}) {
    MachineOffset offset = offset_of(3);
    offset.axes[2].offset = wild;
    const std::uint64_t before = reader.counts().malformed;
    MachineOffset came;
    for (int attempt = 0; attempt < 20 && reader.counts().malformed == before; ++attempt) {
      ASSERT_TRUE(writer.write(offset));
      ASSERT_FALSE(reader.receive(came, 0.05));
    }
    EXPECT_GT(reader.counts().malformed, before);
  }
  EXPECT_EQ(reader.counts().received, 0U);
}

TEST(Dds, AnOffsetThatNobodyTookInTimeIsGone) {
  const DdsNode node(place("old-offsets"));
  DdsReader<MachineOffset> reader(node);
  DdsWriter<MachineOffset> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  MachineOffset came;
  ASSERT_TRUE(exchange(writer, reader, offset_of(1), came)) << "they hear each other";
  while (reader.receive(came, 0.05)) {
  }
  const std::uint64_t taken = reader.counts().received;
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(writer.write(offset_of(1)));
  dds_sleepfor(2 * kOffsetLifespan_ns);
  EXPECT_FALSE(reader.receive(came, 0.02));
  EXPECT_EQ(reader.counts().received, taken);
}

TEST(Dds, OfTwoThatSendOffsetsTheStrongerIsHeard) {
  DdsPlace strong = place("offset-owners"), weak = strong;
  strong.strength = 2;
  weak.strength = 1;
  const DdsNode strong_node(strong), weak_node(weak);
  DdsReader<MachineOffset> reader(strong_node);
  DdsWriter<MachineOffset> owner(strong_node), standby(weak_node);
  ASSERT_TRUE(owner.wait_for_readers(1, kPatience_s));
  ASSERT_TRUE(standby.wait_for_readers(1, kPatience_s));
  MachineOffset came;
  ASSERT_TRUE(exchange(owner, reader, offset_of(1), came));
  MachineOffset other = offset_of(1);
  other.sequence = 12;
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(standby.write(other));
    while (reader.receive(came, 0.05)) EXPECT_EQ(came.sequence, 11U);
  }
}

TEST(Dds, WhoComesLateStillLearnsTheMachineTheModelsTheDiagnosesAndTheStatus) {
  const DdsNode node(place("late"));
  DdsWriter<MachineDescription> machines(node);
  DdsWriter<ModelAnnouncement> models(node);
  DdsWriter<DiagnosisAnnouncement> diagnoses(node);
  DdsWriter<MachineStatus> statuses(node);
  ASSERT_TRUE(machines.write({0.002, {{"X", false, "Nm"}, {"B", true, ""}}}));
  ASSERT_TRUE(models.write({"X", 1, 0, "t0", "first", "{}"}));
  ASSERT_TRUE(models.write({"B", 1, 0, "t0", "first", "{}"}));
  ASSERT_TRUE(models.write({"X", 2, 1, "t1", "better", R"({"schema":"servotwin.model/1"})"}));
  ASSERT_TRUE(diagnoses.write({"X", "{}"}));
  ASSERT_TRUE(diagnoses.write({"X", R"({"schema":"servotwin.diagnosis/1"})"}));
  MachineStatus status;
  status.state = DaemonState::kRunning;
  status.frames = 1000;
  status.work_p99_s = 12e-6;
  status.axes = {{"X", 2, 1.5e-6, "judging"}, {"B", 0, kAbsent, ""}};
  status.axes[1].rotary = true;
  status.axes[1].alarm = AlarmState::kRaised;
  status.last_error = "disk is full";
  status.repeated = 9;
  ASSERT_TRUE(statuses.write(status));

  const DdsNode late(node.place());
  DdsReader<MachineDescription> machine_reader(late);
  MachineDescription machine;
  ASSERT_TRUE(machine_reader.receive(machine, kPatience_s));
  EXPECT_EQ(machine.cycle_s, 0.002);
  ASSERT_EQ(machine.axes.size(), 2U);
  EXPECT_EQ(machine.axes[0].torque_unit, "Nm");
  EXPECT_TRUE(machine.axes[1].rotary);

  DdsReader<ModelAnnouncement> model_reader(late);
  ModelAnnouncement model;
  bool x = false, b = false;
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(model_reader.receive(model, kPatience_s));
    (model.axis == "X" ? x : b) = true;
    if (model.axis == "X") {
      EXPECT_EQ(model.version, 2) << "the one in force, not the one before";
      EXPECT_EQ(model.parent, 1);
      EXPECT_EQ(model.reason, "better");
      EXPECT_EQ(model.model_json, R"({"schema":"servotwin.model/1"})");
    }
  }
  EXPECT_TRUE(x && b);

  DdsReader<DiagnosisAnnouncement> diagnosis_reader(late);
  DiagnosisAnnouncement diagnosis;
  ASSERT_TRUE(diagnosis_reader.receive(diagnosis, kPatience_s));
  EXPECT_EQ(diagnosis.axis, "X");
  EXPECT_EQ(diagnosis.diagnosis_json, R"({"schema":"servotwin.diagnosis/1"})") << "the last one";

  DdsReader<MachineStatus> status_reader(late);
  MachineStatus now;
  ASSERT_TRUE(status_reader.receive(now, kPatience_s));
  EXPECT_EQ(now.state, DaemonState::kRunning);
  EXPECT_EQ(now.frames, 1000U);
  EXPECT_EQ(now.work_p99_s, 12e-6);
  EXPECT_TRUE(std::isnan(now.wake_p50_s));
  ASSERT_EQ(now.axes.size(), 2U);
  EXPECT_EQ(now.axes[0].activity, "judging");
  EXPECT_FALSE(now.axes[0].rotary);
  EXPECT_TRUE(now.axes[1].rotary);
  EXPECT_EQ(now.axes[0].alarm, AlarmState::kOff);
  EXPECT_EQ(now.axes[1].alarm, AlarmState::kRaised);
  EXPECT_EQ(now.last_error, "disk is full");
  EXPECT_EQ(now.repeated, 9U);
}

TEST(Dds, ADescriptionWithACycleOutOfRangeIsCountedAndNotGiven) {
  const DdsNode node(place("cycle"));
  DdsReader<MachineDescription> reader(node);
  DdsWriter<MachineDescription> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  MachineDescription came;
  std::uint64_t refused = 0;
  for (const double cycle_s : {0.0, -1e-3, 1e-300, 9.9e-6, 1.01, 1e300, kAbsent}) {
    ASSERT_TRUE(writer.write({cycle_s, {{"X", false, ""}}}));
    ASSERT_TRUE(writer.wait_for_delivery(kPatience_s));
    EXPECT_FALSE(reader.receive(came, 0.02)) << cycle_s;
    EXPECT_EQ(reader.counts().malformed, ++refused) << cycle_s;
  }
  for (const double cycle_s : {1e-5, 1.0}) {
    ASSERT_TRUE(writer.write({cycle_s, {{"X", false, ""}}}));
    ASSERT_TRUE(reader.receive(came, kPatience_s)) << cycle_s;
    EXPECT_EQ(came.cycle_s, cycle_s);
  }
}

TEST(Dds, NamesThatDoNotFitAreRefusedBeforeTheyAreSent) {
  const auto refused = [](const auto& action) -> std::string {
    try {
      action();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "nothing";
  };
  EXPECT_THAT(refused([] { DdsNode node({"", 91, ""}); }), HasSubstr("machine name ''"));
  EXPECT_THAT(refused([] { DdsNode node({"a/b", 91, ""}); }), HasSubstr("machine name 'a/b'"));
  EXPECT_THAT(refused([] { DdsNode node({std::string(64, 'x'), 91, ""}); }), HasSubstr("1 to 63"));
  EXPECT_THAT(refused([] {
                DdsNode node({"mill", 231, ""});
              }),
              HasSubstr("DDS domain 231: must be 0 to 230"));
  const DdsNode node(place("names"));
  DdsWriter<MachineDescription> writer(node);
  EXPECT_THAT(refused([&] {
                writer.write({0.001, {{std::string(32, 'x'), false, ""}}});
              }),
              HasSubstr("longer than 31"));
  EXPECT_THAT(refused([&] {
                writer.write({0.001, {{"X,Y", false, ""}}});
              }),
              HasSubstr("axis name 'X,Y'"));
  MachineDescription many;
  many.cycle_s = 0.001;
  many.axes.resize(33);
  EXPECT_THAT(refused([&] { writer.write(many); }), HasSubstr("at most 32 axes, not 33"));
}

}  // namespace
}  // namespace servotwin
