// asterism-interruptions: what the gate for interruptions does for a tracker. Annotated sequences are
// interrupted in many ways, also by one another, and tracked with the gate and without it. Whole sequences as
// they are show whether the gate acts where nothing interrupts them.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <asterism/solver/base/split_mix.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/others/lgt.hpp>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "dataset.hpp"
#include "ground_truth.hpp"
#include "interruptions.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism;
using namespace asterism::bench;
using asterism::detail::SplitMix64;

// The first frames of a sequence.
struct Clip {
  std::string name;
  std::vector<cv::Mat> images;
  std::vector<std::optional<cv::Rect2d>> truth;  // of the same area and centre as the annotated region
};

Clip read(const Sequence& sequence, std::size_t most) {
  Clip clip{sequence.name, {}, {}};
  FrameReader reader(sequence);
  for (std::size_t t = 0; t < std::min(most, sequence.length()); ++t) {
    clip.images.push_back(reader(t).clone());
    const std::optional<Region>& truth = sequence.truth[t];
    clip.truth.push_back(truth ? std::optional(truth->equal_area_box()) : std::nullopt);
  }
  return clip;
}

// What a tracker is shown, and the box that its answer is compared with, if it is.
struct Shown {
  cv::Mat image;
  std::optional<cv::Rect2d> truth;
};
struct Kind {
  std::string name;
  std::vector<Shown> shown;
};

cv::Mat fitted(const cv::Mat& image, cv::Size size) {
  cv::Mat result;
  cv::resize(image, result, size, 0, 0, cv::INTER_AREA);
  return result;
}

// Interrupts a clip before frame `at`.
class Interrupter {
 public:
  static constexpr std::size_t kAfter = 30;  // frames of the clip after the interruption

  Interrupter(const Clip& clip, std::size_t at) : clip_(clip), at_(at) {}

  // The frames from `at` + `skipped` on.
  void go_on(Kind& kind, std::size_t skipped = 0) const {
    for (std::size_t t = at_ + skipped; t < std::min(clip_.images.size(), at_ + skipped + kAfter); ++t)
      kind.shown.push_back({clip_.images[t], clip_.truth[t]});
  }
  // Frames of another clip.
  void show(Kind& kind, const Clip& other, std::size_t first, std::size_t frames) const {
    for (std::size_t i = 0; i < frames; ++i) {
      const cv::Mat& image = other.images[std::min(first + i, other.images.size() - 1)];
      kind.shown.push_back({fitted(image, clip_.images[0].size()), {}});
    }
  }
  // At most half of the frames that are left are replaced.
  std::size_t replaceable(std::size_t frames) const {
    return std::min(frames, (clip_.images.size() - at_) / 2);
  }
  // `make(image, i)` is inserted `frames` times.
  Kind inserted(const std::string& name, std::size_t frames,
                const std::function<cv::Mat(const cv::Mat&, int)>& make) const {
    Kind kind{name, {}};
    for (std::size_t i = 0; i < frames; ++i)
      kind.shown.push_back({make(clip_.images[at_], static_cast<int>(i)), {}});
    go_on(kind);
    return kind;
  }
  // `make(image, box)` is shown in place of `frames` frames.
  Kind replaced(const std::string& name, std::size_t frames,
                const std::function<cv::Mat(const cv::Mat&, const cv::Rect2d&)>& make) const {
    Kind kind{name, {}};
    frames = replaceable(frames);
    cv::Rect2d box = *clip_.truth[0];
    for (std::size_t t = at_; t < at_ + frames; ++t) {
      box = clip_.truth[t].value_or(box);
      kind.shown.push_back({make(clip_.images[t], box), {}});
    }
    go_on(kind, frames);
    return kind;
  }

 private:
  const Clip& clip_;
  std::size_t at_;
};

// `pixels`, as large as the image, in a box relative to the object's: (0, 0, 1, 1) is the object's.
cv::Mat covered(const cv::Mat& image, const cv::Rect2d& object, const cv::Rect2d& relative,
                const cv::Mat& pixels) {
  const cv::Rect2d box(object.x + relative.x * object.width, object.y + relative.y * object.height,
                       relative.width * object.width, relative.height * object.height);
  const cv::Rect cover = cv::Rect(box) & cv::Rect({}, image.size());
  cv::Mat result = image.clone();
  if (!cover.empty()) pixels(cover).copyTo(result(cover));
  return result;
}

std::vector<Kind> kinds(const Clip& clip, std::size_t at, const Clip& other, const Clip& third,
                        SplitMix64& random) {
  const Interrupter interrupter(clip, at);
  const cv::Mat& first = clip.images[0];
  const auto begin = [&](const Clip& of) {
    return random.below(std::max<std::size_t>(of.images.size(), 26) - 25);
  };
  const std::size_t of_other = begin(other), of_third = begin(third);
  std::vector<Kind> result{{"unaltered", {}}};
  interrupter.go_on(result.back());
  for (const std::size_t frames : {2, 5, 25}) {
    result.push_back({"cut to another video, " + std::to_string(frames), {}});
    interrupter.show(result.back(), other, of_other, frames);
    interrupter.go_on(result.back());
  }
  result.push_back({"the same, the first video runs on", {}});
  interrupter.show(result.back(), other, of_other, interrupter.replaceable(25));
  interrupter.go_on(result.back(), interrupter.replaceable(25));
  result.push_back({"cuts to two other videos, 5 each", {}});
  interrupter.show(result.back(), other, of_other, 5);
  interrupter.show(result.back(), third, of_third, 5);
  interrupter.go_on(result.back());

  const auto inserted = [&](const char* name, std::size_t frames, auto make) {
    result.push_back(interrupter.inserted(name, frames, make));
  };
  const auto replaced = [&](const char* name, std::size_t frames, auto make) {
    result.push_back(interrupter.replaced(name, frames, make));
  };
  using Image = const cv::Mat&;
  using Box = const cv::Rect2d&;
  replaced("inverted, 1", 1, [](Image image, Box) { return testing::inverted(image); });
  result.push_back({"letterbox bars that stay", {}});
  interrupter.go_on(result.back());
  for (Shown& shown : result.back().shown) shown.image = testing::letterboxed(shown.image);
  inserted("rolled by half the height, 5", 5, [](Image image, int) { return testing::rolled(image); });
  inserted("doubled at half the height, 5", 5, [](Image image, int) { return testing::doubled(image); });
  inserted("station's logo, 5", 5, [](Image image, int) { return testing::with_logo(image); });
  const auto row =
      static_cast<int>(first.rows / 4 + random.below(static_cast<std::size_t>(first.rows / 2 + 1)));
  inserted("decoder's smear, 5", 5, [row](Image image, int) { return testing::smeared(image, row); });

  const auto gray = [&](int level) { return testing::of_one_color(first, cv::Scalar::all(level)); };
  replaced("black, 10", 10, [&](Image, Box) { return gray(0); });
  replaced("gray, 10", 10, [&](Image, Box) { return gray(128); });
  inserted("gray, 25 inserted", 25, [&](Image, int) { return gray(128); });
  inserted("noise, 10", 10, [](Image image, int i) { return testing::gray_noise(image, 60, i); });
  replaced("decoder's gray half, 5", 5, [](Image image, Box box) {
    const int half = image.rows / 2;
    return testing::with_gray(image, {0, box.y + box.height / 2 > half ? half : 0, image.cols, half});
  });
  const cv::Mat foreign = fitted(other.images[0], first.size());
  replaced("flat occluder, 8", 8, [&](Image image, Box box) {
    return covered(image, box, {-0.5, -0.5, 2, 2}, gray(100));
  });
  replaced("flat occluder of the lower half, 8", 8, [&](Image image, Box box) {
    return covered(image, box, {-0.5, 0.4, 2, 1}, gray(100));
  });
  replaced("textured occluder, 8", 8, [&](Image image, Box box) {
    return covered(image, box, {-0.25, -0.25, 1.5, 1.5}, foreign);
  });
  return result;
}

// Of one kind, over the clips.
struct Sums {
  std::string kind;
  double with = 0, without = 0;  // of the overlaps' averages
  std::size_t interrupted = 0;   // frames
};

template <class T>
void measure(const GatedTracker<T>& tracker, const std::string& name, const std::vector<Clip>& clips,
             std::size_t draws) {
  std::vector<Sums> sums;
  for (std::size_t run = 0; run < draws * clips.size(); ++run) {
    SplitMix64 random(1000 + run);
    const std::size_t c = run % clips.size();
    const Clip& clip = clips[c];
    const Clip& other = clips[(c + 1 + random.below(clips.size() - 1)) % clips.size()];
    const Clip& third = clips[(c + 1 + random.below(clips.size() - 1)) % clips.size()];
    const std::size_t at = 10 + random.below(std::clamp<std::size_t>(clip.images.size() / 2, 11, 40) - 10);
    GatedTracker<T> with = tracker;
    T without = tracker.tracker();
    with.init(clip.images[0], *clip.truth[0]), without.init(clip.images[0], *clip.truth[0]);
    for (std::size_t t = 1; t < at; ++t) {
      with.update(clip.images[t]);
      without.update(clip.images[t]);
    }
    const std::vector<Kind> all = kinds(clip, at, other, third, random);
    sums.resize(all.size());
    for (std::size_t k = 0; k < all.size(); ++k) {
      GatedTracker<T> gated = with;
      T ungated = without;
      double sum_with = 0, sum_without = 0;
      int compared = 0;
      for (const Shown& shown : all[k].shown) {
        const TrackResult result = gated.update(shown.image), other_result = ungated.update(shown.image);
        sums[k].interrupted += result.interrupted;
        if (!shown.truth) continue;
        sum_with += tools::overlap(result.box, *shown.truth);
        sum_without += tools::overlap(other_result.box, *shown.truth);
        ++compared;
      }
      sums[k].kind = all[k].name;
      sums[k].with += sum_with / std::max(1, compared);
      sums[k].without += sum_without / std::max(1, compared);
    }
  }
  const auto n = static_cast<double>(draws * clips.size());
  std::printf("%s, %zu interruptions of each kind in %zu sequences\n%-36s %7s %7s %7s %s\n", name.c_str(),
              draws * clips.size(), clips.size(), "kind", "without", "with", "gain", "frames interrupted");
  for (const Sums& of : sums)
    std::printf("%-36s %7.3f %7.3f %+7.3f %zu\n", of.kind.c_str(), of.without / n, of.with / n,
                (of.with - of.without) / n, of.interrupted);
  std::fflush(stdout);
}

// Whole sequences as they are, each tracked `draws` times, from the second time on from a box that is moved
// by up to a pixel: those in which the gate changes a box, and their average overlaps.
template <class T>
void compare_unaltered(const GatedTracker<T>& tracker, const std::string& name,
                       const std::vector<Sequence>& sequences, std::size_t draws) {
  std::printf("%s, unaltered, %zu runs of each sequence\n%-36s %7s %7s %7s %s\n", name.c_str(), draws,
              "sequence", "without", "with", "gain", "frames, of them with another box, interrupted");
  struct Compared {
    double with = 0, without = 0;  // sums of the runs' average overlaps
    int frames = 0, other = 0, interrupted = 0;
  };
  const auto print = [&](const std::string& of, const Compared& sum, std::size_t runs) {
    const auto n = static_cast<double>(runs);
    std::printf("%-36s %7.3f %7.3f %+7.4f %d %d %d\n", of.c_str(), sum.without / n, sum.with / n,
                (sum.with - sum.without) / n, sum.frames, sum.other, sum.interrupted);
    std::fflush(stdout);
  };
  Compared all;
  for (const Sequence& sequence : sequences) {
    FrameReader reader(sequence);
    SplitMix64 random(1000);
    Compared of;
    for (std::size_t run = 0; run < draws; ++run) {
      const auto move = [&] { return run == 0 ? 0 : static_cast<double>(random.below(2001)) / 1000 - 1; };
      cv::Rect2d start = sequence.truth[0]->equal_area_box();
      start.x += move(), start.y += move();
      GatedTracker<T> with = tracker;
      T without = tracker.tracker();
      const cv::Mat first = reader(0);
      with.init(first, start), without.init(first, start);
      double overlap_with = 0, overlap_without = 0;
      int compared = 0;
      for (std::size_t t = 1; t < sequence.length(); ++t) {
        const cv::Mat image = reader(t);
        const Frame frame(image);
        const TrackResult result = with.update(frame), other = without.update(frame);
        of.frames += 1, of.other += result.box != other.box, of.interrupted += result.interrupted;
        if (!sequence.truth[t]) continue;
        const cv::Rect2d truth = sequence.truth[t]->equal_area_box();
        overlap_with += tools::overlap(result.box, truth);
        overlap_without += tools::overlap(other.box, truth);
        ++compared;
      }
      of.with += overlap_with / std::max(1, compared), of.without += overlap_without / std::max(1, compared);
    }
    if (of.other > 0) print(sequence.name, of, draws);
    all.with += of.with, all.without += of.without;
    all.frames += of.frames, all.other += of.other, all.interrupted += of.interrupted;
  }
  print("all " + std::to_string(sequences.size()), all, draws * sequences.size());
}

// Calls `visit` with the GatedTracker of this name.
template <class Visit>
void visit_tracker(const std::string& name, Visit&& visit) {
  const AnyTracker tracker = make_tracker(name);
  if (const auto* const dpt = tracker.target<GatedTracker<Dpt>>())
    visit(*dpt);
  else if (const auto* const coarse = tracker.target<GatedTracker<CoarseTracker>>())
    visit(*coarse);
  else if (const auto* const lgt = tracker.target<GatedTracker<Lgt>>())
    visit(*lgt);
  else
    throw std::invalid_argument(name + " has no gate of its own");
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset;
  std::vector<std::string> names{"dpt", "dpt_plus", "kcf"}, only;
  std::size_t frames = 100, draws = 3;
  bool unaltered = false;
  CLI::App app(
      "Prints the average overlap of trackers after interruptions of many kinds, with the gate for "
      "interruptions and without it. The sequences are also cut into each other.",
      "asterism-interruptions");
  app.add_option("DATASET", dataset, "a folder of at least two sequences")->required();
  app.add_option("--trackers", names, "trackers of asterism with a gate, separated by commas")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  app.add_option(
         "--draws", draws,
         "interruptions of each kind in a sequence, at positions that are drawn; with --unaltered, runs, "
         "from the second on from a box that is moved by up to a pixel")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  CLI::Option* const most = app.add_option("--frames", frames, "of each sequence, at most")
                                ->check(CLI::Range(30, 10000))
                                ->capture_default_str();
  app.add_flag(
         "--unaltered", unaltered,
         "interrupt nothing; compare the boxes in all frames, and list the sequences in which they differ")
      ->excludes(most);
  return tools::run_tool(app, argc, argv, [&] {
    cv::setNumThreads(1);
    for (const std::string& name : names)
      visit_tracker(name, [](const auto&) {});  // unknown ones fail before the first run
    const Dataset data = open_dataset(dataset, Layout::Auto, only);
    print_notes(data);
    for (const Sequence& sequence : data.sequences)
      if (sequence.length() < 30 || !sequence.truth[0])
        throw std::runtime_error(sequence.name + ": fewer than 30 frames, or no object in the first one");
    if (unaltered) {
      for (const std::string& name : names)
        visit_tracker(name,
                      [&](const auto& tracker) { compare_unaltered(tracker, name, data.sequences, draws); });
      return;
    }
    std::vector<Clip> clips;
    for (const Sequence& sequence : data.sequences) clips.push_back(read(sequence, frames));
    if (clips.size() < 2) throw std::runtime_error("two sequences are needed: they interrupt each other");
    for (const std::string& name : names)
      visit_tracker(name, [&](const auto& tracker) { measure(tracker, name, clips, draws); });
  });
}
