#include "drivers/recordings/matlab/mat.h"

#include <fcntl.h>
#include <hdf5.h>
#include <matio.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/file_handle.h"
#include "drivers/common/memory.h"
#include "drivers/common/text.h"
#include "drivers/recordings/column_map.h"
#include "drivers/recordings/matlab/mat_handles.h"

namespace servotwin {
namespace {

using Variable = MatVariableHandle;

// The library reports damage by a message and continues with zeros; here a message is an error.
thread_local std::string complaint;

void listen_to_library() {
  complaint.clear();
  // char* in matio 1.5.23, const char* in 1.5.28.
  Mat_LogInitFunc("servotwin", [](int, auto* message) {
    if (complaint.empty()) complaint = message;
  });
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // HDF5 would print its own messages
}

void require_no_complaint(const std::string& source) {
  if (complaint.empty()) return;
  throw std::runtime_error(source +
                           ": the MATLAB file is damaged: " + in_quotes(trimmed(complaint)));
}

// How many elements with contents of their own a variable claims, which begins at `at`: those of a
// cell array, and those of an array of structures that have fields. 0 of other classes.
std::uint64_t contents_claimed(const FileHandle& handle, std::uint64_t at, bool swapped) {
  // Words of four bytes. MATLAB has names of 63 characters, and few arrays of more than three
  // dimensions.
  constexpr std::size_t kFlags = 2, kDimensionBytes = 5, kDimensions = 6, kWords = 64;
  constexpr std::uint32_t kClassMask = 0xff, kCell = 1, kStructure = 2;
  std::array<std::uint32_t, kWords> words{};
  const std::size_t got = handle.read_at(reinterpret_cast<char*>(words.data()), sizeof words, at);
  if (got < kDimensions * sizeof words[0]) return 0;
  if (swapped) {
    for (std::uint32_t& word : words) word = __builtin_bswap32(word);
  }
  const std::uint32_t kind = words[kFlags] & kClassMask;
  if (kind != kCell && kind != kStructure) return 0;
  // An element takes its tag and its bytes, filled up to eight; a small one has both in eight.
  const auto is_small = [&](std::size_t i) { return words[i] >> 16 != 0; };
  const auto bytes_of = [&](std::size_t i) -> std::size_t {
    return is_small(i) ? words[i] >> 16 : words[i + 1];
  };
  const auto is_known = [](std::size_t i) { return i + 1 < kWords; };
  const auto after = [&](std::size_t i) {
    if (!is_known(i)) return kWords;
    return is_small(i) ? i + 2 : i + 2 + (bytes_of(i) + 7) / 8 * 2;
  };
  const std::size_t name = kDimensions + (std::size_t{words[kDimensionBytes]} + 7) / 8 * 2;
  std::uint64_t count = 1;
  for (std::size_t i = kDimensions; i < kDimensions + words[kDimensionBytes] / sizeof words[0];
       ++i) {
    if (i >= kWords || __builtin_mul_overflow(count, words[i], &count))
      return std::numeric_limits<std::uint64_t>::max();
  }
  const std::size_t fields = after(after(name));  // behind the length of a field's name
  const bool has_none = kind == kStructure && is_known(fields) && bytes_of(fields) == 0;
  return has_none ? 0 : count;
}

// A v5 file is a chain of elements with their lengths. The library does not notice if the last one
// is cut off, and fills it with zeros, so the chain is checked here first. (HDF5 does notice.)
// The library reserves memory for as many cells and structures as a variable claims. Each of them
// takes at least a tag, so that more are damage; seen here where they are neither compressed nor
// inside others.
void require_whole_elements(const std::filesystem::path& file) {
  constexpr std::uint64_t kHeader = 128, kTag = 8;
  constexpr std::uint32_t kMatrix = 14;
  const FileHandle handle = FileHandle::open(file, O_RDONLY);
  const std::uint64_t size = std::filesystem::file_size(file);
  std::string header(kHeader, '\0');
  header.resize(handle.read_at(header.data(), kHeader, 0));
  if (header.starts_with("MATLAB 7.3")) return;
  // "MI" in the byte order of the machine that made the file; MATLAB runs on little-endian ones
  // today.
  const bool swapped = header.ends_with("MI") == (std::endian::native == std::endian::little);
  std::uint64_t at = kHeader;
  while (at + kTag <= size) {
    std::uint32_t tag[2] = {};  // type and length
    if (handle.read_at(reinterpret_cast<char*>(tag), kTag, at) != kTag) break;
    if (swapped) {
      for (std::uint32_t& word : tag) word = __builtin_bswap32(word);
    }
    const std::uint64_t claimed =
        tag[0] == kMatrix ? contents_claimed(handle, at + kTag, swapped) : 0;
    if (claimed > tag[1] / kTag) {
      throw std::runtime_error(file.string() +
                               ": the MATLAB file is damaged: the variable at byte " +
                               std::to_string(at) + " claims " + std::to_string(claimed) +
                               " cells or structures within " + std::to_string(tag[1]) + " bytes");
    }
    at += kTag + tag[1];
  }
  if (at == size) return;
  throw std::runtime_error(
      file.string() + ": the MATLAB file is cut off or damaged: its variables end" + " at byte " +
      std::to_string(at) + ", the file at byte " + std::to_string(size));
}

std::string shape_of(const matvar_t& variable) {
  std::string shape;
  for (int i = 0; i < variable.rank; ++i) {
    shape += (i == 0 ? "" : " x ") + std::to_string(variable.dims[i]);
  }
  return shape;
}

// The number of values of a real numeric vector; anything else is refused by name.
std::size_t length_of(const std::string& source, const matvar_t& variable) {
  const std::string where = source + ": variable " + in_quotes(variable.name) + " is ";
  if (variable.class_type < MAT_C_DOUBLE || variable.class_type > MAT_C_UINT64) {
    throw std::runtime_error(
        where + "not an array of numbers (but a structure, cell, text or sparse matrix)");
  }
  if (variable.isComplex != 0) throw std::runtime_error(where + "complex");
  std::size_t longest = variable.rank > 0 ? 1 : 0, extended = 0;
  for (int i = 0; i < variable.rank; ++i) {
    if (variable.dims[i] == 1) continue;
    ++extended;
    longest = variable.dims[i];
  }
  if (extended > 1) {
    throw std::runtime_error(where + shape_of(variable) + ", but a channel is a vector");
  }
  // The library counts elements in an int.
  if (longest > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    throw std::runtime_error(where + shape_of(variable) + ": too long to be read");
  }
  return longest;
}

template <class Stored>
void read_as(const std::string& source, mat_t* file, matvar_t* variable, std::size_t begin,
             std::vector<double>& values) {
  const auto read = [&](void* to) {
    if (Mat_VarReadDataLinear(file, variable, to, static_cast<int>(begin), 1,
                              static_cast<int>(values.size())) != 0) {
      throw std::runtime_error(source + ": variable " + in_quotes(variable->name) +
                               " cannot be read: the file is damaged or cut off");
    }
    require_no_complaint(source);
  };
  if constexpr (std::is_same_v<Stored, double>) {
    read(values.data());
  } else {
    std::vector<Stored> stored(values.size());
    read(stored.data());
    std::transform(stored.begin(), stored.end(), values.begin(),
                   [](Stored value) { return static_cast<double>(value); });
  }
}

void read_values(const std::string& source, mat_t* file, matvar_t* variable, std::size_t begin,
                 std::vector<double>& values) {
  // A value that the library leaves unset is NaN and counts as missing.
  std::fill(values.begin(), values.end(), kAbsent);
  switch (variable->class_type) {
    case MAT_C_SINGLE:
      return read_as<float>(source, file, variable, begin, values);
    case MAT_C_INT8:
      return read_as<std::int8_t>(source, file, variable, begin, values);
    case MAT_C_UINT8:
      return read_as<std::uint8_t>(source, file, variable, begin, values);
    case MAT_C_INT16:
      return read_as<std::int16_t>(source, file, variable, begin, values);
    case MAT_C_UINT16:
      return read_as<std::uint16_t>(source, file, variable, begin, values);
    case MAT_C_INT32:
      return read_as<std::int32_t>(source, file, variable, begin, values);
    case MAT_C_UINT32:
      return read_as<std::uint32_t>(source, file, variable, begin, values);
    case MAT_C_INT64:
      return read_as<std::int64_t>(source, file, variable, begin, values);
    case MAT_C_UINT64:
      return read_as<std::uint64_t>(source, file, variable, begin, values);
    default:
      return read_as<double>(source, file, variable, begin, values);
  }
}

constexpr const char* kMatRemedy = "save it without compression (in MATLAB: save -v6)";

void require_plausible_values(const std::filesystem::path& file, std::size_t rows,
                              std::size_t columns) {
  require_plausible_size(
      file, static_cast<double>(rows) * static_cast<double>(columns) * sizeof(double),
      "values (" + std::to_string(rows) + " rows, " + std::to_string(columns) + " columns)",
      kMatRemedy);
}

/// An object of the HDF5 library.
class Hdf5 {
 public:
  Hdf5(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Hdf5(const Hdf5&) = delete;
  Hdf5& operator=(const Hdf5&) = delete;
  ~Hdf5() {
    if (id_ >= 0) close_(id_);
  }
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

/// The size of a chunk of a v7.3 variable [bytes]; 0 if it has none.
double chunk_bytes(hid_t file, const std::string& variable) {
  const Hdf5 data(H5Dopen2(file, variable.c_str(), H5P_DEFAULT), H5Dclose);
  if (data < 0) return 0.0;  // a group: no vector, which reading says
  const Hdf5 properties(H5Dget_create_plist(data), H5Pclose), type(H5Dget_type(data), H5Tclose);
  if (H5Pget_layout(properties) != H5D_CHUNKED) return 0.0;
  std::array<hsize_t, H5S_MAX_RANK> length{};
  const int rank = H5Pget_chunk(properties, H5S_MAX_RANK, length.data());
  auto bytes = static_cast<double>(H5Tget_size(type));
  for (int i = 0; i < rank; ++i) bytes *= static_cast<double>(length[static_cast<std::size_t>(i)]);
  return bytes;
}

// HDF5 inflates a chunk as a whole, however few of its values belong to the vector.
void require_plausible_chunks(const std::filesystem::path& file,
                              const std::vector<std::string>& variables) {
  const Hdf5 opened(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (opened < 0) throw std::runtime_error(file.string() + ": the MATLAB file is damaged");
  for (const std::string& variable : variables)
    require_plausible_size(file, chunk_bytes(opened, variable),
                           "values at once (a chunk of variable " + in_quotes(variable) + ")",
                           kMatRemedy);
}

// Converts to SI; values that are not numbers are counted and noted.
void convert(const std::string& name, const Unit& unit, std::vector<double>& values,
             std::vector<std::string>& notes) {
  std::size_t missing = 0, first = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = std::isfinite(values[i]) ? unit.to_si(values[i]) : kAbsent;
    if (std::isnan(values[i]) && missing++ == 0) first = i + 1;
  }
  if (missing == 0) return;
  notes.push_back(name + ": NaN or infinite in " + std::to_string(missing) + " of " +
                  counted(values.size(), "row") + ", the first is number " + std::to_string(first));
}

// The rows [begin, end) whose time is within the options' range, in seconds after the first stamp.
std::pair<std::size_t, std::size_t> selected_rows(const std::vector<double>& time,
                                                  const ReadOptions& options) {
  if (!selects_part(options)) return {0, time.size()};
  const auto stamped =
      std::find_if(time.begin(), time.end(), [](double t) { return !std::isnan(t); });
  if (stamped == time.end()) return {0, 0};
  const auto inside = [&](double t) {
    return t - *stamped >= options.from_s && t - *stamped <= options.to_s;
  };
  const auto first = std::find_if(time.begin(), time.end(), inside);
  const auto last = std::find_if(time.rbegin(), std::make_reverse_iterator(first), inside);
  return {static_cast<std::size_t>(first - time.begin()),
          static_cast<std::size_t>(last.base() - time.begin())};
}

}  // namespace

Recording read_mat(const std::filesystem::path& file, const ReadOptions& options) {
  const std::string source = file.string();
  require_whole_elements(file);
  listen_to_library();
  const MatFile mat(Mat_Open(file.c_str(), MAT_ACC_RDONLY));
  if (!mat)
    throw std::runtime_error(source + ": the MATLAB file is damaged or of an unknown version");

  std::vector<Variable> variables;
  std::vector<std::string> names;
  while (matvar_t* next = Mat_VarReadNextInfo(mat.get())) {
    variables.emplace_back(next);
    names.emplace_back(next->name == nullptr ? "" : next->name);
  }
  require_no_complaint(source);
  if (names.empty()) throw std::runtime_error(source + ": the MATLAB file has no variables");
  Layout layout = lay_out(source, names, options);

  std::size_t rows = 0;
  std::string first_name;
  const auto require_rows = [&](std::size_t index) {
    const std::size_t length = length_of(source, *variables[index]);
    if (first_name.empty()) {
      first_name = names[index];
      rows = length;
    }
    if (length != rows) {
      throw std::runtime_error(source + ": variables differ in length: " + first_name + " has " +
                               std::to_string(rows) + " values, " + names[index] + " has " +
                               std::to_string(length));
    }
  };
  std::vector<std::string> read;
  if (layout.time) {
    require_rows(*layout.time);
    read.push_back(names[*layout.time]);
  }
  for (const Layout::Column& column : layout.columns) {
    require_rows(column.index);
    read.push_back(names[column.index]);
  }
  require_plausible_values(file, rows, layout.columns.size() + 1);
  if (Mat_GetVersion(mat.get()) == MAT_FT_MAT73) require_plausible_chunks(file, read);
  require_memory(file, rows, layout.columns.size() + 1);

  Recording recording;
  recording.source = source;
  recording.axes = std::move(layout.axes);
  recording.notes = std::move(layout.notes);
  std::vector<double>& time = recording.time;
  time.resize(rows);
  if (layout.time) {
    read_values(source, mat.get(), variables[*layout.time].get(), 0, time);
    convert("time", layout.time_unit, time, recording.notes);
  } else {
    for (std::size_t i = 0; i < rows; ++i) time[i] = static_cast<double>(i) / *options.rate_hz;
  }
  const auto [begin, end] = selected_rows(time, options);
  if (begin == end) throw_no_rows(source, rows == 0 ? 0.0 : time.back() - time.front(), options);
  if (end - begin < rows) {
    recording.notes.push_back("outside --from and --to: " + std::to_string(rows - (end - begin)) +
                              " of " + counted(rows, "row"));
    time = std::vector<double>(time.begin() + static_cast<std::ptrdiff_t>(begin),
                               time.begin() + static_cast<std::ptrdiff_t>(end));
  }
  for (const Layout::Column& column : layout.columns) {
    std::vector<double>& values = values_of(recording.axes[column.axis], column.channel);
    values.resize(end - begin);
    read_values(source, mat.get(), variables[column.index].get(), begin, values);
    convert(column.name, column.unit, values, recording.notes);
  }
  fill_absent(recording);
  return recording;
}

}  // namespace servotwin
