#pragma once

// Makes a program of a tracker: for a video, and for an evaluation that speaks TraX. It calls cv::imread and
// cv::VideoCapture, so the program links to OpenCV's imgcodecs and videoio.

#include <asterism/trackers/tracker/region.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstdio>
#include <exception>
#include <iomanip>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

inline cv::Rect2d read_box(const std::string& text) {
  cv::Rect2d box;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf%c", &box.x, &box.y, &box.width, &box.height, &rest) != 4)
    throw std::invalid_argument("'" + text + "' is not a box X,Y,WIDTH,HEIGHT");
  return box;
}

inline std::string to_text(const cv::Rect2d& box) {
  return to_string(Region::rectangle(box));  // with all digits
}

}  // namespace detail

/// Runs a tracker for a client of the TraX protocol, version 1, such as `asterism-eval run --external` or the
/// toolkit of VOT, until the client says quit or `in` ends. Images are paths, boxes are upright. The tracker
/// starts again with every message `initialize`. If the tracker throws, or a box cannot be read, the client
/// is told the reason, and the exception is thrown. docs/trax.md describes the protocol.
template <Tracker T>
void serve_trax(T& tracker, std::istream& in = std::cin, std::ostream& out = std::cout) {
  out << R"(@@TRAX:hello "trax.version=1" "trax.image=path" "trax.region=rectangle")" << std::endl;
  try {
    for (std::string line; std::getline(in, line);) {
      std::istringstream words(line);
      std::string message, file, box;
      words >> message >> std::quoted(file) >> std::quoted(box);
      if (message == "@@TRAX:quit") return;
      if (message != "@@TRAX:initialize" && message != "@@TRAX:frame") continue;
      if (file.starts_with("file://")) file.erase(0, 7);
      const cv::Mat image = cv::imread(file, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
      if (image.empty()) throw std::runtime_error(file + ": no image that OpenCV reads");
      TrackResult result;
      if (message == "@@TRAX:initialize")
        tracker.init(image, result.box = detail::read_box(box));
      else
        result = tracker.update(image);
      out << "@@TRAX:state \"" << detail::to_text(result.box) << "\" \"confidence=" << result.confidence
          << '"' << std::endl;
    }
  } catch (const std::exception& error) {
    out << "@@TRAX:quit " << std::quoted(std::string("trax.reason=") + error.what()) << std::endl;
    throw;
  }
}

/// Follows the object in `box` [px] of the first frame of a video, or of images such as folder/%08d.jpg.
/// Prints to `out` for each further frame the box x,y,width,height [px], the confidence and, if it is so,
/// `lost`; at the end to standard error the number of lost frames and the mean times of the tracker's stages
/// [ms]. std::runtime_error if the video cannot be read.
template <Tracker T>
void follow_video(T& tracker, const std::string& video, const cv::Rect2d& box,
                  std::ostream& out = std::cout) {
  // By default OpenCV prefers FFmpeg, which rounds decoded images differently from imread in serve_trax.
  const bool images = video.find('%') != std::string::npos;
  cv::VideoCapture frames(video, images ? cv::CAP_IMAGES : cv::CAP_ANY);
  cv::Mat image;
  if (!frames.read(image)) throw std::runtime_error("cannot read " + video);
  tracker.init(image, box);
  int count = 0, lost = 0;
  std::size_t parts = 0;
  std::map<std::string_view, double> milliseconds;
  for (; frames.read(image); ++count) {
    const TrackResult result = tracker.update(image);
    out << detail::to_text(result.box) << ' ' << result.confidence << (result.lost ? " lost\n" : "\n");
    lost += result.lost;
    parts += result.parts.size();
    for (const StageTime& time : result.times) milliseconds[time.stage] += time.milliseconds;
  }
  if (count == 0) return;
  std::cerr << lost << " of " << count << " frames lost, parts a frame " << static_cast<double>(parts) / count
            << ", ms a frame:";
  for (const auto& [stage, time] : milliseconds) std::cerr << ' ' << stage << ' ' << time / count;
  std::cerr << '\n';
}

/// The `main` of a tracker's program. `PROGRAM VIDEO X,Y,WIDTH,HEIGHT` follows the object in this box of the
/// first frame (`follow_video`); with fewer arguments the program speaks TraX on the standard streams
/// (`serve_trax`). Returns the exit code: 0, or 1 after an exception, whose message goes to standard error.
template <Tracker T>
int run_program(T tracker, int argc, char** argv) {
  try {
    if (argc > 2)
      follow_video(tracker, argv[1], detail::read_box(argv[2]));
    else
      serve_trax(tracker);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
