// Programs and corrections over DDS: received as sent, and completely by late readers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>

#include "drivers/dds/dds.h"
#include "servotwin.h"
#include "tests/drivers/dds_place.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

ProgramChunk chunk_of(std::uint32_t chunk, std::uint32_t chunks, std::size_t rows) {
  ProgramChunk out;
  out.program = "part.1";
  out.revision = 1'234'567'890'123ULL;
  out.chunk = chunk;
  out.chunks = chunks;
  out.learn = true;
  out.axes = {"X", "B"};
  for (std::size_t k = 0; k < rows; ++k) out.time_s.push_back(0.001 * static_cast<double>(k));
  for (std::size_t i = 0; i < 2 * rows; ++i)
    out.command.push_back(static_cast<double>(chunk) + 1.0 / static_cast<double>(i + 3));
  return out;
}

void expect_same(const ProgramChunk& came, const ProgramChunk& sent) {
  EXPECT_EQ(came.program, sent.program);
  EXPECT_EQ(came.revision, sent.revision);
  EXPECT_EQ(came.chunk, sent.chunk);
  EXPECT_EQ(came.chunks, sent.chunks);
  EXPECT_EQ(came.learn, sent.learn);
  EXPECT_EQ(came.axes, sent.axes);
  EXPECT_EQ(came.time_s, sent.time_s);
  EXPECT_EQ(came.command, sent.command);
}

TEST(DdsProgram, ChunksArriveAsTheyWereSentWhateverTheirSize) {
  const DdsNode node(place("programs"));
  DdsReader<ProgramChunk> reader(node);
  DdsWriter<ProgramChunk> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  for (const std::size_t rows : {std::size_t{3}, kMaxChunkSamples, std::size_t{1}}) {
    const ProgramChunk sent = chunk_of(3, 7, rows);
    ASSERT_TRUE(writer.write(sent));
    ProgramChunk came;
    ASSERT_TRUE(reader.receive(came, kPatience_s));
    expect_same(came, sent);
  }
}

// An inconsistent program is passed on unchanged, so that the daemon can refuse it by its name.
TEST(DdsProgram, LengthsThatContradictEachOtherComeAsTheyAre) {
  const DdsNode node(place("odd-programs"));
  DdsReader<ProgramChunk> reader(node);
  DdsWriter<ProgramChunk> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  ProgramChunk sent = chunk_of(9, 2, 5), came;
  sent.command.pop_back();
  sent.axes.clear();
  ASSERT_TRUE(writer.write(sent));
  ASSERT_TRUE(reader.receive(came, kPatience_s));
  expect_same(came, sent);
}

TEST(DdsProgram, WhoComesLateGetsTheChunksOfTheWholeProgramInTheirOrder) {
  const DdsNode node(place("late-programs"));
  DdsWriter<ProgramChunk> writer(node);
  for (std::uint32_t chunk = 0; chunk < kMaxProgramChunks; ++chunk)
    ASSERT_TRUE(writer.write(chunk_of(chunk, kMaxProgramChunks, 4)));
  const DdsNode late(node.place());
  DdsReader<ProgramChunk> reader(late);
  for (std::uint32_t chunk = 0; chunk < kMaxProgramChunks; ++chunk) {
    ProgramChunk came;
    ASSERT_TRUE(reader.receive(came, kPatience_s)) << chunk;
    ASSERT_EQ(came.chunk, chunk);
    expect_same(came, chunk_of(chunk, kMaxProgramChunks, 4));
  }
}

TEST(DdsProgram, AProgramThatCannotBeAnsweredByNameIsCountedAndNotGiven) {
  const DdsNode node(place("nameless-programs"));
  DdsReader<ProgramChunk> reader(node);
  // A writer of ours does not send it, so one of the wire itself.
  const dds_entity_t topic = dds_create_topic(node.participant(), topics::kProgram.type,
                                              topics::kProgram.name, nullptr, nullptr);
  const DdsEntity writer(
      dds_create_writer(node.publisher(), topic, topics::kProgram.qos().get(), nullptr), "write");
  servotwin_msgs_ProgramChunk sample{};
  node.place().machine.copy(sample.machine, sizeof sample.machine - 1);
  std::string("../part").copy(sample.program, sizeof sample.program - 1);
  ASSERT_EQ(dds_write(writer.get(), &sample), DDS_RETCODE_OK);
  ProgramChunk came;
  for (int i = 0; i < 100 && reader.counts().malformed == 0; ++i)
    ASSERT_FALSE(reader.receive(came, 0.1));
  EXPECT_EQ(reader.counts().malformed, 1U);
}

TEST(DdsProgram, WhatDoesNotFitIsRefusedBeforeItIsSent) {
  const DdsNode node(place("wide-programs"));
  DdsWriter<ProgramChunk> writer(node);
  const auto refused = [&](const ProgramChunk& chunk) -> std::string {
    try {
      writer.write(chunk);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "nothing";
  };
  ProgramChunk named = chunk_of(0, 1, 4);
  named.program = std::string(64, 'x');
  EXPECT_THAT(refused(named), HasSubstr("longer than 63"));
  EXPECT_THAT(refused(chunk_of(0, 1, kMaxChunkSamples + 1)),
              HasSubstr("time_s: 1025 values in a chunk, at most 1024 fit"));
  ProgramChunk many = chunk_of(0, 1, 4);
  many.axes.resize(33, "X");
  EXPECT_THAT(refused(many), HasSubstr("at most 32 axes, not 33"));
}

TEST(DdsProgram, CorrectionsArriveAsTheyWereSent) {
  const DdsNode node(place("corrections"));
  DdsReader<CorrectionChunk> reader(node);
  DdsWriter<CorrectionChunk> writer(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  CorrectionChunk sent;
  sent.program = "part.1";
  sent.revision = 7;
  sent.chunk = 1;
  sent.chunks = 2;
  sent.state = CorrectionState::kLearned;
  sent.reason = "limited by the model";
  sent.created_ns = 1'769'860'800'123'456'789;
  sent.valid_until_ns = sent.created_ns + 5;
  sent.cycle_s = 0.001;
  sent.axes = {{"X", false, 12, 1e-4, 2e-4, 3e-6, 4e-6}, {"B", true, 3, 5e-4, 6e-4, 7e-6, 8e-6}};
  sent.contour_before_rms = 9e-6;
  sent.contour_after_max = 1e-6;
  sent.corrected = {1.0, 2.0, 3.0, 4.0};
  sent.error_before = {5.0, 6.0, 7.0, 8.0};
  sent.error_after = {9.0, 10.0, 11.0, 12.0};
  sent.contour_before = {13.0, 14.0};
  sent.contour_after = {15.0, 16.0};
  ASSERT_TRUE(writer.write(sent));
  CorrectionChunk came;
  ASSERT_TRUE(reader.receive(came, kPatience_s));
  EXPECT_EQ(came.program, sent.program);
  EXPECT_EQ(came.revision, 7U);
  EXPECT_EQ(came.chunk, 1U);
  EXPECT_EQ(came.chunks, 2U);
  EXPECT_EQ(came.state, CorrectionState::kLearned);
  EXPECT_EQ(came.reason, sent.reason);
  EXPECT_EQ(came.created_ns, sent.created_ns);
  EXPECT_EQ(came.valid_until_ns, sent.valid_until_ns);
  EXPECT_EQ(came.cycle_s, 0.001);
  ASSERT_EQ(came.axes.size(), 2U);
  EXPECT_EQ(came.axes[1].name, "B");
  EXPECT_TRUE(came.axes[1].rotary);
  EXPECT_EQ(came.axes[1].model_version, 3);
  EXPECT_EQ(came.axes[0].before_rms, 1e-4);
  EXPECT_EQ(came.axes[0].before_max, 2e-4);
  EXPECT_EQ(came.axes[0].after_rms, 3e-6);
  EXPECT_EQ(came.axes[0].after_max, 4e-6);
  EXPECT_EQ(came.contour_before_rms, 9e-6);
  EXPECT_TRUE(std::isnan(came.contour_before_max));
  EXPECT_TRUE(std::isnan(came.contour_after_rms));
  EXPECT_EQ(came.contour_after_max, 1e-6);
  EXPECT_EQ(came.corrected, sent.corrected);
  EXPECT_EQ(came.error_before, sent.error_before);
  EXPECT_EQ(came.error_after, sent.error_after);
  EXPECT_EQ(came.contour_before, sent.contour_before);
  EXPECT_EQ(came.contour_after, sent.contour_after);

  // A refusal has nothing but its reason.
  CorrectionChunk refusal;
  refusal.program = "part.2";
  refusal.reason = "chunk 1 of 2 is missing";
  ASSERT_TRUE(writer.write(refusal));
  ASSERT_TRUE(reader.receive(came, kPatience_s));
  EXPECT_EQ(came.program, "part.2");
  EXPECT_EQ(came.state, CorrectionState::kRefused);
  EXPECT_EQ(came.reason, refusal.reason);
  EXPECT_TRUE(came.axes.empty());
  EXPECT_TRUE(came.corrected.empty());
}

}  // namespace
}  // namespace servotwin
