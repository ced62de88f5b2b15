#pragma once

#include <array>
#include <asterism/parts/concept/frame.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/trackers/tracker/region.hpp>
#include <concepts>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The state of one part after a frame. Positions are pixel centres, as all Point2 are.
struct PartState {
  Point2 position;       ///< placement in the MAP constellation [px]
  Size2 size;            ///< of the part's template in the image [px]
  Point2 visual_best;    ///< visually most similar position x_A [px]
  double weight = 0;     ///< response at the MAP position, compared by the update gate
  bool updated = false;  ///< the appearance model was updated in this frame
};

/// Milliseconds spent in one stage of `update`.
struct StageTime {
  std::string_view stage;   ///< a string literal, e.g. "root", "color", "parts", "springs", "update"
  double milliseconds = 0;  ///< wall-clock time
};

/// The corners of a box turned by `angle` [rad, from the x axis towards the y axis] about its middle,
/// sub-pixel: those that the upright box has at its top left, top right, bottom right and bottom left. For
/// angle 0 they are (x, y), (x + width, y), (x + width, y + height), (x, y + height): pixels' edges, like the
/// box.
ASTERISM_API std::array<cv::Point2d, 4> turned(const cv::Rect2d& box, double angle);

/// A tracker's answer for one frame.
struct TrackResult {
  /// Sub-pixel, axis-aligned, in pixels' edges. It may reach over the frame's border, but its centre
  /// (centre_of) is in the image: at least 0 and at most width - 1 and height - 1.
  cv::Rect2d box;
  /// Rotation of the object since `init` [rad, from the x axis towards the y axis], estimated from its parts:
  /// 0 for trackers without parts. `box` is the object's box turned back upright.
  double angle = 0;
  double confidence = 0;  ///< in [0, 1]
  /// The probability that the box overlaps the object, in [0, 1] (BoxJudge); 0 in an interrupted frame. Empty
  /// if the tracker has none.
  std::optional<double> probability;
  bool lost = false;  ///< the tracker reports that it has lost the object
  /// The response in this frame is too weak to rely on its box (CoarseOptions::lost_below), whatever the
  /// frames before say. GatedTracker and KalmanTracker go by it. Empty: as `lost`.
  std::optional<bool> weak;
  /// The frame shows nothing of the scene (GatedTracker): the box is that of the frame before, moved into the
  /// image if that is smaller now. `lost` is set, too.
  bool interrupted = false;
  /// Covariance of the box's centre, x and y [px], and of the natural logarithm of its size, in this order;
  /// both sides are scaled alike. Positive semi-definite. Empty if the tracker has none.
  std::optional<Eigen::Matrix3d> covariance;
  /// Whether the placement of the parts is proven to have the least energy (certify), and is not just one of
  /// several minima. Empty unless the tracker's options ask for it.
  std::optional<bool> certified;
  /// Empty for trackers without parts.
  std::vector<PartState> parts;
  double update_threshold = 0;   ///< parts of less weight are not updated; 0 where no weight is compared
  std::vector<Link> links;       ///< the springs between parts, as indices into `parts`
  std::vector<StageTime> times;  ///< in the order of the stages

  /// The object's box as it is turned, and that of a part; see `turned`.
  std::array<cv::Point2d, 4> corners() const { return turned(box, angle); }
  std::array<cv::Point2d, 4> corners(const PartState& part) const {
    return turned(box_around(part.position, part.size), angle);
  }

  /// `weak`, or `lost` where that is empty.
  bool is_weak() const { return weak.value_or(lost); }

  /// The time of all stages together.
  double milliseconds() const {
    double sum = 0;
    for (const StageTime& t : times) sum += t.milliseconds;
    return sum;
  }
};

/// A single-object tracker.
///
/// - `init(image, box)`: start on an object; may be called again at any time with any frame size. `box` is in
///   pixels and covers x .. x + width - 1. Throws std::invalid_argument, and keeps the former state, for a
///   box that is not finite, smaller than 1 x 1, or does not overlap the image, and for an image that Frame
///   refuses. A GatedTracker, as all that make_tracker knows, also refuses a box that has one gray level or
///   color together with its surroundings (of twice its sides): a video that begins blank has to be started
///   later. Noise is not refused; shows_scene tells it from a scene.
/// - `update(image)`: the object's box in the next image. Throws std::logic_error before `init`, and
///   std::invalid_argument for an image that Frame refuses; the state is then as before the call.
template <class T>
concept Tracker = requires(T tracker, const cv::Mat& image, const cv::Rect2d& box) {
  tracker.init(image, box);
  { tracker.update(image) } -> std::same_as<TrackResult>;
};

/// A Tracker that also takes a Frame, so that trackers of several objects can share one (MultiTracker). The
/// results are the same, without the stage "frame".
template <class T>
concept FrameTracker = Tracker<T> && requires(T tracker, const Frame& frame, const cv::Rect2d& box) {
  tracker.init(frame, box);
  { tracker.update(frame) } -> std::same_as<TrackResult>;
};

namespace detail {

/// The part of a frame that a tracker gets: the frame or, if it is not a FrameTracker, its 8-bit pixels.
template <Tracker T>
decltype(auto) seen_by(const Frame& frame) {
  if constexpr (FrameTracker<T>)
    return (frame);
  else
    return (frame.bgr().empty() ? frame.gray() : frame.bgr());
}

}  // namespace detail

/// Any Tracker, chosen at run time. It is a FrameTracker itself; if the tracker in it is not, that gets the
/// frame's 8-bit pixels. A copy copies the tracker, and throws std::invalid_argument for one that is not
/// Stateful. After a move from it, it may only be assigned to or destroyed.
class AnyTracker {
 public:
  /// Holds any tracker except an AnyTracker.
  template <class T>
  requires(!std::same_as<T, AnyTracker> && Tracker<T>) AnyTracker(T tracker)
      : self_(std::make_unique<Model<T>>(std::move(tracker))) {}

  /// The copy is independent.
  AnyTracker(const AnyTracker& other) : self_(other.self_->clone()) {}
  AnyTracker(AnyTracker&&) noexcept = default;
  AnyTracker& operator=(const AnyTracker& other) {
    self_ = other.self_->clone();
    return *this;
  }
  AnyTracker& operator=(AnyTracker&&) noexcept = default;
  ~AnyTracker() = default;

  void init(const cv::Mat& image, const cv::Rect2d& box) { self_->init(image, box); }
  TrackResult update(const cv::Mat& image) { return self_->update(image); }
  void init(const Frame& frame, const cv::Rect2d& box) { self_->init(frame, box); }
  /// On the region's equal_area_box.
  void init(const cv::Mat& image, const Region& region) { init(image, region.equal_area_box()); }
  void init(const Frame& frame, const Region& region) { init(frame, region.equal_area_box()); }
  TrackResult update(const Frame& frame) { return self_->update(frame); }

  /// `save` returns the tracker's state between two frames as bytes (save_state). `restore` sets it in a
  /// tracker of the same options, which need not be initialised and then continues as the saved one would
  /// have, bit for bit (restore_state). They throw what these functions throw, and std::invalid_argument for
  /// a tracker that is not Stateful.
  std::vector<std::byte> save() const { return save_state(*this); }
  void restore(std::span<const std::byte> state) { restore_state(*this, state); }
  void visit_state(StateArchive& archive) { self_->visit_state(archive); }

  /// The tracker in it if that is a T, otherwise nullptr.
  template <class T>
  const T* target() const {
    const auto* const model = dynamic_cast<const Model<T>*>(self_.get());
    return model != nullptr ? &model->tracker : nullptr;
  }

 private:
  struct Concept {
    virtual ~Concept() = default;
    virtual std::unique_ptr<Concept> clone() const = 0;
    virtual void init(const cv::Mat&, const cv::Rect2d&) = 0;
    virtual TrackResult update(const cv::Mat&) = 0;
    virtual void init(const Frame&, const cv::Rect2d&) = 0;
    virtual TrackResult update(const Frame&) = 0;
    virtual void visit_state(StateArchive&) = 0;
  };
  template <class T>
  struct Model final : Concept {
    explicit Model(T t) : tracker(std::move(t)) {}
    std::unique_ptr<Concept> clone() const override {
      if constexpr (Stateful<T>)
        return std::make_unique<Model>(tracker);
      else
        throw_not_stateful("tracker");
    }
    void init(const cv::Mat& image, const cv::Rect2d& box) override { tracker.init(image, box); }
    TrackResult update(const cv::Mat& image) override { return tracker.update(image); }
    void init(const Frame& frame, const cv::Rect2d& box) override {
      tracker.init(detail::seen_by<T>(frame), box);
    }
    TrackResult update(const Frame& frame) override { return tracker.update(detail::seen_by<T>(frame)); }
    void visit_state(StateArchive& archive) override {
      if constexpr (Stateful<T>)
        tracker.visit_state(archive);
      else
        throw_not_stateful("tracker");
    }
    T tracker;
  };
  std::unique_ptr<Concept> self_;
};

/// The trackers that `make_tracker` knows by a name alone, that is, all except dpt_net:FOLDER.
ASTERISM_API std::vector<std::string> tracker_names();

/// A tracker from its description: a name, with default options; `dpt{"part": "mosse", "grid_rows": 3}`, a
/// name and a JSON object of options, which are the members of the class's options; `{"tracker": "dpt",
/// "part": "mosse"}`, the same as one object; or `dpt+MODEL`, DPT with another part model. Part models are
/// written as PartRegistry::read has them. The names:
///
/// - "dpt" (Dpt), and its variants by the names of the paper's Table 1 or in words: "dpt_loc" or "dpt_local",
///   "dpt_str" or "dpt_star", "dpt_3x3_ov" or "dpt_nine_overlapping", "dpt_3x3_nov" or "dpt_nine_parts",
///   "dpt_crs" or "coarse" (the coarse layer alone), "dpt_crs_nos" or "dpt_coarse_no_color" (its filter
///   alone);
/// - "kcf", that filter in the window of Henriques' KCF;
/// - "dpt_plus", DPT with a root that learns from its surroundings, and a scale filter (docs/tracker.md);
/// - "dpt_net:FOLDER", DPT with a network in its root: backbone.onnx and head.onnx of NanoTrack, which a user
///   has in this folder (docs/tracker.md);
/// - "lgt" (Lgt), after Cehovin, Kristan and Leonardis (docs/trackers.md);
/// - "kalman" (KalmanTracker of DPT, or of the tracker that its option "of" describes).
///
/// Throws std::invalid_argument: for an unknown name, with a list of the known ones; for an unknown option,
/// with the nearest known one; for a wrong value, with the reason; and, if the library was built without
/// PartRegistry, for a description that is more than a name.
ASTERISM_API AnyTracker make_tracker(std::string_view description);

/// All options of a tracker with their values, as one JSON object that `make_tracker` takes back:
/// `{"tracker": "dpt", "coarse": {..}, ..}`. description: as for `make_tracker`; of a name alone, these are
/// its defaults. A part model of a plugin is listed by its name alone. Throws as `make_tracker`, and
/// std::invalid_argument where the library was built without PartRegistry.
ASTERISM_API std::string tracker_options(std::string_view description);

}  // namespace ASTERISM_ABI
}  // namespace asterism
