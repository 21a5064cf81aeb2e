// The signals of a recording between which a frequency response is estimated: channels of axes, or
// columns of any file.
#pragma once

#include <string>
#include <vector>

#include "cli/common/options.h"
#include "identification/response/frequency_response.h"

namespace servotwin::cli {

class OptionTable;

struct ResponseSignals {
  std::string axis;                 ///< empty: the signals are columns
  std::vector<std::string> inputs;  ///< names
  std::string output;
  double sample_time_s = 0.0;
  bool differenced = false;  ///< the signals are positions
  std::vector<ResponseRecord> records;
};

/// REC --axis --input --output.
struct ResponseOptions {
  RecordingOptions recording;
  std::string axis;  ///< empty: inputs and outputs are columns
  std::vector<std::string> inputs, outputs;

  void declare(OptionTable& command);
  /// Reads the signals and prints on `people` what was read.
  [[nodiscard]] ResponseSignals read(std::FILE* people) const;
};

}  // namespace servotwin::cli
