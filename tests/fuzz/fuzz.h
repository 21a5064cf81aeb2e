// What every harness shares. A harness is one file, NAME.cpp: it defines the function below for one
// reader of foreign bytes. It is built twice: with libFuzzer (./dev fuzz), and as a test that
// replays seeds/NAME and regressions/NAME with mutations of them (replay.cpp).
#pragma once

#include <sys/mman.h>
#include <sys/types.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

/// One input. Whatever it is: the reader answers, or refuses by an exception derived from
/// std::runtime_error or std::invalid_argument with one line. Everything else ends the program.
// NOLINTNEXTLINE(readability-identifier-naming): the name that libFuzzer calls
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace servotwin::fuzz {

inline std::string_view text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// Ends the program where a promise of the reader is broken.
inline void require(bool kept) {
  if (!kept) __builtin_trap();
}

/// Runs `read`; a refusal is fine if it is one line that says something.
template <class Read>
void refused_or_read(Read&& read) {
  const auto one_line = [](const std::exception& refusal) {
    const std::string_view message = refusal.what();
    require(!message.empty() && message.find('\n') == message.npos);
  };
  try {
    read();
  } catch (const std::runtime_error& refusal) {
    one_line(refusal);
  } catch (const std::invalid_argument& refusal) {
    one_line(refusal);
  }
}

/// The input as a file, for readers that take a path; in memory, one for all inputs.
inline std::filesystem::path as_file(const std::uint8_t* data, std::size_t size) {
  static const int file = memfd_create("input", 0);
  require(file >= 0 && ftruncate(file, 0) == 0 &&
          pwrite(file, data, size, 0) == static_cast<ssize_t>(size));
  return "/proc/self/fd/" + std::to_string(file);
}

}  // namespace servotwin::fuzz
