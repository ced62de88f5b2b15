#include <asterism/solver/base/stopwatch.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <optional>
#include <stdexcept>

#include "petsc_field.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

const char* DistributedOptions::problem() const {
  if (!(tolerance >= 0) || !detail::is_finite(tolerance)) return "option tolerance is negative or not finite";
  if (max_iterations < 0) return "option max_iterations is negative";
  if (method != PetscMethod::NewtonTrustRegion && method != PetscMethod::Lmvm)
    return "option method is none of PETSc's that are known here";
  if (preconditioner < PetscPreconditioner::Jacobi || preconditioner > PetscPreconditioner::AdditiveSchwarz)
    return "option preconditioner is none of PETSc's that are known here";
  return nullptr;
}

namespace detail::distributed {

namespace {

constexpr const char* kPrefix = "asterism_";

struct MethodName {
  const char* name;
  TaoType tao;
};
MethodName name_of(PetscMethod method) {
  switch (method) {
    case PetscMethod::NewtonTrustRegion:
      return {"PETSc, Newton, trust region (TAO)", TAONTR};
    case PetscMethod::Lmvm:
      return {"PETSc, L-BFGS (TAO)", TAOLMVM};
  }
  return {"PETSc", TAONTR};
}

double power_of_two(double value) { return value > 0 ? std::ldexp(1.0, std::ilogb(value)) : 1.0; }

/// One solve: what PETSc calls back.
template <int kDim>
class Solve {
 public:
  Solve(const Communicator& comm, SpringField<kDim>& field, const DistributedOptions& options, Vec x)
      : comm_(comm),
        field_(field),
        options_(options),
        tolerance_(std::max(options.tolerance, kLeastTolerance)),
        x_(x) {}

  double tolerance() const { return tolerance_; }
  int iterations() const { return iterations_; }
  int linear_solves() const { return linear_solves_; }
  bool is_stopped() const { return is_stopped_; }

  /// Moves x. Returns why it ended, as far as the method knows.
  Status run(Message& message) {
    OwnedTao tao;
    OwnedMat hessian, model;
    check(TaoCreate(comm_, &tao));
    check(TaoSetOptionsPrefix(tao, kPrefix));
    check(TaoSetType(tao, name_of(options_.method).tao));
    check(TaoSetSolution(tao, x_));
    check(TaoSetObjective(tao, energy_of, this));
    check(TaoSetGradient(tao, nullptr, gradient_of, this));
    check(TaoSetObjectiveAndGradient(tao, nullptr, both_of, this));
    if (options_.method == PetscMethod::NewtonTrustRegion) {
      // The preconditioner must be positive definite, so that it is made from a matrix without negative
      // curvature.
      const bool is_diagonal = preconditioner() == PetscPreconditioner::Jacobi;
      hessian = field_.make_matrix(x_, Part::Whole);
      model = field_.make_matrix(x_, is_diagonal ? Part::Diagonal : Part::Whole);
      model_part_ = is_diagonal ? Part::Diagonal : Part::Whole;
      check(TaoSetHessian(tao, hessian, model, hessian_of, this));
      KSP ksp = nullptr;
      check(TaoGetKSP(tao, &ksp));
      check(KSPSetOptionsPrefix(ksp, kPrefix));
      // The only norm that needs no sum over all processes of its own.
      check(KSPSetNormType(ksp, KSP_NORM_NATURAL));
      precondition(ksp);
      // The radius is in the norm of the preconditioner, whose square is an energy: that of the start is 1.
      check(TaoSetInitialTrustRegionRadius(tao, 1));
      set_default("tao_ntr_init_type", "constant");
      set_default("tao_ntr_epsilon", "1e-11");  // where energies no longer differ but by rounding
    }
    check(TaoSetTolerances(tao, 0, 0, 0));
    check(TaoSetMaximumIterations(tao, PETSC_MAX_INT));
    check(TaoSetMaximumFunctionEvaluations(tao, PETSC_MAX_INT));
    check(TaoSetConvergenceTest(tao, test, this));
    check(TaoSetFromOptions(tao));
    check(TaoSolve(tao));
    TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
    check(TaoGetConvergedReason(tao, &reason));
    message.assign(TaoConvergedReasons[reason]);
    if (is_reached_) return Status::Converged;
    return is_stopped_ || iterations_ >= options_.max_iterations ? Status::MaxIterations : Status::NoProgress;
  }

  static constexpr double kLeastTolerance = 64 * std::numeric_limits<double>::epsilon();

 private:
  // PETSc 3.18's incomplete factors crash on a process without nodes.
  PetscPreconditioner preconditioner() const {
    return comm_.min(field_.own_nodes()) == 0 ? PetscPreconditioner::Jacobi : options_.preconditioner;
  }

  void precondition(KSP ksp) {
    PC pc = nullptr;
    check(KSPGetPC(ksp, &pc));
    switch (preconditioner()) {
      case PetscPreconditioner::Jacobi:
        check(PCSetType(pc, PCPBJACOBI));
        break;
      case PetscPreconditioner::Gamg:
        check(PCSetType(pc, PCGAMG));
        // The interpolation of another iterate can make the preconditioner indefinite.
        check(PCGAMGSetReuseInterpolation(pc, PETSC_FALSE));
        break;
      case PetscPreconditioner::AdditiveSchwarz:
        check(PCSetType(pc, PCASM));
        check(PCASMSetType(pc, PC_ASM_BASIC));  // symmetric, as conjugate gradients want
        // Incomplete factors that stay positive definite.
        set_default("sub_pc_type", "icc");
        set_default("sub_pc_factor_shift_type", "positive_definite");
        break;
    }
  }

  // PETSc's subdomains are known only once the matrix is: their options come from its database.
  static void set_default(const std::string& name, const char* value) {
    const std::string key = std::string("-").append(kPrefix).append(name);
    PetscBool is_set = PETSC_FALSE;
    check(PetscOptionsHasName(nullptr, nullptr, key.c_str(), &is_set));
    if (!is_set) check(PetscOptionsSetValue(nullptr, key.c_str(), value));
  }

  // Whether to end at an iterate.
  static PetscErrorCode test(Tao tao, void* self) {
    PetscFunctionBeginUser;
    constexpr int kRejected = 60;  // a radius that shrinks for so long finds no step
    auto& solve = *static_cast<Solve*>(self);
    PetscInt iteration = 0;
    Vec gradient = nullptr;
    PetscCall(TaoGetIterationNumber(tao, &iteration));
    solve.rejected_ = solve.iterations_ == iteration ? solve.rejected_ + 1 : 0;
    solve.iterations_ = static_cast<int>(iteration);
    PetscCall(TaoGetGradient(tao, &gradient, nullptr, nullptr));
    PetscCall(solve.field_.stationarity(gradient, &solve.stationarity_));
    solve.is_reached_ = !(solve.stationarity_ > solve.tolerance_);  // also for NaN, which the verdict rejects
    const auto* const asked = solve.options_.stop;
    int stop = asked != nullptr && asked->load(std::memory_order_relaxed) ? 1 : 0;
    PetscCallMPI(MPI_Allreduce(MPI_IN_PLACE, &stop, 1, MPI_INT, MPI_MAX, solve.comm_));
    solve.is_stopped_ = stop != 0;
    TaoConvergedReason reason = TAO_CONTINUE_ITERATING;
    if (solve.is_reached_)
      reason = TAO_CONVERGED_USER;
    else if (solve.is_stopped_ || iteration >= solve.options_.max_iterations)
      reason = TAO_DIVERGED_MAXITS;
    else if (solve.rejected_ > kRejected)
      reason = TAO_DIVERGED_TR_REDUCTION;
    PetscCall(TaoSetConvergedReason(tao, reason));
    PetscFunctionReturn(0);
  }

  static PetscErrorCode energy_of(Tao, Vec x, PetscReal* energy, void* self) {
    return static_cast<Solve*>(self)->field_.evaluate(x, energy, nullptr);
  }
  static PetscErrorCode gradient_of(Tao, Vec x, Vec gradient, void* self) {
    return static_cast<Solve*>(self)->field_.evaluate(x, nullptr, gradient);
  }
  static PetscErrorCode both_of(Tao, Vec x, PetscReal* energy, Vec gradient, void* self) {
    return static_cast<Solve*>(self)->field_.evaluate(x, energy, gradient);
  }
  static PetscErrorCode hessian_of(Tao tao, Vec x, Mat hessian, Mat model, void* self) {
    PetscFunctionBeginUser;
    auto& solve = *static_cast<Solve*>(self);
    ++solve.linear_solves_;
    // Equations are solved the better the nearer the minimum, and no better than the tolerance needs.
    KSP ksp = nullptr;
    const double wanted = std::max(0.1 * solve.tolerance_ / solve.stationarity_, 1e-4);
    const double accuracy = std::min(std::max(std::sqrt(solve.stationarity_), wanted), 0.1);
    PetscCall(TaoGetKSP(tao, &ksp));
    PetscCall(KSPSetTolerances(ksp, accuracy, PETSC_DEFAULT, PETSC_DEFAULT, PETSC_DEFAULT));
    PetscCall(solve.field_.assemble(x, hessian, Part::Whole, false));
    PetscCall(solve.field_.assemble(x, model, solve.model_part_, true));
    PetscFunctionReturn(0);
  }

  const Communicator& comm_;
  SpringField<kDim>& field_;
  const DistributedOptions& options_;
  double tolerance_;
  Vec x_;
  Part model_part_ = Part::Whole;
  double stationarity_ = 1;  // of the last iterate
  bool is_reached_ = false;
  bool is_stopped_ = false;
  int rejected_ = 0;  // steps since the last iterate
  int iterations_ = 0;
  int linear_solves_ = 0;
};

}  // namespace

}  // namespace detail::distributed

using namespace detail::distributed;

template <int kDim>
struct DistributedSystem<kDim>::Impl {
  Communicator comm;
  Message problem = "";
  std::vector<std::int64_t> share_ends;  // of each process's share, as node numbers
  std::int64_t share_begin = 0;
  LocalSystem<kDim> local;
  std::optional<SpringField<kDim>> field;
  OwnedVec x;
  double length_unit = 1;  // PETSc gets a system of unit length and energy: it has thresholds of its own
  double energy_unit = 1;

  explicit Impl(MPI_Comm given) : comm(given) {}

  Message distribute(const SystemShare<kDim>& share) {
    const auto count = static_cast<std::int64_t>(share.anchors.cols());
    share_begin = comm.before(count);
    share_ends = comm.all(count);
    std::partial_sum(share_ends.begin(), share_ends.end(), share_ends.begin());
    if (const Message bad =
            comm.agree_on([&] { return share_problem(share, share_begin, share_ends.back()); });
        !bad.empty())
      return bad;
    local = partition(comm, share);
    field.emplace(comm, local);
    x = field->make_vector(local.start);
    if (!field->set_rule(x)) return {};  // solve says so
    double energy = 0;
    check(field->evaluate(x, &energy, nullptr));
    if (!detail::is_finite(energy)) return {};
    const double length = field->length();
    constexpr double kLeast = 1e-16;
    scale(length, std::max(energy / (length * length), kLeast * field->largest_stiffness()));
    return {};
  }

  // Divides lengths and stiffness by units of about these sizes: powers of two, for the scaling to be exact.
  void scale(double length, double stiffness) {
    length_unit = power_of_two(length);
    const double stiffness_unit = power_of_two(stiffness);
    energy_unit = stiffness_unit * length_unit * length_unit;
    local.system.anchors /= length_unit;
    local.system.rest_length /= length_unit;
    local.system.anchor_stiffness /= stiffness_unit;
    local.system.link_stiffness /= stiffness_unit;
    check(VecScale(x, 1 / length_unit));
  }

  // Fixes a node of each component that nothing holds, and returns these nodes; or says what is wrong.
  std::vector<int> ground(bool wanted, Message& wrong) {
    const std::vector<double> components = field->components();
    double first = std::numeric_limits<double>::infinity();
    for (const double label : components) first = label >= 0 ? std::min(first, label) : first;
    first = comm.min(first);
    std::vector<int> grounded;
    if (!detail::is_finite(first)) return grounded;
    if (!wanted) {
      wrong = numbered("node", static_cast<std::int64_t>(first),
                       "is in a connected component without anchor stiffness");
      return grounded;
    }
    for (int i = 0; i < local.system.nodes(); ++i) {
      const auto place = static_cast<std::size_t>(i);
      if (components[place] == static_cast<double>(local.numbers[place])) grounded.push_back(i);
    }
    for (const int i : grounded) local.system.fix(i);
    return grounded;
  }

  // Each process minimises over its nodes, all at once. In one turn, those that are linked to a lower
  // process's are held, in the next those that are linked to a higher one's: no two nodes that are linked
  // move on two processes. A Schwarz that fails leaves its nodes where they were. With two turns, PETSc's
  // Newton took 3 to 7 steps for 1e5 nodes on two processes, with four 1 or 2, in less time.
  void minimise_locally(const DistributedOptions& options) {
    using OwnSystem = typename LocalSystem<kDim>::System;
    OwnSystem& system = local.system;
    // Without alignment: the others' nodes would have to move too.
    AnySolver<OwnSystem> sweeps = system_solver<OwnSystem>("schwarz", {{"align", false}});
    sweeps.options().tolerance = options.tolerance;
    sweeps.options().stop = options.stop;
    std::vector<int> held;
    const auto hold = [&](int i) {
      if (system.is_fixed(i)) return;
      system.fix(i);
      held.push_back(i);
    };
    const int turns = comm.size() > 1 ? 4 : 1;
    for (int turn = 0; turn < turns; ++turn) {
      for (const Link& link : system.links()) {
        const auto [own, ghost] = std::minmax(link.i, link.j);
        if (ghost < local.own) continue;
        const bool is_lower = local.rows[static_cast<std::size_t>(ghost)] < local.rows.front();
        if (is_lower == (turn % 2 == 0)) hold(own);
        hold(ghost);
      }
      Points points = field->fetch(x);
      (void)sweeps.solve(system, points);
      for (const int i : std::exchange(held, {})) system.release(i);
      double* values = nullptr;
      check(VecGetArrayWrite(x, &values));
      Eigen::Map<Points>(values, kDim, local.own) = points.leftCols(local.own);
      check(VecRestoreArrayWrite(x, &values));
    }
  }

  void solve(const DistributedOptions& options, Vec start, Summary& summary) {
    OwnedVec gradient;
    check(VecDuplicate(x, &gradient));
    double first_energy = 0;
    double norm = 0;
    double stationarity = 0;
    const bool in_range = field->set_rule(x);
    check(field->evaluate(x, &first_energy, gradient));
    check(VecNorm(gradient, NORM_2, &norm));
    if (!in_range || !detail::is_finite(first_energy) || !detail::is_finite(norm)) {
      summary.status = Status::NumericalFailure;
      summary.message = "energy or gradient at the start leave the range of the scalar";
      return;
    }
    summary.initial_energy = energy_unit * first_energy;

    field->energy_evaluations = field->gradient_evaluations = 0;
    // A place across a cut that is still frustrated would limit each step: turns and steps alternate, as in
    // Schwarz.
    constexpr int kRounds = 5;
    const int steps = options.method == PetscMethod::NewtonTrustRegion ? 4 : 100;
    DistributedOptions part = options;
    std::optional<Solve<kDim>> solve;
    Message words = "";
    Status status = Status::MaxIterations;
    summary.iterations = summary.linear_solves = 0;
    for (int round = 0;; ++round) {
      const bool is_local = options.schwarz_first && options.max_iterations > 0 && round < kRounds;
      if (is_local) minimise_locally(options);
      const int left = options.max_iterations - summary.iterations;
      part.max_iterations = is_local ? std::min(left, steps) : left;
      solve.emplace(comm, *field, part, x);
      if (left > 0) status = solve->run(words);
      summary.iterations += solve->iterations();
      summary.linear_solves += solve->linear_solves();
      if (!is_local || status != Status::MaxIterations || solve->is_stopped() || left <= steps) break;
    }
    summary.factorizations = 0;
    summary.energy_evaluations = field->energy_evaluations;
    summary.gradient_evaluations = field->gradient_evaluations;

    // The verdict, as a Session has it.
    double energy = 0;
    check(field->evaluate(x, &energy, gradient));
    check(field->stationarity(gradient, &stationarity));
    const double rounding = static_cast<double>(local.nodes + local.links) *
                            std::numeric_limits<double>::epsilon() * first_energy;
    const bool is_finite = detail::is_finite(energy) && detail::is_finite(stationarity);
    if (!is_finite || energy > first_energy + rounding) {
      check(VecCopy(start, x));
      check(field->evaluate(x, &energy, gradient));
      check(field->stationarity(gradient, &stationarity));
      status = is_finite ? Status::NoProgress : Status::NumericalFailure;
      summary.message = "no step lowered the energy";
    } else if (stationarity <= solve->tolerance()) {
      status = Status::Converged;
    } else if (solve->is_stopped()) {
      status = Status::Interrupted;
    } else if (status == Status::Converged) {
      status = Status::NoProgress;
    }
    if (summary.message.empty()) {
      summary.message.assign(status == Status::Converged       ? "stationary to the tolerance"
                             : status == Status::MaxIterations ? "not yet stationary"
                             : status == Status::Interrupted   ? "asked to stop, not yet stationary"
                                                               : "stopped short of the tolerance");
      if (status == Status::NoProgress) summary.message.append(" (").append(words).append(")");
    }
    check(VecNorm(gradient, NORM_2, &norm));
    summary.status = status;
    summary.final_energy = energy_unit * energy;
    summary.gradient_norm = energy_unit / length_unit * norm;
    summary.stationarity = stationarity;
  }

  // Sends node `number` to process_of(number). What this process gets are nodes from `begin` on, as columns.
  template <typename ProcessOf>
  Points collect(std::int64_t begin, ProcessOf&& process_of) const try {
    struct Placed {
      std::int64_t number;
      double x[kDim];
    };
    std::vector<Placed> nodes(static_cast<std::size_t>(local.own));
    std::vector<int> to;
    const double* values = nullptr;
    check(VecGetArrayRead(x, &values));
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      nodes[i].number = local.numbers[i];
      std::transform(values + kDim * i, values + kDim * (i + 1), nodes[i].x,
                     [this](double coordinate) { return length_unit * coordinate; });
      to.push_back(process_of(local.numbers[i]));
    }
    check(VecRestoreArrayRead(x, &values));
    nodes = comm.template exchange<Placed>(nodes, to);
    Points result(kDim, static_cast<Eigen::Index>(nodes.size()));
    for (const Placed& node : nodes) std::copy_n(node.x, kDim, result.col(node.number - begin).data());
    return result;
  } catch (const PetscFailure& failure) {
    throw std::runtime_error(std::string(std::string_view(failure.message)));
  }
};

template <int kDim>
DistributedSystem<kDim>::DistributedSystem(MPI_Comm comm, const SystemShare<kDim>& share)
    : impl_(std::make_unique<Impl>(comm)) {
  const PetscErrors errors;
  try {
    impl_->problem = impl_->distribute(share);
  } catch (const PetscFailure& failure) {
    impl_->problem = failure.message;
  } catch (const std::bad_alloc&) {
    impl_->problem = Communicator::kOutOfMemory;
  }
  impl_->problem = impl_->comm.agree(impl_->problem);
}

template <int kDim>
DistributedSystem<kDim>::~DistributedSystem() = default;
template <int kDim>
DistributedSystem<kDim>::DistributedSystem(DistributedSystem&&) noexcept = default;
template <int kDim>
DistributedSystem<kDim>& DistributedSystem<kDim>::operator=(DistributedSystem&&) noexcept = default;

template <int kDim>
const Message& DistributedSystem<kDim>::problem() const {
  return impl_->problem;
}

template <int kDim>
Summary DistributedSystem<kDim>::solve(const DistributedOptions& options) {
  const detail::Stopwatch stopwatch;
  Impl& impl = *impl_;
  Summary summary;
  summary.solver = name_of(options.method).name;
  const PetscErrors errors;
  const char* const wrong = options.problem();
  summary.status = Status::InvalidInput;
  summary.message = impl.problem.empty() ? impl.comm.agree(wrong != nullptr ? wrong : "") : impl.problem;
  if (summary.message == Communicator::kOutOfMemory) summary.status = Status::OutOfMemory;
  if (summary.message.empty()) {
    OwnedVec start;
    std::vector<int> grounded;
    const auto fail = [&](Status status, const Message& message) {
      summary.status = status;
      summary.message = message;
      if (start != nullptr) VecCopy(start, impl.x);
    };
    try {
      check(VecDuplicate(impl.x, &start));
      check(VecCopy(impl.x, start));
      grounded = impl.ground(options.hold_floating, summary.message);
      if (summary.message.empty()) impl.solve(options, start, summary);
    } catch (const PetscFailure& failure) {
      fail(failure.code == PETSC_ERR_MEM ? Status::OutOfMemory : Status::NumericalFailure, failure.message);
    } catch (const std::bad_alloc&) {
      fail(Status::OutOfMemory, Communicator::kOutOfMemory);
    }
    for (const int i : grounded) impl.local.system.release(i);
  }
  summary.seconds = stopwatch.seconds();
  return summary;
}

template <int kDim>
auto DistributedSystem<kDim>::placement() const -> Points {
  if (!impl_->problem.empty()) return Points(kDim, 0);
  const auto& ends = impl_->share_ends;
  return impl_->collect(impl_->share_begin, [&](std::int64_t number) {
    return static_cast<int>(std::upper_bound(ends.begin(), ends.end(), number) - ends.begin());
  });
}

template <int kDim>
auto DistributedSystem<kDim>::gather(int root) const -> Points {
  if (!impl_->problem.empty()) return Points(kDim, 0);
  return impl_->collect(0, [root](std::int64_t) { return root; });
}

template <int kDim>
std::int64_t DistributedSystem<kDim>::nodes() const {
  return impl_->local.nodes;
}
template <int kDim>
std::int64_t DistributedSystem<kDim>::links() const {
  return impl_->local.links;
}
template <int kDim>
std::int64_t DistributedSystem<kDim>::cut_links() const {
  return impl_->local.cut_links;
}
template <int kDim>
std::int64_t DistributedSystem<kDim>::own_nodes() const {
  return impl_->local.own;
}

template class DistributedSystem<2>;
template class DistributedSystem<3>;

}  // namespace ASTERISM_ABI
}  // namespace asterism
