// Descriptions of trackers: a std::invalid_argument (or std::runtime_error for a plugin that is none), or a
// tracker that gives finite boxes or says why not.

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

// Whether the numbers ask for a tracker of a size that fits here: sizes are the user's to choose.
bool is_small(std::string_view description) {
  const std::size_t brace = description.find('{');
  if (brace == std::string_view::npos) return true;
  const auto json = nlohmann::json::parse(description.substr(brace), nullptr, false);
  const auto leaves = json.is_structured() ? json.flatten() : json;
  return std::all_of(leaves.begin(), leaves.end(), [](const auto& leaf) {
    // A part or a tracker within, with options of its own.
    if (leaf.is_string()) return is_small(leaf.template get<std::string>());
    return !leaf.is_number() || std::abs(leaf.template get<double>()) <= kMost;
  });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view description = fuzz::text(data, size);
  // Other people's files are not for this to load; and parsers of names recurse.
  if (description.find('/') != std::string_view::npos || size > 600) return 0;
  try {
    AnyTracker tracker = make_tracker(description);
    if (is_small(description)) fuzz::follow(tracker);
  } catch (const std::invalid_argument&) {
  } catch (const std::runtime_error&) {
  }
  return 0;
}
