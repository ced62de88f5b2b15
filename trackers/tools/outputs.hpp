#pragma once

#include <asterism/trackers/tracker/tracker.hpp>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <span>
#include <string>

namespace asterism::tools {

/// Boxes as lines of `frame,x,y,width,height,confidence,lost,milliseconds,probability`, each flushed at once;
/// for several objects `frame,id,x,..`. All functions throw std::runtime_error if the file cannot be written.
class CsvFile {
 public:
  /// `path` "-" is standard output.
  CsvFile(const std::string& path, bool several);
  /// Adds a line per object, with ids from 1 in their order; milliseconds: for all objects in this frame.
  void add(int frame, std::span<const TrackResult> objects, double milliseconds);

 private:
  void write(const std::string& line);

  bool several_;
  std::string name_;
  std::ofstream file_;
  std::ostream* stream_ = nullptr;  // `file_` or std::cout
};

/// An mp4 video whose frames are all resized to the size of the first.
class VideoFile {
 public:
  VideoFile(std::filesystem::path path, double fps) : path_(std::move(path)), fps_(fps) {}
  /// Throws std::runtime_error if the file cannot be opened for writing.
  void add(const cv::Mat& frame);
  /// Completes the file; throws std::runtime_error if it cannot be played, for example because the disk is
  /// full.
  void close();

 private:
  std::filesystem::path path_;
  double fps_;
  cv::Size size_;
  cv::VideoWriter writer_;
};

/// The reason in errno as ": reason"; empty if errno is 0.
std::string why();

/// Throws std::runtime_error, which names `option`, if a file cannot be created at `path` because its folder
/// does not exist.
void check_output(const std::string& option, const std::filesystem::path& path);

/// Writes an image; throws std::runtime_error if that fails.
void write_image(const std::filesystem::path& path, const cv::Mat& image);

}  // namespace asterism::tools
