#pragma once

#include <asterism/solver/run/iteration.hpp>
#include <asterism/solver/run/options.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/solver/terms/system.hpp>
#include <functional>
#include <optional>
#include <string_view>

#include "stopping_rule.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Whether x is one of the system's arrays, which a solve would change.
bool shares_memory(const System& system, const Eigen::MatrixXd& x);

/// The frame around the iterations of every method: it validates the input before them, and judges the result
/// after them, so that all follow the same rule and bad input leaves x unchanged.
class SystemRun {
 public:
  using Points = Eigen::MatrixXd;
  /// Improves run.x() and says why it stopped.
  using Iterate = std::function<Status(SystemRun&)>;

  /// Validates, aligns x if the options ask for it, iterates and judges.
  static Summary solve(std::string_view name, const AlignedOptions& options, const System& system, Points& x,
                       const Iterate& iterate);

  const System& system() const { return *system_; }
  const SystemRule& rule() const { return rule_; }
  Summary& summary() { return summary_; }
  const Points& x() const { return *x_; }
  double energy() const { return energy_; }
  const Points& gradient() const { return gradient_; }

  /// To be called once at every iterate. Whether the method has to end there; it then returns end().
  bool is_over();
  Status end() const { return end_; }

  /// Moves x along a direction of descent to the first of ever shorter steps with a sufficient decrease
  /// (Armijo, c1 = 1e-4; Nocedal & Wright, section 3.1), where the rounding of the energy hides it, with a
  /// flatter slope (Hager & Zhang 2005). `step` is the first one tried and becomes the one taken. False, with
  /// x as it was, where rounding leaves none.
  bool search(const Points& direction, double& step);
  /// The gradient before the last search that found a step.
  const Points& previous_gradient() const { return other_gradient_; }
  /// Moves x as one rigid body to where the anchors' springs are least, if that lowers the energy.
  void align(bool allow_reflection);
  /// Reports an iterate of another method that this one calls; false where the caller asks to stop.
  bool pass_on(const Iteration& at);
  /// Moves x to where the energy is known to be lower: to another point, or by a multiple of a step.
  void move_to(const Points& x);
  void move_by(double factor, const Points& step);
  /// The step along a direction up to which a quadratic model is trusted, 1 at most: as far as the nodes are
  /// from where their springs pull them, or the characteristic length. A robust loss may have little
  /// curvature, and beyond it none and no force.
  double trusted_step(const Points& direction) const;
  /// Whether the caller asks to stop; the next iterate is then the last.
  bool is_asked_to_stop();
  /// Whether a term has no second derivatives; the summary then says which.
  bool lacks_hessian();

 private:
  SystemRun(const AlignedOptions& options, Points& x) : options_(options), x_(&x) {}
  bool start(const System& given);
  bool is_stationary();
  bool report();
  void judge(Status reason);
  double rounding(double energy) const;
  void evaluate_after_move();

  AlignedOptions options_;
  const System* system_ = nullptr;
  std::optional<System> grounded_;
  SystemRule rule_;
  Summary summary_;
  Points* x_;
  Points start_, gradient_, other_x_, other_gradient_;
  double start_energy_ = 0, energy_ = 0, lowest_ = 0, lower_bound_ = -1;
  double last_tested_ = 0;  // the squared gradient of the last test of rounding
  bool is_within_gap_ = false, is_stopped_ = false;
  Status end_ = Status::NotRun;
};

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
