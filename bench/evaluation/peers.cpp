#include "peers.hpp"

#include <algorithm>
#include <asterism/trackers/tracker.hpp>
#include <map>
#include <memory>
#include <numeric>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <string_view>

#include "peers_internal.hpp"
#include "trax_client.hpp"

namespace asterism::bench {
namespace {

constexpr std::string_view kTrax = "trax:";

Start our_tracker(const std::string& name) {
  return [name](const Image& image, const Region& object) -> Step {
    auto tracker = std::make_shared<AnyTracker>(make_tracker(name));
    tracker->init(image.pixels, object.box());
    return [tracker](const Image& next) {
      const TrackResult result = tracker->update(next.pixels);
      return Report{Region::rectangle(result.box), result.confidence};  // also where it is not sure of it
    };
  };
}

Start trax_tracker(const std::string& command) {
  return [command](const Image& image, const Region& object) -> Step {
    const auto argument = [](const Image& i) {
      return i.file.empty() ? tools::TraxImage(i.pixels) : tools::TraxImage(i.file);
    };
    auto client = std::make_shared<tools::TraxClient>(command);
    client->initialize(argument(image), {object});
    return [client, argument](const Image& next) {
      const auto reply = client->frame(argument(next)).at(0);
      return Report{reply.region, reply.confidence.value_or(std::numeric_limits<double>::quiet_NaN())};
    };
  };
}

std::map<std::string, Start> registry() {
  std::map<std::string, Start> trackers;
  for (const std::string& name : tracker_names()) trackers[name] = our_tracker(name);
#ifdef ASTERISM_EVALUATION_OPENCV
  add_opencv_peers(trackers);
#endif
#ifdef ASTERISM_EVALUATION_DLIB
  add_dlib_peers(trackers);
#endif
  return trackers;
}

// How many letters are to be put in, taken out or replaced to make one word the other (Levenshtein).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

}  // namespace

std::vector<std::string> evaluated_tracker_names() {
  std::vector<std::string> names;
  for (const auto& [name, start] : registry()) names.push_back(name);
  return names;
}

EvaluatedTracker evaluated_tracker(const std::string& name) {
  cv::setNumThreads(1);
  if (name.starts_with(kTrax) && name.size() > kTrax.size())
    return {name, trax_tracker(name.substr(kTrax.size()))};
  const auto trackers = registry();
  if (const auto found = trackers.find(name); found != trackers.end()) return {name, found->second};

  std::vector<std::string> known = evaluated_tracker_names();
  std::stable_sort(known.begin(), known.end(), [&](const std::string& a, const std::string& b) {
    return edit_distance(name, a) < edit_distance(name, b);
  });
  std::string list;
  for (const std::string& other : known) list += other + ", ";
  throw std::invalid_argument("unknown tracker \"" + name + "\" (known: " + list + "trax:COMMAND)");
}

}  // namespace asterism::bench
