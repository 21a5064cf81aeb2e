// Whether offsets may be armed, by what the mapping says of the drives.
#include "daemon/input/offset_contract.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

namespace servotwin::daemon {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

CanMap map_with(const std::string& x, const std::string& y) {
  std::string text = "cycle_s = 0.001\n";
  for (const auto& [name, key, id] :
       {std::tuple{"X", x, "0x401"}, std::tuple{"Y", y, "0x402"}, std::tuple{"Z", y, "0x403"}}) {
    text += std::string("[[axis]]\nname = \"") + name + "\"\n" + key +
            "\ncommand = {id = 0x181, start_bit = 0, length = 32, unit = \"um\"}\noffset = {id = " +
            id + ", start_bit = 0, length = 32, unit = \"um\"}\n";
  }
  CheckedCanMap checked = check_can_map(text, "m.toml", "");
  if (!checked.problems.empty()) throw std::runtime_error(messages(checked.problems));
  return std::move(checked.map);
}

/// X and Y are corrected, Z is not.
Config with(double validity_s, std::vector<std::string> permitted = {}) {
  Config config;
  for (const char* name : {"X", "Y", "Z"}) config.axes.push_back({name, false, ""});
  config.axes[0].correction = config.axes[1].correction = OffsetLimits{1e-4, 0.01, 100.0};
  config.ilc.validity_s = validity_s;
  config.ilc.arm_without_timeout = std::move(permitted);
  return config;
}

TEST(OffsetContract, HoldsWhereEveryDriveDropsAnOffsetLateEnough) {
  const CanMap map = map_with("offset_timeout_s = 0.02", "offset_timeout_s = 0.05");
  const OffsetContract contract = offset_contract(with(0.02), 0.001, &map);
  EXPECT_THAT(contract.refusals, IsEmpty());
  EXPECT_THAT(contract.refusal(), IsEmpty());
  EXPECT_EQ(contract.drive_timeout_s, 0.05) << "the drive that waits longest";
}

TEST(OffsetContract, IsRefusedWhereTheMappingSaysNothing) {
  const CanMap map = map_with("offset_timeout_s = 0.02", "");
  const OffsetContract contract = offset_contract(with(0.02, {"Y"}), 0.001, &map);
  EXPECT_THAT(contract.refusals, ElementsAre(AllOf(HasSubstr("does not say"), HasSubstr("axis Y"),
                                                   HasSubstr("offset_timeout_s"))));
  EXPECT_THAT(contract.refusal(), StartsWith("offsets cannot be armed: the CAN mapping"));
}

TEST(OffsetContract, IsRefusedForADriveThatKeepsAnOffsetUnlessItsAxisIsNamed) {
  const CanMap map = map_with("offset_timeout_s = \"none\"", "offset_timeout_s = \"none\"");
  const OffsetContract contract = offset_contract(with(0.02, {"X"}), 0.001, &map);
  EXPECT_THAT(contract.refusals,
              ElementsAre(AllOf(HasSubstr("axis Y keeps the last offset for ever"),
                                HasSubstr("ilc.arm_without_timeout = [\"Y\"]"))));
  EXPECT_THAT(contract.remarks,
              ElementsAre(AllOf(HasSubstr("axis X keeps the last offset for ever"),
                                HasSubstr("after any gap longer than"))));
  EXPECT_THAT(offset_contract(with(0.02, {"X", "Y"}), 0.001, &map).refusals, IsEmpty());
}

TEST(OffsetContract, IsRefusedIfADriveDropsAnOffsetBeforeItsValidityIsOver) {
  const CanMap map = map_with("offset_timeout_s = 0.02", "offset_timeout_s = 0.019");
  EXPECT_THAT(offset_contract(with(0.02), 0.001, &map).refusals,
              ElementsAre(AllOf(HasSubstr("ilc.validity_s = 0.02 s is longer"),
                                HasSubstr("0.019 s"), HasSubstr("axis Y"))));
}

TEST(OffsetContract, IsRefusedIfAnOffsetExpiresBeforeTheNext) {
  EXPECT_THAT(offset_contract(with(0.0019), 0.001, nullptr).refusals,
              ElementsAre(HasSubstr("ilc.validity_s = 0.0019 s is shorter than two cycles of the "
                                    "machine (0.002 s)")));
  EXPECT_THAT(offset_contract(with(0.002), 0.001, nullptr).refusals, IsEmpty());
  Config none = with(0.0019);
  none.axes[0].correction = none.axes[1].correction = std::nullopt;
  EXPECT_THAT(offset_contract(none, 0.001, nullptr).refusals, IsEmpty()) << "nothing is corrected";
}

TEST(OffsetContract, SaysWhichObjectsOfTheDrivesMustBeSet) {
  CanMap map = map_with("offset_timeout_s = 0.025", "");
  map.messages[map.find(0, CanChannel::kOffset)->message].rpdo = 4;
  EXPECT_THAT(drive_settings(with(0.02), map),
              ElementsAre(AllOf(StartsWith("X: 0x1403:05 = 25 [ms]: event timer"),
                                HasSubstr("(0x401)"), HasSubstr("offset_timeout_s = 0.025")),
                          AllOf(StartsWith("X: 0x6007:00: abort connection"), HasSubstr("100 ms")),
                          AllOf(StartsWith("Y: 0x1400 + n, sub-index 5, >= 20 [ms]"),
                                HasSubstr("no offset_timeout_s")),
                          StartsWith("Y: 0x6007:00")));
}

}  // namespace
}  // namespace servotwin::daemon
