// Checks whether a recording fits into memory before it is read: the kernel would grant the memory
// and kill the process later. Any thread. Source: proc(5), MemAvailable.
#pragma once

#include <cstdint>
#include <filesystem>

namespace servotwin {

[[nodiscard]] std::uint64_t available_memory_bytes();

/// Throws std::runtime_error with the sizes and the remedy if `columns` of `rows` doubles are more
/// than `available` bytes.
void require_memory(const std::filesystem::path& file, std::uint64_t rows, std::uint64_t columns,
                    std::uint64_t available = available_memory_bytes());

}  // namespace servotwin
