#pragma once

#include <mpi.h>

#include <Eigen/Core>
#include <asterism/solver/base/config.hpp>
#include <asterism/solver/problem/message.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/summary.hpp>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <vector>

/// @file
/// Spring systems on the processes of MPI, solved by PETSc: for constellations that are too large for one
/// machine. docs/distributed.md is the guide. Needs target asterism::petsc.

namespace asterism {
inline namespace ASTERISM_ABI {

/// Initialises MPI and PETSc where the program has not done so, and finalises in its destructor what it
/// initialised. PETSc reads its options from argv and from the environment variable PETSC_OPTIONS, and is
/// kept from catching signals. Everything below needs one of these, or the program's own PetscInitialize.
class ASTERISM_API PetscRuntime {
 public:
  /// Throws std::runtime_error if PETSc cannot be initialised.
  PetscRuntime(int& argc, char**& argv);
  ~PetscRuntime();
  PetscRuntime(const PetscRuntime&) = delete;
  PetscRuntime& operator=(const PetscRuntime&) = delete;

 private:
  bool owns_mpi_ = false;
  bool owns_petsc_ = false;
};

/// A link between nodes of all processes, numbered from 0.
struct GlobalLink {
  std::int64_t i = 0;  ///< a node
  std::int64_t j = 0;  ///< another node
};

/// The share of one process in a distributed system before it is partitioned. Nodes are numbered through the
/// processes: those of process 0 come first. Links and fixed nodes may be listed by any process, once. A
/// process may have nothing, and one process may have everything. Values and units are those of SpringSystem.
template <int kDim>
struct SystemShare {
  using Points = Eigen::Matrix<double, kDim, Eigen::Dynamic>;

  Points anchors;                    ///< Dim x n, the process's nodes [px]
  Eigen::VectorXd anchor_stiffness;  ///< n
  Points start;                      ///< Dim x n, where a solve starts [px]
  std::vector<GlobalLink> links;     ///< between nodes of any processes
  Eigen::VectorXd rest_length;       ///< one for each link [px]
  Eigen::VectorXd link_stiffness;    ///< one for each link
  std::vector<std::int64_t> fixed;   ///< nodes that are held where the start has them
};

/// A whole system and its start as one process's share. Throws std::invalid_argument if links have offsets
/// or nodes have loads, which distributed systems do not support.
template <int kDim>
SystemShare<kDim> whole_share(const SpringSystem<double, kDim>& system,
                              const typename SpringSystem<double, kDim>::Points& start) {
  if (system.has_offsets())
    throw std::invalid_argument("a distributed system cannot have links with offsets");
  if (system.has_loads()) throw std::invalid_argument("a distributed system cannot have loads");
  SystemShare<kDim> share{system.anchors,     system.anchor_stiffness, start, {},
                          system.rest_length, system.link_stiffness,   {}};
  for (const Link& link : system.links()) share.links.push_back({link.i, link.j});
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) share.fixed.push_back(i);
  }
  return share;
}

/// The methods of PETSc that minimise the energy.
enum class PetscMethod {
  NewtonTrustRegion,  ///< TAONTR: Newton's method, conjugate gradients in a trust region
  Lmvm,               ///< TAOLMVM: limited-memory BFGS
};

/// The preconditioner of the conjugate gradients. Where a process has no nodes, it is Jacobi.
enum class PetscPreconditioner {
  Jacobi,           ///< the diagonal blocks, one a node
  Gamg,             ///< PETSc's algebraic multigrid, with the rigid motions as near null space
  AdditiveSchwarz,  ///< a subdomain a process, overlap 1, incomplete Cholesky factors
};

/// Options of DistributedSystem::solve, the same on all processes; those of SolverOptions mean the same here.
/// PETSc's own options, with the prefix asterism_, come on top: -asterism_ksp_rtol, -asterism_pc_type ...
struct DistributedOptions {
  double tolerance = 1e-8;     ///< of the stationarity
  int max_iterations = 1000;   ///< of PETSc's method; 0: only evaluate the start
  bool hold_floating = false;  ///< hold a node of each component that no anchor holds
  /// First, each process minimises by Schwarz over its own nodes, while it holds those of others, in turns:
  /// of two linked nodes on two processes, only one moves in a turn. This never raises the energy and leaves
  /// little to PETSc's method: on one process nothing. Not counted in Summary::iterations.
  bool schwarz_first = true;
  /// If given, read in every iteration: the solve ends on all processes once it is set on one.
  const std::atomic<bool>* stop = nullptr;
  PetscMethod method = PetscMethod::NewtonTrustRegion;
  PetscPreconditioner preconditioner = PetscPreconditioner::Jacobi;

  /// The first problem of the options, or nullptr if there is none.
  const char* problem() const;
};

/// A spring system whose nodes are spread over the processes of a communicator, each with its links and
/// copies of the nodes at their far ends. PETSc's partitioner (PT-Scotch or ParMETIS) decides who gets which.
///
/// All functions but the plain getters are collective: every process calls them. Bad input on one process is
/// refused by all, with the message of the first that has it. If memory runs out on one process in the midst
/// of a step, the others may wait for it, as in every MPI program.
template <int kDim>
class ASTERISM_API DistributedSystem {
 public:
  using Points = typename SystemShare<kDim>::Points;

  /// Partitions and distributes the system of all shares. Links between the partitions are on both sides.
  /// problem() says what is wrong with it.
  DistributedSystem(MPI_Comm comm, const SystemShare<kDim>& share);
  ~DistributedSystem();
  DistributedSystem(DistributedSystem&&) noexcept;
  DistributedSystem& operator=(DistributedSystem&&) noexcept;

  /// Why solve will refuse the system; empty if it will not. The same on all processes.
  const Message& problem() const;

  /// Moves the nodes to a stationary point of the energy, starting from where they are. The same summary on
  /// all processes. Status and message are those of every solver; PETSc's own error gives NumericalFailure,
  /// or OutOfMemory, with PETSc's words. Iterations are steps of the method.
  Summary solve(const DistributedOptions& options = {});

  /// The places of the nodes: each process gets the columns of its share. This and gather have no columns if
  /// there is a problem(), and throw std::runtime_error for an error of PETSc or MPI.
  Points placement() const;
  /// All nodes in the order of their numbers on process `root`, nothing on the others.
  Points gather(int root = 0) const;

  std::int64_t nodes() const;      ///< of all processes
  std::int64_t links() const;      ///< of all processes
  std::int64_t cut_links() const;  ///< that join nodes of two processes
  std::int64_t own_nodes() const;  ///< of this process, after partitioning

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Writes the system of all shares to a file in PETSc's binary format (docs/distributed.md), without the
/// links' order between processes being kept. Collective. Throws std::runtime_error, with the file's name, on
/// all processes if it cannot be written.
template <int kDim>
ASTERISM_API void write_petsc(MPI_Comm comm, const std::filesystem::path& path,
                              const SystemShare<kDim>& share);

/// Reads what write_petsc wrote, each process an equal share. Collective. Throws std::runtime_error, with the
/// file's name, on all processes if it cannot be read.
template <int kDim>
ASTERISM_API SystemShare<kDim> read_petsc(MPI_Comm comm, const std::filesystem::path& path);

/// The number of coordinates of such a file's points, 2 or 3. Collective; throws as read_petsc does.
ASTERISM_API int petsc_file_dim(MPI_Comm comm, const std::filesystem::path& path);

extern template class DistributedSystem<2>;
extern template class DistributedSystem<3>;

}  // namespace ASTERISM_ABI
}  // namespace asterism
