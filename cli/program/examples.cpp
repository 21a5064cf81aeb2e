#include "cli/program/examples.h"

namespace servotwin::cli {
namespace {

// clang-format off
constexpr std::string_view kExamples[] = {
    "servotwin identify examples/axis_production.csv --axis X --model x.json",
    "servotwin predict examples/axis_production.csv --axis X --model x.json --plot x.svg",
    "servotwin simulate examples/axis_production.csv --model x.json --noise 1 --out simulated.csv",
    "servotwin export x.json --fmu x.fmu",
    "servotwin diagnose examples/axis_production.csv --axis X --report x.html",
    "servotwin history --store /var/lib/servotwin --axis X",
    "servotwin motion-law --velocities 1,2,5,10,20,50,100 --travel 100 --out friction_path.csv",
    "servotwin characterize examples/axis_production.csv --axis X --method motion",
    "servotwin sequence --bare bare.csv --covered covered.csv --axis X --lead 32",
    "servotwin frequency-response examples/axis_production.csv --axis X --plot x.svg",
    "servotwin multivariable examples/axis_production.csv",
    "servotwin fit-axis examples/feed_axis.toml --response response.csv --out fitted.toml",
    "servotwin what-if examples/feed_axis.toml --set coupling.stiffness_nm_per_rad=36000",
    "servotwin learn examples/axis_production.csv --model x.json --out corrected.csv",
    "servotwin preview path.csv --dds --machine mill-7",
    "servotwin replay examples/axis_production.csv --dds",
    "servotwin watch --dds --summary",
    "servotwin mqtt --machine mill-7 --broker broker.plant:1883",
    "servotwin mtconnect --machine mill-7 --device Devices.xml",
    "servotwin ros2 --machine mill-7 --ros-domain 0",
    "servotwin put-in-force x.json --dds",
    "servotwin check-config examples/can_daemon.toml",
    "servotwin help identify",
    "servotwin version",
    "servotwin completion bash > ~/.local/share/bash-completion/completions/servotwin",
    "servotwin formats",
    "servotwin manual > servotwin.1",
};
// clang-format on

}  // namespace

std::vector<std::string> examples_of(std::string_view command) {
  std::vector<std::string> out;
  const std::string begin = "servotwin " + std::string(command);
  for (const std::string_view line : kExamples) {
    if (line == begin || line.starts_with(begin + " ")) out.emplace_back(line);
  }
  return out;
}

}  // namespace servotwin::cli
