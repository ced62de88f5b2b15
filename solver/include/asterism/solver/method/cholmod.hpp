#pragma once

#include <Eigen/CholmodSupport>
#include <algorithm>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/base/memory.hpp>
#include <asterism/solver/linear/sparse_cholesky.hpp>
#include <asterism/solver/method/ida.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/solver/terms/system.hpp>
#ifdef ASTERISM_SOLVER_COMPILED
#include <asterism/solver/terms/from_springs.hpp>
#endif
#include <memory>
#include <new>
#include <string_view>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {

/// Eigen's CHOLMOD, silent, which throws std::bad_alloc where memory runs out, at the call in which it does:
/// the next one would forget it, and go on with what is not a factor.
class Cholmod {
 public:
  using Matrix = Eigen::SparseMatrix<double>;

  /// `llt` for L L^T, which notices negative pivots, instead of L D L^T where that is quicker.
  explicit Cholmod(bool llt = false) : llt_(llt) {}

  void analyzePattern(const Matrix& lower) {
    cholesky_ = std::make_unique<Cholesky>();
    cholesky_->cholmod().print = 0;
    if (llt_) cholesky_->cholmod().final_ll = 1;
    cholesky_->analyzePattern(lower);
    check_memory();
    require_entries(cholesky_->cholmod().lnz, sizeof(double));
  }
  void factorize(const Matrix& lower) {
    cholesky_->factorize(lower);
    check_memory();
  }
  Eigen::ComputationInfo info() const { return cholesky_->info(); }
  /// Entries in the longest column of the factor, after analyzePattern.
  double longest_column() const { return cholesky_->longest_column(); }

  template <typename RightHandSide>
  RightHandSide solve(const RightHandSide& b) const {
    RightHandSide x = cholesky_->solve(b);
    check_memory();
    return x;
  }

 private:
  class Cholesky : public Eigen::CholmodDecomposition<Matrix> {
   public:
    double longest_column() const {
      const int* counts = static_cast<const int*>(this->m_cholmodFactor->ColCount);
      return *std::max_element(counts, counts + this->m_cholmodFactor->n);
    }
  };

  void check_memory() const {
    if (cholesky_->cholmod().status == CHOLMOD_OUT_OF_MEMORY) raise(std::bad_alloc());
  }

  bool llt_;
  std::unique_ptr<Cholesky> cholesky_;  // Eigen's cannot be moved
};

}  // namespace detail

/// Factorisation policy of Ida: CHOLMOD (SuiteSparse) with its own choice of ordering, simplicial or
/// supernodal; for very large sparse systems. Works in double whatever the system's scalar. The ordering is
/// computed once per topology. Silent. Uses the heap. Needs target asterism::cholmod.
template <typename System>
class CholmodCholesky {
 public:
  using Points = typename System::Points;

  static constexpr std::string_view kIdaName = "IDA, CHOLMOD";

  /// Assembles and factors K_dyn; false where it is not positive definite in double.
  bool factorize(const System& system) {
    stiffness_.assemble(system, [this](const auto& pattern) { cholesky_.analyzePattern(pattern); });
    return stiffness_.factorize(cholesky_);
  }

  /// x <- x - K_dyn^-1 g, all dimensions at once.
  void descend(const Points& gradient, Points& x) {
    right_hand_side_ = gradient.transpose().template cast<double>();
    step_ = cholesky_.solve(right_hand_side_);
    x -= step_.transpose().template cast<typename System::Scalar>();
  }

 private:
  using RightHandSide = Eigen::Matrix<double, Eigen::Dynamic, System::kDim, Eigen::ColMajor>;

  detail::SparseStiffness<double> stiffness_;
  detail::Cholmod cholesky_;
  RightHandSide right_hand_side_;
  RightHandSide step_;
};

/// Factorisation policy of Certifier: CHOLMOD with its own choice of ordering, for very large systems. A W
/// that is not positive definite then has no bound of its least eigenvalue. Needs target asterism::cholmod.
class CholmodProof {
 public:
  using Matrix = detail::Cholmod::Matrix;

  /// Orders the pattern of a lower triangle.
  void analyze(const Matrix& lower) { cholesky_.analyzePattern(lower); }
  /// Entries in the longest column of the factor, after analyze.
  double longest_column() const { return cholesky_.longest_column(); }
  /// False where the matrix is not positive definite.
  bool factorize_definite(const Matrix& lower) {
    cholesky_.factorize(lower);
    return cholesky_.info() == Eigen::Success;
  }
  /// 0: CHOLMOD gives no direction of negative curvature.
  double negative_curvature(Eigen::VectorXd&) const { return 0; }
  /// matrix^-1 b.
  template <typename RightHandSide>
  RightHandSide solve(const RightHandSide& b) {
    return cholesky_.solve(b);
  }

 private:
  detail::Cholmod cholesky_{true};
};

/// CHOLMOD for newton_by: with its own choice of ordering, for very large systems. Needs target
/// asterism::cholmod.
class CholmodFactorization final : public SparseFactorization {
 public:
  void analyze(const Matrix& lower) override { cholesky_.analyzePattern(lower); }
  bool factorize(const Matrix& lower) override {
    cholesky_.factorize(lower);
    return cholesky_.info() == Eigen::Success;
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const override { return cholesky_.solve(b); }

 private:
  detail::Cholmod cholesky_{true};  // L D L^T would not notice negative pivots
};

/// Ida with CHOLMOD.
template <typename System>
using CholmodIda = Ida<System, CholmodCholesky<System>>;

/// "newton-cholmod": newton_by CHOLMOD.
inline AnySolver<System> newton_by_cholmod() {
  return newton_by("Newton, CHOLMOD", [] { return std::make_unique<CholmodFactorization>(); });
}

/// Adds "newton-cholmod".
inline void add_cholmod(SolverRegistry<System>& registry) {
  registry.add("newton-cholmod", newton_by_cholmod);
}

/// Adds "ida-cholmod", and with asterism::solver_compiled "newton-cholmod" for models that are made of terms.
template <typename Springs>
void add_cholmod(SolverRegistry<Springs>& registry) {
  registry.template add<CholmodIda<Springs>>("ida-cholmod");
#ifdef ASTERISM_SOLVER_COMPILED
  if constexpr (HasTerms<Springs>) {
    registry.add("newton-cholmod",
                 [] { return AnySolver<Springs>(newton_by_cholmod(), detail::FromSprings<Springs>()); });
  }
#endif
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
