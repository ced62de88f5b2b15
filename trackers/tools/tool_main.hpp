#pragma once

#include <string>
#include <string_view>

namespace asterism::tools {

/// Replaces standard streams that were closed at the start of the process by unusable ones; otherwise a file
/// that it opens could take their place and receive what is printed. To be called first.
void open_standard_streams();

/// Stops OpenCV and FFmpeg from printing: their messages only repeat the errors that a tool reports.
/// std::cerr no longer prints anything.
void silence_libraries();

/// A text with each line break and the indentation after it replaced by a blank.
std::string one_line(const std::string& text);

/// Throws std::runtime_error unless everything printed on standard output has been written.
void flush_output();

/// Prints an error on one line, "program: reason", even if a library's message has several; returns `code`.
int fail(std::string_view program, const std::string& reason, int code);

}  // namespace asterism::tools
