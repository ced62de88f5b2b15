#include "peers.hpp"

#include <algorithm>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <atomic>
#include <cctype>
#include <map>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <string_view>

#include "peers_internal.hpp"
#include "text.hpp"
#include "trax_client.hpp"

namespace asterism::bench {
namespace {

constexpr std::string_view kTrax = "trax:";
constexpr std::string_view kPython = "python:";
constexpr std::string_view kNanoTrack = "nanotrack:";

// Whether it is one of ours by more than its name.
bool is_described(const std::string& name) {
  return name.find_first_of("+{") != std::string::npos || name.starts_with("dpt_net");
}

Start our_tracker(const std::string& name) {
  return [name](const Image& image, const Region& object) -> Step {
    auto tracker = std::make_shared<AnyTracker>(make_tracker(name));
    tracker->init(image.pixels, object);
    return [tracker](const Image& next) {
      const TrackResult result = tracker->update(next.pixels);
      return Report{Region::rectangle(result.box), result.confidence};  // even if it is flagged as lost
    };
  };
}

/// The command of an external tracker: that of asterism.trax for python:MODULE:CLASS.
std::string trax_command(const std::string& external) {
  if (!external.starts_with(kPython)) return external;
  const std::string of_class = external.substr(kPython.size());
  const std::size_t colon = of_class.rfind(':');
  if (colon == 0 || colon == std::string::npos || colon + 1 == of_class.size())
    throw std::invalid_argument("expected python:MODULE:CLASS or python:FILE.py:CLASS, found \"" + external +
                                '"');
  // As python3 -m asterism.trax, which prints a traceback where python3 does not find the package.
  constexpr const char* kProgram =
      "import sys\n"
      "try:\n  from asterism.trax import main\n"
      "except ImportError as error:\n  sys.exit(f'{sys.executable}, which is python3 here: {error}')\n"
      "sys.exit(main(sys.argv[1:]))";
  return "exec python3 -c " + shell_quoted(kProgram) + " " + shell_quoted(of_class);
}

Start trax_tracker(const std::string& external, double timeout) {
  const auto has_answered = std::make_shared<std::atomic<bool>>(false);
  const std::string command = trax_command(external);
  return [external, command, timeout, has_answered](const Image& image, const Region& object) -> Step {
    const auto argument = [](const Image& i) {
      return i.file.empty() ? tools::TraxImage(i.pixels) : tools::TraxImage(i.file);
    };
    tools::TraxClientOptions options;
    options.timeout = timeout;
    options.name = external;
    std::shared_ptr<tools::TraxClient> client;
    try {
      client = std::make_shared<tools::TraxClient>(command, options);
      client->initialize(argument(image), {object});
    } catch (const std::exception& error) {
      if (*has_answered) throw;
      const std::string what = error.what();
      const char* const hint = what.ends_with("exit code 0") ? "; the command has to speak TraX" : "";
      throw UnusableTracker(what + " before its first answer" + hint);
    }
    *has_answered = true;
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

}  // namespace

std::vector<std::string> evaluated_tracker_names() {
  std::vector<std::string> names;
  for (const auto& [name, start] : registry()) names.push_back(name);
  return names;
}

bool is_external(const std::string& name) { return name.starts_with(kTrax) && name.size() > kTrax.size(); }

std::string name_of(const std::string& tracker) {
  for (const std::string of_folder : {"nanotrack", "dpt_net"})
    if (tracker.starts_with(of_folder + ':')) return of_folder;
  return tracker;
}

bool has_confidence(const std::string& name) {
  if (is_external(name)) return false;
  const std::vector<std::string> ours = tracker_names();
  return name.starts_with(kNanoTrack) || is_described(name) || name == "dlib" ||
         std::ranges::find(ours, name) != ours.end();
}

EvaluatedTracker evaluated_tracker(const std::string& name, double timeout) {
  cv::setNumThreads(1);
  if (is_external(name)) return {name, trax_tracker(name.substr(kTrax.size()), timeout)};
  if (name.starts_with(kNanoTrack)) {
#ifdef ASTERISM_EVALUATION_NANOTRACK
    return {name, nanotrack_peer(name.substr(kNanoTrack.size()))};
#else
    throw std::invalid_argument(name + ": this build is without OpenCV's dnn module");
#endif
  }
  if (is_described(name)) {
    make_tracker(name);  // throws if it is unknown
    return {name, our_tracker(name)};
  }
  const auto trackers = registry();
  if (const auto found = trackers.find(name); found != trackers.end()) return {name, found->second};

  // A peer is also found by its own name, as OpenCV's CSRT is.
  std::string plain;
  for (const char letter : name) plain += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  std::vector<std::string> known = evaluated_tracker_names();
  std::string hint = detail::near_name(plain, known);
  if (hint.empty()) {
    hint = detail::near_name(plain, known,
                             [](const std::string& other) { return other.substr(other.find('-') + 1); });
  }
  for (const char* of :
       {"dpt+MODEL", "dpt_net:FOLDER", "nanotrack:FOLDER", "trax:COMMAND", "trax:python:MODULE:CLASS"})
    known.emplace_back(of);
  throw std::invalid_argument("unknown tracker '" + name + "'" + hint + detail::known_names(known));
}

}  // namespace asterism::bench
