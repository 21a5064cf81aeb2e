// Checks whether a recording fits into memory before it is read: the kernel would grant the memory
// and kill the process later. Errors: std::runtime_error with the sizes and the remedy. Any thread.
// Source: proc(5), MemAvailable.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace servotwin {

[[nodiscard]] std::uint64_t available_memory_bytes();

/// Throws if `columns` of `rows` doubles are more than `available` bytes.
void require_memory(const std::filesystem::path& file, std::uint64_t rows, std::uint64_t columns,
                    std::uint64_t available = available_memory_bytes());

/// Throws if what is packed in the file would take `needed` bytes, more than 64 MB and 100 times
/// the file: a recording does not, so a small file cannot take the memory of the host.
void require_plausible_size(const std::filesystem::path& file, double needed,
                            const std::string& of_what, const std::string& remedy);

}  // namespace servotwin
