#include <algorithm>
#include <asterism/parts/models/siamese.hpp>
#include <asterism/parts/models/spatial_reliability.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/around/redetecting.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cctype>
#include <cmath>
#include <concepts>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#ifdef ASTERISM_TRACKERS_JSON
#include <asterism/parts/concept/option_text.hpp>
#include <asterism/parts/concept/part_registry.hpp>
#include <asterism/trackers/tracker/tracker_options.hpp>
#include <nlohmann/json.hpp>
#endif

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

#ifndef ASTERISM_TRACKERS_JSON
constexpr char kNeedsJson[] =
    "options of trackers need a build with nlohmann-json (Debian package nlohmann-json3-dev)";
#endif

#ifdef ASTERISM_TRACKERS_JSON
// The options of one tracker, and the option "redetect", which every tracker has.
template <class Options>
struct AllOptions {
  Options& own;
  bool& redetect;
};

template <class Options>
void visit_options(OptionVisitor& visit, AllOptions<Options>& options) {
  visit_options(visit, options.own);
  if constexpr (std::same_as<Options, KalmanOptions>) {
    OptionText of;  // make_kalman has read it; here it becomes a known name
    visit("of", of, of.text);
  }
  visit("redetect", options.redetect);
}
#endif

// `options` with the values in a JSON object; an empty text sets none.
template <class Options>
Options with(Options options, std::string_view name, std::string_view json, bool& redetect) {
  if (json.empty()) return options;
#ifdef ASTERISM_TRACKERS_JSON
  AllOptions<Options> all{options, redetect};
  PartRegistry().read(std::string(name), json, all);
  return options;
#else
  static_cast<void>(redetect);
  throw std::invalid_argument(std::string(name) + ": " + kNeedsJson);
#endif
}

#ifdef ASTERISM_TRACKERS_JSON
// The options of any tracker as JSON: the alternative to AnyTracker as `Made` below.
struct ListedTracker {
  nlohmann::ordered_json options;

  template <class T>
  ListedTracker(const T& tracker)
      : options(nlohmann::ordered_json::parse(PartRegistry::list(tracker.options()))) {}
  template <class T>
  ListedTracker(const GatedTracker<T>& gated) : ListedTracker(gated.tracker()) {}
};

nlohmann::ordered_json parse(std::string_view text) { return nlohmann::ordered_json::parse(text); }
#endif

// A Kalman tracker around the tracker that the option `of` describes.
template <class Made>
Made make_kalman(std::string_view name, std::string_view json, bool& redetect) {
  std::string of = "dpt", options(json);
#ifdef ASTERISM_TRACKERS_JSON
  detail::check_nesting(std::string(name), json);
  auto object = nlohmann::ordered_json::parse(json, nullptr, false);  // refused below if not an object
  if (object.is_object() && object.contains("of")) {
    of = object["of"].is_string() ? object["of"].get<std::string>() : object["of"].dump();
    object.erase("of");
    options = object.dump();
  }
#endif
  Made made = KalmanTracker(make_tracker(of), with(KalmanOptions(), name, options, redetect));
#ifdef ASTERISM_TRACKERS_JSON
  if constexpr (std::same_as<Made, ListedTracker>) {
    nlohmann::ordered_json all = {{"of", parse(tracker_options(of))}};
    all.update(made.options);
    made.options = all;
  }
#endif
  return made;
}

// The names that the paper's Table 1 abbreviates, in words.
constexpr std::pair<std::string_view, std::string_view> kInWords[] = {
    {"dpt_local", "dpt_loc"},
    {"dpt_star", "dpt_str"},
    {"dpt_nine_overlapping", "dpt_3x3_ov"},
    {"dpt_nine_parts", "dpt_3x3_nov"},
    {"dpt_coarse_no_color", "dpt_crs_nos"},
};

std::string_view abbreviated(std::string_view name) {
  for (const auto& [words, abbreviation] : kInWords)
    if (name == words) return abbreviation;
  return name;
}

// The variants in the paper's Table 1, and dpt_plus, which goes beyond the paper.
std::optional<DptOptions> dpt_variant(std::string_view name) {
  name = abbreviated(name);
  DptOptions options;
  if (name == "dpt") return options;
  if (name == "dpt_loc" || name == "dpt_str") {
    options.constellation = name == "dpt_loc" ? Constellation::Local : Constellation::Star;
    return options;
  }
  if (name == "dpt_3x3_ov" || name == "dpt_3x3_nov") {
    options.grid_rows = options.grid_cols = 3;
    options.overlap = name == "dpt_3x3_ov" ? 0.5 : 0;
    return options;
  }
  if (name == "dpt_plus") {
    SpatialReliabilityOptions filter;
    filter.color_channels = true;
    options.coarse.root = SpatialReliability(filter);
    options.scale_filter_share = 1;
    options.judge = true;
    options.solver = {"newton", {}};
    return options;
  }
  return {};
}

// dpt_net:FOLDER, with the networks that a user has.
std::optional<DptOptions> dpt_net(std::string_view name) {
  constexpr std::string_view kName = "dpt_net";
  if (!name.starts_with(kName)) return {};
  if (name.size() < kName.size() + 2 || name[kName.size()] != ':')
    throw std::invalid_argument("dpt_net: name the folder of its networks, dpt_net:FOLDER");
  DptOptions options;
  options.coarse.root = Siamese({.network = {std::string(name.substr(kName.size() + 1))}});
  options.root_weight = 1;
  options.solver = {"newton", {}};
  return options;
}

std::optional<CoarseOptions> coarse_variant(std::string_view name) {
  name = abbreviated(name);
  CoarseOptions options;
  if (name == "coarse" || name == "dpt_crs") return options;
  if (name == "kcf" || name == "dpt_crs_nos") {
    options.use_color = false;
    if (name == "kcf") {
      KcfOptions filter;
      filter.proportional_window = true;
      options.root = Kcf(filter);
    }
    return options;
  }
  return {};
}

// Suggests the nearest known name, except for trackers that only asterism-eval has: none of ours is meant.
[[noreturn]] void refuse_name(const std::string& name) {
  const std::vector<std::string> names = tracker_names();
  std::string plain;
  for (const char letter : name) plain += static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
  const bool is_prefixed = plain.starts_with("opencv-") || plain.starts_with("opencv_");
  const std::string of_opencv = is_prefixed ? plain.substr(7) : plain;
  std::string hint = detail::near_name(detail::letters_of(name), names, detail::letters_of);
  const auto answer = [&](const std::string& whose, const std::string& evaluated, const char* condition) {
    hint = ": it is " + whose + ", which asterism-eval runs as '" + evaluated + "'" + condition +
           "; our most accurate one is 'dpt_plus'";
  };
  const auto is_one_of = [&](std::initializer_list<std::string_view> theirs) {
    return std::find(theirs.begin(), theirs.end(), of_opencv) != theirs.end();
  };
  if (is_one_of({"csrt", "mil", "mosse", "medianflow", "tld", "boosting"}))
    answer("OpenCV's", "opencv-" + of_opencv, "");
  if (is_one_of({"goturn", "dasiamrpn", "nano", "vit"}))
    answer("OpenCV's", "opencv-" + of_opencv, " if it finds the files of its network");
  if (plain.starts_with("dlib")) answer("dlib's", "dlib", "");
  if (plain.starts_with("nanotrack"))
    hint = ": asterism-eval runs it as 'nanotrack:FOLDER'; 'dpt_net:FOLDER' is DPT with its network";
  if (plain.starts_with("trax:")) answer("another program's", name, "");
  throw std::invalid_argument("unknown tracker '" + name + "'" + hint + detail::known_names(names));
}

// Makes a tracker by its name, as an AnyTracker or another type that any tracker converts to, and sets
// `redetect` if its options do.
template <class Made>
Made make_plain(std::string_view name, std::string_view json, bool& redetect) {
  if (const auto options = dpt_variant(name)) return GatedTracker(Dpt(with(*options, name, json, redetect)));
  if (const auto options = dpt_net(name)) return GatedTracker(Dpt(with(*options, name, json, redetect)));
  if (const auto options = coarse_variant(name))
    return GatedTracker(CoarseTracker(with(*options, name, json, redetect)));
  if (name == "lgt") return GatedTracker(Lgt(with(LgtOptions(), name, json, redetect)));
  if (name == "kalman") return make_kalman<Made>(name, json, redetect);
  refuse_name(std::string(name));
}

template <class Made>
Made make_named(std::string_view name, std::string_view json) {
  bool redetect = false;
  Made made = make_plain<Made>(name, json, redetect);
  if constexpr (std::same_as<Made, AnyTracker>) {
    if (redetect) return RedetectingTracker(std::move(made));
  } else {
    made.options["redetect"] = redetect;
  }
  return made;
}

// Makes a tracker by its description and stores its name in `name`.
template <class Made>
Made make_described(std::string_view description, std::string& name) {
#ifdef ASTERISM_TRACKERS_JSON
  constexpr std::string_view kParts = "dpt+";
  if (description.starts_with(kParts)) {
    name = "dpt";
    DptOptions options;
    options.part = PartRegistry().make(description.substr(kParts.size()));
    Made made = GatedTracker(Dpt(options));
    if constexpr (!std::same_as<Made, AnyTracker>) made.options["redetect"] = false;
    return made;
  }
  if (description.starts_with('{')) {
    detail::check_nesting("a tracker's description", description);
    nlohmann::ordered_json object;
    try {
      object = parse(description);
    } catch (const nlohmann::json::exception& error) {  // also for a number beyond the range of double
      throw std::invalid_argument(std::string("a tracker's description is not a JSON object: ") +
                                  error.what());
    }
    if (!object.contains("tracker") || !object["tracker"].is_string())
      throw std::invalid_argument("a tracker's description must have its name as \"tracker\"");
    name = object["tracker"].get<std::string>();
    object.erase("tracker");
    return make_named<Made>(name, object.dump());
  }
#endif
  const std::size_t brace = std::min(description.find('{'), description.size());
  name = description.substr(0, brace);
  return make_named<Made>(name, description.substr(brace));
}

}  // namespace

std::array<cv::Point2d, 4> turned(const cv::Rect2d& box, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  const cv::Point2d middle(box.x + box.width / 2, box.y + box.height / 2);
  std::array<cv::Point2d, 4> corners{cv::Point2d(box.x, box.y),
                                     {box.x + box.width, box.y},
                                     {box.x + box.width, box.y + box.height},
                                     {box.x, box.y + box.height}};
  if (angle == 0) return corners;
  for (cv::Point2d& corner : corners) {
    const cv::Point2d d = corner - middle;
    corner = middle + cv::Point2d(c * d.x - s * d.y, s * d.x + c * d.y);
  }
  return corners;
}

std::vector<std::string> tracker_names() {
  std::vector<std::string> names{"dpt",     "coarse",     "kcf",         "dpt_crs",  "dpt_crs_nos", "dpt_loc",
                                 "dpt_str", "dpt_3x3_ov", "dpt_3x3_nov", "dpt_plus", "lgt",         "kalman"};
  for (const auto& pair : kInWords) names.emplace_back(pair.first);
  return names;
}

AnyTracker make_tracker(std::string_view description) {
  std::string name;
  return make_described<AnyTracker>(description, name);
}

std::string tracker_options(std::string_view description) {
#ifdef ASTERISM_TRACKERS_JSON
  std::string name;
  const ListedTracker listed = make_described<ListedTracker>(description, name);
  nlohmann::ordered_json all = {{"tracker", name}};
  all.update(listed.options);
  return all.dump(2);
#else
  make_tracker(description);
  throw std::invalid_argument(std::string(description) + ": " + kNeedsJson);
#endif
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
