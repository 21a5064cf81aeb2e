// The transactions in the write-ahead log of an SQLite database, read from the file itself: SQLite
// takes a damaged frame for the end of the log and says nothing. Format:
// https://www.sqlite.org/fileformat2.html#walformat. Any thread.
#pragma once

#include <filesystem>
#include <vector>

namespace servotwin::daemon {

/// The numbers, from 1, of the frames that end a transaction, those behind a damaged frame as well,
/// in ascending order. A frame that the file ends in is none. `page_size` of the database [bytes].
/// Empty if there is no log. Throws std::runtime_error if it cannot be read.
[[nodiscard]] std::vector<int> commits_in_log(const std::filesystem::path& log,
                                              std::size_t page_size);

}  // namespace servotwin::daemon
