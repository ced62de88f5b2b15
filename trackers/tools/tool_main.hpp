#pragma once

#include <string>
#include <string_view>

namespace asterism::tools {

/// Keeps OpenCV and FFmpeg from printing: what they say only repeats the errors that a tool reports.
void silence_libraries();

/// Prints an error in one line, "program: reason", also where a library's message has more; returns `code`.
int fail(std::string_view program, std::string reason, int code);

}  // namespace asterism::tools
