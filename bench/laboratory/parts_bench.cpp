#include "parts_bench.hpp"

#include <asterism/parts/features/fhog.hpp>
#include <asterism/parts/features/mrf.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <cstdio>
#include <functional>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "bars.hpp"
#include "kernels/filter_plan.hpp"

#ifdef ASTERISM_BENCH_DLIB
#include <dlib/image_transforms.h>
#include <dlib/opencv.h>
#endif
#ifdef ASTERISM_BENCH_OPENCV_TRACKING
#include <opencv2/tracking.hpp>
#endif

namespace asterism::bench {
namespace {

using part_kernels_v0_1::FilterPlan;

/// Something that is timed: `call` is one unit of work.
struct Item {
  std::string name;
  std::function<void()> call;
  std::vector<double> seconds = {};  // per call, one value per round

  double time() const { return median(seconds); }
};

/// Times the items in turn, each for several milliseconds in every round.
void measure(const std::vector<Item*>& items, int rounds) {
  constexpr double kSlice = 4e-3;  // [s]
  for (Item* const item : items) item->call();
  for (int round = 0; round < rounds; ++round) {
    for (Item* const item : items) {
      const double start = cpu_seconds();
      double now = start;
      int calls = 0;
      do {
        item->call();
        ++calls;
        now = cpu_seconds();
      } while (now - start < kSlice);
      item->seconds.push_back((now - start) / calls);
    }
  }
}

cv::Mat texture(int rows, int cols, int type) {
  cv::Mat image(rows, cols, type);
  cv::RNG random(1);
  random.fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {}, 2);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

/// A synthetic video: a texture that drifts by a pixel or two per frame, back and forth.
class Video {
 public:
  Video() {
    const cv::Mat large = texture(520, 680, CV_8UC3);
    for (int t = 0; t < 16; ++t) {
      const int at = t < 8 ? t : 16 - t;
      images_.push_back(large({10 + 2 * at, 10 + at, 640, 480}).clone());
    }
  }
  const cv::Mat& first() const { return images_.front(); }
  const cv::Mat& next() { return images_[++frame_ % images_.size()]; }

 private:
  std::vector<cv::Mat> images_;
  std::size_t frame_ = 0;
};

/// The pieces of one step of a filter, on buffers of the filter's own size.
class Stages {
 public:
  explicit Stages(int target)
      : image_(texture(480, 640, CV_8UC3)), frame_(image_), target_(target), centre_(320, 240) {
    const Size2 size(target, target);
    kcf_.init(frame_, centre_, size);
    cells_ = static_cast<int>(kcf_.response().values.cols());
    plan_ = FilterPlan::shared(cells_, cells_);
    const int plane = cells_ * cells_;
    features_.reset(kChannels * plane);
    window_.reset(plane);
    for (int i = 0; i < plane; ++i) window_.data()[i] = 1;
    sample_.reset(plan_->spectra_floats(kChannels));
    template_.reset(plan_->spectra_floats(kChannels));
    split_.reset(2 * plan_->half_floats());
    plane_.reset(plan_->plane_floats());
    work_.reset(part_kernels_v0_1::work_floats(cells_, cells_));
    sampler_.sample(frame_.gray(), centre_, kcf_.window(), {4 * cells_, 4 * cells_}, patch_);
    hog_.compute(patch_, features_.data());

    const auto& t = plan_->transform;
    const auto& kernels = plan_->kernels;
    const auto forward = [&t, &kernels, this](float* spectra) {
      kernels.forward(t, kChannels, features_.data(), window_.data(), spectra, work_.data());
    };
    forward(template_.data());
    items_ = {
        {"patch",
         [this] {
           sampler_.sample(frame_.gray(), centre_ + Point2(0.3, 0.6), kcf_.window(), {4 * cells_, 4 * cells_},
                           patch_);
         }},
        {"fHOG", [this] { hog_.compute(patch_, features_.data()); }},
        {"transform of 32 channels", [this, forward] { forward(sample_.data()); }},
        {"product with the template",
         [this, &t, &kernels] {
           kernels.correlate(t, kChannels, sample_.data(), template_.data(), split_.data());
         }},
        {"power and template's update",
         [this, &t, &kernels] {
           kernels.train(t, kChannels, 0.02F, sample_.data(), template_.data(), split_.data());
         }},
        {"transform of a plane",
         [this, &t, &kernels] { kernels.forward_plane(t, plane_.data(), split_.data(), work_.data()); }},
        {"kernel", [this] { plan_->kernels.gaussian(0, 0, plan_->plane_floats(), plane_.data()); }},
        {"detect and train", [this] { kcf_.adapt(frame_, kcf_.localize(frame_, centre_).position); }}};

    // The same work by other libraries.
    gray_ = cv::Mat(cells_ * 4, cells_ * 4, CV_8UC1);
    patch_.copyTo(gray_);
    channel_ = cv::Mat(cells_, cells_, CV_32FC1, cv::Scalar(0.5));
    peers_ = {{"OpenCV's dft, 32 channels", [this] {
                 for (int k = 0; k < kChannels; ++k) cv::dft(channel_, spectrum_);
               }}};
#ifdef ASTERISM_BENCH_DLIB
    peers_.push_back({"dlib's fHOG", [this] {
                        dlib::extract_fhog_features(dlib::cv_image<unsigned char>(gray_), dlib_features_, 4);
                      }});
#endif
  }
  Stages(const Stages&) = delete;
  Stages& operator=(const Stages&) = delete;

  std::vector<Item*> items() {
    std::vector<Item*> result;
    for (Item& item : items_) result.push_back(&item);
    for (Item& item : peers_) result.push_back(&item);
    return result;
  }

  void print() const {
    // How often each piece occurs in a step: a patch is sampled and transformed twice, and single planes are
    // transformed three times to detect and twice to train.
    constexpr int kTimes[] = {2, 2, 2, 1, 1, 5, 2, 1};
    const double whole = items_.back().time();
    std::printf("\nA filter of %d x %d cells of 4 pixels, 32 channels; target of %d pixels\n", cells_, cells_,
                target_);
    double sum = 0;
    for (std::size_t i = 0; i < items_.size(); ++i) {
      const double step = kTimes[i] * items_[i].time();
      if (i + 1 < items_.size()) sum += step;
      std::printf("  %-30s %8.1f us  x %d %9.1f us %6.1f %%\n", items_[i].name.c_str(),
                  1e6 * items_[i].time(), kTimes[i], 1e6 * step, 100 * step / whole);
    }
    std::printf("  %-30s %8s         %9.1f us %6.1f %%\n", "the rest: maps, peak, moments", "",
                1e6 * (whole - sum), 100 * (1 - sum / whole));
    const auto share = [&](std::initializer_list<std::size_t> which) {
      double total = 0;
      for (const std::size_t i : which) total += kTimes[i] * items_[i].time();
      return 100 * total / whole;
    };
    std::printf("  share of transforms %.0f %%, of fHOG %.0f %%, of products %.0f %%\n", share({2, 5}),
                share({1}), share({3, 4}));
    for (const Item& peer : peers_) {
      const Item& ours = items_[peer.name.find("fHOG") != std::string::npos ? 1 : 2];
      std::printf("  %-30s %8.1f us, %.2f x ours\n", peer.name.c_str(), 1e6 * peer.time(),
                  peer.time() / ours.time());
    }
  }

 private:
  static constexpr int kChannels = 32;  // of Kcf's default features

  cv::Mat image_;
  Frame frame_;
  int target_, cells_ = 0;
  Point2 centre_;
  Kcf kcf_;
  std::shared_ptr<const FilterPlan> plan_;
  PatchSampler sampler_;
  Fhog hog_;
  cv::Mat patch_, gray_, channel_, spectrum_;
  AlignedFloats features_, window_, sample_, template_, split_, plane_, work_;
#ifdef ASTERISM_BENCH_DLIB
  dlib::array<dlib::array2d<float>> dlib_features_;
#endif
  std::vector<Item> items_, peers_;
};

/// The filters for which there is a bar: a root and four parts of half its side.
class Constellation {
 public:
  Constellation() {
    const Frame frame(video_.first());
    for (int t = 0; t < 16; ++t) frames_.emplace_back(video_.next());
    filters_.resize(5);
    places_ = {{320, 240}, {300, 220}, {340, 220}, {300, 260}, {340, 260}};
    for (std::size_t i = 0; i < filters_.size(); ++i) {
      const double side = i == 0 ? 80 : 40;
      filters_[i].init(frame, places_[i], {side, side});
    }
  }
  /// Includes the conversion of the frame, as in a tracker's update.
  void step() { step(Frame(video_.next())); }
  /// On a frame that has already been converted.
  void step_on_next() { step(frames_[++at_ % frames_.size()]); }

 private:
  void step(const Frame& frame) {
    for (std::size_t i = 0; i < filters_.size(); ++i) {
      places_[i] = filters_[i].localize(frame, places_[i]).position;
      filters_[i].adapt(frame, places_[i]);
    }
  }

  Video video_;
  std::vector<Frame> frames_;
  std::size_t at_ = 0;
  std::vector<Kcf> filters_;
  std::vector<Point2> places_;
};

/// A part that localises and learns a target of 100 pixels in a video.
template <typename Part>
Item follow(std::string name, const std::vector<Frame>& frames, Part part) {
  const Point2 start(320, 240);
  part.init(frames.front(), start, {100, 100});
  return {std::move(name), [&frames, part, at = start, t = std::size_t{0}]() mutable {
            const Frame& frame = frames[++t % frames.size()];
            at = part.localize(frame, at).position;
            part.adapt(frame, at);
          }};
}

/// A likelihood as in segmentation: a blob that is mostly foreground, noise, and many cells of exactly 0
/// or 1.
cv::Mat likelihood() {
  cv::Mat map(32, 32, CV_32FC1);
  cv::RNG random(5);
  for (int y = 0; y < map.rows; ++y) {
    for (int x = 0; x < map.cols; ++x) {
      const bool inside = std::hypot(x - 15.0, 0.8 * (y - 16.0)) < 9;
      const double value = random.uniform(-0.4, 0.5) + (inside ? 0.8 : 0.1);
      map.at<float>(y, x) = static_cast<float>(std::clamp(value, 0.0, 1.0));
    }
  }
  return map;
}

}  // namespace

void parts_bench(bool quick) {
  cv::setNumThreads(1);
  const int rounds = quick ? 5 : 41;
  Stages root(80), part(40);
  Constellation constellation;
  Item five{"a root and four parts", [&] { constellation.step_on_next(); }};
  Item with_frame{"the same from a color image", [&] { constellation.step(); }};
  Video large;
  std::vector<Frame> frames;
  for (int t = 0; t < 16; ++t) frames.emplace_back(large.next());
  for (const Frame& frame : frames) frame.gray();
  StrcfOptions without_color;
  without_color.features.color = false;
  Item roots[] = {follow("Kcf", frames, Kcf()), follow("Strcf, without color", frames, Strcf(without_color)),
                  follow("Strcf", frames, Strcf())};
  const cv::Mat map = likelihood();
  Item mrf{"random field of 32 x 32 cells", [&] { regularize_posterior(map); }};

  std::vector<Item*> items = root.items();
  for (Item* const item : part.items()) items.push_back(item);
  items.push_back(&five);
  items.push_back(&with_frame);
  items.push_back(&mrf);
  for (Item& item : roots) items.push_back(&item);
#ifdef ASTERISM_BENCH_OPENCV_TRACKING
  Video video;
  const cv::Ptr<cv::TrackerKCF> peer = cv::TrackerKCF::create();
  peer->init(video.first(), cv::Rect(280, 200, 80, 80));
  Item opencv{"OpenCV's TrackerKCF", [&] {
                cv::Rect box;
                peer->update(video.next(), box);
              }};
  items.push_back(&opencv);
#endif
  measure(items, rounds);

  std::printf("Kernels with %d lanes; medians of %d rounds in which all take turns, CPU time of one thread\n",
              part_kernels_v0_1::kernels().lanes, rounds);
  root.print();
  part.print();
  std::printf("\nA target of 100 pixels, detect and train\n");
  for (const Item& item : roots) std::printf("  %-30s %8.2f ms\n", item.name.c_str(), 1e3 * item.time());

  Bars bars(quick, false, "");
  std::printf("\n%-46s %-42s %-22s %s\n", "", "measured", "target", "goal");
  bars.at_most("root and four parts, detect and train", "%.2f ms", 1e3 * five.time(), 1.5, 1.0);
#ifdef ASTERISM_BENCH_OPENCV_TRACKING
  bars.times_faster("the five and the frame's gray against TrackerKCF", with_frame.time(), opencv.time(), 3,
                    5);
#endif
  bars.at_most(mrf.name, "%.3f ms", 1e3 * mrf.time(), 0.3, 0.15);
}

}  // namespace asterism::bench
