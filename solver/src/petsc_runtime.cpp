#include <stdexcept>

#include "petsc_internal.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

PetscRuntime::PetscRuntime(int& argc, char**& argv) {
  int has_mpi = 0;
  PetscBool has_petsc = PETSC_FALSE;
  MPI_Initialized(&has_mpi);
  if (has_mpi == 0) {
    if (MPI_Init(&argc, &argv) != MPI_SUCCESS) throw std::runtime_error("MPI cannot be initialised");
    owns_mpi_ = true;
  }
  if (PetscInitialized(&has_petsc) == 0 && !has_petsc) {
    if (PetscInitialize(&argc, &argv, nullptr, nullptr) != 0) {
      if (owns_mpi_) MPI_Finalize();
      throw std::runtime_error("PETSc cannot be initialised");
    }
    owns_petsc_ = true;
    PetscPopSignalHandler();
  }
}

PetscRuntime::~PetscRuntime() {
  if (owns_petsc_) PetscFinalize();
  if (owns_mpi_) MPI_Finalize();
}

namespace detail::distributed {

namespace {

thread_local Message first_words;

PetscErrorCode keep_words(MPI_Comm, int, const char* function, const char*, PetscErrorCode code,
                          PetscErrorType type, const char* words, void*) {
  if (type == PETSC_ERROR_INITIAL || first_words.empty())
    first_words.assign("PETSc: ").append(words != nullptr && *words != '\0' ? words : function);
  return code;
}

}  // namespace

PetscErrors::PetscErrors() {
  first_words.clear();
  PetscPushErrorHandler(keep_words, nullptr);
}

PetscErrors::~PetscErrors() { PetscPopErrorHandler(); }

void PetscErrors::check(PetscErrorCode code) {
  if (first_words.empty()) first_words.assign("PETSc: error ").append(static_cast<int>(code));
  throw PetscFailure{code, std::exchange(first_words, Message(""))};
}

void PetscErrors::check_mpi(int code) {
  char words[MPI_MAX_ERROR_STRING] = "";
  int length = 0;
  MPI_Error_string(code, words, &length);
  throw PetscFailure{PETSC_ERR_MPI, Message("MPI: ").append(words)};
}

Communicator::Communicator(MPI_Comm comm) {
  check_mpi(MPI_Comm_dup(comm, &comm_));
  MPI_Comm_set_errhandler(comm_, MPI_ERRORS_RETURN);
  MPI_Comm_rank(comm_, &rank_);
  MPI_Comm_size(comm_, &size_);
}

Communicator::~Communicator() {
  int finalized = 0;
  if (comm_ != MPI_COMM_NULL && MPI_Finalized(&finalized) == MPI_SUCCESS && finalized == 0)
    MPI_Comm_free(&comm_);
}

double Communicator::reduce(double value, MPI_Op operation) const {
  double result = value;
  check_mpi(MPI_Allreduce(&value, &result, 1, MPI_DOUBLE, operation, comm_));
  return result;
}

std::int64_t Communicator::sum(std::int64_t value) const {
  std::int64_t result = 0;
  check_mpi(MPI_Allreduce(&value, &result, 1, MPI_INT64_T, MPI_SUM, comm_));
  return result;
}

void Communicator::sum(Eigen::Ref<Eigen::VectorXd> values) const {
  check_mpi(MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), MPI_DOUBLE, MPI_SUM,
                          comm_));
}

std::int64_t Communicator::before(std::int64_t value) const {
  std::int64_t result = 0;
  check_mpi(MPI_Exscan(&value, &result, 1, MPI_INT64_T, MPI_SUM, comm_));
  return rank_ == 0 ? 0 : result;  // MPI leaves that of process 0 undefined
}

std::vector<std::int64_t> Communicator::all(std::int64_t value) const {
  std::vector<std::int64_t> values(static_cast<std::size_t>(size_));
  check_mpi(MPI_Allgather(&value, 1, MPI_INT64_T, values.data(), 1, MPI_INT64_T, comm_));
  return values;
}

Message Communicator::agree(const Message& message) const {
  const int mine = message.empty() ? size_ : rank_;
  int first = size_;
  check_mpi(MPI_Allreduce(&mine, &first, 1, MPI_INT, MPI_MIN, comm_));
  if (first == size_) return {};
  static_assert(std::is_trivially_copyable_v<Message>);
  Message agreed = message;
  check_mpi(MPI_Bcast(&agreed, static_cast<int>(sizeof agreed), MPI_BYTE, first, comm_));
  return agreed;
}

Message numbered(std::string_view subject, std::int64_t number, std::string_view problem) {
  Message message(subject);
  message.append(" ").append(std::to_string(number)).append(" ").append(problem);
  return message;
}

}  // namespace detail::distributed

}  // namespace ASTERISM_ABI
}  // namespace asterism
