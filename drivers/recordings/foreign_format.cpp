#include "drivers/recordings/foreign_format.h"

#include <algorithm>
#include <array>

namespace servotwin {
namespace {

using namespace std::string_view_literals;

constexpr const char* kTopics =
    "export the topic with command and encoder as CSV, for example with PlotJuggler";
constexpr const char* kArrays = "Servotwin's Python module takes its arrays (docs/python.md)";
constexpr std::string_view kPdf = "%PDF-";
constexpr const char* kPicture = "export the values from the program that shows the curves, as CSV";
constexpr const char* kCapture =
    "of buses, logs of CAN are read: those of candump -l, Vector ASC and PEAK TRC";

// First bytes by the public description of each format.
constexpr std::array kForeign{
    ForeignFormat{"SQLite format 3\0"sv, "SQLite database, as old bags of ROS 2 are",
                  "ros2 bag convert makes an MCAP file of a bag, which is read"},
    ForeignFormat{"#ROSBAG"sv, "ROS 1 bag", kTopics},
    ForeignFormat{
        "MDF     "sv, "measurement file of ASAM (MDF)",
        "in Python, asammdf.MDF('FILE').export('csv', single_time_base=True, add_units=True) "
        "makes a CSV file of it"},
    ForeignFormat{
        "LOGG"sv, "CAN log of Vector (BLF)",
        "python3 -m can.logconvert FILE.blf FILE.asc (python3-can) makes one that is read"},
    ForeignFormat{"TDSm"sv, "measurement of LabVIEW (TDMS)",
                  "in Python, nptdms.TdmsFile.read('FILE').as_dataframe().to_csv('FILE.csv')"},
    ForeignFormat{"PAR1"sv, "Parquet table",
                  "in Python, pandas.read_parquet('FILE').to_csv('FILE.csv', index=False)"},
    ForeignFormat{"\x93NUMPY"sv, "numpy array", kArrays},
    ForeignFormat{"\x89HDF\r\n\x1a\n"sv, "HDF5 file, but not one of MATLAB 7.3", kArrays},
    ForeignFormat{"PK\x03\x04"sv, "spreadsheet or another ZIP archive",
                  "save the sheet as CSV, or unpack the archive"},
    ForeignFormat{"\xd0\xcf\x11\xe0"sv, "old spreadsheet", "save the sheet as CSV"},
    ForeignFormat{"\x1f\x8b"sv, "file that gzip has packed", "unpack it: gunzip -k FILE"},
    ForeignFormat{"\xfd"
                  "7zXZ"sv,
                  "file that xz has packed", "unpack it: unxz -k FILE"},
    ForeignFormat{"BZh"sv, "file that bzip2 has packed", "unpack it: bunzip2 -k FILE"},
    ForeignFormat{"\x28\xb5\x2f\xfd"sv, "file that zstd has packed", "unpack it: unzstd FILE"},
    ForeignFormat{kPdf, "PDF document", kPicture},
    ForeignFormat{"\x89PNG"sv, "picture (PNG)", kPicture},
    ForeignFormat{"\xff\xd8\xff"sv, "picture (JPEG)", kPicture},
    ForeignFormat{"\xd4\xc3\xb2\xa1"sv, "network capture (pcap)", kCapture},
    ForeignFormat{"\xa1\xb2\xc3\xd4"sv, "network capture (pcap)", kCapture},
    ForeignFormat{"\x0a\x0d\x0d\x0a"sv, "network capture (pcapng)", kCapture},
};

}  // namespace

std::span<const ForeignFormat> foreign_formats() noexcept { return kForeign; }

const ForeignFormat* foreign_format(std::string_view start) noexcept {
  // A table may have a column PAR1; none of these formats is text, but that a PDF may begin with
  // much of it, and no column is called so.
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < '\t'; };
  if (std::none_of(start.begin(), start.end(), is_control) && !start.starts_with(kPdf))
    return nullptr;
  const auto* found = std::find_if(kForeign.begin(), kForeign.end(), [&](const ForeignFormat& one) {
    return start.starts_with(one.begins);
  });
  return found == kForeign.end() ? nullptr : found;
}

}  // namespace servotwin
