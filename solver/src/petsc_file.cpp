#include <petscviewer.h>

#include <array>
#include <bit>
#include <fstream>
#include <stdexcept>

#include "petsc_internal.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

using namespace detail::distributed;

namespace {

constexpr double kVersion = 1;
constexpr int kHeader = 4;  // version, Dim, nodes, links

template <typename Number>
bool read_big_endian(std::istream& in, Number& number) {
  std::array<char, sizeof(Number)> bytes{};
  if (!in.read(bytes.data(), std::ssize(bytes))) return false;
  if constexpr (std::endian::native == std::endian::little) std::reverse(bytes.begin(), bytes.end());
  number = std::bit_cast<Number>(bytes);
  return true;
}

/// What is wrong with the sizes in a file, or with opening it. PETSc's own errors would be those of the first
/// process alone, for which the others would wait.
Message problem_of(const std::filesystem::path& path, PetscFileMode mode) {
  if (mode == FILE_MODE_WRITE)
    return std::ofstream(path, std::ios::binary | std::ios::app) ? "" : "cannot be written";
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) return "cannot be read";
  const auto bytes = static_cast<std::int64_t>(in.tellg());
  in.seekg(0);
  std::int64_t end = 0;
  std::array<double, kHeader> header{};
  // An object of this class and size, or of any size if that is negative.
  const auto has = [&](PetscInt type, std::int64_t size) {
    PetscInt found_type = 0, found_size = 0;
    if (!in.seekg(end) || !read_big_endian(in, found_type) || !read_big_endian(in, found_size)) return false;
    if (found_type != type || found_size < 0 || (size >= 0 && found_size != size)) return false;
    const std::size_t width = type == VEC_FILE_CLASSID ? sizeof(double) : sizeof(PetscInt);
    end += static_cast<std::int64_t>(2 * sizeof(PetscInt) + width * static_cast<std::size_t>(found_size));
    return end <= bytes;
  };
  bool is_header = has(VEC_FILE_CLASSID, kHeader);
  for (double& value : header) is_header = is_header && read_big_endian(in, value);
  if (!is_header) return "is not a system in PETSc's binary format";
  constexpr double kMost = 1e15;  // read_header has PETSc's own limit
  for (const double value : header) {
    if (!(value >= 0 && value < kMost)) return "is not a system in PETSc's binary format";
  }
  const auto dim = static_cast<std::int64_t>(header[1]);
  const auto nodes = static_cast<std::int64_t>(header[2]);
  const auto links = static_cast<std::int64_t>(header[3]);
  const char* const missing = !has(VEC_FILE_CLASSID, dim * nodes)   ? "anchors"
                              : !has(VEC_FILE_CLASSID, nodes)       ? "anchor stiffness"
                              : !has(VEC_FILE_CLASSID, dim * nodes) ? "start"
                              : !has(IS_FILE_CLASSID, 2 * links)    ? "links"
                              : !has(VEC_FILE_CLASSID, links)       ? "rest lengths"
                              : !has(VEC_FILE_CLASSID, links)       ? "link stiffness"
                              : !has(IS_FILE_CLASSID, -1)           ? "fixed nodes"
                                                                    : nullptr;
  if (missing == nullptr) return "";
  return Message("no ").append(missing).append(" of the size that the header gives");
}

/// Calls work(communicator, viewer) on the open file. Errors name the file.
template <typename Work>
auto with_file(MPI_Comm given, const std::filesystem::path& path, PetscFileMode mode, Work&& work) {
  const PetscErrors errors;
  try {
    const Communicator comm(given);
    const Message bad =
        comm.agree_on([&] { return comm.rank() == 0 ? problem_of(path, mode) : Message(""); });
    if (!bad.empty()) throw PetscFailure{PETSC_ERR_FILE_OPEN, bad};
    OwnedViewer viewer;
    check(PetscViewerCreate(comm, &viewer));
    check(PetscViewerSetType(viewer, PETSCVIEWERBINARY));
    check(PetscViewerBinarySetSkipInfo(viewer, PETSC_TRUE));  // no second file, FILE.info
    check(PetscViewerFileSetMode(viewer, mode));
    check(PetscViewerFileSetName(viewer, path.c_str()));
    return work(comm, PetscViewer(viewer));
  } catch (const PetscFailure& failure) {
    throw std::runtime_error(path.string() + ": " + std::string(std::string_view(failure.message)));
  }
}

[[noreturn]] void refuse(const Message& message) { throw PetscFailure{PETSC_ERR_FILE_UNEXPECTED, message}; }

void write(const Communicator& comm, PetscViewer viewer, const double* values, Eigen::Index count,
           int block) {
  OwnedVec vector;
  check(VecCreateMPIWithArray(comm, block, static_cast<PetscInt>(count), PETSC_DETERMINE, values, &vector));
  check(VecView(vector, viewer));
}

void write(const Communicator& comm, PetscViewer viewer, std::vector<PetscInt> numbers, int block) {
  OwnedIs set;
  check(
      ISCreateGeneral(comm, static_cast<PetscInt>(numbers.size()), numbers.data(), PETSC_USE_POINTER, &set));
  check(ISSetBlockSize(set, block));
  check(ISView(set, viewer));
}

/// The process's part of `count` blocks. `what` is for errors.
Eigen::MatrixXd read(const Communicator& comm, PetscViewer viewer, std::int64_t count, int block,
                     const char* what) {
  PetscInt own = PETSC_DECIDE;
  auto all = static_cast<PetscInt>(count);
  check(PetscSplitOwnership(comm, &own, &all));
  OwnedVec vector;
  check(VecCreate(comm, &vector));
  check(VecSetSizes(vector, own * block, all * block));
  check(VecSetType(vector, VECSTANDARD));
  if (VecLoad(vector, viewer) != 0)
    refuse(Message("no ").append(what).append(" of the size that the header gives"));
  const double* values = nullptr;
  check(VecGetArrayRead(vector, &values));
  Eigen::MatrixXd result = Eigen::Map<const Eigen::MatrixXd>(values, block, own);
  check(VecRestoreArrayRead(vector, &values));
  return result;
}

std::vector<std::int64_t> read_numbers(const Communicator& comm, PetscViewer viewer, int block,
                                       const char* what) {
  OwnedIs set;
  check(ISCreate(comm, &set));
  check(ISSetType(set, ISGENERAL));
  check(ISSetBlockSize(set, block));
  if (ISLoad(set, viewer) != 0) refuse(Message("no ").append(what).append(" after the positions"));
  PetscInt count = 0;
  const PetscInt* values = nullptr;
  check(ISGetLocalSize(set, &count));
  check(ISGetIndices(set, &values));
  std::vector<std::int64_t> numbers(values, values + count);
  check(ISRestoreIndices(set, &values));
  return numbers;
}

struct Header {
  int dim;
  std::int64_t nodes, links;
};

Header read_header(const Communicator& comm, PetscViewer viewer) {
  OwnedVec vector, copy;
  OwnedScatter scatter;
  check(VecCreate(comm, &vector));
  check(VecSetType(vector, VECSTANDARD));
  PetscInt size = 0;
  if (VecLoad(vector, viewer) != 0 || VecGetSize(vector, &size) != 0 || size != kHeader)
    refuse("is not a system in PETSc's binary format");
  check(VecScatterCreateToAll(vector, &scatter, &copy));
  check(VecScatterBegin(scatter, vector, copy, INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter, vector, copy, INSERT_VALUES, SCATTER_FORWARD));
  double values[kHeader];
  const double* found = nullptr;
  check(VecGetArrayRead(copy, &found));
  std::copy_n(found, kHeader, values);
  check(VecRestoreArrayRead(copy, &found));
  if (values[0] != kVersion) refuse("is of another version of the format, or not a system");
  if (values[1] != 2 && values[1] != 3) refuse("its points have neither 2 nor 3 coordinates");
  const double most = static_cast<double>(PETSC_MAX_INT) / values[1];
  if (!(values[2] >= 0 && values[2] <= most && values[3] >= 0 && values[3] <= most))
    refuse("has more nodes or links than this PETSc can count, or a number of them that is none");
  return {static_cast<int>(values[1]), static_cast<std::int64_t>(values[2]),
          static_cast<std::int64_t>(values[3])};
}

}  // namespace

template <int kDim>
void write_petsc(MPI_Comm given, const std::filesystem::path& path, const SystemShare<kDim>& share) {
  with_file(given, path, FILE_MODE_WRITE, [&](const Communicator& comm, PetscViewer viewer) {
    const auto count = static_cast<std::int64_t>(share.anchors.cols());
    const std::int64_t first = comm.before(count);
    const std::int64_t nodes = comm.sum(count);
    const std::int64_t links = comm.sum(std::int64_t{std::ssize(share.links)});
    const Message bad = comm.agree_on([&] { return share_problem(share, first, nodes); });
    if (!bad.empty()) refuse(bad);
    const double header[kHeader] = {kVersion, kDim, static_cast<double>(nodes), static_cast<double>(links)};
    write(comm, viewer, header, comm.rank() == 0 ? kHeader : 0, 1);
    write(comm, viewer, share.anchors.data(), share.anchors.size(), kDim);
    write(comm, viewer, share.anchor_stiffness.data(), count, 1);
    write(comm, viewer, share.start.data(), share.start.size(), kDim);
    std::vector<PetscInt> ends;
    for (const auto& [i, j] : share.links) {
      ends.push_back(static_cast<PetscInt>(i));
      ends.push_back(static_cast<PetscInt>(j));
    }
    write(comm, viewer, ends, 2);
    write(comm, viewer, share.rest_length.data(), share.rest_length.size(), 1);
    write(comm, viewer, share.link_stiffness.data(), share.link_stiffness.size(), 1);
    write(comm, viewer, {share.fixed.begin(), share.fixed.end()}, 1);
  });
}

template <int kDim>
SystemShare<kDim> read_petsc(MPI_Comm given, const std::filesystem::path& path) {
  return with_file(given, path, FILE_MODE_READ, [&](const Communicator& comm, PetscViewer viewer) {
    const Header header = read_header(comm, viewer);
    if (header.dim != kDim) refuse(Message("its points have ").append(header.dim).append(" coordinates"));
    SystemShare<kDim> share;
    share.anchors = read(comm, viewer, header.nodes, kDim, "anchors");
    share.anchor_stiffness = read(comm, viewer, header.nodes, 1, "anchor stiffness").transpose();
    share.start = read(comm, viewer, header.nodes, kDim, "start");
    const auto ends = read_numbers(comm, viewer, 2, "links");
    if (comm.sum(std::int64_t{std::ssize(ends)}) != 2 * header.links)
      refuse("has another number of links than its header gives");
    for (std::size_t e = 0; e + 1 < ends.size(); e += 2) share.links.push_back({ends[e], ends[e + 1]});
    share.rest_length = read(comm, viewer, header.links, 1, "rest lengths").transpose();
    share.link_stiffness = read(comm, viewer, header.links, 1, "link stiffness").transpose();
    share.fixed = read_numbers(comm, viewer, 1, "fixed nodes");
    return share;
  });
}

int petsc_file_dim(MPI_Comm given, const std::filesystem::path& path) {
  return with_file(given, path, FILE_MODE_READ, [](const Communicator& comm, PetscViewer viewer) {
    return read_header(comm, viewer).dim;
  });
}

template void write_petsc(MPI_Comm, const std::filesystem::path&, const SystemShare<2>&);
template void write_petsc(MPI_Comm, const std::filesystem::path&, const SystemShare<3>&);
template SystemShare<2> read_petsc(MPI_Comm, const std::filesystem::path&);
template SystemShare<3> read_petsc(MPI_Comm, const std::filesystem::path&);

}  // namespace ASTERISM_ABI
}  // namespace asterism
