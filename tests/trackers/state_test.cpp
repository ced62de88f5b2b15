#include <gtest/gtest.h>

#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/parts/models/mosse.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/parts/models/superpixels.hpp>
#include <asterism/parts/models/template.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <cstring>
#include <functional>
#include <limits>
#include <stdexcept>

#include "moving_square.hpp"
#include "same_results.hpp"

namespace asterism {
namespace {

using Bytes = std::vector<std::byte>;
constexpr std::size_t kHeader = 32, kChecksumAt = 24;

AnyTracker started(AnyTracker tracker) {
  tracker.init(draw_frame(0), true_box(0));
  return tracker;
}

// CRC-32 bit by bit.
void seal(Bytes& state) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (std::size_t i = kHeader; i < state.size(); ++i) {
    crc ^= std::to_integer<std::uint32_t>(state[i]);
    for (int k = 0; k < 8; ++k) crc = crc & 1 ? crc >> 1 ^ 0xEDB88320 : crc >> 1;
  }
  crc = ~crc;
  std::memcpy(state.data() + kChecksumAt, &crc, sizeof crc);
}

std::string refusal(AnyTracker& tracker, const Bytes& state) {
  try {
    tracker.restore(state);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "taken";
}

// Small enough to change every byte of its state.
GatedTracker<CoarseTracker> small_tracker() {
  CoarseOptions options;
  options.use_color = false;
  options.root = ColorHistogram({.space = ColorHistogramOptions::Space::Gray, .bins = 8});
  return GatedTracker(CoarseTracker(options));
}

std::vector<std::pair<std::string, std::function<AnyTracker()>>> trackers() {
  std::vector<std::pair<std::string, std::function<AnyTracker()>>> result;
  for (const char* name : {"dpt", "coarse", "kcf", "dpt_3x3_ov", "dpt_plus", "lgt", "kalman"})
    result.emplace_back(name, [name] { return make_tracker(name); });
  result.emplace_back("kalman of lgt", [] { return KalmanTracker(make_tracker("lgt")); });
  const std::pair<const char*, AnyPart> parts[]{{"mosse", Mosse()},
                                                {"strcf", Strcf()},
                                                {"superpixel parts", Superpixels()},
                                                {"template", Template()},
                                                {"color_histogram", ColorHistogram()},
                                                {"linear kcf", [] {
                                                   KcfOptions options;
                                                   options.kernel.type = Kernel::Type::Linear;
                                                   options.features.color = true;
                                                   options.separate_update = false;
                                                   return Kcf(options);
                                                 }()}};
  for (const auto& [name, part] : parts)
    result.emplace_back(name, [part = part] {
      DptOptions options;
      options.coarse.root = options.part = part;
      options.grid_rows = 3;
      options.constellation = Constellation::Local;
      options.solver = {"newton", {}};
      return AnyTracker(GatedTracker(Dpt(options)));
    });
  return result;
}

TEST(State, ARestoredTrackerGoesOnBitByBit) {
  for (const auto& [name, make] : trackers()) {
    SCOPED_TRACE(name);
    AnyTracker saved = started(make());
    for (int t = 1; t <= 20; ++t) saved.update(draw_frame(t));
    const Bytes state = saved.save();
    EXPECT_EQ(state, saved.save());
    // Restore into a new tracker, and into one that follows something else.
    AnyTracker fresh = make(), other = make();
    other.init(draw_frame(9), {100, 90, 70, 30});
    other.update(draw_frame(8));
    fresh.restore(state);
    other.restore(state);
    EXPECT_EQ(fresh.save(), state);
    // The object is hidden for a while; also restore afterwards.
    AnyTracker without = make();
    for (int t = 21; t <= 40; ++t) {
      const cv::Mat image =
          t > 24 && t <= 30 ? cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(90)) : draw_frame(t);
      const TrackResult expected = saved.update(image);
      expect_same(fresh.update(image), expected);
      expect_same(other.update(image), expected);
      if (t > 30) expect_same(without.update(image), expected);
      if (t == 30) without.restore(saved.save());
    }
    EXPECT_EQ(fresh.save(), saved.save());
    EXPECT_EQ(without.save(), saved.save());
  }
}

TEST(State, IsThatOfEveryTracker) {
  for (const std::string& name : tracker_names()) {
    AnyTracker source = started(make_tracker(name)), target = make_tracker(name);
    EXPECT_THROW(target.save(), std::logic_error) << name;
    target.restore(source.save());
    expect_same(target.update(draw_frame(1)), source.update(draw_frame(1)));
  }
}

TEST(State, CopiesOfATrackerAreIndependent) {
  for (const auto& [name, make] : trackers()) {
    SCOPED_TRACE(name);
    AnyTracker first = started(make()), reference = started(make()), second = first;
    second.update(draw_frame(5));
    for (int t = 1; t <= 3; ++t) expect_same(first.update(draw_frame(t)), reference.update(draw_frame(t)));
  }
}

TEST(State, AnyNumberOfThreadsTakesIt) {
  DptOptions options;
  Dpt one(options);
  options.threads = 2;
  Dpt two(options);
  one.init(draw_frame(0), true_box(0));
  restore_state(two, save_state(one));
  expect_same(one.update(draw_frame(1)), two.update(draw_frame(1)));
}

TEST(State, EveryFlippedByteAndEveryLengthIsRefused) {
  AnyTracker source = started(small_tracker());
  const Bytes state = source.save();
  ASSERT_LT(state.size(), 2000u);
  AnyTracker target = started(small_tracker()), reference = started(small_tracker());
  Bytes damaged = state;
  for (std::size_t i = 0; i < state.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      damaged[i] ^= std::byte(1 << bit);
      EXPECT_THROW(target.restore(damaged), std::runtime_error) << i;
      damaged[i] = state[i];
    }
    EXPECT_THROW(target.restore(std::span(state).first(i)), std::runtime_error) << i;
  }
  damaged.push_back({});
  EXPECT_THROW(target.restore(damaged), std::runtime_error);
  // The refused state left the tracker unchanged.
  for (int t = 1; t <= 3; ++t) expect_same(target.update(draw_frame(t)), reference.update(draw_frame(t)));
  EXPECT_EQ(refusal(target, {}), "state: these bytes are not a saved state");
  EXPECT_EQ(refusal(target, Bytes(100)), "state: these bytes are not a saved state");
  damaged = state;
  damaged[8] = std::byte(99);
  EXPECT_EQ(refusal(target, damaged), "state: of format version 99, this is version 1");
  EXPECT_EQ(refusal(target, state), "taken");
}

// A corrupted state with a correct checksum gives an error, or a tracker that returns boxes.
TEST(State, NothingInASealedStateCrashes) {
  std::uint32_t random = 1;
  const auto next = [&] { return (random = random * 1664525u + 1013904223u) >> 8; };
  for (const auto& [name, make] : trackers()) {
    SCOPED_TRACE(name);
    AnyTracker source = started(make());
    const Bytes state = source.save();
    int refused = 0;
    for (int i = 0; i < 60; ++i) {
      Bytes changed = state;
      // Half of the changes are among the options and sizes at the beginning.
      const std::size_t from = kHeader + next() % (i % 2 == 0 ? 2000 : state.size() - kHeader - 8);
      const double values[]{0, -1, 1e308, 1e-308, 1e6, -1e6};
      if (i % 3 == 0)
        changed[from] ^= std::byte(1 << next() % 8);
      else if (i % 3 == 1)
        std::memcpy(changed.data() + from, &values[next() % std::size(values)], sizeof(double));
      else
        changed.erase(changed.begin() + static_cast<std::ptrdiff_t>(from),
                      changed.begin() + static_cast<std::ptrdiff_t>(from) + 4);
      const std::uint64_t size = changed.size() - kHeader;
      std::memcpy(changed.data() + 16, &size, sizeof size);
      seal(changed);
      AnyTracker target = make();
      try {
        target.restore(changed);
      } catch (const std::runtime_error&) {
        ++refused;
        continue;
      } catch (const std::invalid_argument&) {
        ++refused;
        continue;
      }
      for (int t = 1; t <= 2; ++t) try {
          target.update(draw_frame(t));
        } catch (const std::exception&) {  // parts refuse positions that are not finite
        }
    }
    EXPECT_GT(refused, 20);
    EXPECT_LT(refused, 60);
  }
}

// Otherwise a model's list would be as long as the damaged number.
TEST(State, ADamagedLengthIsRefusedBeforeItIsUsed) {
  struct List {
    std::vector<double> values;
    void visit_state(StateArchive& archive) {
      auto length = static_cast<int>(values.size());
      archive.count(length, sizeof(double));
      values.resize(static_cast<std::size_t>(length));
      for (double& value : values) archive(value);
    }
  };
  const Bytes state = save_state(List{{1, 2, 3}});
  List target{{7}};
  for (const int length : {-1, 2, 4, 1 << 20, std::numeric_limits<int>::max()}) {
    Bytes changed = state;
    std::memcpy(changed.data() + kHeader, &length, sizeof length);
    seal(changed);
    EXPECT_THROW(restore_state(target, changed), std::runtime_error) << length;
    EXPECT_EQ(target.values, std::vector<double>{7});
  }
  restore_state(target, state);
  EXPECT_EQ(target.values, (std::vector<double>{1, 2, 3}));
}

TEST(State, OfEachTrackerIsForItAlone) {
  for (const auto& [name, make] : trackers()) {
    const Bytes state = started(make()).save();
    for (const auto& [other, make_other] : trackers()) {
      AnyTracker target = make_other();
      EXPECT_EQ(refusal(target, state) == "taken", name == other) << name << " into " << other;
    }
  }
}

TEST(State, OfOtherOptionsOrAnotherTrackerIsRefused) {
  AnyTracker dpt = started(make_tracker("dpt")), coarse = started(make_tracker("coarse"));
  const Bytes of_dpt = dpt.save(), of_coarse = coarse.save();
  EXPECT_EQ(refusal(coarse, of_dpt), "state: of something else: it has 'dpt' where 'coarse layer' is");
  EXPECT_EQ(refusal(dpt, of_coarse), "state: of something else: it has 'coarse layer' where 'dpt' is");
  DptOptions gate, part;
  gate.mask_gate = 0.25;
  AnyTracker other = Dpt(gate);
  EXPECT_EQ(refusal(other, of_dpt), "state: of other options: 'mask_gate' was 0.200000 and is 0.250000");
  part.part = Mosse();
  other = Dpt(part);
  EXPECT_EQ(refusal(other, of_dpt), "state: of something else: it has 'kcf' where 'mosse' is");
  KcfOptions filter;
  filter.lambda = 1e-3;
  part.part = Kcf(filter);
  other = Dpt(part);
  EXPECT_EQ(refusal(other, of_dpt), "state: of other options: 'lambda' was 0.000100 and is 0.001000");
  EXPECT_THROW(other.update(draw_frame(0)), std::logic_error) << "it was not initialised, and is not";
}

struct Forgetful {
  void init(const cv::Mat&, const cv::Rect2d&) {}
  TrackResult update(const cv::Mat&) { return {}; }
};
struct ForgetfulPart {
  void init(const Frame&, const Point2&, const Size2&) {}
  Evidence localize(const Frame&, const Point2& around) { return {.position = around}; }
  double similarity_at(const Point2&) const { return 1; }
  void adapt(const Frame&, const Point2&) {}
};

TEST(State, OfWhatHasNoneIsRefused) {
  const std::string no_tracker = "state: this kind of tracker cannot be saved";
  DptOptions dpt;
  dpt.part = ForgetfulPart();
  LgtOptions lgt;
  lgt.part = ForgetfulPart();
  std::vector<std::pair<AnyTracker, std::string>> cases;
  cases.emplace_back(Forgetful(), no_tracker);
  cases.emplace_back(KalmanTracker(Forgetful()), no_tracker);
  cases.emplace_back(Dpt(dpt), "state: this kind of part model cannot be saved");
  cases.emplace_back(Lgt(lgt), "state: this kind of part model cannot be saved");
  for (auto& [tracker, reason] : cases) {
    tracker.init(draw_frame(0), true_box(0));
    try {
      tracker.save();
      FAIL() << reason;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), reason);
    }
    tracker.update(draw_frame(1));  // the tracker still works
  }
  EXPECT_THROW(AnyTracker(cases[0].first), std::invalid_argument);
}

}  // namespace
}  // namespace asterism
