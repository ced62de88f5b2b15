#pragma once

#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/constellation/transform.hpp>
#include <asterism/trackers/dpt/coarse.hpp>
#include <functional>
#include <span>
#include <variant>

namespace asterism {
inline namespace ASTERISM_ABI {

/// Which parts are linked by springs (the paper's Table 1).
enum class Constellation { Full, Local, Star };

/// What holds a part at its visually best position.
enum class AnchorLaw {
  Variance,   ///< static_stiffness, the paper's
  Covariance  ///< static_information
};

/// What finds the placement of the parts.
enum class SpringSolver {
  Ida,    ///< the paper's
  Newton  ///< the same minimum in a fraction of the iterations
};

/// Options of Dpt; the paper's values (Sec. 3.1) are the defaults. What the paper leaves open is said so.
struct DptOptions {
  /// Parts at most, grid_rows x grid_cols.
  static constexpr int kMaxParts = 16;
  /// The type of its spring system.
  using Springs =
      SpringSystem<double, 2, Eigen::Dynamic, kMaxParts, Model<Hooke, Quadratic, AnchorShape::Anisotropic>>;

  /// The coarse layer: root and color.
  CoarseOptions coarse;
  /// The parts' model z^(i), not yet initialised: the paper's is a Kcf, with the root's parameters.
  AnyPart part = paper_filter();

  /// The object's box is split into grid_rows x grid_cols equal parts, N_p of them (2 x 2), at most
  /// kMaxParts.
  int grid_rows = 2, grid_cols = 2;
  /// The fraction of its side that a part shares with each neighbour, in [0, 0.99]: parts grow so that they
  /// still cover the box. 3 x 3 parts with one half have the size of 2 x 2 (DPT_3x3_ov of Table 1).
  double overlap = 0;
  /// Which parts are linked.
  Constellation constellation = Constellation::Full;

  /// Rate of the nominal spring lengths' update, alpha_spr (Sec. 2.5.2), in [0, 1].
  double spring_rate = 0.95;
  /// A part is updated if its response at the MAP position is at least this fraction of the strongest part's
  /// ...
  double response_gate = 0.5;
  /// ... and at least this fraction of its pixels are on the object according to the segmentation
  /// (Sec. 2.5.2).
  double mask_gate = 0.2;
  /// Smoothness of the parts' motion: each has a Gaussian prior about where its velocity of the last frame
  /// takes it, of this information in units of 1 / area of a part, >= 0. 0, the paper's, is none; 1 is a
  /// deviation of a part's mean side.
  double smoothness = 0;
  /// How the object's box follows the constellation. Open in the paper: Algorithm 2 updates "position and
  /// size", Sec. 2.5.2 fits a "Euclidean transform".
  TransformModel transform = TransformModel::Similarity;

  /// The object's size follows the constellation and, with this weight of the logarithms in [0, 1], a scale
  /// filter on the object. 0, the paper's: the constellation alone.
  double scale_share = 0;
  ScaleFilterOptions scale;
  /// Parts that can grow and shrink with the object; the paper's keep their size.
  bool resize_parts = false;

  /// What an anchor's stiffness is made of.
  AnchorLaw anchor_law = AnchorLaw::Variance;
  /// What finds the placement of the parts.
  SpringSolver spring_solver = SpringSolver::Ida;
  /// The solver's stopping rule. Open in the paper; see docs/tracker.md.
  SolverOptions solver;

  /// Threads that the parts are searched and trained on, the calling one among them; 0: as many as the
  /// machine runs at once, at most 256. Results are the same, bit for bit, for any number.
  int threads = 1;

  /// Called in `update` after each solve with the system, the placement that it was started from (2 x N_p)
  /// and its summary, to look at or to record them; none if empty. What it throws leaves `update`, and the
  /// next one goes on from the frame before.
  std::function<void(const Springs& system, const Springs::Points& start, const Summary& summary)> on_solve;
};

/// Deformable Parts Tracker (Lukezic, Cehovin, Kristan): a coarse layer of a root filter and a color model,
/// and a mid level of parts whose MAP constellation is the equilibrium of a spring system. `update` is the
/// paper's Algorithm 2.
class ASTERISM_API Dpt {
 public:
  /// Parts at most.
  static constexpr int kMaxParts = DptOptions::kMaxParts;
  /// The box keeps to this range of its first size, whatever a collapsed or burst constellation says.
  static constexpr double kMinScale = 0.1, kMaxScale = 10;
  /// The type of its spring system.
  using Springs = DptOptions::Springs;
  using Placement = Springs::Points;  ///< 2 x N_p, a part is a column

  /// Throws std::invalid_argument for options out of range.
  explicit Dpt(const DptOptions& options = DptOptions());

  void init(const cv::Mat& image, const cv::Rect2d& box);
  TrackResult update(const cv::Mat& image);
  void init(const Frame& frame, const cv::Rect2d& box);
  TrackResult update(const Frame& frame);

  /// For save_state; of the options `threads` may differ.
  void visit_state(StateArchive& archive);

  /// The spring system of the last frame and how its solver stopped.
  const Springs& springs() const { return springs_; }
  const Summary& summary() const { return summary_; }
  /// The coarse layer after the last frame.
  const CoarseLayer& coarse() const { return coarse_; }
  const DptOptions& options() const { return options_; }

 private:
  /// Algorithm 2.
  TrackResult follow(const Frame& frame);
  TrackResult standing() const;
  /// f(i) for every part i, on `threads` threads; throws what the first part threw that did.
  template <typename F>
  void for_each_part(F&& f);
  int part_count() const { return options_.grid_rows * options_.grid_cols; }
  /// Line 4 of Algorithm 2: root position and size by the transform from the last constellation to
  /// `placement`, which is scaled to the size that the scale filter has a say in, if there is one.
  void move(const Frame& frame, Placement& placement);
  /// Sec. 2.3.3: anchors, static and dynamic stiffness from the parts' evidence; nominal lengths are kept.
  void set_springs(std::span<const Evidence> evidence);
  /// The smoothness prior: the anchors become the products of evidence and prediction.
  void smooth_motion();
  /// Laplace's covariance of the placement, taken to the box (TrackResult::covariance); none where the
  /// placement is no strict minimum.
  std::optional<Eigen::Matrix3d> box_covariance(const Placement& placement) const;
  /// Sec. 2.5.2: which parts may learn from this frame; returns the least response that may.
  double gate_updates(const Segmentation& segmentation, std::vector<PartState>& states) const;

  DptOptions options_;
  CoarseLayer coarse_;
  ScaleFilter scale_;
  std::vector<AnyPart> parts_;
  Size2 part_size_ = Size2::Zero();  // in the image [px]
  Springs springs_;
  std::variant<Ida<Springs>, Newton<Springs>> solver_;
  Summary summary_;
  Placement placement_;  // X_{t-1}
  Placement velocity_;   // X_{t-1} - X_{t-2}
  Size2 initial_size_ = Size2::Zero();
  double angle_ = 0;  // since init [rad]
  InterruptionGate gate_;
  bool initialized_ = false;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
