#pragma once

#include <asterism/solver/energy/spring_element.hpp>
#include <asterism/solver/energy/stationarity.hpp>
#include <asterism/solver/problem/validate.hpp>
#include <cmath>

#include "petsc_internal.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail::distributed {

/// Of a matrix: all of it, or the blocks of its diagonal, one a node.
enum class Part { Whole, Diagonal };

/// Energy, gradient, Hessian and stopping rule of a distributed system, on PETSc's vectors of its own nodes.
/// What PETSc calls back returns PETSc's error codes; the rest throws PetscFailure. All of it is collective.
template <int kDim>
class SpringField {
 public:
  using System = SpringSystem<double, kDim>;
  using Point = typename System::Point;
  using Points = typename System::Points;

  /// Both live as long as this.
  SpringField(const Communicator& comm, const LocalSystem<kDim>& local)
      : comm_(comm), local_(local), x_(kDim, local.system.nodes()) {
    check(
        VecCreateSeqWithArray(PETSC_COMM_SELF, kDim, static_cast<PetscInt>(x_.size()), x_.data(), &local_x_));
    const OwnedVec x = make_vector();
    OwnedIs from;
    check(ISCreateBlock(PETSC_COMM_SELF, kDim, static_cast<PetscInt>(local.rows.size()), local.rows.data(),
                        PETSC_COPY_VALUES, &from));
    check(VecScatterCreate(x, from, local_x_, nullptr, &scatter_));
  }

  OwnedVec make_vector() const {
    OwnedVec x;
    check(VecCreate(comm_, &x));
    check(VecSetSizes(x, kDim * local_.own, PETSC_DETERMINE));
    check(VecSetBlockSize(x, kDim));
    check(VecSetType(x, VECSTANDARD));
    return x;
  }
  OwnedVec make_vector(const Points& own) const {
    OwnedVec x = make_vector();
    double* values = nullptr;
    check(VecGetArrayWrite(x, &values));
    Eigen::Map<Points>(values, kDim, local_.own) = own;
    check(VecRestoreArrayWrite(x, &values));
    return x;
  }

  int own_nodes() const { return local_.own; }

  /// Of own nodes and ghosts, where x is; valid until the next call of a function with an x.
  const Points& fetch(Vec x) {
    check(update(x));
    return x_;
  }

  /// The energy of all springs, and the gradient unless it is null. Fixed nodes have none.
  PetscErrorCode evaluate(Vec x, double* energy, Vec gradient) {
    PetscFunctionBeginUser;
    PetscCall(update(x));
    const bool wants_gradient = gradient != nullptr;
    double* values = nullptr;  // also of a process without nodes
    if (wants_gradient) PetscCall(VecGetArrayWrite(gradient, &values));
    Eigen::Map<Points> g(values, kDim, wants_gradient ? local_.own : 0);
    double sum = 0;
    for (int i = 0; i < local_.own; ++i) {
      const auto anchor = anchor_force(system(), i, anchor_offset(system(), i, x_));
      sum += anchor.energy;
      if (wants_gradient) g.col(i) = anchor.gradient;
    }
    for_each_link([&](const Link& link, const auto& force, const auto& spring) {
      if (is_own(link.i)) sum += force.energy;  // the other end's process leaves it out
      if (!wants_gradient) return;
      const Point pull = force.tension * spring.direction;
      if (is_own(link.i)) g.col(link.i) += pull;
      if (is_own(link.j)) g.col(link.j) -= pull;
    });
    if (wants_gradient) {
      for (int i = 0; i < local_.own; ++i) {
        if (system().is_fixed(i)) g.col(i).setZero();
      }
      PetscCall(VecRestoreArrayWrite(gradient, &values));
      ++gradient_evaluations;
    }
    PetscCall(PetscLogFlops(5.0 * kDim * local_.own + (7.0 * kDim + 9) * system().link_count()));
    if (energy != nullptr) {
      PetscCallMPI(MPI_Allreduce(&sum, energy, 1, MPI_DOUBLE, MPI_SUM, comm_));
      ++energy_evaluations;
    }
    PetscFunctionReturn(0);
  }

  /// A matrix with the Hessian's pattern, and the rigid motions of x as its near null space.
  OwnedMat make_matrix(Vec x, Part part) {
    std::vector<PetscInt> own_columns(static_cast<std::size_t>(local_.own), 1);
    std::vector<PetscInt> other_columns(own_columns.size());
    for (const Link& link : system().links()) {
      if (part == Part::Diagonal) break;
      const auto count = [&](int i, int j) {
        if (is_own(i)) ++(is_own(j) ? own_columns : other_columns)[static_cast<std::size_t>(i)];
      };
      count(link.i, link.j);
      count(link.j, link.i);
    }
    // Parallel links share a column, and no row has more columns than there are nodes.
    const auto bound = [](std::vector<PetscInt>& counts, std::int64_t nodes) {
      for (PetscInt& count : counts) count = std::min(count, static_cast<PetscInt>(nodes));
    };
    bound(own_columns, local_.own);
    bound(other_columns, local_.nodes - local_.own);
    OwnedMat hessian;
    check(MatCreate(comm_, &hessian));
    check(MatSetSizes(hessian, kDim * local_.own, kDim * local_.own, PETSC_DETERMINE, PETSC_DETERMINE));
    check(MatSetType(hessian, MATAIJ));
    check(MatSetBlockSize(hessian, kDim));
    check(MatXAIJSetPreallocation(hessian, kDim, own_columns.data(), other_columns.data(), nullptr, nullptr));
    check(MatSetOption(hessian, MAT_NO_OFF_PROC_ENTRIES, PETSC_TRUE));
    check(MatSetOption(hessian, MAT_SYMMETRIC, PETSC_TRUE));
    check(MatSetOption(hessian, MAT_SYMMETRY_ETERNAL, PETSC_TRUE));

    MatNullSpace motions = nullptr;
    check(MatNullSpaceCreateRigidBody(x, &motions));
    check(MatSetNearNullSpace(hessian, motions));
    check(MatNullSpaceDestroy(&motions));
    return hessian;
  }

  /// The Hessian at x. With `clamp` no anchor or link has negative curvature, and a small multiple of each
  /// node's stiffness makes the matrix positive definite. A fixed node is coupled to none.
  PetscErrorCode assemble(Vec x, Mat hessian, Part part, bool clamp) {
    PetscFunctionBeginUser;
    PetscCall(update(x));
    PetscCall(MatZeroEntries(hessian));
    diagonal_.resize(static_cast<std::size_t>(local_.own));
    for (int i = 0; i < local_.own; ++i)
      diagonal_[static_cast<std::size_t>(i)] =
          anchor_curvature(system(), i, anchor_offset(system(), i, x_), clamp);
    PetscErrorCode code = 0;
    for_each_link([&](const Link& link, const auto& full, const auto& spring) {
      const Block block = link_curvature(clamp ? full.clamped() : full, spring);
      const Block coupling = -block;  // symmetric, so that the order of its entries does not matter
      const auto add = [&](int i, int j) {
        if (!is_own(i) || code != 0) return;
        diagonal_[static_cast<std::size_t>(i)] += block;
        if (part == Part::Whole && !system().is_fixed(i) && !system().is_fixed(j))
          code = MatSetValuesBlocked(hessian, 1, row(i), 1, row(j), coupling.data(), ADD_VALUES);
      };
      add(link.i, link.j);
      add(link.j, link.i);
    });
    PetscCall(code);
    for (int i = 0; i < local_.own; ++i) {
      Block& block = diagonal_[static_cast<std::size_t>(i)];
      if (clamp)
        block += (part == Part::Diagonal ? 1e-3 : 1e-6) * std::max(stiffness_[i], least_stiffness_) *
                 Block::Identity();
      if (system().is_fixed(i)) block = std::max(stiffness_[i], least_stiffness_) * Block::Identity();
      PetscCall(MatSetValuesBlocked(hessian, 1, row(i), 1, row(i), block.data(), ADD_VALUES));
    }
    PetscCall(MatAssemblyBegin(hessian, MAT_FINAL_ASSEMBLY));
    PetscCall(MatAssemblyEnd(hessian, MAT_FINAL_ASSEMBLY));
    PetscCall(PetscLogFlops((4.0 * kDim * kDim + 4 * kDim + 10) * system().link_count()));
    PetscFunctionReturn(0);
  }

  /// Sets the stopping rule, that of asterism::stationarity, with lengths from x. False where stiffness or
  /// lengths leave the range of doubles.
  bool set_rule(Vec x) {
    detail::link_stiffness_of_nodes(system(), held_by_links_);
    stiffness_ = held_by_links_ + system().anchor_stiffness;
    length_ = characteristic_length(fetch(x));
    const auto own = stiffness_.head(local_.own);
    least_stiffness_ = comm_.max(local_.own > 0 ? own.maxCoeff() : 0) * 1e-8;
    bool in_range = is_finite(length_);
    weights_.setZero(local_.own);
    for (int i = 0; i < local_.own && length_ > 0; ++i) {
      if (!(stiffness_[i] > 0)) continue;
      weights_[i] = 1 / (stiffness_[i] * length_);
      in_range &= weights_[i] > 0 && is_finite(weights_[i]);
    }
    return comm_.min(in_range ? 1 : 0) > 0;
  }
  double length() const { return length_; }
  /// The largest node_stiffness of all.
  double largest_stiffness() const { return least_stiffness_ * 1e8; }

  /// NaN where the gradient has one.
  PetscErrorCode stationarity(Vec gradient, double* result) const {
    PetscFunctionBeginUser;
    const double* values = nullptr;
    PetscCall(VecGetArrayRead(gradient, &values));
    const Eigen::Map<const Points> g(values, kDim, local_.own);
    double largest = 0;
    int is_nan = 0;
    for (int i = 0; i < local_.own; ++i) {
      const double value = (g.col(i) * weights_[i]).norm();
      is_nan |= is_finite(value) ? 0 : 1;
      largest = std::max(largest, value);
    }
    PetscCall(VecRestoreArrayRead(gradient, &values));
    double both[2] = {largest, static_cast<double>(is_nan)};
    PetscCallMPI(MPI_Allreduce(MPI_IN_PLACE, both, 2, MPI_DOUBLE, MPI_MAX, comm_));
    *result = both[1] > 0 ? std::numeric_limits<double>::quiet_NaN() : both[0];
    PetscFunctionReturn(0);
  }

  /// For each own node and ghost -1 if an anchor or a fixed node holds its connected component, else the
  /// first node of the component. Links of zero stiffness do not connect.
  std::vector<double> components() {
    const int n = system().nodes();
    Eigen::VectorXi up = Eigen::VectorXi::LinSpaced(n, 0, n - 1);
    for (int l = 0; const Link& link : system().links()) {
      if (system().link_stiffness[l++] > 0) up[root(up, link.i)] = root(up, link.j);
    }
    // The least label of each local component spreads, until no process's labels change.
    Points own(kDim, local_.own);
    for (int i = 0; i < local_.own; ++i) {
      const bool is_held = system().anchor_stiffness[i] > 0 || system().is_fixed(i);
      own.col(i).setConstant(is_held ? -1 : static_cast<double>(local_.numbers[static_cast<std::size_t>(i)]));
    }
    std::vector<double> labels(static_cast<std::size_t>(n));
    Eigen::VectorXd least(n);
    while (true) {
      const OwnedVec shared = make_vector(own);
      const auto known = fetch(shared).row(0);
      least.setConstant(std::numeric_limits<double>::infinity());
      for (int i = 0; i < n; ++i) {
        double& label = least[root(up, i)];
        label = std::min(label, known[i]);
      }
      bool changes = false;
      for (int i = 0; i < n; ++i) {
        labels[static_cast<std::size_t>(i)] = least[root(up, i)];
        changes |= i < local_.own && known[i] != least[root(up, i)];
      }
      for (int i = 0; i < local_.own; ++i) own.col(i).setConstant(labels[static_cast<std::size_t>(i)]);
      if (comm_.max(changes ? 1 : 0) == 0) return labels;
    }
  }

  int energy_evaluations = 0;
  int gradient_evaluations = 0;

 private:
  using Block = Eigen::Matrix<double, kDim, kDim, Eigen::ColMajor>;

  const System& system() const { return local_.system; }
  bool is_own(int i) const { return i < local_.own; }
  const PetscInt* row(int i) const { return &local_.rows[static_cast<std::size_t>(i)]; }

  PetscErrorCode update(Vec x) {
    PetscFunctionBeginUser;
    PetscCall(VecScatterBegin(scatter_, x, local_x_, INSERT_VALUES, SCATTER_FORWARD));
    PetscCall(VecScatterEnd(scatter_, x, local_x_, INSERT_VALUES, SCATTER_FORWARD));
    PetscFunctionReturn(0);
  }

  template <typename OnLink>
  void for_each_link(OnLink&& on_link) const {
    int l = 0;
    for (const Link& link : system().links()) {
      const Point d = x_.col(link.i) - x_.col(link.j);
      Spring<System> here = spring(system(), link, d);
      // Where nothing else decides on a direction, the nodes' numbers do: not those of this process.
      if (!(here.length > 0) && here.direction == fixed_direction<Point>(link)) [[unlikely]] {
        const GlobalLink global = local_.global(link);
        here.direction = fixed_direction<Point>({static_cast<int>(global.i), static_cast<int>(global.j)});
      }
      on_link(link, link_force(system(), l, here), here);
      ++l;
    }
  }

  // asterism::characteristic_length over all processes.
  double characteristic_length(const Points& x) const {
    Point centroid;
    double square = mean_square_length(false, centroid);
    if (!(square > 0)) square = mean_square_length(true, centroid);
    if (square > 0) return std::sqrt(square);
    double extent = 0;
    Eigen::Matrix<double, kDim + 1, 1> sums;  // whether anchors have stiffness, and x
    sums.setZero();
    for (int i = 0; i < local_.own; ++i) {
      if (system().anchor_stiffness[i] > 0) {
        extent = std::max(extent, system().anchors.col(i).cwiseAbs().maxCoeff());
        sums[0] = 1;
      }
      sums.template tail<kDim>() += x.col(i);
    }
    extent = comm_.max(extent);
    comm_.sum(sums);
    const auto nodes = static_cast<double>(local_.nodes);
    if (!(sums[0] > 0)) centroid = sums.template tail<kDim>() / nodes;
    double distances = (x.leftCols(local_.own).colwise() - centroid).squaredNorm();
    const double spread = std::sqrt(comm_.sum(distances) / nodes);
    return extent > 0 ? std::min(extent, spread) : spread;
  }

  double mean_square_length(bool all, Point& centroid) const {
    const auto anchor_stiffness = [&](int i) {
      const double k = system().anchor_stiffness[i];
      return all || (held_by_links_[i] > 0 && !system().is_fixed(i)) ? k : 0;
    };
    double strongest = system().link_count() > 0 ? system().link_stiffness.maxCoeff() : 0;
    for (int i = 0; i < local_.own; ++i) strongest = std::max(strongest, anchor_stiffness(i));
    const SpringWeight<double> weight_of(comm_.max(strongest));
    Eigen::Matrix<double, kDim + 1, 1> first;  // weights, weighted anchors
    first.setZero();
    for (int i = 0; i < local_.own; ++i) {
      const double weight = weight_of(anchor_stiffness(i));
      if (!(weight > 0)) continue;
      first[0] += weight;
      first.template tail<kDim>() += weight * system().anchors.col(i);
    }
    comm_.sum(first);
    centroid = first.template tail<kDim>();
    if (first[0] > 0) centroid /= first[0];
    Eigen::Vector2d second(0, 0);  // weights of links, weighted squares
    for (int i = 0; i < local_.own; ++i) {
      const double weight = weight_of(anchor_stiffness(i));
      if (weight > 0) second[1] += weight * (system().anchors.col(i) - centroid).squaredNorm();
    }
    for (int l = 0; const Link& link : system().links()) {
      const double weight = weight_of(system().link_stiffness[l]);
      if (is_own(link.i) && weight > 0) {
        second[0] += weight;
        second[1] += weight * (system().rest_length[l] * system().rest_length[l]);
      }
      ++l;
    }
    comm_.sum(second);
    return second[1] > 0 ? second[1] / (first[0] + second[0]) : 0;
  }

  const Communicator& comm_;
  const LocalSystem<kDim>& local_;
  Points x_;  // of own nodes and ghosts, the memory of local_x_
  OwnedVec local_x_;
  OwnedScatter scatter_;
  std::vector<Block, Eigen::aligned_allocator<Block>> diagonal_;
  typename System::NodeVector stiffness_;      // A_ii, right for own nodes
  typename System::NodeVector held_by_links_;  // sum_j k_ij, likewise
  Eigen::VectorXd weights_;                    // 1 / (A_ii L)
  double length_ = 0;
  double least_stiffness_ = 0;
};

}  // namespace detail::distributed
}  // namespace ASTERISM_ABI
}  // namespace asterism
