// Sets every option of every part model and tracker to the ends of its range and beyond: either a message
// that names it refuses it, or a start and one more frame take little time and memory.

#include <gtest/gtest.h>

#include <asterism/trackers/tracker/tracker_options.hpp>
#include <cmath>
#include <ctime>
#include <fstream>
#include <functional>
#include <limits>
#include <ostream>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "../solver/sanitizer.hpp"
#include "moving_square.hpp"

namespace asterism {
namespace {

/// A numerical option and its range.
struct Number {
  std::string path;
  OptionRange range;
  bool whole;
};

/// Lists the numerical options; sets the one with the given path, if any, to `value`.
class Walk final : public OptionVisitor {
 public:
  explicit Walk(std::string path = {}, double value = 0) : path_(std::move(path)), value_(value) {}

  std::vector<Number> numbers;

  void operator()(std::string_view name, double& value, const OptionRange& range) override {
    see(name, value, range, false);
  }
  void operator()(std::string_view name, int& value, const OptionRange& range) override {
    see(name, value, range, true);
  }
  void operator()(std::string_view, bool&) override {}
  void operator()(std::string_view, std::uint64_t&) override {}

 private:
  template <typename T>
  void see(std::string_view name, T& value, const OptionRange& range, bool whole) {
    const std::string path = prefix_ + std::string(name);
    numbers.push_back({path, range, whole});
    if (path == path_) value = static_cast<T>(value_);
  }
  void enter(std::string_view name) override { prefix_ += std::string(name) + '.'; }
  void leave() override { prefix_.erase(prefix_.find_last_of('.', prefix_.size() - 2) + 1); }

  std::string path_, prefix_;
  double value_;
};

constexpr int kSide = 64;
const cv::Rect2d kBox(20, 20, 24, 24);

cv::Mat frame_at(int shift) {
  static const cv::Mat texture = noise({kSide + 8, kSide + 8}, 5, 0, 255, 1);
  return texture({shift, shift, kSide, kSide}).clone();
}

template <typename Model>
void run_part(Model model) {
  const Frame first(frame_at(0)), second(frame_at(2));
  model.init(first, centre_of(kBox), {kBox.width, kBox.height});
  const Evidence evidence = model.localize(second, centre_of(kBox));
  EXPECT_TRUE(evidence.position.allFinite() && std::isfinite(evidence.peak) &&
              evidence.covariance.allFinite());
  model.adapt(second, evidence.position);
}

void run_scale(ScaleFilter filter) {
  const Frame first(frame_at(0)), second(frame_at(2));
  filter.init(first, centre_of(kBox), {kBox.width, kBox.height});
  EXPECT_TRUE(std::isfinite(filter.localize(second, centre_of(kBox))));
  filter.adapt(second, centre_of(kBox), {kBox.width, kBox.height});
}

template <typename Tracker>
void run_tracker(Tracker tracker) {
  tracker.init(frame_at(0), kBox);
  const TrackResult result = tracker.update(frame_at(2));
  for (const double value : {result.box.x, result.box.y, result.box.width, result.box.height})
    EXPECT_TRUE(std::isfinite(value));
}

/// A class with options: its name, its numerical options, and a run with one of them set.
struct Case {
  std::string name;
  std::vector<Number> numbers;
  std::function<void(const std::string& path, double value)> run;

  friend std::ostream& operator<<(std::ostream& out, const Case& that) { return out << that.name; }
};

template <typename Options, typename Run>
Case make_case(std::string name, Options options, Run run) {
  Walk list;
  visit_options(static_cast<OptionVisitor&>(list), options);
  return {std::move(name), list.numbers, [options, run](const std::string& path, double value) mutable {
            Options changed = options;
            Walk set(path, value);
            visit_options(static_cast<OptionVisitor&>(set), changed);
            run(changed);
          }};
}
template <typename Model, typename Options>
Case part(std::string name, Options options = {}) {
  return make_case(std::move(name), options, [](const Options& o) { run_part(Model(o)); });
}
template <typename Tracker, typename Options>
Case tracker(std::string name, Options options = {}) {
  return make_case(std::move(name), options, [](const Options& o) { run_tracker(Tracker(o)); });
}

DptOptions everything() {
  DptOptions options;
  options.scale_filter_share = 0.25;
  return options;
}

// A new model or tracker is added here.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
    part<ColorHistogram, ColorHistogramOptions>("color_histogram"),
    part<Kcf, KcfOptions>("kcf"),
    part<Mosse, MosseOptions>("mosse"),
    part<SpatialReliability, SpatialReliabilityOptions>("spatial_reliability"),
    part<Strcf, StrcfOptions>("strcf"),
    part<Superpixels, SuperpixelsOptions>("superpixels"),
    part<Template, TemplateOptions>("template"),
    make_case("scale_filter", ScaleFilterOptions(), [](const auto& o) { run_scale(ScaleFilter(o)); }),
#if __has_include(<asterism/parts/models/flow.hpp>)
    part<Flow, FlowOptions>("flow"),
#endif
#if __has_include(<asterism/parts/models/keypoints.hpp>)
    part<Keypoints, KeypointsOptions>("keypoints"),
#endif
    tracker<Dpt>("dpt", everything()),
    tracker<CoarseTracker, CoarseOptions>("coarse"),
    tracker<Lgt, LgtOptions>("lgt"),
    make_case("kalman", KalmanOptions(),
              [](const auto& o) { run_tracker(KalmanTracker(AnyTracker(CoarseTracker()), o)); }),
  };
  return all;
}

class Options : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(All, Options, ::testing::ValuesIn(cases()),
                         [](const auto& one) { return one.param.name; });

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// A value in /proc/self/status [MB], or 0.
double memory(const std::string& name) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (double kilobytes = 0; word == name + ":" && status >> kilobytes) return kilobytes / 1024;
  return 0;
}

/// The cost of a call [s, MB], if the system reports it.
struct Cost {
  double seconds, megabytes;
};
template <typename Call>
Cost cost_of(Call call) {
  std::ofstream("/proc/self/clear_refs") << '5';  // resets the peak
  const double before = memory("VmRSS"), start = cpu_seconds();
  call();
  return {cpu_seconds() - start, memory("VmHWM") - before};
}

#if defined(NDEBUG) && !defined(ASTERISM_TEST_SANITIZED) && !defined(ASTERISM_TEST_EMULATOR)
constexpr double kMostSeconds = 2, kMostMegabytes = 300;
#else
constexpr double kMostSeconds = 60, kMostMegabytes = 3000;  // with freed memory that is not returned yet
#endif

TEST_P(Options, AllNumbersHaveFiniteRanges) {
  std::set<std::string> paths;
  for (const Number& number : GetParam().numbers) {
    EXPECT_TRUE(std::isfinite(number.range.least) && number.range.least < number.range.most &&
                std::isfinite(number.range.most))
        << number.path;
    EXPECT_TRUE(paths.insert(number.path).second) << number.path << " is visited twice";
  }
  EXPECT_FALSE(paths.empty());
}

TEST_P(Options, DefaultsAreInTheirRanges) { GetParam().run("", 0); }

TEST_P(Options, BeyondTheirRangesAreRefusedByNameValueAndRange) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const auto& [path, range, whole] : GetParam().numbers) {
    std::vector<double> values;
    if (whole) {
      values = {std::ceil(range.least) - 1, std::floor(range.most) + 1, std::numeric_limits<int>::min(),
                std::numeric_limits<int>::max()};
    } else {
      values = {std::nextafter(range.least, -kInfinity),
                std::nextafter(range.most, kInfinity),
                -1e300,
                1e300,
                std::nan(""),
                kInfinity,
                -kInfinity};
    }
    for (const double value : values) {
      SCOPED_TRACE(path + " = " + std::to_string(value));
      try {
        GetParam().run(path, value);
        ADD_FAILURE() << "taken";
      } catch (const std::invalid_argument& error) {
        const std::string message = error.what();
        EXPECT_NE(message.find(path + " must be in ["), std::string::npos) << message;
        EXPECT_NE(message.find("], is "), std::string::npos) << message;
        EXPECT_EQ(message.find('\n'), std::string::npos) << message;
      }
    }
  }
}

TEST_P(Options, AtTheEndsOfTheirRangesTakeLittleTimeAndMemory) {
  for (const auto& [path, range, whole] : GetParam().numbers) {
    for (const double value : {range.least, range.most}) {
      SCOPED_TRACE(path + " = " + std::to_string(value));
      const Cost cost = cost_of([&, &path = path] {
        try {
          GetParam().run(path, value);
        } catch (const std::invalid_argument& error) {  // two options that contradict each other
          EXPECT_NE(std::string(error.what()).find("must"), std::string::npos) << error.what();
        }
      });
      EXPECT_LT(cost.seconds, kMostSeconds);
      EXPECT_LT(cost.megabytes, kMostMegabytes);
    }
  }
}

}  // namespace
}  // namespace asterism
