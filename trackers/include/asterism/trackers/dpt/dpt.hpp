#pragma once

#include <array>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/constellation/spring_constellation.hpp>
#include <asterism/trackers/constellation/stiffness.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <asterism/trackers/dpt/box_judge.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <asterism/trackers/dpt/scale_share.hpp>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Which parts are linked by springs (the paper's Table 1).
enum class Constellation { Full, Local, Star };

/// The solve of Dpt in a frame. It refers to the tracker's own data, which is valid during the call of
/// DptOptions::on_solve.
struct DptSolve {
  const SpringConstellation& springs;        ///< the springs of the frame
  const SpringConstellation::Points& start;  ///< the placement that the solve was started from, 2 x N_p
  std::span<const Evidence> evidence;        ///< of each part, from which the springs' stiffness follows
  /// The object's box that goes with `start`: that of the frame before, moved to the root's position. The
  /// box of the frame follows from it by the transform from `start` to the solution.
  cv::Rect2d start_box;
  const Summary& summary;  ///< how the solver stopped
};

/// Options of Dpt; the paper's values (Sec. 3.1) are the defaults. Comments say what the paper leaves open.
struct DptOptions {
  /// Maximum number of parts, grid_rows x grid_cols.
  static constexpr int kMaxParts = 16;

  /// The coarse layer: root and color.
  CoarseOptions coarse;
  /// The parts' model z^(i), not yet initialised; in the paper a Kcf with the root's parameters.
  AnyPart part = paper_filter();

  /// The object's box is divided into grid_rows x grid_cols equal parts, N_p in number (2 x 2), at most
  /// kMaxParts.
  int grid_rows = 2, grid_cols = 2;
  /// The fraction of its side that a part shares with each neighbour, in [0, 0.99]: parts grow so that they
  /// still cover the box. 3 x 3 parts with one half have the size of 2 x 2 (DPT_3x3_ov of Table 1).
  double overlap = 0;
  /// Which parts are linked.
  Constellation constellation = Constellation::Full;

  /// Rate of the nominal spring lengths' update, alpha_spr (Sec. 2.5.2), in [0, 1].
  double spring_rate = 0.95;
  /// A part is only updated if its response at the MAP position is at least this fraction of the strongest
  /// part's (Sec. 2.5.2).
  double response_gate = 0.5;
  /// A part is only updated if the segmentation finds at least this fraction of its pixels on the object
  /// (Sec. 2.5.2).
  double mask_gate = 0.2;
  /// How the object's box follows the constellation. Open in the paper: Algorithm 2 updates "position and
  /// size", Sec. 2.5.2 fits a "Euclidean transform".
  TransformModel transform = TransformModel::Similarity;

  /// The root's evidence as a measurement of the object's centre beside that of the constellation: this
  /// factor, >= 0, times the stiffness that Eq. 11 gives it, against the constellation's covariance. 0, as in
  /// the paper: the constellation alone. 1: as if the root were a part. 1e9: the root alone; the parts
  /// follow.
  double root_weight = 0;
  /// Weight, in [0, 1], of a scale filter in the logarithm of the object's size; the rest is that of the
  /// constellation. 0, as in the paper: the constellation alone. Without effect if the root measures the size
  /// (SizingModel): then that is the object's, and the parts move apart or together with it.
  double scale_filter_share = 0;
  /// The scale filter.
  ScaleFilterOptions scale;

  /// The parameters of the laws of all springs' stiffness.
  StiffnessLaw stiffness;
  /// The solver that finds the placement of the parts, one of system_methods(), with its options: "ida" is
  /// the paper's; "newton" finds the same minimum in a fraction of the iterations. The paper leaves the
  /// stopping rule open; see docs/tracker.md.
  SolverDescription solver = {"ida", {}};
  /// Test whether the placement is proven to be the MAP: TrackResult::certified. Changes nothing else.
  bool certify = false;

  /// Compare each box with the first frame: TrackResult::probability, and `lost` where it is below one half
  /// (BoxJudge, whose weights were fitted to the boxes of dpt_plus). If false, a weak response is a loss.
  bool judge = false;

  /// Number of threads that search and train the parts, including the calling one; 0: as many as the machine
  /// runs at once, at most 256. Results are the same, bit for bit, for any number.
  int threads = 1;

  /// Called in `update` after each solve, to look at it or to record it; none if empty. What it throws leaves
  /// `update`, and the next one goes on from the frame before.
  std::function<void(const DptSolve& solve)> on_solve;
};

/// Deformable Parts Tracker (Lukezic, Cehovin, Kristan): a coarse layer of a root filter and a color model,
/// and a mid level of parts whose MAP constellation is the equilibrium of a spring system. `update` is the
/// paper's Algorithm 2. Of the options `threads` may differ between a saved tracker and the one that it is
/// restored to.
class ASTERISM_API Dpt : public TrackerBase<Dpt> {
 public:
  /// Parts at most.
  static constexpr int kMaxParts = DptOptions::kMaxParts;
  using Placement = SpringConstellation::Points;  ///< 2 x N_p, a part is a column

  /// Throws std::invalid_argument for options out of range, and for an unknown solver.
  explicit Dpt(const DptOptions& options = DptOptions());

  /// The spring system of the last frame and how its solver stopped.
  const SpringConstellation& springs() const { return constellation_; }
  const Summary& summary() const { return summary_; }
  /// The coarse layer after the last frame.
  const CoarseLayer& coarse() const { return coarse_; }
  const DptOptions& options() const { return options_; }
  /// The result if the object and its parts stay where they are, for GatedTracker.
  TrackResult standing() const;

 private:
  friend TrackerBase<Dpt>;
  static constexpr std::string_view kName = "Dpt";
  using Evidences = std::array<Evidence, kMaxParts>;

  void start(const Frame& frame, const cv::Rect2d& box);
  /// Algorithm 2.
  TrackResult follow(const Frame& frame);
  void visit_learned(StateArchive& archive);

  /// Line 1: the parts go along with the root, whose centre is at `position` now.
  Placement displaced_parts(const Point2& position) const;
  /// Line 2 (Sec. 2.3.3): anchors, static and dynamic stiffness from the responses of the parts near x;
  /// nominal lengths are kept.
  Evidences form_spring_system(const Frame& frame, const Placement& x);
  /// Line 3: moves x, the start, to the MAP constellation. Returns the box's covariance
  /// (TrackResult::covariance).
  std::optional<Eigen::Matrix3d> estimate_map_constellation(Placement& x);
  /// Line 4: root position and size, by the transform from the last constellation to x, and by the root's own
  /// evidence where it has a weight. x becomes the last constellation. If a scale filter or the root
  /// contributes to the size, x and the box's covariance are scaled to that size.
  void update_root(const Frame& frame, const Evidence& root, Placement& x,
                   std::optional<Eigen::Matrix3d>& covariance);
  /// The shift of the centre by the root's evidence [px]; also changes the box's covariance.
  Point2 weigh_root(const Evidence& root, const Point2& centre,
                    std::optional<Eigen::Matrix3d>& covariance) const;
  /// Line 5 (Sec. 2.5.2): nominal lengths, and the models of those parts that may learn, which it marks.
  void update_constellation(const Frame& frame, const Segmentation& segmentation, TrackResult& result);
  /// Line 6: color model and root filter.
  void update_coarse_models(const Frame& frame, const Segmentation& segmentation);

  int part_count() const { return constellation_.size(); }
  /// f(i) for every part i, on `threads` threads; rethrows the first exception.
  template <typename F>
  void for_each_part(F&& f);
  /// Each part at its place in the constellation, with its response there.
  void report_parts(const Evidences& evidence, TrackResult& result) const;
  /// Laplace's covariance of the placement x, taken to the box; none where x is no strict minimum.
  std::optional<Eigen::Matrix3d> box_covariance(const Placement& x) const;

  DptOptions options_;
  CoarseLayer coarse_;
  ScaleShare scale_;
  BoxJudge judge_;
  std::vector<AnyPart> parts_;
  Size2 part_size_ = Size2::Zero();  // in the image [px]
  SpringConstellation constellation_;
  Summary summary_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
