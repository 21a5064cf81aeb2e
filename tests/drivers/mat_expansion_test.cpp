// A small MATLAB file that would become large in memory is refused before the memory is spent.
#include <gmock/gmock.h>
#include <hdf5.h>
#include <matio.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/recordings/recording_file.h"
#include "tests/support/peak_memory.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

/// Time and command as integers of one byte, all 0.
void write_zeros(const std::filesystem::path& file, std::size_t rows, mat_ft version,
                 matio_compression compression) {
  mat_t* out = Mat_CreateVer(file.c_str(), nullptr, version);
  ASSERT_NE(out, nullptr);
  std::vector<std::int8_t> zeros(rows, 0);
  std::array<std::size_t, 2> shape{rows, 1};
  for (const char* name : {"t", "x"}) {
    matvar_t* variable =
        Mat_VarCreate(name, MAT_C_INT8, MAT_T_INT8, 2, shape.data(), zeros.data(), 0);
    EXPECT_EQ(Mat_VarWrite(out, variable, compression), 0);
    Mat_VarFree(variable);
  }
  Mat_Close(out);
}

Recording read(const std::filesystem::path& file) {
  ReadOptions options;
  options.columns = "X.command=x[mm]";
  return read_recording(file, options);
}

/// What reading says, and by how much the peak of memory grew, in a process of its own, whose peak
/// starts at what it has now.
std::pair<std::string, long> said_and_grown_kib(const std::filesystem::path& file) {
  int ends[2];
  if (pipe(ends) != 0) return {};
  const pid_t child = fork();
  if (child == 0) {
    std::string said = "read";
    const long before = test::peak_kib();
    try {
      (void)read(file);
    } catch (const std::exception& error) {
      said = error.what();
    }
    said = std::to_string(test::peak_kib() - before) + " " + said;
    _exit(write(ends[1], said.data(), said.size()) < 0 ? 1 : 0);
  }
  close(ends[1]);
  std::array<char, 4096> text{};
  const ssize_t size = ::read(ends[0], text.data(), text.size());
  close(ends[0]);
  waitpid(child, nullptr, 0);
  const std::string all(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  const std::size_t blank = all.find(' ');
  return {all.substr(blank + 1), std::stol(all)};
}

class MatExpansion : public testing::TestWithParam<mat_ft> {};

TEST_P(MatExpansion, ASmallFileThatBecomesLargeIsRefusedBeforeItIsRead) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "zeros.mat";
  write_zeros(file, 31'000'000, GetParam(), MAT_COMPRESSION_ZLIB);
  ASSERT_LT(std::filesystem::file_size(file), 1'200'000U);  // v5: 120 kB
  const auto [said, grown_kib] = said_and_grown_kib(file);
  EXPECT_THAT(said, HasSubstr("zeros.mat: a file of "));
  EXPECT_THAT(said, HasSubstr("would become 496 MB of values (31000000 rows, 2 columns)"));
  EXPECT_THAT(said, HasSubstr("the limit is 100 times the size of the file, or 64 MB"));
  EXPECT_THAT(said, HasSubstr("save -v6"));
#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)  // their shadow is memory, too
  EXPECT_LT(grown_kib, 8'000);
#endif
}

TEST(MatExpansion5, ARecordingOfConstantsIsRead) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "zeros.mat";
  write_zeros(file, 4'000'000, MAT_FT_MAT5, MAT_COMPRESSION_ZLIB);  // 64 MB: just allowed
  EXPECT_EQ(read(file).time.size(), 4'000'000U);
  // What is stored without compression is never refused: 5 MB become 80 MB.
  write_zeros(file, 5'000'000, MAT_FT_MAT5, MAT_COMPRESSION_NONE);
  EXPECT_EQ(read(file).time.size(), 5'000'000U);
}

/// `bytes` zeros as zlib writes them, made in parts.
std::vector<unsigned char> deflated_zeros(std::size_t bytes) {
  std::vector<unsigned char> block(1'000'000, 0), out(bytes / 500 + 1000);
  z_stream stream{};
  EXPECT_EQ(deflateInit(&stream, Z_DEFAULT_COMPRESSION), Z_OK);
  stream.next_out = out.data();
  stream.avail_out = static_cast<unsigned>(out.size());
  for (std::size_t left = bytes; left > 0;) {
    const std::size_t part = std::min(left, block.size());
    left -= part;
    stream.next_in = block.data();
    stream.avail_in = static_cast<unsigned>(part);
    EXPECT_EQ(deflate(&stream, left == 0 ? Z_FINISH : Z_NO_FLUSH), left == 0 ? Z_STREAM_END : Z_OK);
  }
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

/// Adds a vector of 100 values in a compressed chunk of this length.
void add_vector(hid_t file, const char* name, hsize_t chunk) {
  const hsize_t length[2] = {1, 100}, most[2] = {1, H5S_UNLIMITED}, part[2] = {1, chunk};
  const hsize_t begin[2] = {0, 0};
  const hid_t space = H5Screate_simple(2, length, most), how = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(how, 2, part);
  H5Pset_deflate(how, 1);
  const hid_t data =
      H5Dcreate2(file, name, H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, how, H5P_DEFAULT);
  const std::vector<unsigned char> zeros = deflated_zeros(chunk * sizeof(double));
  EXPECT_GE(H5Dwrite_chunk(data, H5P_DEFAULT, 0, begin, zeros.size(), zeros.data()), 0);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, 6);
  const hid_t scalar = H5Screate(H5S_SCALAR);
  const hid_t kind = H5Acreate2(data, "MATLAB_class", type, scalar, H5P_DEFAULT, H5P_DEFAULT);
  EXPECT_GE(H5Awrite(kind, type, "double"), 0);
  H5Aclose(kind);
  H5Sclose(scalar);
  H5Tclose(type);
  H5Dclose(data);
  H5Pclose(how);
  H5Sclose(space);
}

/// A v7.3 file with the vectors t and x, of 100 values each.
void write_chunks(const std::filesystem::path& file, hsize_t chunk) {
  Mat_Close(Mat_CreateVer(file.c_str(), nullptr, MAT_FT_MAT73));
  const hid_t out = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  ASSERT_GE(out, 0);
  for (const char* name : {"t", "x"}) add_vector(out, name, chunk);
  H5Fclose(out);
}

TEST(MatExpansion73, AFewValuesInAChunkThatBecomesLargeAreRefusedBeforeItIsInflated) {
  const test::TemporaryDirectory directory;
  const auto file = directory.path() / "chunk.mat";
  write_chunks(file, 1000);
  EXPECT_EQ(read(file).time.size(), 100U);
  write_chunks(file, 25'000'000);
  ASSERT_LT(std::filesystem::file_size(file), 1'000'000U);
  const auto [said, grown_kib] = said_and_grown_kib(file);
  EXPECT_THAT(said, HasSubstr("would become 200 MB of values at once (a chunk of variable 't')"));
#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)  // their shadow is memory, too
  EXPECT_LT(grown_kib, 8'000);
#endif
}

INSTANTIATE_TEST_SUITE_P(Formats, MatExpansion, testing::Values(MAT_FT_MAT5, MAT_FT_MAT73),
                         [](const auto& about) {
                           return std::string(about.param == MAT_FT_MAT5 ? "v5" : "v73");
                         });

}  // namespace
}  // namespace servotwin
