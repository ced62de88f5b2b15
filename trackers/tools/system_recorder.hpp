#pragma once

#include <asterism/trackers/dpt.hpp>
#include <fstream>
#include <optional>
#include <string>

namespace asterism::tools {

/// The spring systems that a Dpt solves, with the placements it starts from, as JSON lines
/// (docs/system-json.md).
class SystemRecorder {
 public:
  /// Throws std::runtime_error where the program was built without asterism::json, which the others need.
  static void check_built();

  /// `name` is what the systems are called after. Throws std::runtime_error where the file cannot be written.
  SystemRecorder(const std::string& path, std::string name);
  SystemRecorder(const SystemRecorder&) = delete;
  SystemRecorder& operator=(const SystemRecorder&) = delete;

  /// A tracker that is recorded; not to be used beyond this object's life.
  Dpt make_tracker();

  /// Writes the last system that was solved, if it is not written yet, as that of a frame. Apart from the
  /// solve, so that it does not count as the tracker's time. Throws std::runtime_error where it cannot.
  void write(int frame);

 private:
  struct Solve {
    Dpt::Springs system;
    Dpt::Placement start;
    Summary summary;
  };
  std::string path_, name_;
  std::ofstream file_;
  std::optional<Solve> last_;
};

}  // namespace asterism::tools
