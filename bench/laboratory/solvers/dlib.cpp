// dlib's optimisers without constraints: three that use gradients, and its trust region on the Hessian.
#include <dlib/optimization.h>
#include <dlib/revision.h>

#include <utility>

#include "objective.hpp"

namespace asterism::bench {
namespace {

using Column = dlib::matrix<double, 0, 1>;
using Matrix = dlib::matrix<double>;

/// The objective as dlib asks for it: the gradient by a function of its own, at the last point of the energy
/// nearly always.
class Evaluations {
 public:
  explicit Evaluations(Objective& objective) : objective_(objective) { gradient_.set_size(objective.size()); }

  double energy(const Column& x) {
    if (x_.size() == 0 || x != x_) {
      energy_ = objective_(x.begin(), gradient_.begin());
      x_ = x;
    }
    return energy_;
  }
  const Column& gradient(const Column& x) {
    energy(x);
    return gradient_;
  }
  void hessian(const Column& x, Matrix& result) {
    result.set_size(x.size(), x.size());
    objective_.hessian(x.begin(), result.begin());
  }

 private:
  Objective& objective_;
  Column x_, gradient_;
  double energy_ = 0;
};

/// dlib's stopping strategy: the laboratory's rule.
class StopWhenDone {
 public:
  StopWhenDone(Objective& objective, const Summary& summary, int max_iterations)
      : objective_(objective), summary_(summary), max_iterations_(max_iterations) {}

  // Called at the start too. An iteration that does not move is one more try along the gradient for dlib;
  // two in a row are the end.
  bool should_continue_search(const Column& x, double, const Column&) {
    if (x_.size() == 0) {
      x_ = x;
      return !objective_.done();
    }
    idle_ = x == x_ ? idle_ + 1 : 0;
    x_ = x;
    return !objective_.iterated() && idle_ < 2 && summary_.iterations < max_iterations_;
  }

 private:
  Objective& objective_;
  const Summary& summary_;
  int max_iterations_;
  Column x_;
  int idle_ = 0;
};

// With search strategies made in place, as to copy dlib's L-BFGS reads numbers that are not there yet.
template <typename MakeSearch>
void line_search(Evaluations& at, const MakeSearch& search, StopWhenDone stop, Column& x) {
  constexpr double kLeastEnergy = 0;
  dlib::find_min(
      search(), std::move(stop), [&](const Column& here) { return at.energy(here); },
      [&](const Column& here) -> const Column& { return at.gradient(here); }, x, kLeastEnergy);
}

// A method is its name, and dlib's call.
struct Lbfgs {
  static constexpr std::string_view kName = "dlib, L-BFGS (10 pairs)";  // as in dlib's examples
  static void run(Evaluations& at, StopWhenDone stop, Column& x) {
    line_search(
        at, [] { return dlib::lbfgs_search_strategy(10); }, std::move(stop), x);
  }
};
struct Bfgs {
  static constexpr std::string_view kName = "dlib, BFGS";
  static void run(Evaluations& at, StopWhenDone stop, Column& x) {
    line_search(
        at, [] { return dlib::bfgs_search_strategy(); }, std::move(stop), x);
  }
};
struct Cg {
  static constexpr std::string_view kName = "dlib, nonlinear CG";
  static void run(Evaluations& at, StopWhenDone stop, Column& x) {
    line_search(
        at, [] { return dlib::cg_search_strategy(); }, std::move(stop), x);
  }
};
struct TrustRegion {
  static constexpr std::string_view kName = "dlib, trust region (its iterations are accepted steps)";

  struct Model {
    using column_vector = Column;
    using general_matrix = Matrix;

    Evaluations& at;

    double operator()(const Column& x) const { return at.energy(x); }
    void get_derivative_and_hessian(const Column& x, Column& gradient, Matrix& hessian) const {
      gradient = at.gradient(x);
      at.hessian(x, hessian);
    }
  };
  static void run(Evaluations& at, StopWhenDone stop, Column& x) {
    dlib::find_min_trust_region(std::move(stop), Model{at}, x);
  }
};

template <typename Method>
struct Dlib {
  static constexpr std::string_view name() { return Method::kName; }

  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    Evaluations at(objective);
    Column x(objective.size());
    objective.write(start, x.begin());
    try {
      Method::run(at, StopWhenDone(objective, summary, max_iterations), x);
    } catch (const dlib::error& error) {  // of numbers that are not finite
      summary.message.assign(error.what());
      return Status::NoProgress;
    }
    return summary.iterations < max_iterations ? Status::NoProgress : Status::MaxIterations;
  }
};

template <typename Method>
SolverEntry entry(const std::string& name, int nodes) {
  using Solver = PeerSolver<Dlib<Method>>;
  return {
      name, std::string(Solver::name()), format("dlib %d.%d", DLIB_MAJOR_VERSION, DLIB_MINOR_VERSION), nodes,
      0,    make_runner<Solver>};
}

const Registration kLbfgs(entry<Lbfgs>("dlib-lbfgs", 1000));
const Registration kBfgs(entry<Bfgs>("dlib-bfgs", 100));
const Registration kCg(entry<Cg>("dlib-cg", 100));
const Registration kTrustRegion(entry<TrustRegion>("dlib-trust", 64));

}  // namespace
}  // namespace asterism::bench
