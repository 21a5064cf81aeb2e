// A model file: what is accepted is within its bounds, is written and read to the same, and can be
// simulated.
#include <cmath>
#include <nlohmann/json.hpp>

#include "identification/model/model_file.h"
#include "tests/fuzz/fuzz.h"
#include "twin/twin.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  fuzz::refused_or_read([&] {
    const ModelRecord record = read_model(fuzz::as_file(data, size));
    const nlohmann::json written = to_json(record);
    fuzz::require(to_json(model_from_json(written)) == written);
    Twin twin(record.model);
    twin.start(0.0);
    for (int i = 0; i < 10; ++i) (void)twin.follow(1e-6 * i);
  });
  return 0;
}
