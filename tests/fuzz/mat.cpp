// A recording as MATLAB file. libmatio reads it, whose own faults are not ours: what it does not
// survive is kept away from it, if at all, by what is checked before.
#include "drivers/recordings/matlab/mat.h"

#include "drivers/recordings/recording_file.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  ReadOptions options;
  options.columns = "X.command=qg[m],X.actual=qm[m],time=t[s]";
  fuzz::refused_or_read([&] { (void)read_mat(fuzz::as_file(data, size), options); });
  return 0;
}
