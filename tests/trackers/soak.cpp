// Runs a tracker for any number of frames on a clip that restarts again and again. After each restart its
// results must be those of a fresh start bit for bit, and memory and time per frame must not grow.
//
//   soak [FRAMES [TRACKER]]

#include <sys/prctl.h>
#include <unistd.h>

#include <asterism/trackers/tracker/tracker.hpp>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "moving_square.hpp"

namespace asterism {
namespace {

constexpr int kClip = 50;  // frames

// FNV-1a hash of a tracker's results.
class Digest {
 public:
  void add(const TrackResult& result) {
    for (const double value : {result.box.x, result.box.y, result.box.width, result.box.height, result.angle,
                               result.confidence, double(result.lost)})
      add(value);
    for (const PartState& part : result.parts)
      for (const double value : {part.position.x(), part.position.y(), part.weight, double(part.updated)})
        add(value);
  }
  std::uint64_t value() const { return value_; }

 private:
  void add(double number) {
    const auto bits = std::bit_cast<std::uint64_t>(number);
    for (int shift = 0; shift < 64; shift += 8) value_ = (value_ ^ (bits >> shift & 0xff)) * 0x100000001b3ULL;
  }
  std::uint64_t value_ = 0xcbf29ce484222325ULL;
};

double cpu_seconds() {
  std::timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double resident_megabytes() {
  std::ifstream file("/proc/self/statm");
  double total = 0, resident = 0;
  if (!(file >> total >> resident)) throw std::runtime_error("/proc/self/statm cannot be read");
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576;
}

std::uint64_t digest_of_clip(AnyTracker& tracker, const std::vector<cv::Mat>& clip) {
  Digest digest;
  tracker.init(clip[0], true_box(0));
  for (std::size_t t = 1; t < clip.size(); ++t) digest.add(tracker.update(clip[t]));
  return digest.value();
}

int soak(long frames, const char* name) {
  std::vector<cv::Mat> clip;
  for (int t = 0; t < kClip; ++t) clip.push_back(draw_frame(t));
  AnyTracker fresh = make_tracker(name), tracker = make_tracker(name);
  const std::uint64_t expected = digest_of_clip(fresh, clip);

  const long rounds = std::max(10L, frames / (kClip - 1));
  const long tenth = rounds / 10;
  double first_seconds = 0, last_seconds = 0, megabytes = 0;
  for (long round = 0; round < rounds; ++round) {
    const double before = cpu_seconds();
    if (digest_of_clip(tracker, clip) != expected) {
      std::fprintf(stderr, "%s: other results than a fresh start's in round %ld\n", name, round + 1);
      return 1;
    }
    const double seconds = cpu_seconds() - before;
    if (round < tenth) first_seconds += seconds;
    if (round >= rounds - tenth) last_seconds += seconds;
    if (round + 1 == tenth) megabytes = resident_megabytes();
  }
  const double grown = resident_megabytes() - megabytes, drift = last_seconds / first_seconds;
  const double milliseconds = 1000 * first_seconds / static_cast<double>(tenth * (kClip - 1));
  std::printf(
      "%s: %ld frames from %ld starts, all as from the first; %.2f MB resident, %+.2f MB since the first "
      "tenth;\n%.2f ms of CPU a frame in the first tenth, %.3f times that in the last\n",
      name, rounds * (kClip - 1), rounds, megabytes + grown, grown, milliseconds, drift);
  // Other processes may change the time by more than a tenth, and by more if there are few frames.
  return grown <= 1 && (drift <= 1.5 || frames < 10000) ? 0 : 1;
}

}  // namespace
}  // namespace asterism

int main(int argc, char** argv) try {
  prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0);  // a single large page would be two megabytes more
  return asterism::soak(argc > 1 ? std::atol(argv[1]) : 1000, argc > 2 ? argv[2] : "dpt");
} catch (const std::exception& error) {
  std::fprintf(stderr, "soak: %s\n", error.what());
  return 1;
}
