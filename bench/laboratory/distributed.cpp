#include "distributed.hpp"

#include <petscsys.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <asterism/solver/distributed/petsc.hpp>
#include <asterism/solver/io/json.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <variant>

#include "solve.hpp"

namespace asterism::bench {

namespace {

constexpr std::array kMethods = {
    std::pair("newton", PetscMethod::NewtonTrustRegion),
    std::pair("lmvm", PetscMethod::Lmvm),
};
constexpr std::array kPreconditioners = {
    std::pair("jacobi", PetscPreconditioner::Jacobi),
    std::pair("schwarz", PetscPreconditioner::AdditiveSchwarz),
    std::pair("gamg", PetscPreconditioner::Gamg),
};

template <typename Pairs>
std::vector<std::string> names(const Pairs& pairs) {
  std::vector<std::string> result;
  for (const auto& pair : pairs) result.emplace_back(pair.first);
  return result;
}
template <typename Pairs>
auto named(const Pairs& pairs, const std::string& name) {
  return std::find_if(pairs.begin(), pairs.end(), [&](const auto& pair) { return name == pair.first; })
      ->second;
}

using AnyShare = std::variant<SystemShare<2>, SystemShare<3>>;

int rank() {
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  return rank;
}

double reduce(double value, MPI_Op operation) {
  double result = value;
  MPI_Allreduce(&value, &result, 1, MPI_DOUBLE, operation, PETSC_COMM_WORLD);
  return result;
}

/// What the first process's work() returns, on all of them; its error is thrown on all.
int on_first(const std::function<int()>& work) {
  int result = 0;
  std::string error;
  if (rank() == 0) {
    try {
      result = work();
    } catch (const std::exception& e) {
      error = e.what();
      if (error.empty()) error = "unknown error";
    }
  }
  int both[2] = {result, static_cast<int>(error.size())};
  MPI_Bcast(both, 2, MPI_INT, 0, PETSC_COMM_WORLD);
  error.resize(static_cast<std::size_t>(both[1]));
  MPI_Bcast(error.data(), both[1], MPI_CHAR, 0, PETSC_COMM_WORLD);
  if (!error.empty()) throw std::runtime_error(error);
  return both[0];
}

/// The first system of a JSON file; all of it is the first process's.
AnyShare read_json(const std::filesystem::path& file) {
  AnyShare share;
  const int dim = on_first([&] {
    const auto systems = read_systems(file);
    if (systems.empty()) throw std::runtime_error(file.string() + ": no systems");
    return std::visit(
        [&](const auto& stored) {
          constexpr int kDim = std::decay_t<decltype(stored.system)>::kDim;
          share = whole_share<kDim>(stored.system, stored.start);
          return kDim;
        },
        systems.front());
  });
  if (dim == 3 && rank() != 0) share = SystemShare<3>();
  return share;
}

AnyShare read(const std::filesystem::path& file) {
  if (on_first([&] { return is_petsc_file(file) ? 1 : 0; }) == 0) return read_json(file);
  if (petsc_file_dim(PETSC_COMM_WORLD, file) == 2) return read_petsc<2>(PETSC_COMM_WORLD, file);
  return read_petsc<3>(PETSC_COMM_WORLD, file);
}

/// The system of a file in PETSc's format as one process has it.
Problem read_problem(const std::filesystem::path& file) {
  const auto share = read_petsc<2>(PETSC_COMM_SELF, file);
  std::vector<Link> links;
  links.reserve(share.links.size());
  for (const auto& [i, j] : share.links) links.push_back({static_cast<int>(i), static_cast<int>(j)});
  Problem problem{System(Topology<>::from_links(static_cast<int>(share.start.cols()), links)), share.start};
  problem.system.anchors = share.anchors;
  problem.system.anchor_stiffness = share.anchor_stiffness;
  problem.system.rest_length = share.rest_length;
  problem.system.link_stiffness = share.link_stiffness;
  for (const std::int64_t i : share.fixed) problem.system.fix(static_cast<int>(i));
  return problem;
}

/// The time since the last call, on the slowest process [s].
class Laps {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return reduce(seconds, MPI_MAX);
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// The most memory that the processes have had, in all [bytes].
double peak_memory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return reduce(1024.0 * static_cast<double>(usage.ru_maxrss), MPI_SUM);
}

double flops() {
  PetscLogDouble flops = 0;
  (void)PetscGetFlops(&flops);
  return reduce(flops, MPI_SUM);
}

template <int kDim>
void solve(const DistributedRun& run, SystemShare<kDim> share, double read_seconds, double first_memory,
           Laps& laps) {
  DistributedSystem<kDim> system(PETSC_COMM_WORLD, share);
  const double partition_seconds = laps.lap();
  if (!system.problem().empty())
    throw std::runtime_error(run.file.string() + ": " + std::string(std::string_view(system.problem())));
  if (run.save.empty()) share = {};
  DistributedOptions options;
  options.tolerance = run.limits.tolerance;
  options.max_iterations = run.limits.iterations;
  options.method = named(kMethods, run.method);
  options.preconditioner = named(kPreconditioners, run.preconditioner);
  options.schwarz_first = run.schwarz_first;
  const double partition_memory = peak_memory();
  const double flops_before = flops();
  const Summary summary = system.solve(options);
  const double solve_seconds = laps.lap();
  const double flops_a_node = (flops() - flops_before) / static_cast<double>(system.nodes());
  const auto bytes_a_node = [&](double bytes) {
    return (bytes - first_memory) / static_cast<double>(system.nodes());
  };
  const double solve_memory = peak_memory();

  int processes = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &processes);
  const double fewest = reduce(static_cast<double>(system.own_nodes()), MPI_MIN);
  const double most = reduce(static_cast<double>(system.own_nodes()), MPI_MAX);
  if (rank() == 0) {
    std::printf("%s: %lld nodes, %lld links, %d processes with %.0f to %.0f nodes, %lld links between them\n",
                run.file.c_str(), static_cast<long long>(system.nodes()),
                static_cast<long long>(system.links()), processes, fewest, most,
                static_cast<long long>(system.cut_links()));
    std::printf("solver        %s\n", std::string(summary.solver).c_str());
    std::printf("status        %s (%s)\n", std::string(to_string(summary.status)).c_str(),
                std::string(std::string_view(summary.message)).c_str());
    std::printf("energy        %.15g -> %.15g\n", summary.initial_energy, summary.final_energy);
    std::printf("stationarity  %.2e\n", summary.stationarity);
    std::printf("iterations    %d, with %d evaluations of the energy, %d of the gradient\n",
                summary.iterations, summary.energy_evaluations, summary.gradient_evaluations);
    std::printf("time          read %.2f s, partition %.2f s, solve %.2f s\n", read_seconds,
                partition_seconds, solve_seconds);
    std::printf("memory        %.0f bytes a node at most until partitioned, %.0f until solved\n",
                bytes_a_node(partition_memory), bytes_a_node(solve_memory));
    std::printf("arithmetic    %.0f flops a node by PETSc\n", flops_a_node);
  }
  if (!run.save.empty()) {
    share.start = system.placement();
    write_petsc(PETSC_COMM_WORLD, run.save, share);
  }
}

/// Calls work() with MPI and PETSc; prints its error, once.
int with_petsc(const std::function<void()>& work) {
  // PETSc's options come from the environment, as the command line is this program's.
  static char name[] = "asterism-bench";
  char* arguments[] = {name, nullptr};
  char** argv = arguments;
  int argc = 1;
  const PetscRuntime runtime(argc, argv);
  try {
    work();
    return 0;
  } catch (const std::exception& error) {
    if (rank() == 0) std::fprintf(stderr, "asterism-bench: %s\n", error.what());
    return 1;
  }
}

}  // namespace

const std::vector<std::string>& distributed_methods() {
  static const auto all = names(kMethods);
  return all;
}
const std::vector<std::string>& distributed_preconditioners() {
  static const auto all = names(kPreconditioners);
  return all;
}

int solve_distributed(const DistributedRun& run) {
  return with_petsc([&] {
    const double first_memory = peak_memory();
    Laps laps;
    AnyShare share = read(run.file);
    const double seconds = laps.lap();
    std::visit([&](auto& of_dim) { solve(run, std::move(of_dim), seconds, first_memory, laps); }, share);
  });
}

bool is_petsc_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  char first = 0;
  return (in >> std::ws).get(first) && first != '{' && first != '[';
}

int solve_petsc_file(const std::filesystem::path& file, const std::vector<SolverEntry>& solvers,
                     const Limits& limits) {
  return with_petsc([&] { solve_problem(file.string(), read_problem(file), solvers, limits); });
}

int write_distributed(const std::filesystem::path& file, const std::filesystem::path& json, int nodes,
                      int dim, std::uint64_t seed) {
  return with_petsc([&] {
    AnyShare share;
    if (!json.empty()) {
      share = read_json(json);
    } else if (dim == 2) {
      if (rank() == 0) {
        const auto random = testing::sparse_system<SpringSystem<double, 2>>(seed, nodes);
        share = whole_share<2>(random.system, random.start);
      }
    } else {
      share = SystemShare<3>();
      if (rank() == 0) {
        const auto random = testing::sparse_system<SpringSystem<double, 3>>(seed, nodes);
        share = whole_share<3>(random.system, random.start);
      }
    }
    std::visit([&](const auto& of_dim) { write_petsc(PETSC_COMM_WORLD, file, of_dim); }, share);
  });
}

}  // namespace asterism::bench
