#include <asterism/trackers/coarse.hpp>
#include <asterism/trackers/dpt.hpp>
#include <asterism/trackers/tracker.hpp>
#include <stdexcept>
#ifdef ASTERISM_TRACKERS_REGISTRY
#include <asterism/parts/part_registry.hpp>
#endif

namespace asterism::inline ASTERISM_ABI {

std::vector<std::string> tracker_names() { return {"dpt", "coarse", "kcf"}; }

AnyTracker make_tracker(std::string_view name) {
  if (name == "dpt") return Dpt();
  if (name == "coarse") return CoarseTracker();
  if (name == "kcf") {
    CoarseOptions options;
    options.use_colour = false;
    options.root.proportional_window = true;
    return CoarseTracker(options);
  }
#ifdef ASTERISM_TRACKERS_REGISTRY
  if (name.starts_with("dpt+")) {
    DptOptions options;
    options.part_model = PartRegistry().make(name.substr(4));
    return Dpt(options);
  }
#endif
  std::string known;
  for (const std::string& n : tracker_names()) known += (known.empty() ? "" : ", ") + n;
  throw std::invalid_argument("unknown tracker '" + std::string(name) + "' (known: " + known + ")");
}

}  // namespace asterism::inline ASTERISM_ABI
