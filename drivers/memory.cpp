#include "drivers/memory.h"

#include <unistd.h>

#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

#include "drivers/text.h"

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

}  // namespace servotwin
