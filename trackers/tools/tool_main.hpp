#pragma once

#include <string>
#include <string_view>

namespace asterism::tools {

/// Gives a process that was started without standard streams ones that cannot be used, so that no file it
/// opens takes their place and gets what is printed. To be called first.
void open_standard_streams();

/// Keeps OpenCV and FFmpeg from printing: what they say only repeats the errors that a tool reports. Nothing
/// can be printed by std::cerr any more.
void silence_libraries();

/// A text with a blank for each break of a line and what it is indented by.
std::string one_line(const std::string& text);

/// Throws std::runtime_error unless all that was printed on standard output has been written.
void flush_output();

/// Prints an error in one line, "program: reason", also where a library's message has more; returns `code`.
int fail(std::string_view program, const std::string& reason, int code);

}  // namespace asterism::tools
