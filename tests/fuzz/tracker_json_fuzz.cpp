// Fuzzes descriptions of trackers: the outcome must be a std::invalid_argument (or std::runtime_error for an
// invalid plugin), or a tracker that returns finite boxes or throws with a reason.

#include <algorithm>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "bytes.hpp"
#include "small_scene.hpp"

using namespace asterism;

namespace {

constexpr double kMost = 40;

// Whether the options keep the tracker small enough to run here: large sizes are valid, but slow.
bool is_small(std::string_view description) {
  const std::size_t brace = description.find('{');
  if (brace == std::string_view::npos) return true;
  const auto json = nlohmann::json::parse(description.substr(brace), nullptr, false);
  const auto leaves = json.is_structured() ? json.flatten() : json;
  return std::all_of(leaves.begin(), leaves.end(), [](const auto& leaf) {
    // A nested part or tracker with options of its own.
    if (leaf.is_string()) return is_small(leaf.template get<std::string>());
    return !leaf.is_number() || std::abs(leaf.template get<double>()) <= kMost;
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view description = fuzz::text(data, size);
  // Other files on this system must not be loaded, and parsers of names recurse.
  if (description.find('/') != std::string_view::npos || size > 600) return 0;
  try {
    AnyTracker tracker = make_tracker(description);
    if (is_small(description)) fuzz::follow(tracker);
  } catch (const std::invalid_argument&) {
  } catch (const std::runtime_error&) {
  }
  return 0;
}
