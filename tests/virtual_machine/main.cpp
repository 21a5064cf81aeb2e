// servotwin-virtual-machine OUT.csv: writes the recording that ships as
// examples/axis_production.csv.
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iostream>
#include <string>

#include "tests/virtual_machine/example_machine.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: servotwin-virtual-machine OUT.csv    (- for standard output)\n";
    return 2;
  }
  const std::string path = argv[1];
  try {
    std::ofstream file;
    if (path != "-") file.open(path, std::ios::binary);
    std::ostream& out = path == "-" ? std::cout : file;
    if (out) servotwin::virtual_machine::write_example(out);
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
