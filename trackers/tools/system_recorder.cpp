#include "system_recorder.hpp"

#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/around/redetecting.hpp>
#include <cerrno>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "outputs.hpp"

#ifdef ASTERISM_TRACK_HAS_JSON
#include <asterism/solver/io/json.hpp>
#include <nlohmann/json.hpp>
#endif

namespace asterism::tools {

namespace {

// The Dpt in a tracker, if there is one.
const GatedTracker<Dpt>* dpt_in(const AnyTracker& tracker) {
  const auto* const searching = tracker.target<RedetectingTracker>();
  return (searching != nullptr ? searching->tracker() : tracker).target<GatedTracker<Dpt>>();
}

}  // namespace

#ifdef ASTERISM_TRACK_HAS_JSON
namespace {

nlohmann::json numbers_of(const cv::Rect2d& box) { return {box.x, box.y, box.width, box.height}; }

// The similarity without rotation that takes a box to one of the centre and area of another.
PlaneTransform box_transform(const cv::Rect2d& from, const cv::Rect2d& to) {
  PlaneTransform transform{.scale = std::sqrt(to.area() / from.area())};
  transform.translation = centre_of(to) - transform.scale * centre_of(from);
  return transform;
}

}  // namespace
#endif

void SystemRecorder::check_built() {
#ifndef ASTERISM_TRACK_HAS_JSON
  throw std::runtime_error(
      "--record-systems: this asterism-track was built without asterism::json (Debian package "
      "nlohmann-json3-dev)");
#endif
}

SystemRecorder::SystemRecorder(const std::string& path, std::string name, std::string tracker)
    : path_(path), name_(std::move(name)), tracker_(std::move(tracker)) {
  errno = 0;
  file_.open(path);
  if (!file_) throw std::runtime_error("cannot write " + path_ + why());
}

bool SolveWatch::can_observe(const AnyTracker& tracker) { return dpt_in(tracker) != nullptr; }

std::optional<AnyTracker> SolveWatch::make_tracker(const std::string& description) {
  const AnyTracker tracker = asterism::make_tracker(description);
  const GatedTracker<Dpt>* const dpt = dpt_in(tracker);
  if (dpt == nullptr) return {};
  DptOptions options = dpt->tracker().options();
  options.on_solve = [this](const DptSolve& solve) {
    last_.emplace(Solve{solve.springs,
                        solve.start,
                        {solve.evidence.begin(), solve.evidence.end()},
                        solve.start_box,
                        solve.summary});
  };
  AnyTracker observed = GatedTracker(Dpt(options));
  if (tracker.target<RedetectingTracker>() != nullptr) return RedetectingTracker(std::move(observed));
  return observed;
}

void SystemRecorder::write([[maybe_unused]] int frame, [[maybe_unused]] const SolveWatch::Solve& solve,
                           [[maybe_unused]] const cv::Rect2d& box,
                           [[maybe_unused]] const std::optional<cv::Rect2d>& truth) {
#ifdef ASTERISM_TRACK_HAS_JSON
  const auto& [springs, start, evidence, start_box, summary] = solve;
  if (first_box_.empty()) first_placement_ = start, first_box_ = start_box;
  nlohmann::json origin = {{"tracker", tracker_},
                           {"frame", frame},
                           {"solver", summary.solver},
                           {"status", to_string(summary.status)},
                           {"iterations", summary.iterations},
                           {"initial_energy", summary.initial_energy},
                           {"final_energy", summary.final_energy},
                           {"start_box", numbers_of(start_box)},
                           {"box", numbers_of(box)}};
  for (const Evidence& part : evidence) {
    const Eigen::Matrix2d& c = part.covariance;
    origin["peak"].push_back(part.peak);
    origin["covariance"].push_back({{c(0, 0), c(0, 1)}, {c(1, 0), c(1, 1)}});
  }
  if (truth) {
    origin["true_box"] = numbers_of(*truth);
    const PlaneTransform transform = box_transform(first_box_, *truth);
    for (Eigen::Index i = 0; i < first_placement_.cols(); ++i) {
      const Point2 moved = transform(first_placement_.col(i));
      origin["true_placement"].push_back({moved.x(), moved.y()});
    }
  }
  errno = 0;
  try {
    write_system(file_, springs_of(springs), start, name_ + "/frame " + std::to_string(frame), origin.dump());
  } catch (const std::exception& e) {
    throw std::runtime_error("frame " + std::to_string(frame) + ": " + e.what());
  }
  file_.flush();
  if (!file_) throw std::runtime_error("cannot write " + path_ + why());
#endif
}

}  // namespace asterism::tools
