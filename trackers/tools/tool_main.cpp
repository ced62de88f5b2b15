#include "tool_main.hpp"

#if __has_include(<unistd.h>)
#include <fcntl.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <stdexcept>

namespace asterism::tools {

void open_standard_streams() {
#if __has_include(<unistd.h>)
  // Opened in the wrong direction, so that using a closed stream remains an error. `open` returns the lowest
  // free number, which is that of the stream.
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(stream, F_GETFD) == -1 && errno == EBADF)
      (void)!open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY);
#endif
}

void silence_libraries() {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  std::cerr.rdbuf(
      nullptr);  // where OpenCV's image codecs say why they failed; errors of the tools go to stderr
}

std::string one_line(const std::string& text) {
  std::string line;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\n' && text[i] != '\r') {
      line += text[i];
      continue;
    }
    i = std::min(text.find_first_not_of(" \t\r\n", i), text.size()) - 1;
    line += ' ';
  }
  return line.erase(line.find_last_not_of(' ') + 1);
}

void flush_output() {
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)
    throw std::runtime_error("standard output cannot be written");
}

int fail(std::string_view program, const std::string& text, int code) {
  const std::string reason = one_line(text);
  std::fprintf(stderr, "%.*s: %s\n", static_cast<int>(program.size()), program.data(), reason.c_str());
  return code;
}

}  // namespace asterism::tools
