// Ipopt, an interior-point method, which without constraints is Newton's method with a filter line search.
#define HAVE_CSTDDEF  // which Ipopt's older headers ask for
#define HAVE_CSTDIO
#if __has_include(<coin-or/IpTNLP.hpp>)
#include <coin-or/IpIpoptApplication.hpp>
#include <coin-or/IpTNLP.hpp>
#else
#include <coin/IpIpoptApplication.hpp>
#include <coin/IpTNLP.hpp>
#endif

#include <algorithm>
#include <new>
#include <vector>

#include "objective.hpp"

namespace asterism::bench {
namespace {

using Ipopt::Index;
using Ipopt::Number;

/// The problem without constraints.
class Minimisation : public Ipopt::TNLP {
 public:
  Minimisation(Objective& objective, const Points& start) : objective_(objective), start_(start) {}

  bool get_nlp_info(Index& n, Index& constraints, Index& jacobian, Index& hessian,
                    IndexStyleEnum& style) override {
    n = objective_.size();
    constraints = jacobian = 0;
    hessian = n * (n + 1) / 2;
    style = C_STYLE;
    return true;
  }
  bool get_bounds_info(Index n, Number* lower, Number* upper, Index, Number*, Number*) override {
    constexpr double kNone = 1e20;  // Ipopt takes it for infinity
    std::fill_n(lower, n, -kNone);
    std::fill_n(upper, n, kNone);
    return true;
  }
  bool get_starting_point(Index, bool, Number* x, bool, Number*, Number*, Index, bool, Number*) override {
    objective_.write(start_, x);
    return true;
  }
  // Energy and gradient at a point are asked for one after the other.
  bool eval_f(Index n, const Number* x, bool is_new, Number& energy) override {
    if (is_new || gradient_.empty()) evaluate(n, x);
    energy = energy_;
    return true;
  }
  bool eval_grad_f(Index n, const Number* x, bool is_new, Number* gradient) override {
    if (is_new || gradient_.empty()) evaluate(n, x);
    std::copy(gradient_.begin(), gradient_.end(), gradient);
    return true;
  }
  bool eval_g(Index, const Number*, bool, Index, Number*) override { return true; }
  bool eval_jac_g(Index, const Number*, bool, Index, Index, Index*, Index*, Number*) override { return true; }
  bool eval_h(Index n, const Number* x, bool is_new, Number factor, Index, const Number*, bool, Index,
              Index* rows, Index* columns, Number* values) override {
    if (x != nullptr && is_new) evaluate(n, x);
    const auto size = static_cast<std::size_t>(n);
    if (values != nullptr) {
      matrix_.resize(size * size);
      objective_.hessian(x, matrix_.data());
    }
    std::size_t entry = 0;
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j <= i; ++j, ++entry) {
        if (values != nullptr) {
          values[entry] = factor * matrix_[static_cast<std::size_t>(i) * size + static_cast<std::size_t>(j)];
        } else {
          rows[entry] = i;
          columns[entry] = j;
        }
      }
    }
    return true;
  }
  bool intermediate_callback(Ipopt::AlgorithmMode, Index iteration, Number, Number, Number, Number, Number,
                             Number, Number, Number, Index, const Ipopt::IpoptData*,
                             Ipopt::IpoptCalculatedQuantities*) override {
    return !(iteration > 0 ? objective_.iterated() : objective_.done());
  }
  void finalize_solution(Ipopt::SolverReturn, Index, const Number*, const Number*, const Number*, Index,
                         const Number*, const Number*, Number, const Ipopt::IpoptData*,
                         Ipopt::IpoptCalculatedQuantities*) override {}

 private:
  void evaluate(Index n, const Number* x) {
    gradient_.resize(static_cast<std::size_t>(n));
    energy_ = objective_(x, gradient_.data());
  }

  Objective& objective_;
  const Points& start_;
  double energy_ = 0;
  std::vector<double> gradient_;
  std::vector<double> matrix_;
};

template <bool kExact>
struct Ipopter {
  static constexpr std::string_view name() {
    return kExact ? "Ipopt, exact Hessian" : "Ipopt, limited-memory Hessian";
  }

  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    using namespace Ipopt;
    const SmartPtr<IpoptApplication> application = new IpoptApplication(false);
    const auto options = application->Options();
    options->SetStringValue("sb", "yes");  // no banner
    options->SetIntegerValue("print_level", 0);
    options->SetStringValue("hessian_approximation", kExact ? "exact" : "limited-memory");
    options->SetIntegerValue("max_iter", max_iterations);
    options->SetNumericValue("tol", 1e-14);  // the laboratory's rule ends it
    options->SetNumericValue("acceptable_tol", 1e-14);
    if (application->Initialize("") != Solve_Succeeded) {
      summary.message.assign("Ipopt cannot be initialised");
      return Status::NumericalFailure;
    }
    const SmartPtr<TNLP> problem = new Minimisation(objective, start);
    const ApplicationReturnStatus status = application->OptimizeTNLP(problem);
    if (status == Insufficient_Memory) throw std::bad_alloc();
    summary.message.assign(status == Maximum_Iterations_Exceeded ? "maximum number of iterations"
                                                                 : "stopped short of the tolerance");
    return status == Maximum_Iterations_Exceeded ? Status::MaxIterations : Status::NoProgress;
  }
};

using Exact = PeerSolver<Ipopter<true>>;
using LimitedMemory = PeerSolver<Ipopter<false>>;
const Registration kExact({"ipopt", std::string(Exact::name()), "Ipopt " IPOPT_VERSION, 100, 0,
                           make_runner<Exact>});
const Registration kLimitedMemory({"ipopt-lbfgs", std::string(LimitedMemory::name()), "Ipopt " IPOPT_VERSION,
                                   100, 0, make_runner<LimitedMemory>});

}  // namespace
}  // namespace asterism::bench
