// stall_thread PID NAME: holds one thread still until its process is killed.
#include <iostream>

#include "tests/daemon/stalled_thread.h"

int main(int argc, char** argv) {
  try {
    if (argc != 3) throw std::runtime_error("usage: stall_thread PID NAME");
    const servotwin::daemon::StalledThread stalled(std::stoi(argv[1]), argv[2]);
    std::cout << "stalled" << std::endl;
    stalled.wait_for_its_end();
  } catch (const std::exception& error) {
    std::cerr << "stall_thread: " << error.what() << '\n';
    return 1;
  }
}
