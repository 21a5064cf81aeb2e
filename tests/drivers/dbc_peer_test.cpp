// The DBC reader against a peer that shares no code with it: canmatrix decodes the same frames by
// the same files, and every signal is in the same frames with the same bits and the same value.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "drivers/can/dbc.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

struct Value {
  std::string raw;
  double value = 0.0;
};
/// By frame and signal.
using Values = std::map<std::pair<std::size_t, std::string>, Value>;

struct Frame {
  std::size_t message = 0;
  std::vector<std::uint8_t> data;
};

/// The bits as a whole number, or as a float in hex.
std::string raw_text(const CanSignal& signal, std::uint64_t raw) {
  if (signal.coding == Coding::kSigned) return std::to_string(raw_integer(signal, raw));
  if (signal.coding == Coding::kUnsigned) return std::to_string(raw);
  char text[40];
  std::snprintf(text, sizeof text, "%a", raw_number(signal, raw));
  return text;
}

Values ours(const Dbc& dbc, const std::vector<Frame>& frames) {
  Values values;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const DbcMessage& message = dbc.messages[frames[i].message];
    std::uint64_t selected = 0;
    for (const DbcSignal& signal : message.signals) {
      if (signal.multiplexing == Multiplexing::kSelector)
        selected = raw_bits(signal.signal, frames[i].data);
    }
    for (const DbcSignal& signal : message.signals) {
      if (signal.multiplexing == Multiplexing::kSelected && signal.selected_by != selected)
        continue;
      values[{i, signal.name}] = {raw_text(signal.signal, raw_bits(signal.signal, frames[i].data)),
                                  decoded(signal.signal, frames[i].data)};
    }
  }
  return values;
}

Values of_the_peer(const std::filesystem::path& folder, const Dbc& dbc,
                   const std::vector<Frame>& frames) {
  {
    std::ofstream out(folder / "frames");
    for (const Frame& frame : frames) {
      const DbcMessage& message = dbc.messages[frame.message];
      char text[4];
      out << std::hex << (message.id | (message.extended ? 1U << 31 : 0U)) << ' ';
      for (const std::uint8_t byte : frame.data) {
        std::snprintf(text, sizeof text, "%02x", byte);
        out << text;
      }
      out << '\n';
    }
  }
  const std::string command =
      "/usr/bin/python3 " SERVOTWIN_SOURCE_DIR "/tests/drivers/dbc_peer.py " +
      (folder / "m.dbc").string() + " " + (folder / "frames").string() + " " +
      (folder / "values").string() + " 2>" + (folder / "errors").string();
  if (std::system(command.c_str()) != 0) {
    std::ifstream errors(folder / "errors");
    ADD_FAILURE() << "the peer failed; is the Debian package python3-canmatrix there?\n"
                  << std::string{std::istreambuf_iterator<char>(errors), {}};
  }
  Values values;
  std::ifstream in(folder / "values");
  std::size_t frame = 0;
  std::string name, raw, value;
  while (in >> frame >> name >> raw >> value)
    values[{frame, name}] = {raw, std::strtod(value.c_str(), nullptr)};
  return values;
}

/// `frames` random frames of each message, by both.
void compare(const std::string& text, int frames, std::uint64_t seed) {
  const test::TemporaryDirectory place;
  const std::filesystem::path& folder = place.path();
  std::ofstream(folder / "m.dbc") << text;
  const Dbc dbc = read_dbc(folder / "m.dbc");
  std::mt19937_64 rng{seed};
  std::vector<Frame> all;
  for (std::size_t m = 0; m < dbc.messages.size(); ++m) {
    for (int i = 0; i < frames; ++i) {
      Frame frame{m, std::vector<std::uint8_t>(static_cast<std::size_t>(dbc.messages[m].length))};
      for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(rng());
      // A selector that is any byte would rarely select.
      for (const DbcSignal& signal : dbc.messages[m].signals) {
        if (signal.multiplexing == Multiplexing::kSelector)
          set_raw_bits(signal.signal, rng() % 5, frame.data);
      }
      all.push_back(std::move(frame));
    }
  }
  ASSERT_FALSE(all.empty());
  const Values mine = ours(dbc, all), peers = of_the_peer(folder, dbc, all);
  ASSERT_EQ(mine.size(), peers.size());
  for (const auto& [where, value] : mine) {
    const auto found = peers.find(where);
    ASSERT_NE(found, peers.end()) << "frame " << where.first << ": " << where.second;
    const std::string what = "frame " + std::to_string(where.first) + " of " +
                             dbc.messages[all[where.first].message].name + ": " + where.second;
    if (value.raw.find('x') == value.raw.npos && value.raw.find('n') == value.raw.npos) {
      ASSERT_EQ(value.raw, found->second.raw) << what;
    } else if (value.raw.find("nan") != value.raw.npos) {
      ASSERT_NE(found->second.raw.find("nan"), std::string::npos) << what;
      continue;
    } else {
      ASSERT_EQ(std::strtod(value.raw.c_str(), nullptr),
                std::strtod(found->second.raw.c_str(), nullptr))
          << what;
    }
    // The peer calculates in decimals; here a product and a sum are rounded to doubles.
    const double size = std::abs(value.value) + 1e3;
    if (std::isinf(value.value)) continue;
    ASSERT_NEAR(value.value, found->second.value, 4e-16 * size) << what;
  }
}

constexpr const char* kDrives = R"(VERSION "1.0"

NS_ :
	CM_
	SIG_VALTYPE_

BS_:

BU_: Drive1 Cnc

BO_ 385 Drive1_Status: 8 Drive1
 SG_ Demand : 0|32@1- (0.1,0) [-214748364.8|214748364.7] "um" Cnc
 SG_ Actual : 39|32@0- (0.001,-5) [0|0] "mm"  Cnc

BO_ 641 Drive1_Torque: 5 Drive1
 SG_ Torque : 7|12@0- (0.1,0) [0|0] "%" Cnc
 SG_ Word : 11|3@0+ (1,0) [0|0] "" Cnc
 SG_ Odd : 17|13@1- (-0.25,100) [0|0] "A" Cnc
 SG_ Bit : 39|1@0- (1,0) [0|0] "" Cnc

BO_ 2566834709 Mux : 16 Drive1
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" Cnc
 SG_ Torque0 m0 : 8|16@1- (0.1,0) [0|0] "%" Cnc
 SG_ Torque3 m3 : 15|16@0- (0.1,0) [0|0] "%" Cnc
 SG_ Speed3 m3 : 31|40@0+ (0.5,-1) [0|0] "mm" Cnc
 SG_ Single : 64|32@1- (1,0) [0|0] "rad" Cnc
 SG_ Motorola : 103|32@0- (2,1) [0|0] "rad" Cnc

CM_ BO_ 385 "A comment with a; semicolon,
BO_ 386 NotAMessage: 8 Drive1
and more";
SIG_VALTYPE_ 2566834709 Single : 1;
SIG_VALTYPE_ 2566834709 Motorola : 1;
)";

TEST(DbcPeer, DrivesWithBothByteOrdersSignsFloatsAndAMultiplexer) { compare(kDrives, 200, 1); }

/// Twenty messages of any length with signals anywhere in them.
std::string random_file(std::uint64_t seed) {
  std::mt19937_64 rng{seed};
  const auto below = [&](std::uint64_t end) { return static_cast<int>(rng() % end); };
  constexpr int kLengths[]{1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
  constexpr const char* kScales[]{"1", "0.1", "0.001", "-0.5", "1e-05", "360", "0.0078125"};
  constexpr const char* kOffsets[]{"0", "-40", "0.25", "1000"};
  std::string text = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n", floats;
  for (int m = 0; m < 20; ++m) {
    const bool extended = below(2) == 0;
    const std::uint32_t id = extended ? 0x80000000U + 0x800U + static_cast<std::uint32_t>(m) * 77U
                                      : 0x100U + static_cast<std::uint32_t>(m);
    const int bytes = kLengths[below(std::size(kLengths))];
    const bool multiplexed = bytes > 1 && below(3) == 0;
    text += "BO_ " + std::to_string(id) + " M" + std::to_string(m) + ": " + std::to_string(bytes) +
            " A\n";
    if (multiplexed) text += " SG_ Which M : 0|8@1+ (1,0) [0|0] \"\" B\n";
    for (int s = 0; s < 8; ++s) {
      CanSignal signal;
      do {
        signal.order = below(2) == 0 ? ByteOrder::kLittle : ByteOrder::kBig;
        signal.coding = static_cast<Coding>(below(5) % 3);
        signal.length = signal.coding == Coding::kFloat ? 32 << below(2) : 1 + below(64);
        if (signal.coding == Coding::kFloat && bytes < 4) signal.coding = Coding::kSigned;
        signal.start = below(8 * static_cast<std::uint64_t>(bytes));
      } while (bytes_needed(signal) == 0 || bytes_needed(signal) > bytes);
      const std::string name = "S" + std::to_string(s);
      text += " SG_ " + name;
      if (multiplexed && below(2) == 0) text += " m" + std::to_string(below(4));
      text += " : " + std::to_string(signal.start) + "|" + std::to_string(signal.length) + "@" +
              (signal.order == ByteOrder::kLittle ? "1" : "0") +
              (signal.coding == Coding::kUnsigned ? "+" : "-") + " (" +
              kScales[below(std::size(kScales))] + "," + kOffsets[below(std::size(kOffsets))] +
              ") [0|0] \"\" B\n";
      if (signal.coding == Coding::kFloat) {
        floats += "SIG_VALTYPE_ " + std::to_string(id) + " " + name + " : " +
                  (signal.length == 64 ? "2" : "1") + ";\n";
      }
    }
    text += "\n";
  }
  return text + floats;
}

TEST(DbcPeer, SignalsAnywhereInMessagesOfAnyLength) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE(seed);
    compare(random_file(seed), 30, seed);
  }
}

}  // namespace
}  // namespace servotwin
