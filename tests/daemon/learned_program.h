// A program that a daemon learns over DDS.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/dds/dds.h"
#include "tests/support/process.h"

namespace servotwin::test {

/// Sends the path of axis X [m] and waits until the daemon has a correction that may be sent.
inline void learn_program(const DdsNode& node, const std::string& name,
                          const std::vector<double>& path, double cycle_s) {
  DdsWriter<ProgramChunk> writer(node);
  DdsReader<CorrectionChunk> reader(node);
  ASSERT_TRUE(writer.wait_for_readers(1, kPatience_s));
  ProgramChunk chunk;
  chunk.program = name;
  chunk.learn = true;
  chunk.axes = {"X"};
  chunk.chunks = static_cast<std::uint32_t>((path.size() + 999) / 1000);
  for (std::size_t k = 0; k < path.size(); ++k) {
    chunk.time_s.push_back(cycle_s * static_cast<double>(k));
    chunk.command.push_back(path[k]);
    if (chunk.time_s.size() < 1000 && k + 1 < path.size()) continue;
    ASSERT_TRUE(writer.write(chunk));
    ++chunk.chunk;
    chunk.time_s.clear();
    chunk.command.clear();
  }
  CorrectionChunk correction;
  ASSERT_TRUE(reader.receive(correction, kPatience_s));
  ASSERT_EQ(correction.state, CorrectionState::kLearned) << correction.reason;
  ASSERT_EQ(correction.reason.find("not sent"), std::string::npos) << correction.reason;
}

}  // namespace servotwin::test
