#pragma once

// What the sources of asterism::petsc share.

#include <petscao.h>
#include <petsctao.h>

#include <algorithm>
#include <asterism/solver/distributed/petsc.hpp>
#include <asterism/solver/problem/defect.hpp>
#include <new>
#include <numeric>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail::distributed {

/// An error of PETSc or MPI.
struct PetscFailure {
  PetscErrorCode code;
  Message message;
};

/// While it lives, PETSc's errors on this thread are returned, not printed, and their first text is kept.
class PetscErrors {
 public:
  PetscErrors();
  ~PetscErrors();
  PetscErrors(const PetscErrors&) = delete;
  PetscErrors& operator=(const PetscErrors&) = delete;

  /// Throws a PetscFailure for an error of PETSc, or of MPI.
  static void check(PetscErrorCode code);
  static void check_mpi(int code);
};

inline void check(PetscErrorCode code) {
  if (code != 0) [[unlikely]]
    PetscErrors::check(code);
}
inline void check_mpi(int code) {
  if (code != MPI_SUCCESS) [[unlikely]]
    PetscErrors::check_mpi(code);
}

/// One of PETSc's objects.
template <typename Object, PetscErrorCode (*kDestroy)(Object*)>
class Owned {
 public:
  Owned() = default;
  Owned(Owned&& other) noexcept : object_(std::exchange(other.object_, nullptr)) {}
  Owned& operator=(Owned&& other) noexcept {
    std::swap(object_, other.object_);
    return *this;
  }
  ~Owned() { reset(); }
  operator Object() const { return object_; }
  /// For PETSc's functions that create an object.
  Object* operator&() {
    reset();
    return &object_;
  }
  void reset() {
    PetscBool finalized = PETSC_FALSE;
    if (object_ != nullptr && PetscFinalized(&finalized) == 0 && !finalized) (void)kDestroy(&object_);
    object_ = nullptr;
  }

 private:
  Object object_ = nullptr;
};

using OwnedVec = Owned<Vec, VecDestroy>;
using OwnedMat = Owned<Mat, MatDestroy>;
using OwnedIs = Owned<IS, ISDestroy>;
using OwnedScatter = Owned<VecScatter, VecScatterDestroy>;
using OwnedLayout = Owned<PetscLayout, PetscLayoutDestroy>;
using OwnedTao = Owned<Tao, TaoDestroy>;
using OwnedViewer = Owned<PetscViewer, PetscViewerDestroy>;
using OwnedPartitioning = Owned<MatPartitioning, MatPartitioningDestroy>;
using OwnedAo = Owned<AO, AODestroy>;

/// A copy of a communicator whose errors are returned: by default, those of MPI end the program.
class Communicator {
 public:
  explicit Communicator(MPI_Comm comm);
  ~Communicator();
  Communicator(Communicator&& other) noexcept
      : comm_(std::exchange(other.comm_, MPI_COMM_NULL)), rank_(other.rank_), size_(other.size_) {}
  Communicator& operator=(Communicator&&) = delete;

  operator MPI_Comm() const { return comm_; }
  int rank() const { return rank_; }
  int size() const { return size_; }

  double sum(double value) const { return reduce(value, MPI_SUM); }
  double max(double value) const { return reduce(value, MPI_MAX); }
  double min(double value) const { return reduce(value, MPI_MIN); }
  std::int64_t sum(std::int64_t value) const;
  /// In place, over all processes.
  void sum(Eigen::Ref<Eigen::VectorXd> values) const;
  /// The sum of the values of the processes before this one.
  std::int64_t before(std::int64_t value) const;
  /// One value of each process.
  std::vector<std::int64_t> all(std::int64_t value) const;
  /// The message of the first process that has one, on all processes.
  Message agree(const Message& message) const;

  /// Runs work(), which must not be collective, and agrees on its message or on lack of memory.
  template <typename Work>
  Message agree_on(Work&& work) const {
    Message message;
    try {
      message = work();
    } catch (const std::bad_alloc&) {
      message = kOutOfMemory;
    }
    return agree(message);
  }

  /// Sends record r to process to[r]; returns those sent to this process, in the order of the senders.
  template <typename Record>
  std::vector<Record> exchange(std::span<const Record> records, std::span<const int> to) const {
    static_assert(std::is_trivially_copyable_v<Record>);
    std::vector<int> counts(static_cast<std::size_t>(size_)), starts(counts.size() + 1);
    for (const int process : to) ++counts[static_cast<std::size_t>(process)];
    std::partial_sum(counts.begin(), counts.end(), starts.begin() + 1);
    std::vector<int> next(starts.begin(), starts.end() - 1);
    std::vector<Record> packed(records.size());
    for (std::size_t r = 0; r < records.size(); ++r)
      packed[static_cast<std::size_t>(next[static_cast<std::size_t>(to[r])]++)] = records[r];

    std::vector<int> received(counts.size()), received_starts(counts.size() + 1);
    check_mpi(MPI_Alltoall(counts.data(), 1, MPI_INT, received.data(), 1, MPI_INT, comm_));
    std::partial_sum(received.begin(), received.end(), received_starts.begin() + 1);
    std::vector<Record> result(static_cast<std::size_t>(received_starts.back()));
    MPI_Datatype type;
    check_mpi(MPI_Type_contiguous(static_cast<int>(sizeof(Record)), MPI_BYTE, &type));
    check_mpi(MPI_Type_commit(&type));
    const int code = MPI_Alltoallv(packed.data(), counts.data(), starts.data(), type, result.data(),
                                   received.data(), received_starts.data(), type, comm_);
    MPI_Type_free(&type);
    check_mpi(code);
    return result;
  }

  static constexpr const char* kOutOfMemory = "out of memory";

 private:
  double reduce(double value, MPI_Op operation) const;

  MPI_Comm comm_ = MPI_COMM_NULL;
  int rank_ = 0;
  int size_ = 1;
};

/// The system of a process: a SpringSystem of its own nodes, in the order of their global numbers, and after
/// them of its ghosts, the nodes of other processes that its own are linked to. Its links are all those of
/// its own nodes. PETSc numbers nodes by process: `first_row` + k is own node k.
template <int kDim>
struct LocalSystem {
  using System = SpringSystem<double, kDim>;

  System system{Topology<>::full(0)};
  typename System::Points start;      ///< Dim x own
  std::vector<std::int64_t> numbers;  ///< global ones, of own nodes and ghosts
  std::vector<PetscInt> rows;         ///< PETSc's numbers of own nodes and ghosts
  int own = 0;
  std::int64_t nodes = 0;  ///< of all processes
  std::int64_t links = 0;
  std::int64_t cut_links = 0;

  GlobalLink global(const Link& link) const {
    return {numbers[static_cast<std::size_t>(link.i)], numbers[static_cast<std::size_t>(link.j)]};
  }
};

/// What is wrong with a share, whose first node is number `first` of `nodes`.
template <int kDim>
Message share_problem(const SystemShare<kDim>& share, std::int64_t first, std::int64_t nodes);

/// Partitions the nodes and sends nodes and links to where they belong. The shares have no problem.
template <int kDim>
LocalSystem<kDim> partition(const Communicator& comm, const SystemShare<kDim>& share);

/// "subject number problem" with a number of 64 bits.
Message numbered(std::string_view subject, std::int64_t number, std::string_view problem);

}  // namespace detail::distributed
}  // namespace ASTERISM_ABI
}  // namespace asterism
