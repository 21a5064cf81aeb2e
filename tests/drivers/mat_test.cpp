#include "drivers/recordings/matlab/mat.h"

#include <gtest/gtest.h>
#include <matio.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/recordings/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using test::expect_error;

struct Format {
  const char* name;
  mat_ft version;
  matio_compression compression;
};

const auto kFormats = testing::Values(Format{"v5", MAT_FT_MAT5, MAT_COMPRESSION_NONE},
                                      Format{"v5_compressed", MAT_FT_MAT5, MAT_COMPRESSION_ZLIB},
                                      Format{"v73", MAT_FT_MAT73, MAT_COMPRESSION_NONE},
                                      Format{"v73_compressed", MAT_FT_MAT73, MAT_COMPRESSION_ZLIB});
const auto kVersion5 = testing::Values(Format{"v5", MAT_FT_MAT5, MAT_COMPRESSION_NONE},
                                       Format{"v5_compressed", MAT_FT_MAT5, MAT_COMPRESSION_ZLIB});
const auto kFormatName = [](const auto& about) { return std::string(about.param.name); };

/// Writes MATLAB files with the library itself; what it reads is compared with what went in.
class Writer {
 public:
  Writer(const std::filesystem::path& file, const Format& format)
      : file_(Mat_CreateVer(file.c_str(), nullptr, format.version)),
        compression_(format.compression) {
    if (file_ == nullptr) throw std::runtime_error("cannot create " + file.string());
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { Mat_Close(file_); }

  template <class T>
  void add(const char* name, matio_classes kind, matio_types type, std::vector<T> values,
           std::vector<std::size_t> shape = {}, int flags = 0) {
    if (shape.empty()) shape = {values.size(), 1};
    matvar_t* variable = Mat_VarCreate(name, kind, type, static_cast<int>(shape.size()),
                                       shape.data(), values.data(), flags);
    write(variable);
  }
  void add(const char* name, const std::vector<double>& values,
           std::vector<std::size_t> shape = {}) {
    add(name, MAT_C_DOUBLE, MAT_T_DOUBLE, values, std::move(shape));
  }
  void add_complex(const char* name, std::vector<double> values) {
    std::array<std::size_t, 2> shape{values.size(), 1};
    mat_complex_split_t both{values.data(), values.data()};
    write(Mat_VarCreate(name, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, shape.data(), &both, MAT_F_COMPLEX));
  }
  void add_structure(const char* name) {
    std::array<std::size_t, 2> shape{1, 1};
    std::array<const char*, 1> fields{"field"};
    write(Mat_VarCreateStruct(name, 2, shape.data(), fields.data(), 1));
  }

 private:
  void write(matvar_t* variable) {
    ASSERT_NE(variable, nullptr);
    EXPECT_EQ(Mat_VarWrite(file_, variable, compression_), 0);
    Mat_VarFree(variable);
  }
  mat_t* file_;
  matio_compression compression_;
};

std::vector<double> ramp(std::size_t size, double slope) {
  std::vector<double> values(size);
  for (std::size_t i = 0; i < size; ++i) values[i] = slope * static_cast<double>(i);
  return values;
}

class Mat : public testing::TestWithParam<Format> {
 protected:
  static ReadOptions mapped(const char* columns) {
    ReadOptions options;
    options.columns = columns;
    return options;
  }
  [[nodiscard]] std::filesystem::path file() const { return directory_.path() / "rec.mat"; }

  test::TemporaryDirectory directory_;
};

TEST_P(Mat, ReadsVectorsOfEveryNumericClass) {
  {
    Writer out(file(), GetParam());
    out.add("t", ramp(5, 0.25));
    out.add("row", ramp(5, 0.1), {1, 5});
    out.add<float>("single", MAT_C_SINGLE, MAT_T_SINGLE, {0.5F, 1.5F, 2.5F, -3.5F, 4.5F});
    out.add<std::int8_t>("i8", MAT_C_INT8, MAT_T_INT8, {-1, 2, -3, 4, 127});
    out.add<std::uint8_t>("u8", MAT_C_UINT8, MAT_T_UINT8, {1, 2, 3, 4, 255});
    out.add<std::int16_t>("i16", MAT_C_INT16, MAT_T_INT16, {-1, 2, -3, 4, 32767});
    out.add<std::uint16_t>("u16", MAT_C_UINT16, MAT_T_UINT16, {1, 2, 3, 4, 65535});
    out.add<std::int32_t>("i32", MAT_C_INT32, MAT_T_INT32, {-1, 2, -3, 4, 2147483647});
    out.add<std::uint32_t>("u32", MAT_C_UINT32, MAT_T_UINT32, {1, 2, 3, 4, 4294967295U});
    out.add<std::int64_t>("i64", MAT_C_INT64, MAT_T_INT64, {-1, 2, -3, 4, 1LL << 40});
    out.add<std::uint64_t>("u64", MAT_C_UINT64, MAT_T_UINT64, {1, 2, 3, 4, 1ULL << 40});
  }
  const Recording r = read_recording(
      file(), mapped("A.command=row[m],B.command=single[m],C.command=i8[m],D.command=u8[m],"
                     "E.command=i16[m],F.command=u16[m],G.command=i32[m],H.command=u32[m],"
                     "I.command=i64[m],J.command=u64[m],J.torque=i8[kN]"));
  EXPECT_EQ(r.time, ramp(5, 0.25));
  ASSERT_EQ(r.axes.size(), 10U);
  EXPECT_EQ(r.axes[0].command, ramp(5, 0.1));
  EXPECT_EQ(r.axes[1].command, (std::vector<double>{0.5, 1.5, 2.5, -3.5, 4.5}));
  const double last[] = {127, 255, 32767, 65535, 2147483647, 4294967295, 1LL << 40, 1LL << 40};
  for (std::size_t i = 0; i < std::size(last); ++i) {
    const auto& values = r.axes[i + 2].command;
    SCOPED_TRACE(r.axes[i + 2].name);
    EXPECT_EQ(values[0], i % 2 == 0 ? -1 : 1);
    EXPECT_EQ(values[2], i % 2 == 0 ? -3 : 3);
    EXPECT_EQ(values[4], last[i]);
  }
  EXPECT_EQ(r.axes[9].torque, (std::vector<double>{-1000, 2000, -3000, 4000, 127000}));
  EXPECT_EQ(r.axes[9].torque_unit, "N");
}

TEST_P(Mat, ReadsThePartThatIsAskedFor) {
  {
    Writer out(file(), GetParam());
    std::vector<double> time = ramp(20'000, 0.001);
    for (double& t : time) t += 50.0;
    out.add("t", time);
    out.add("x", ramp(20'000, 1.0));
  }
  ReadOptions options = mapped("X.command=x[mm]");
  options.from_s = 9.9995;
  options.to_s = 10.0025;
  const Recording r = read_recording(file(), options);
  EXPECT_EQ(r.axes.at(0).command, (std::vector<double>{10.0, 10.001, 10.002}));
  ASSERT_EQ(r.time.size(), 3U);
  EXPECT_DOUBLE_EQ(r.time[0], 60.0);
}

TEST_P(Mat, MissingValuesAreNanAndCounted) {
  {
    Writer out(file(), GetParam());
    out.add("t", ramp(4, 1.0));
    out.add("x", {0.0, NAN, HUGE_VAL, 3.0});
  }
  const Recording r = read_recording(file(), mapped("X.command=x[m]"));
  EXPECT_TRUE(std::isnan(r.axes.at(0).command[1]) && std::isnan(r.axes[0].command[2]));
  EXPECT_EQ(r.notes.back(), "X.command: NaN or infinite in 2 of 4 rows, the first is number 2");
}

TEST_P(Mat, RefusesWhatIsNoChannelByName) {
  {
    Writer out(file(), GetParam());
    out.add("t", ramp(6, 1.0));
    out.add("short", ramp(5, 1.0));
    out.add("matrix", ramp(6, 1.0), {2, 3});
    out.add_complex("complex", ramp(6, 1.0));
    out.add_structure("structure");
  }
  const auto refuses = [&](const char* columns, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)read_recording(file(), mapped(columns)); }, parts);
  };
  refuses("X.command=short[m]", {"differ in length", "t has 6", "short has 5"});
  refuses("X.command=matrix[m]", {"'matrix' is 2 x 3", "vector"});
  refuses("X.command=complex[m]", {"'complex' is complex"});
  refuses("X.command=structure[m]", {"'structure' is not an array of numbers"});
  refuses("X.command=matrixx[m]",
          {"no column 'matrixx'", "did you mean 'matrix'", "The file has: ", "short"});
  expect_error<std::runtime_error>([&] { (void)read_recording(file()); },
                                   {"--columns", "complex", "matrix", "short", "structure"});
}

INSTANTIATE_TEST_SUITE_P(Formats, Mat, kFormats, kFormatName);

class DamagedMat : public Mat {
 protected:
  DamagedMat() {
    Writer out(file(), GetParam());
    for (std::size_t i = 0; i < noise_.size(); ++i) {
      noise_[i] = std::sin(1e4 * static_cast<double>(i * i));
    }
    out.add("t", ramp(noise_.size(), 1.0));
    out.add("x", noise_);
  }
  // True if the file is refused, by its name; what is not refused must be read as it was written.
  [[nodiscard]] bool refused() const {
    try {
      const Recording read = read_recording(file(), mapped("X.command=x[m]"));
      EXPECT_EQ(read.time, ramp(noise_.size(), 1.0));
      EXPECT_EQ(read.axes.at(0).command, noise_);
      return false;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find("rec.mat: "), std::string::npos) << error.what();
      return true;
    }
  }
  std::vector<double> noise_ = std::vector<double>(4000);
};

TEST_P(DamagedMat, IsReadWholeBefore) { EXPECT_FALSE(refused()); }

TEST_P(DamagedMat, IsRefusedWhereverItIsCutOff) {
  const auto size = static_cast<double>(std::filesystem::file_size(file()));
  for (const double share : {0.9999, 0.98, 0.9, 0.6, 0.51, 0.3, 0.05, 0.002}) {
    std::filesystem::resize_file(file(), static_cast<std::uintmax_t>(share * size));
    EXPECT_TRUE(refused()) << share;
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, DamagedMat, kFormats, kFormatName);

// A changed byte may be a changed value, which nothing in the format tells; it must not be more.
// Version 5 only: HDF5 1.10 reads beside its own buffers when the structure of a v7.3 file is
// changed.
using ChangedMat = DamagedMat;

TEST_P(ChangedMat, IsReadOrRefused) {
  std::string bytes;
  {
    std::ifstream in(file(), std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  std::mt19937_64 random(20);
  for (int round = 0; round < 300; ++round) {
    std::string changed = bytes;
    // Most of what is not values is at the beginning.
    const std::size_t at = random() % (round % 2 == 0 ? bytes.size() : 4000);
    changed[at] = static_cast<char>(changed[at] ^ (1U << (random() % 8)));
    SCOPED_TRACE("byte " + std::to_string(at));
    try {
      const Recording read =
          read_recording(directory_.file("rec.mat", changed), mapped("X.command=x[m]"));
      ASSERT_EQ(read.axes.at(0).command.size(), read.time.size());
    } catch (const std::runtime_error& error) {
      ASSERT_NE(std::string(error.what()).find("rec.mat: "), std::string::npos) << error.what();
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ChangedMat, kVersion5, kFormatName);

/// Variables of a v5 file, byte by byte as the format's description says, in either byte order.
class HandMade {
 public:
  explicit HandMade(std::endian order) : order_(order) {
    bytes_ = "MATLAB 5.0 MAT-file, made by hand";
    bytes_.resize(124, ' ');
    put<std::uint16_t>(0x0100);
    put<std::uint16_t>('M' << 8 | 'I');
  }
  HandMade& add(char name, const std::vector<double>& values) {
    const auto size = static_cast<std::uint32_t>(8 * values.size());
    for (const std::uint32_t word :
         {14U, 16U + 16U + 16U + 8U + size,                       // a matrix
          6U, 8U, 6U, 0U,                                         // flags: double
          5U, 8U, static_cast<std::uint32_t>(values.size()), 1U,  // shape
          1U, 1U}) {                                              // a name of one byte
      put(word);
    }
    bytes_ += name + std::string(7, '\0');
    put(std::uint32_t{9});  // doubles
    put(size);
    for (const double value : values) put(value);
    return *this;
  }
  /// A cell array of these dimensions that has no contents.
  HandMade& add_cells(char name, std::uint32_t rows, std::uint32_t columns) {
    begin(name, 16U + 16U + 16U, 1U, rows, columns);
    return *this;
  }
  /// An array of structures of these dimensions that has no contents. `field`: name of a field.
  HandMade& add_structures(char name, std::uint32_t rows, std::uint32_t columns,
                           std::optional<char> field) {
    begin(name, 16U + 16U + 16U + 8U + (field ? 16U : 8U), 2U, rows, columns);
    put(std::uint32_t{4U << 16 | 5U});  // the length of a field's name
    put(std::uint32_t{8});
    put(std::uint32_t{1});
    put(std::uint32_t{field ? 8U : 0U});
    if (field) bytes_ += *field + std::string(7, '\0');
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void begin(char name, std::uint32_t size, std::uint32_t kind, std::uint32_t rows,
             std::uint32_t columns) {
    for (const std::uint32_t word : {14U, size, 6U, 8U, kind, 0U, 5U, 8U, rows, columns, 1U, 1U})
      put(word);
    bytes_ += name + std::string(7, '\0');
  }
  template <class T>
  void put(T value) {
    std::string bytes(sizeof value, '\0');
    std::memcpy(bytes.data(), &value, sizeof value);
    if (order_ != std::endian::native) std::reverse(bytes.begin(), bytes.end());
    bytes_ += bytes;
  }
  std::endian order_;
  std::string bytes_;
};

TEST(HandMadeMat, IsReadInEitherByteOrder) {
  const test::TemporaryDirectory directory;
  ReadOptions options;
  options.columns = "X.command=x[mm]";
  for (const auto order : {std::endian::little, std::endian::big}) {
    const std::string bytes = HandMade(order).add('t', {0, 1, 2}).add('x', {5, 6.5, -7}).bytes();
    const Recording r = read_recording(directory.file("rec.mat", bytes), options);
    EXPECT_EQ(r.time, (std::vector<double>{0, 1, 2}));
    EXPECT_EQ(r.axes.at(0).command, (std::vector<double>{0.005, 0.0065, -0.007}));
    const auto cut = directory.file("rec.mat", std::string_view(bytes).substr(0, bytes.size() - 1));
    expect_error<std::runtime_error>([&] { (void)read_recording(cut, options); }, {"cut off"});
  }
}

TEST(HandMadeMat, ClaimsMoreCellsOrStructuresThanItHas) {
  const test::TemporaryDirectory directory;
  ReadOptions options;
  options.columns = "X.command=x[mm]";
  constexpr std::uint32_t kMany = 4'000'000'000U;
  for (const auto order : {std::endian::little, std::endian::big}) {
    const auto with_vectors = [order] {
      return HandMade(order).add('t', {0, 1, 2}).add('x', {5, 6.5, -7});
    };
    const std::string where = "byte " + std::to_string(with_vectors().bytes().size());
    const auto refused = [&](const std::string& bytes, const char* claimed) {
      const auto file = directory.file("rec.mat", bytes);
      expect_error<std::runtime_error>([&] { (void)read_recording(file, options); },
                                       {"rec.mat", "damaged", where.c_str(), claimed});
    };
    refused(with_vectors().add_cells('c', 65'537, 671'088'640).bytes(), "43981136199680 cells");
    refused(with_vectors().add_cells('c', 1, 7).bytes(), "claims 7 cells");
    refused(with_vectors().add_structures('s', 65'537, 671'088'640, 'f').bytes(), "43981136199680");
    refused(with_vectors().add_structures('s', kMany, kMany, 'f').bytes(), "within 72 bytes");
    // One without fields has no contents, however many there are.
    const auto file =
        directory.file("rec.mat", with_vectors().add_structures('s', 1000, 1000, {}).bytes());
    EXPECT_EQ(read_recording(file, options).time.size(), 3);
  }
}

TEST(MatHeader, AHeaderWithNothingBehindIt) {
  const test::TemporaryDirectory directory;
  for (const char* version : {"5.0", "7.3"}) {
    std::string bytes = "MATLAB " + std::string(version) + " MAT-file, made by hand";
    bytes.resize(128, ' ');
    const auto file = directory.file("rec.mat", bytes);
    expect_error<std::runtime_error>([&] { (void)read_recording(file); },
                                     {"rec.mat", "MATLAB file"});
  }
}

}  // namespace
}  // namespace servotwin
