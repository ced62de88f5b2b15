#include "system_recorder.hpp"

#include <cerrno>
#include <stdexcept>
#include <utility>

#include "outputs.hpp"

#ifdef ASTERISM_TRACK_HAS_JSON
#include <asterism/solver/io/json.hpp>
#endif

namespace asterism::tools {

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

std::optional<Dpt> SolveWatch::make_tracker(const std::string& description) {
  const AnyTracker tracker = asterism::make_tracker(description);
  const Dpt* const dpt = tracker.target<Dpt>();
  if (dpt == nullptr) return {};
  DptOptions options = dpt->options();
  options.on_solve = [this](const Dpt::System& system, const Dpt::Placement& start, const Summary& summary) {
    last_.emplace(Solve{system, start, summary});
  };
  return Dpt(options);
}

void SystemRecorder::write([[maybe_unused]] int frame, [[maybe_unused]] const SolveWatch::Solve& solve) {
#ifdef ASTERISM_TRACK_HAS_JSON
  const auto& [system, start, summary] = solve;
  const nlohmann::json origin = {{"tracker", tracker_},
                                 {"frame", frame},
                                 {"solver", summary.solver},
                                 {"status", to_string(summary.status)},
                                 {"iterations", summary.iterations},
                                 {"initial_energy", summary.initial_energy},
                                 {"final_energy", summary.final_energy}};
  errno = 0;
  try {
    write_system(file_, system, start, name_ + "/frame " + std::to_string(frame), origin);
  } catch (const std::exception& e) {
    throw std::runtime_error("frame " + std::to_string(frame) + ": " + e.what());
  }
  file_.flush();
  if (!file_) throw std::runtime_error("cannot write " + path_ + why());
#endif
}

}  // namespace asterism::tools
