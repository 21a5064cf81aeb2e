// Matrices and words as a MATLAB file (v5), to be read by MATLAB, Octave and scipy.
//
// Written beside its place and renamed, so that it appears whole or not at all. Throws
// std::runtime_error that names the file. One thread at a time, as drivers/mat.h.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace servotwin {

/// A matrix, a word, or a column of words (a cell array).
struct MatVariable {
  std::string name;  ///< a letter, then letters, digits and _
  std::variant<Eigen::MatrixXd, std::string, std::vector<std::string>> value;
};

void write_mat(const std::filesystem::path& file, const std::vector<MatVariable>& variables);

}  // namespace servotwin
