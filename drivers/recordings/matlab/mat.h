// Recordings as MATLAB files, v5 and v7.3: one real numeric vector per channel, named by
// ReadOptions::columns.
// A variable has no unit, so ReadOptions::columns must give it. Vectors are read in their stored
// type, one after the other, and only the selected part. Errors: as
// drivers/recordings/recording_file.h. One thread at a time: the HDF5 library below has global
// state. Source: libmatio (BSD-2-Clause).
#pragma once

#include <filesystem>

#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

[[nodiscard]] Recording read_mat(const std::filesystem::path& file, const ReadOptions& options);

}  // namespace servotwin
