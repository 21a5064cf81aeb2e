#include "daemon/store/report_file.h"

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <system_error>

#include "daemon/store/axis_file.h"

namespace servotwin::daemon {

void write_report(const std::filesystem::path& store, const std::string& machine,
                  const std::string& axis, const std::string& html) {
  const std::filesystem::path file = axis_file(store, "reports", machine, axis, ".html");
  std::filesystem::path incomplete = file;
  incomplete += ".part";
  std::error_code error;
  std::filesystem::create_directories(file.parent_path(), error);
  {
    std::ofstream out(incomplete, std::ios::binary);
    out << html;
    out.close();
    if (!out) throw std::runtime_error("report " + file.string() + ": cannot be written");
  }
  std::filesystem::rename(incomplete, file, error);
  if (error)
    throw std::runtime_error("report " + file.string() + ": cannot be written: " + error.message());
}

std::optional<std::string> read_report(const std::filesystem::path& store,
                                       const std::string& machine, const std::string& axis) {
  if (!usable_name(machine) || !usable_name(axis)) return std::nullopt;  // from an address
  std::ifstream in(axis_file(store, "reports", machine, axis, ".html"), std::ios::binary);
  if (!in) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(in), {});
}

}  // namespace servotwin::daemon
