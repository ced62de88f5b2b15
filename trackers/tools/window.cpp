#include "window.hpp"

#include <cstdlib>
#include <opencv2/highgui.hpp>
#include <stdexcept>
#include <string>

#ifdef __linux__
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>
#endif

namespace asterism::tools {
namespace {

const std::string kName = "asterism-track";

// Whether a window can be opened. Tried in a child process, as Qt and GTK end the process if they cannot
// reach the display that the environment names.
bool display_works() {
#ifdef __linux__
  const auto set = [](const char* name) {
    const char* value = std::getenv(name);
    return value != nullptr && *value != '\0';
  };
  if (!set("DISPLAY") && !set("WAYLAND_DISPLAY")) return false;
  const pid_t child = fork();
  if (child < 0) return true;
  if (child == 0) {
    const int null = open("/dev/null", O_WRONLY);
    if (null >= 0) dup2(null, STDERR_FILENO);
    try {
      cv::namedWindow(kName);
    } catch (const cv::Exception&) {
      _exit(1);
    }
    _exit(0);
  }
  int status = 0;
  return waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
#else
  return true;
#endif
}

}  // namespace

Window::Window() {
  if (!display_works()) throw std::runtime_error("--show: there is no display to open a window on");
  try {
    cv::namedWindow(kName, cv::WINDOW_AUTOSIZE);
  } catch (const cv::Exception& e) {
    throw std::runtime_error("--show: no window can be opened: " + e.err);
  }
}

Window::~Window() {
  try {
    cv::destroyWindow(kName);
  } catch (const cv::Exception&) {
    return;  // the user has closed the window already
  }
}

void Window::show(const cv::Mat& image) { cv::imshow(kName, image); }

Window::Key Window::key(int milliseconds) {
  const int pressed = cv::waitKey(milliseconds) & 0xff;
  if (pressed == 'q' || pressed == 27) return Key::kQuit;
  if (cv::getWindowProperty(kName, cv::WND_PROP_VISIBLE) < 1) return Key::kQuit;
  return pressed == ' ' ? Key::kPause : Key::kNone;
}

cv::Rect2d Window::select(const cv::Mat& image) { return cv::selectROI(kName, image, false); }

}  // namespace asterism::tools
