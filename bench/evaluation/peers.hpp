#pragma once

#include <filesystem>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "region.hpp"

namespace asterism::bench {

using tools::Region;

/// One frame, as trackers get it.
struct Image {
  Image(cv::Mat image, std::filesystem::path image_file = {})
      : pixels(std::move(image)), file(std::move(image_file)) {}

  cv::Mat pixels;              ///< 8-bit BGR
  std::filesystem::path file;  ///< for external trackers, which may take nothing else; empty if there is none
};

/// A tracker's answer for one frame.
struct Report {
  std::optional<Region> region;  ///< empty: the tracker reports that it has not found the object
  double confidence = std::numeric_limits<double>::quiet_NaN();  ///< on the tracker's own scale; NaN: none
};

/// A running tracker, at the next frame. May throw whatever the tracker throws.
using Step = std::function<Report(const Image&)>;
/// Starts a new tracker on an object; those that track boxes take its equal_area_box.
using Start = std::function<Step(const Image&, const Region&)>;

/// An external tracker that cannot be used at all: it could not be started, or ended or was silent before its
/// first answer. This does not count as losing the object.
class UnusableTracker : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct EvaluatedTracker {
  std::string name;
  Start start;
};

/// The trackers that `evaluated_tracker` knows in this build: those of `asterism::tracker_names()` and, if
/// installed, OpenCV's opencv-csrt, -kcf and -mil, those of its neural ones (opencv-goturn, ...) whose files
/// are found, those of its legacy module, opencv-mosse, -medianflow, -tld and -boosting, and dlib. Not in the
/// list, as they are more than a name: trackers with options, as `make_tracker` describes them,
/// dpt_net:FOLDER, nanotrack:FOLDER, trax:COMMAND and trax:python:MODULE:CLASS.
std::vector<std::string> evaluated_tracker_names();

/// A tracker by its name, or one of ours by its description for `make_tracker`; nanotrack:FOLDER is NanoTrack
/// with the networks backbone.onnx and head.onnx in that folder, if OpenCV's dnn module is installed;
/// trax:COMMAND is a shell command that speaks TraX, run as a new process for every start;
/// trax:python:MODULE:CLASS is a Python class, or one of a file FILE.py, run by `python3 -m asterism.trax`.
/// All that use OpenCV run on one thread: the number of OpenCV's threads is set to one here. OpenCV's random
/// numbers are seeded alike at every start, but opencv-mil, -boosting and -tld have others of their own, so
/// that no two of their runs are the same. `timeout`: for each answer of an external tracker [s]. Throws
/// std::invalid_argument, which lists the known names, the most similar first, for any other, and if
/// NanoTrack's folder does not have its networks.
EvaluatedTracker evaluated_tracker(const std::string& name, double timeout = 30);
/// The name under which results of a tracker are stored if none is given: "nanotrack" for nanotrack:FOLDER,
/// "dpt_net" for dpt_net:FOLDER, else the same.
std::string name_of(const std::string& tracker);
/// Whether a tracker, which `evaluated_tracker` knows, reports confidences: all of ours, dlib's and NanoTrack
/// do. Of an
/// external one this is not known, and the answer is no.
bool has_confidence(const std::string& name);
/// Whether a name is trax:COMMAND.
bool is_external(const std::string& name);

}  // namespace asterism::bench
