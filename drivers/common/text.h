// Text of files and messages: splitting, quoting, and finding the most similar name.
// Any thread; errors: none.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace servotwin {

/// Around words: the end of a line of DOS is one too, however often it was converted.
inline constexpr std::string_view kBlanks = " \t\r";

/// Without kBlanks at both ends.
[[nodiscard]] std::string_view trimmed(std::string_view text) noexcept;

/// The fields of one line, trimmed. A field in double quotes may hold the separator; "" in it is
/// one quote.
[[nodiscard]] std::vector<std::string> split_fields(std::string_view line, char separator);

/// For a message: in quotes, at most 40 characters, nothing that would break the line.
[[nodiscard]] std::string in_quotes(std::string_view text);

/// A name of a file, without what would break a message into lines.
[[nodiscard]] std::string in_one_line(std::string name);

/// For a message: "a, b, c".
[[nodiscard]] std::string listed(std::span<const std::string> names);

/// For a message: "1 line", "2 lines".
[[nodiscard]] std::string counted(std::size_t count, std::string_view one);

/// For a message: six significant digits.
[[nodiscard]] std::string number(double value);

/// The name with the fewest letters to change, or empty if all of them differ by more than half.
[[nodiscard]] std::string nearest_name(std::string_view name, std::span<const std::string> names);

/// The end of an error message: "; did you mean 'qg'?", or "." if no name is similar.
[[nodiscard]] std::string did_you_mean(std::string_view name, std::span<const std::string> names);

}  // namespace servotwin
