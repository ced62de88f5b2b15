#pragma once

#include <opencv2/core.hpp>

namespace asterism::tools {

/// The window of --show.
class Window {
 public:
  enum class Key { kNone, kPause, kQuit };

  /// Throws std::runtime_error if there is no display.
  Window();
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  void show(const cv::Mat& image);
  /// The key that the user pressed within `milliseconds`; closing the window quits.
  Key key(int milliseconds);
  /// The box that the user draws with the mouse; empty if they cancel.
  cv::Rect2d select(const cv::Mat& image);
};

}  // namespace asterism::tools
