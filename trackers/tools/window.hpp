#pragma once

#include <opencv2/core.hpp>

namespace asterism::tools {

/// The window of --show.
class Window {
 public:
  enum class Key { kNone, kPause, kQuit };

  /// Throws std::runtime_error where there is no display to open it on.
  Window();
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  void show(const cv::Mat& image);
  /// What the user pressed within `milliseconds`; closing the window quits.
  Key key(int milliseconds);
  /// The box that the user draws with the mouse; empty where they give up.
  cv::Rect2d select(const cv::Mat& image);
};

}  // namespace asterism::tools
