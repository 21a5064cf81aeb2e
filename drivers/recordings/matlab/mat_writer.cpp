#include "drivers/recordings/matlab/mat_writer.h"

#include <matio.h>

#include <array>
#include <stdexcept>

#include "drivers/recordings/matlab/mat_handles.h"

namespace servotwin {
namespace {

using Variable = MatVariableHandle;

/// The library copies what it is given; its parameter is not const.
Variable made(const char* name, const Eigen::MatrixXd& matrix) {
  std::array<std::size_t, 2> size{static_cast<std::size_t>(matrix.rows()),
                                  static_cast<std::size_t>(matrix.cols())};
  return Variable(Mat_VarCreate(name, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, size.data(),
                                const_cast<double*>(matrix.data()), 0));
}

Variable made(const char* name, const std::string& word) {
  std::array<std::size_t, 2> size{1, word.size()};
  return Variable(Mat_VarCreate(name, MAT_C_CHAR, MAT_T_UTF8, 2, size.data(),
                                const_cast<char*>(word.data()), 0));
}

Variable made(const char* name, const std::vector<std::string>& words) {
  std::array<std::size_t, 2> size{words.size(), 1};
  Variable cells(Mat_VarCreate(name, MAT_C_CELL, MAT_T_CELL, 2, size.data(), nullptr, 0));
  if (!cells) return cells;
  for (std::size_t i = 0; i < words.size(); ++i)
    Mat_VarSetCell(cells.get(), static_cast<int>(i), made(nullptr, words[i]).release());
  return cells;
}

}  // namespace

void write_mat(const std::filesystem::path& file, const std::vector<MatVariable>& variables) {
  if (std::filesystem::exists(file) && !std::filesystem::is_regular_file(file))
    throw std::runtime_error(file.string() +
                             ": is not a regular file, which a MATLAB file must be");
  const std::filesystem::path beside = file.string() + ".part";
  const auto require = [&](bool fine) {
    if (fine) return;
    std::error_code ignored;
    std::filesystem::remove(beside, ignored);
    throw std::runtime_error(file.string() + ": cannot be written as a MATLAB file");
  };
  MatFile out(
      Mat_CreateVer(beside.c_str(), "MATLAB 5.0 MAT-file, written by Servotwin", MAT_FT_MAT5));
  require(out != nullptr);
  for (const MatVariable& variable : variables) {
    const Variable one = std::visit(
        [&](const auto& value) { return made(variable.name.c_str(), value); }, variable.value);
    require(one != nullptr && Mat_VarWrite(out.get(), one.get(), MAT_COMPRESSION_NONE) == 0);
  }
  require(Mat_Close(out.release()) == 0);
  std::error_code failed;
  std::filesystem::rename(beside, file, failed);
  require(!failed);
}

}  // namespace servotwin
