// Writes matrices and strings as a MATLAB file (v5), which MATLAB, Octave and scipy read.
// The file is written under a temporary name and renamed: completely or not at all. Throws
// std::runtime_error with the name of the file. One thread at a time, as
// drivers/recordings/matlab/mat.h.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace servotwin {

/// A matrix, a string, or a column of strings (a cell array).
struct MatVariable {
  std::string name;  ///< a letter, then letters, digits and _
  std::variant<Eigen::MatrixXd, std::string, std::vector<std::string>> value;
};

void write_mat(const std::filesystem::path& file, const std::vector<MatVariable>& variables);

}  // namespace servotwin
