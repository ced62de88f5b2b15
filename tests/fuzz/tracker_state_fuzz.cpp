// Fuzzes saved states, changed but with a correct checksum: each must be refused, or give a tracker that
// returns finite boxes or throws with a reason. An input selects the tracker and the changes to its state.

#include <array>
#include <asterism/parts/models/color_histogram.hpp>
#include <asterism/parts/models/mosse.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/parts/models/template.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <cstring>
#include <functional>
#include <stdexcept>

#include "bytes.hpp"
#include "small_scene.hpp"

using namespace asterism;

namespace {

using State = std::vector<std::byte>;
constexpr std::size_t kHeader = 32, kSizeAt = 16, kChecksumAt = 24;

struct Saved {
  std::function<AnyTracker()> make;
  State state;
};

std::vector<Saved> saved_trackers() {
  std::vector<Saved> all;
  const auto add = [&all](std::function<AnyTracker()> make) {
    AnyTracker tracker = make();
    tracker.init(fuzz::small_frame(0), fuzz::small_box());
    all.push_back({make, tracker.save()});
  };
  const ColorHistogram histogram({.space = ColorHistogramOptions::Space::Gray, .bins = 8});
  CoarseOptions coarse;
  coarse.use_color = false;
  coarse.root = histogram;
  add([=] { return AnyTracker(GatedTracker(CoarseTracker(coarse))); });
  for (const AnyPart& part : {AnyPart(histogram), AnyPart(Template()), AnyPart(Mosse())}) {
    DptOptions options;
    options.coarse = coarse;
    options.part = part;
    add([=] { return AnyTracker(GatedTracker(Dpt(options))); });
  }
  for (const std::string& name : tracker_names()) {
    // dpt_loc, dpt_3x3_ov and so on save the same as dpt, with other links or more parts.
    if (name.starts_with("dpt_") && name != "dpt_plus") continue;
    try {
      add([=] { return make_tracker(name); });
    } catch (const std::invalid_argument&) {  // its state cannot be saved
    }
  }
  // Last, so that the existing corpus keeps its meaning.
  coarse.root = Strcf();
  add([=] { return AnyTracker(GatedTracker(CoarseTracker(coarse))); });
  return all;
}

// The CRC-32 of the header. Not instrumented: its loop does not help the fuzzer, and would take a quarter of
// its time.
#ifdef __clang__
__attribute__((no_sanitize("coverage")))
#endif
std::uint32_t
checksum(const State& state) {
  static const auto table = [] {
    std::array<std::uint32_t, 256> result;
    for (std::uint32_t i = 0; i < result.size(); ++i) {
      result[i] = i;
      for (int k = 0; k < 8; ++k)
        result[i] = (result[i] & 1) != 0 ? result[i] >> 1 ^ 0xEDB88320 : result[i] >> 1;
    }
    return result;
  }();
  std::uint32_t crc = ~std::uint32_t{0};
  for (std::size_t i = kHeader; i < state.size(); ++i)
    crc = crc >> 8 ^ table[(crc ^ std::to_integer<std::uint32_t>(state[i])) & 255];
  return ~crc;
}

void seal(State& state) {
  const std::uint64_t size = state.size() - kHeader;
  const std::uint32_t crc = checksum(state);
  std::memcpy(state.data() + kSizeAt, &size, sizeof size);
  std::memcpy(state.data() + kChecksumAt, &crc, sizeof crc);
}

// One change: position (32 bits, modulo the state's length), kind (8 bits), and value.
void change(State& state, fuzz::Bytes& bytes) {
  const std::size_t at = kHeader + bytes.take<std::uint32_t>() % (state.size() - kHeader);
  const auto kind = bytes.take<std::uint8_t>();
  const auto put = [&](auto value) {
    std::memcpy(state.data() + at, &value, std::min(sizeof value, state.size() - at));
  };
  switch (kind % 5) {
    case 0:
      put(bytes.take<std::uint8_t>());
      break;
    case 1:
      put(bytes.take<std::int32_t>());
      break;
    case 2:
      put(bytes.take<float>());
      break;
    case 3:
      put(bytes.take<double>());
      break;
    case 4:
      state.resize(at + 1);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::vector<Saved> all = saved_trackers();
  static const std::array<cv::Mat, 2> frames{fuzz::small_frame(0), fuzz::small_frame(1)};
  fuzz::Bytes bytes(data, size);
  const Saved& saved = all[bytes.take<std::uint8_t>() % all.size()];
  State state = saved.state;
  for (int i = 0; i < 8 && !bytes.empty(); ++i) change(state, bytes);
  seal(state);
  AnyTracker tracker = saved.make();
  try {
    tracker.restore(state);
    fuzz::check(tracker.update(frames[1]));
    fuzz::check(tracker.update(frames[0]));
  } catch (const std::invalid_argument&) {
  } catch (const std::runtime_error&) {
  }
  return 0;
}
