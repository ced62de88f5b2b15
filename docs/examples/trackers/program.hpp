#pragma once

// A tracker as a program. `PROGRAM VIDEO X,Y,WIDTH,HEIGHT` follows the object in this box of the first frame
// [px] and prints the box in each further frame, and at the end the times of the tracker's stages. Without
// arguments the program is a TraX tracker, version 1, on the standard streams.

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

inline cv::Rect2d read_box(const std::string& text) {
  cv::Rect2d box;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf", &box.x, &box.y, &box.width, &box.height) != 4)
    throw std::invalid_argument("'" + text + "' is not a box X,Y,WIDTH,HEIGHT");
  return box;
}

inline std::string to_text(const cv::Rect2d& box) {
  return to_string(asterism::Region::rectangle(box));  // with all digits
}

template <asterism::Tracker T>
void serve_trax(T& tracker) {
  std::cout << R"(@@TRAX:hello "trax.version=1" "trax.image=path" "trax.region=rectangle")" << std::endl;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string message, file, box;
    words >> message >> std::quoted(file) >> std::quoted(box);
    if (message == "@@TRAX:quit") return;
    if (message != "@@TRAX:initialize" && message != "@@TRAX:frame") continue;
    if (file.starts_with("file://")) file.erase(0, 7);
    const cv::Mat image = cv::imread(file, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
    asterism::TrackResult result;
    if (message == "@@TRAX:initialize")
      tracker.init(image, result.box = read_box(box));
    else
      result = tracker.update(image);
    std::cout << "@@TRAX:state \"" << to_text(result.box) << "\" \"confidence=" << result.confidence << '"'
              << std::endl;
  }
}

template <asterism::Tracker T>
void follow(T& tracker, const std::string& video, const cv::Rect2d& box) {
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
    const asterism::TrackResult result = tracker.update(image);
    std::cout << to_text(result.box) << ' ' << result.confidence << (result.lost ? " lost\n" : "\n");
    lost += result.lost;
    parts += result.parts.size();
    for (const asterism::StageTime& time : result.times) milliseconds[time.stage] += time.milliseconds;
  }
  if (count == 0) return;
  std::cerr << lost << " of " << count << " frames lost, parts a frame " << static_cast<double>(parts) / count
            << ", ms a frame:";
  for (const auto& [stage, time] : milliseconds) std::cerr << ' ' << stage << ' ' << time / count;
  std::cerr << '\n';
}

template <asterism::Tracker T>
int run_tracker(T tracker, int argc, char** argv) {
  try {
    if (argc > 2)
      follow(tracker, argv[1], read_box(argv[2]));
    else
      serve_trax(tracker);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
