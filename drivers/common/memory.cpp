#include "drivers/common/memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

#include "drivers/common/text.h"

namespace servotwin {

std::uint64_t available_memory_bytes() {
  std::ifstream meminfo("/proc/meminfo");
  std::string key;
  std::uint64_t kibibytes = 0;
  while (meminfo >> key >> kibibytes) {
    if (key == "MemAvailable:") return kibibytes * 1024;
    meminfo.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
  }
  // Without /proc, the total memory of the system is the best estimate.
  return static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) *
         static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

void require_memory(const std::filesystem::path& file, std::uint64_t rows, std::uint64_t columns,
                    std::uint64_t available) {
  const double needed = static_cast<double>(rows) * static_cast<double>(columns) * sizeof(double);
  if (needed <= static_cast<double>(available)) return;
  std::error_code unknown_size;
  const std::uintmax_t bytes = std::filesystem::file_size(file, unknown_size);
  const std::string size =
      unknown_size ? std::string() : " (" + number(static_cast<double>(bytes) / 1e9) + " GB)";
  throw std::runtime_error(file.string() + size + ": about " + number(static_cast<double>(rows)) +
                           " rows of " + std::to_string(columns) + " columns need " +
                           number(needed / 1e9) + " GB of memory, but only " +
                           number(static_cast<double>(available) / 1e9) +
                           " GB are free; read a part of it with --from S --to S");
}

// Packed, integers of one byte, or chunks that were never written: the time stamps of a recording
// alone are more than 1 % of what is read of it.
void require_plausible_size(const std::filesystem::path& file, double needed,
                            const std::string& of_what, const std::string& remedy) {
  constexpr double kMaxExpansion = 100;    // memory of the values, as a multiple of the file
  constexpr double kAlwaysAllowed = 64e6;  // bytes: two minutes of ten channels at 8 kHz
  const auto size = static_cast<double>(std::filesystem::file_size(file));
  if (needed <= std::max(kAlwaysAllowed, kMaxExpansion * size)) return;
  const auto megabytes = [](double bytes) { return number(bytes / 1e6) + " MB"; };
  throw std::runtime_error(file.string() + ": a file of " + megabytes(size) + " would become " +
                           megabytes(needed) + " of " + of_what + "; the limit is " +
                           number(kMaxExpansion) + " times the size of the file, or " +
                           megabytes(kAlwaysAllowed) + ". If this is a recording, " + remedy);
}

}  // namespace servotwin
