// servotwin-virtual-machine [RECORDING] OUT.csv: writes what the virtual machine records, by name.
#include <cstdlib>
#include <exception>
#include <fstream>
#include <functional>
#include <iostream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/virtual_machine/example_machine.h"
#include "tests/virtual_machine/friction_rigs.h"
#include "tests/virtual_machine/recording.h"

namespace {

using namespace servotwin::virtual_machine;

// Of the cover where it takes more when it closes; paper 002 saw that and gives no number.
constexpr double kClosing = 1.12;

CsvFormat rig_format() {
  CsvFormat format;
  format.command_decimals = 9;  // its encoder has 24 bit on a turn
  format.actual_decimals = 9;
  format.torque_decimals = 6;
  return format;
}

void write_cover_rig(bool covered, double closing_ratio, std::uint64_t seed, double slowest,
                     double fastest, std::ostream& out) {
  const auto motion = cover_rig_motion(seed, slowest, fastest, 3);
  write_csv(
      {record(cover_rig_axis(covered, 0.01, closing_ratio), motion.command(), motion.duration())},
      rig_format(), out);
}

struct Named {
  std::string name, what;
  std::function<void(std::ostream&)> write;
};

const std::vector<Named>& recordings() {
  static const std::vector<Named> all{
      {"example", "examples/axis_production.csv", write_example},
      {"drive-chain", "paper 001: 51 velocities both ways, 15 min of motion",
       [](std::ostream& out) {
         write_csv({drive_chain_record(drive_chain_velocities(), drive_chain_bands())},
                   rig_format(), out);
       }},
      {"bare", "paper 002: the drive alone, 50 to 400 mm/s",
       [](std::ostream& out) { write_cover_rig(false, 1.0, 1, 0.05, 0.4, out); }},
      {"bare-slow", "the same, 10 to 50 mm/s",
       [](std::ostream& out) { write_cover_rig(false, 1.0, 3, 0.01, 0.05, out); }},
      {"covered", "paper 002: with its telescopic cover, 50 to 400 mm/s",
       [](std::ostream& out) { write_cover_rig(true, 1.0, 2, 0.05, 0.4, out); }},
      {"covered-slow", "the same, 10 to 50 mm/s",
       [](std::ostream& out) { write_cover_rig(true, 1.0, 4, 0.01, 0.05, out); }},
      {"closing", "covered, with a cover that takes 1.12 times as much when it closes",
       [](std::ostream& out) { write_cover_rig(true, kClosing, 2, 0.05, 0.4, out); }},
  };
  return all;
}

int usage() {
  std::cerr << "usage: servotwin-virtual-machine [RECORDING] OUT.csv    (- for standard output)\n";
  for (const Named& one : recordings()) std::cerr << "  " << one.name << ": " << one.what << '\n';
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3 || std::string_view(argv[1]).starts_with("--")) return usage();
  const std::string name = argc == 3 ? argv[1] : "example", path = argv[argc - 1];
  try {
    const Named* chosen = nullptr;
    for (const Named& one : recordings()) {
      if (one.name == name) chosen = &one;
    }
    if (chosen == nullptr) return usage();
    std::ofstream file;
    if (path != "-") file.open(path, std::ios::binary);
    std::ostream& out = path == "-" ? std::cout : file;
    if (out) chosen->write(out);
    if (!out.flush()) {
      std::cerr << "servotwin-virtual-machine: cannot write " << path << '\n';
      return EXIT_FAILURE;
    }
  } catch (const std::exception& e) {
    std::cerr << "servotwin-virtual-machine: " << e.what() << '\n';
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
