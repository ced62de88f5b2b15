#pragma once

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/models/color.hpp>
#include <asterism/trackers/constellation/elastic.hpp>
#include <asterism/trackers/tracker/tracker_base.hpp>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Lgt's part model, a ColorHistogram that searches twice its size to each side.
ASTERISM_API AnyPart histogram_part();

/// Options of Lgt.
struct LgtOptions {
  /// The parts' model, not yet initialised.
  AnyPart part = histogram_part();
  ColorOptions color;
  /// Parts at most, in [1, 100], and their side [object's mean side, in [0.01, 10]].
  int max_parts = 20;
  double part_side = 0.25;
  ElasticOptions springs = {.deformation = 0.1, .reach = 0.1};
  /// A part's similarity s, 1 for a perfect match, is the likelihood exp(sharpness (s - 1)), > 0.
  double sharpness = 10;
  /// Rate at which a part's weight follows how well it does, in (0, 1]; below `remove_below`, in [0, 1], it
  /// is removed.
  double weight_rate = 0.1;
  double remove_below = 0.1;
  /// Rate at which the layout follows the placement, in [0, 1].
  double layout_rate = 0.1;
  /// The object is lost where the parts' similarity is less than this on average, in [0, 1].
  double lost_below = 0.3;
};

/// Coupled layers, after LGT (Cehovin, Kristan and Leonardis, "Robust visual tracking using an adaptive
/// coupled-layer visual model", PAMI 2013). The local layer is a constellation of small histogram parts on a
/// Delaunay triangulation of springs; parts that do badly fade and leave. The global layer, the color model,
/// says where on the object new ones are needed, and weighs what the parts see.
class ASTERISM_API Lgt : public TrackerBase<Lgt> {
 public:
  /// Throws std::invalid_argument for options out of range.
  explicit Lgt(const LgtOptions& options = LgtOptions());

  const LgtOptions& options() const { return options_; }

 private:
  friend TrackerBase<Lgt>;
  static constexpr std::string_view kName = "Lgt";

  void start(const Frame& frame, const cv::Rect2d& box);
  TrackResult follow(const Frame& frame);
  TrackResult standing() const;
  void visit_learned(StateArchive& archive);

  using Points = ElasticConstellation::Points;

  // What the part model says of a position, times the global layer's probability.
  double likelihood(std::size_t part, const Segmentation& segmentation, const Point2& position) const;
  // The displacement that is best for all parts together.
  Point2 common_displacement(const Segmentation& segmentation) const;
  // The likelihood's moments near where a part is expected.
  Evidence evidence_near(std::size_t part, const Segmentation& segmentation, const Point2& expected) const;
  // Parts that do badly leave, new ones join.
  void renew(const Frame& frame, const Segmentation& segmentation, int new_parts);

  LgtOptions options_;
  std::vector<AnyPart> models_;
  std::vector<double> weights_;
  ElasticConstellation parts_;
  ColorModel color_;
  ObjectPose pose_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
