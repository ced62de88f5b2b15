#pragma once

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/models/color.hpp>
#include <asterism/trackers/around/kalman.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/constellation/motion.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Lgt's part model: a histogram of 16 gray levels on 6 x 6 samples.
ASTERISM_API AnyPart histogram_part();

/// The ways in which Lgt makes a box from its parts.
enum class PartsBox {
  Bounds,  ///< the bounding box of all parts, as in LGT
  Spread   ///< the first box, each side scaled as the parts' weighted spread along it
};

/// Options of Lgt. Where LGT has a value, it is the default: that of the authors' later MATLAB code, which
/// they recommend. Lengths in it are in units: the object's first box has a mean side (arithmetic) of 60.
struct LgtOptions {
  /// The parts' model, not yet initialised.
  AnyPart part = histogram_part();
  /// Maximum number of parts, in [1, 100].
  int max_parts = 60;
  /// The color model of the global layer.
  ColorOptions color = {.foreground_prior = 0.1, .mrf = {.enabled = false}};
  /// The model of motion of the global layer.
  MotionOptions motion;
  /// Whether the global layer uses color. A cue that is not used finds all positions equally likely.
  bool use_color = true;
  bool use_motion = true;  ///< Whether it uses motion; without effect if MotionModel is not available.
  bool use_shape = true;   ///< Whether it uses the model of the object's shape.
  /// Initial standard deviation, in the cross-entropy method, of the object's translation from the one that
  /// the Kalman filter predicts [units], >= 0; 0: no search over it.
  double translation = 6.3;
  double rotation = 0.3;  ///< The same of the rotation [rad], >= 0.
  double scale = 0.01;    ///< The same of the logarithm of the scale, >= 0.
  /// The springs of the local layer. LGT instead penalises deviations from the affine motion of neighbours.
  ElasticOptions springs = {.deformation = 0.3, .reach = 0.1};
  /// A part of similarity s, 1 for a perfect match, has the likelihood exp(sharpness (s - 1)), > 0.
  double sharpness = 20;
  /// Rate at which a part's weight follows how well it matches, in (0, 1].
  double weight_rate = 0.5;
  /// A part is removed if its weight is below this, in [0, 1].
  double remove_below = 0.1;
  /// How the object's box follows from the parts.
  PartsBox box = PartsBox::Bounds;
  /// The object is lost if the parts' mean similarity is less than this, in [0, 1].
  double lost_below = 0.3;
};

/// Coupled layers, after LGT (Cehovin, Kristan and Leonardis, "Robust visual tracking using an adaptive
/// coupled-layer visual model", PAMI 2013). The local layer is a set of small histogram parts: where they all
/// are is found by the cross-entropy method, where each is by the MAP of springs on their Delaunay
/// triangulation. Parts that do badly leave. The global layer, color, motion and shape, says where new ones
/// join, and learns from those that do well.
class ASTERISM_API Lgt : public TrackerBase<Lgt> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Lgt(const LgtOptions& options = LgtOptions());

  const LgtOptions& options() const { return options_; }
  /// The result if the object and its parts stay where they are, for GatedTracker.
  TrackResult standing() const;

 private:
  friend TrackerBase<Lgt>;
  static constexpr std::string_view kName = "Lgt";
  static constexpr int kShapeCells = 50;  // of the shape model, on each axis
  static constexpr int kMostFrames = 1'000'000'000;

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  void visit_learned(StateArchive& archive);

  using Points = ElasticConstellation::Points;
  using Map = Eigen::Array<float, kShapeCells, kShapeCells>;  // of cells about the pose's centre, row, column
  struct Part {
    AnyPart model;
    double weight;
  };

  double unit() const;  // [px]
  Size2 part_size() const;
  Point2 cell(int row, int col) const;  // position of a map's cell in the image
  Eigen::VectorXd weights() const;
  // Weighted deviation of the parts from their mean, on each axis, and at least that of one part.
  Size2 spread() const;
  // Of the parts; its centre is in the image.
  cv::Rect2d box_of_parts(const Frame& frame) const;

  // Parts merge, leave and join. moving: the model of motion's posterior.
  void renew(const Frame& frame, const Segmentation& moving);

  // The local layer.
  PlaneTransform common_motion() const;
  Evidence evidence_near(const Part& part, const Point2& expected) const;
  void reweight(const Frame& frame);
  void merge(const Frame& frame, std::vector<Point2>& placement);
  void remove(std::vector<Point2>& placement);
  void add(const Frame& frame, std::vector<Point2>& placement, const Point2& position);

  // The global layer.
  void learn_shape(const std::vector<Point2>& placement);
  Map probability(const Frame& frame, const Segmentation& color, const Segmentation& moving) const;
  void add_likely(const Frame& frame, std::vector<Point2>& placement, Map probability);

  std::vector<Point2> placement() const;
  // The parts are here now, and linked again.
  void assign(const std::vector<Point2>& placement);

  LgtOptions options_;
  std::vector<Part> parts_;
  ElasticConstellation constellation_;
  double capacity_ = 0;  // running mean of the number of parts
  Size2 first_spread_ = Size2::Ones();
  ColorModel color_;
  MotionModel motion_;
  Map shape_ = Map::Zero();
  ConstantVelocityFilter filter_;  // of the centre [px]; the third coordinate is not used
  ObjectPose pose_;
  cv::Rect2d box_;  // of the last result
  int frames_ = 0;  // seeds the cross-entropy method, less than kMostFrames
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
