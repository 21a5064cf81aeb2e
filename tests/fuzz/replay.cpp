// NAME MUTATIONS DIRECTORY...: puts every file of the directories through a harness, and then that
// many inputs with bytes of theirs changed, from a fixed seed. What libFuzzer found once stays
// found, also without it.
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz.h"

namespace {

void run(const std::string& input) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()), input.size());
}

std::string mutated(std::string input, const std::string& other, std::mt19937_64& random) {
  const auto any = [&](std::size_t below) { return static_cast<std::size_t>(random() % below); };
  for (std::size_t changes = 1 + any(4); changes > 0 && !input.empty(); --changes) {
    const std::size_t at = any(input.size());
    switch (any(5)) {
      case 0:
        input[at] = static_cast<char>(any(256));
        break;
      case 1:
        input.erase(at, 1 + any(8));
        break;
      case 2:
        input.insert(at, input.substr(any(input.size()), any(16)));
        break;
      case 3:
        input.resize(at);
        break;
      default:
        input = input.substr(0, at) + other.substr(std::min(at, other.size()));
    }
  }
  return input;
}

}  // namespace

// What escapes is a finding, and ends the program.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  std::vector<std::string> inputs;
  for (int i = 2; i < argc; ++i) {
    if (!std::filesystem::is_directory(argv[i])) continue;  // no regression yet
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(argv[i]))
      files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    for (const std::filesystem::path& file : files) {
      std::ifstream in(file, std::ios::binary);
      inputs.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
      run(inputs.back());
    }
  }
  if (inputs.empty()) {
    std::cerr << "there is no input\n";
    return 1;
  }
  const int mutations = argc > 1 ? std::atoi(argv[1]) : 0;
  std::mt19937_64 random(1);
  for (int i = 0; i < mutations; ++i) {
    const std::string &one = inputs[random() % inputs.size()],
                      &other = inputs[random() % inputs.size()];
    run(mutated(one, other, random));
  }
  std::cout << inputs.size() << " inputs and " << mutations << " changed ones\n";
}
