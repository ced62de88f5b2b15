#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace asterism::bench {

/// Whether a text is UTF-8, as JSON, CSV and HTML require; names of files need not be.
bool is_utf8(std::string_view text);

/// The text with \\xHH for each byte that is not part of valid UTF-8: for messages.
std::string printable(std::string_view text);

/// The text as one word of a shell's command.
std::string shell_quoted(std::string_view text);

/// Throws std::runtime_error: "FILE: reason", or with the line of the file.
[[noreturn]] void fail(const std::filesystem::path& file, const std::string& reason);
[[noreturn]] void fail(const std::filesystem::path& file, std::size_t line, const std::string& reason);

}  // namespace asterism::bench
