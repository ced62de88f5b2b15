#include "tool_main.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

namespace asterism::tools {

void silence_libraries() {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
}

int fail(std::string_view program, std::string reason, int code) {
  std::replace(reason.begin(), reason.end(), '\n', ' ');
  reason.erase(reason.find_last_not_of(' ') + 1);
  std::fprintf(stderr, "%.*s: %s\n", static_cast<int>(program.size()), program.data(), reason.c_str());
  return code;
}

}  // namespace asterism::tools
