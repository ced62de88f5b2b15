#pragma once

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/models/color.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/trackers/constellation/pose.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <optional>

namespace asterism {
inline namespace ASTERISM_ABI {

/// The paper's part model, Kcf with default options. Not inline, so that not every program with options has
/// to compile it.
ASTERISM_API AnyPart paper_filter();

/// Options of the coarse layer (Sec. 2.2).
struct CoarseOptions {
  /// The root's model z^(0), not yet initialised: the paper's is a Kcf.
  AnyPart root = paper_filter();
  /// The color model of object and surroundings. The paper leaves two of its options open. The foreground's
  /// prior is the box's share of the region that the histograms are taken from, 1 / 1.6^2, about 3/8. The
  /// random field stops after three iterations, so that the posterior is smooth but not yet 0 or 1 almost
  /// everywhere, as it is at convergence; a product with the response would take that as certain.
  ColorOptions color = {.foreground_prior = 0.375, .mrf = {.max_iterations = 3}};
  /// Multiply the root's response by the color probability. If false, or if the root has no response map, the
  /// root alone gives the position.
  bool use_color = true;
  /// Weight, in [0, 1], of the mean color posterior in the object's box around each position, in a sum with
  /// the response that replaces the product (Bertinetto et al., *Staple*, CVPR 2016, with 0.3). 0: the
  /// paper's product.
  double color_share = 0;
  /// Refine the maximum below the spacing of the root's grid. The paper leaves this open.
  bool sub_pixel = true;
  /// The root's response is weak (TrackResult::weak) if its peak is below this. Then the target is lost,
  /// unless the tracker has a probability (BoxJudge) that says it better.
  double lost_below = 0.2;
};

/// The paper's coarse representation: the root correlation filter z^(0) and the global color model C_t,
/// which together place the object's centre within the search region of the root.
class ASTERISM_API CoarseLayer {
 public:
  /// Throws std::invalid_argument for options out of range, or which need what the library was built without.
  explicit CoarseLayer(const CoarseOptions& options = CoarseOptions());

  /// Learn both models from the object's box.
  void init(const Frame& frame, const cv::Rect2d& box);

  /// The layer's answer for a frame.
  struct Estimate {
    Evidence evidence;              ///< of the density of Eq. 4
    double similarity = 0;          ///< the root filter's own response at the position
    Segmentation segmentation;      ///< of the search window, empty where the color model is off
    bool weak = false;              ///< `similarity` is below CoarseOptions::lost_below
    double root_milliseconds = 0;   ///< wall-clock time of the root filter
    double color_milliseconds = 0;  ///< of the color model
  };
  /// The object's position near its last one: the maximum of Eq. 4.
  Estimate localize(const Frame& frame);
  /// Confidence, lost flag and stages of a tracker's result, as the estimate has them.
  void report(const Estimate& estimate, TrackResult& result) const;

  /// Move the object to a pose without learning; a root that can follows its size.
  void move(const ObjectPose& pose);
  /// Update the root filter and, where the segmentation was informative, the histograms
  /// at the object's box: line 6 of Algorithm 2.
  void adapt(const Frame& frame, bool informative);

  void visit_state(StateArchive& archive);

  /// The object's pose after the last frame, x^(0).
  const ObjectPose& pose() const { return pose_; }
  const CoarseOptions& options() const { return options_; }
  /// The evidence of the last `localize`.
  const Evidence& evidence() const { return evidence_; }
  /// The object's size [px] by the last `localize`; none unless the root measures it (SizingModel).
  std::optional<Size2> found_size() const { return root_.found_size(); }

 private:
  // `density_` times the color probability, ...
  void multiply_color(const Segmentation& segmentation);
  // ... or its weighted sum with the mean posterior of the box.
  void add_posterior(const Segmentation& segmentation);
  // What the root searches, and the color model with it.
  cv::Rect2d search_window() const;

  CoarseOptions options_;
  AnyPart root_;
  ColorModel color_;
  ObjectPose pose_;
  Evidence evidence_;
  ResponseMap density_;  // Eq. 4 on the root's response grid
};

/// The coarse layer alone as a tracker: DPT_crs of the paper's Table 1, or its KCF baseline DPT_crs_nos
/// without color. The box keeps its size, unless the root measures it (SizingModel).
class ASTERISM_API CoarseTracker : public TrackerBase<CoarseTracker> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit CoarseTracker(const CoarseOptions& options = CoarseOptions());

  const CoarseOptions& options() const { return layer_.options(); }
  /// The result if the object stays where it is, for GatedTracker.
  TrackResult standing() const;

 private:
  friend TrackerBase<CoarseTracker>;
  static constexpr std::string_view kName = "CoarseTracker";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  void visit_learned(StateArchive& archive);

  CoarseLayer layer_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
