#pragma once

#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

namespace asterism::tools {

/// Stores the last system that a Dpt solved.
class SolveWatch {
 public:
  struct Solve {
    SpringConstellation springs;
    Dpt::Placement start;
    std::vector<Evidence> evidence;
    cv::Rect2d start_box;
    Summary summary;
  };
  SolveWatch() = default;
  SolveWatch(const SolveWatch&) = delete;
  SolveWatch& operator=(const SolveWatch&) = delete;

  /// Whether a tracker is a Dpt, perhaps with a search for its object.
  static bool can_observe(const AnyTracker& tracker);
  /// Makes the Dpt of a description and observes it; it must not outlive this object. Empty if the
  /// description is of another tracker.
  std::optional<AnyTracker> make_tracker(const std::string& description);
  /// Empty before the first solve.
  const std::optional<Solve>& last() const { return last_; }

 private:
  std::optional<Solve> last_;
};

/// The spring systems that a Dpt solves, with the placements it starts from, as JSON lines
/// (docs/system-json.md).
class SystemRecorder {
 public:
  /// Throws std::runtime_error if the program was built without asterism::json, which the other functions
  /// need.
  static void check_built();

  /// `name`: of the systems; `tracker`: the description of the tracker that solves them. Throws
  /// std::runtime_error if the file cannot be written.
  SystemRecorder(const std::string& path, std::string name, std::string tracker);

  /// Writes the system of a frame, the tracker's box after it and, where it is known, the annotated box with
  /// the true placement: the first system's start, scaled and moved as its box has to be to get the annotated
  /// centre and area. Separate from the solve, so that it does not count as the tracker's time. Throws
  /// std::runtime_error on failure.
  void write(int frame, const SolveWatch::Solve& solve, const cv::Rect2d& box,
             const std::optional<cv::Rect2d>& truth);

 private:
  std::string path_, name_, tracker_;
  std::ofstream file_;
  // The parts in the object: their first placement in a box, which has its first size.
  Dpt::Placement first_placement_;
  cv::Rect2d first_box_;
};

}  // namespace asterism::tools
