#include "tests/virtual_machine/recording.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tests/virtual_machine/example_machine.h"

namespace servotwin::virtual_machine {
namespace {

AxisRecord small_record(const std::string& name) {
  AxisRecord r;
  r.name = name;
  r.sample_time = 0.6e-3;
  r.command = (Eigen::ArrayXd(3) << 0.0, 1.2345678e-3, -2e-3).finished();
  r.actual = (Eigen::ArrayXd(3) << -1e-12, 1.2e-3, -0.0125).finished();
  r.torque = (Eigen::ArrayXd(3) << 1.0, -0.00004, 12.34567).finished();
  return r;
}

TEST(Recording, IsWrittenWithUnitsAndFixedDecimals) {
  std::ostringstream out;
  write_csv(
      {small_record("X"), small_record("Y")},
      {.time_decimals = 4, .command_decimals = 6, .actual_decimals = 3, .comments = {"made up"}},
      out);
  EXPECT_EQ(
      out.str(),
      "# made up\n"
      "time[s],X.command[mm],X.actual[mm],X.torque[Nm],Y.command[mm],Y.actual[mm],Y.torque[Nm]\n"
      "0.0000,0.000000,0.000,1.0000,0.000000,0.000,1.0000\n"
      "0.0006,1.234568,1.200,0.0000,1.234568,1.200,0.0000\n"
      "0.0012,-2.000000,-12.500,12.3457,-2.000000,-12.500,12.3457\n");
}

TEST(Recording, RefusesAxesThatDoNotBelongTogether) {
  std::ostringstream out;
  EXPECT_THROW(write_csv({}, {}, out), std::invalid_argument);
  AxisRecord shorter = small_record("Y");
  shorter.command.conservativeResize(2);
  EXPECT_THROW(write_csv({small_record("X"), shorter}, {}, out), std::invalid_argument);
  AxisRecord slower = small_record("Y");
  slower.sample_time = 1e-3;
  EXPECT_THROW(write_csv({small_record("X"), slower}, {}, out), std::invalid_argument);
}

TEST(Example, ShippedRecordingIsWhatTheVirtualMachineMakes) {
  const std::filesystem::path path =
      std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "examples/axis_production.csv";
  std::ifstream file(path, std::ios::binary);
  ASSERT_TRUE(file) << path;
  const std::string shipped{std::istreambuf_iterator<char>(file), {}};
  std::ostringstream out;
  write_example(out);
  const std::string made = out.str();
  // Not EXPECT_EQ on the whole: the report of a difference would be megabytes.
  const auto [a, b] = std::mismatch(shipped.begin(), shipped.end(), made.begin(), made.end());
  const auto line = 1 + std::count(shipped.begin(), a, '\n');
  EXPECT_TRUE(a == shipped.end() && b == made.end())
      << path << " differs from what the virtual machine makes, first in line " << line
      << "; make it again with servotwin-virtual-machine";
  EXPECT_LT(shipped.size(), 2'500'000U);
}

TEST(Example, PathIsClosedAndAxesKeepStep) {
  const PlanePath path = example_program();
  EXPECT_DOUBLE_EQ(path.x().duration(), path.y().duration());
  EXPECT_NEAR(path.x().duration(), 24.0, 1.0);
  EXPECT_EQ(path.x().end_position(), 0.0);
  EXPECT_EQ(path.y().end_position(), 0.0);
}

}  // namespace
}  // namespace servotwin::virtual_machine
