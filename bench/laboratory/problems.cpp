#include "problems.hpp"

#include <algorithm>
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/io/json.hpp>
#include <asterism/solver/method/make_solver.hpp>
#include <asterism/solver/method/solve_global.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/testing/sparse_system.hpp>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <stdexcept>

#include "experiments.hpp"
#include "measure.hpp"

namespace asterism::bench {

namespace {

constexpr double kSolved = 1e-6;  // relative gap above the least energy known
constexpr int kFirst = 300000;    // index of the first systems, which no experiment takes

/// Makes the systems of a family, from number 0 on.
struct Family {
  std::string name;
  std::function<Problem(int number)> problem;
};

Problem numbered(testing::Kind kind, int nodes, int number) {
  return testing::numbered_system<System>(kind, Topology<>::full(nodes),
                                          static_cast<std::uint64_t>(kFirst + number));
}

// The least energy that the library finds, moves x there, and a proven bound.
double least_energy(const Problem& problem, Points& x, double& lower_bound) {
  BranchAndBoundOptions options;
  options.gap = 1e-7;
  options.max_nodes = 1000000;
  options.max_seconds = 5;
  x = problem.start;
  const Summary global = solve_global(problem.system, x, options);
  lower_bound = global.lower_bound;
  Points other = problem.start;
  AnySolver<System> starts = make_solver<System>("multi-start", {{"starts", 200}, {"tolerance", 1e-10}});
  const Summary found = starts.solve(problem.system, other);
  if (!global.usable() || (found.usable() && found.final_energy < global.final_energy)) x = other;
  return energy(problem.system, x);
}

// Systems in which a solve from their own start ends more than 0.1 % above the least energy.
Problem with_several_minima(int number) {
  for (int index = 1000, found = -1;; ++index) {
    const Problem problem = numbered(testing::Kind::Lit, 4, index);
    Points x = problem.start;
    const Summary summary = Auto<System>().solve(problem.system, x);
    double lower_bound = 0;
    Points least;
    if (summary.final_energy > 1.001 * least_energy(problem, least, lower_bound) && ++found == number)
      return problem;
  }
}

// A chain that is longer than the distance of its two ends, which alone are held firmly: the less the larger
// the number.
Problem cable(int number) {
  constexpr int kNodes = 20;
  std::vector<Link> links;
  for (int i = 1; i < kNodes; ++i) links.push_back({i - 1, i});
  System system(Topology<>::from_links(kNodes, links));
  for (int i = 0; i < kNodes; ++i) system.anchors.col(i) << std::min(0.5 + 0.05 * number, 0.9) * i, 0;
  system.anchors(1, kNodes / 2) = -3;
  system.anchor_stiffness.setConstant(1e-3);
  system.anchor_stiffness[0] = system.anchor_stiffness[kNodes - 1] = 10;
  system.rest_length.setOnes();
  system.link_stiffness.setOnes();
  testing::Rng rng(static_cast<std::uint64_t>(kFirst + number));
  const Points start = system.anchors + testing::random_points<System>(rng, kNodes, -0.3, 0.3);
  return {system, start};
}

std::vector<Family> families() {
  std::vector<Family> result;
  for (const testing::Kind kind : testing::kKinds) {
    result.push_back({std::string(to_string(kind)) + "-4", [=](int k) { return numbered(kind, 4, k); }});
  }
  for (const int nodes : {9, 16}) {
    for (const testing::Kind kind : {testing::Kind::Lit, testing::Kind::Track}) {
      result.push_back({std::string(to_string(kind)) + "-" + std::to_string(nodes),
                        [=](int k) { return numbered(kind, nodes, k); }});
    }
  }
  for (const HardCase& hard : hard_cases()) {
    result.push_back({hard.name, [hard](int k) {
                        // The last levels leave energies that are little more than rounding errors.
                        const std::size_t level =
                            static_cast<std::size_t>(k) % std::min<std::size_t>(3, hard.levels.size());
                        return hard.problem(kFirst + k, hard.levels[level]);
                      }});
  }
  result.push_back({"several-minima", with_several_minima});
  result.push_back({"nearest-36", [](int k) {
                      return testing::sparse_system<System>(static_cast<std::uint64_t>(kFirst + k), 36);
                    }});
  result.push_back({"cable-20", cable});
  return result;
}

void write(std::ostream& out, const std::string& family, int number, const Problem& problem, Json origin) {
  const std::string name = family + "/" + std::to_string(number);
  Points minimiser;
  double lower_bound = 0;
  const double minimum = least_energy(problem, minimiser, lower_bound);
  origin["minimum"] = minimum;
  origin["lower_bound"] = lower_bound;
  origin["minimiser"] = coordinates(minimiser);
  write_system(out, problem.system, problem.start, name, origin.dump());
  if (!out.flush()) throw std::runtime_error(name + ": cannot be written");
  std::printf("%s: %.15g, proven to be at least %.15g\n", name.c_str(), minimum, lower_bound);
}

std::ofstream open(const std::filesystem::path& path) {
  std::ofstream out(path);
  if (!out) throw std::runtime_error(path.string() + ": cannot be written");
  return out;
}

KnownProblem known_problem(const std::filesystem::path& file, const StoredSystem<System>& stored) {
  const auto refuse = [&](const std::string& what) {
    throw std::runtime_error(file.string() + ": " + stored.name + ": " + what);
  };
  KnownProblem known{file.stem().string(),
                     stored.name,
                     {stored.system, stored.start},
                     Points(2, stored.system.nodes()),
                     0,
                     0};
  try {
    const Json origin = Json::parse(stored.origin), minimiser = origin.at("minimiser");
    known.minimum = origin.at("minimum").get<double>();
    known.lower_bound = origin.at("lower_bound").get<double>();
    if (std::ssize(minimiser) != known.minimiser.cols()) refuse("origin.minimiser needs a point per node");
    for (int i = 0; const Json& point : minimiser)
      known.minimiser.col(i++) << point.at(0).get<double>(), point.at(1).get<double>();
  } catch (const Json::exception&) {
    refuse("origin needs the numbers minimum and lower_bound, and the points minimiser");
  }
  const double found = energy(known.problem.system, known.minimiser);
  if (!(std::abs(found - known.minimum) <= 1e-9 * std::abs(known.minimum)))
    refuse(format("the energy of origin.minimiser is %.15g, not the minimum %.15g", found, known.minimum));
  if (!(known.lower_bound <= known.minimum * (1 + 1e-9))) refuse("origin.lower_bound is above the minimum");
  return known;
}

/// How a solver does on a family.
struct Score {
  int solved = 0;
  std::vector<double> gaps;     // where it does not solve
  std::vector<double> seconds;  // where it does
};

void print(const std::string& family, int problems, int proven,
           const std::vector<std::pair<std::string, Score>>& scores) {
  for (const auto& [solver, score] : scores) {
    std::printf("| %s | %d | %d | %s | %d |", family.c_str(), problems, proven, solver.c_str(), score.solved);
    std::printf(score.gaps.empty() ? " - |" : " %.1e |", score.gaps.empty() ? 0 : median(score.gaps));
    std::printf(score.seconds.empty() ? " - |\n" : " %.3g |\n",
                score.seconds.empty() ? 0 : 1e6 * median(score.seconds));
  }
}

}  // namespace

bool KnownProblem::proven() const { return Summary::is_within(kSolved, minimum, lower_bound); }

std::vector<KnownProblem> read_problem_set(const std::filesystem::path& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".jsonl") files.push_back(entry.path());
  }
  if (files.empty()) throw std::runtime_error(folder.string() + ": no files *.jsonl of problems");
  std::sort(files.begin(), files.end());
  std::vector<KnownProblem> problems;
  for (const std::filesystem::path& file : files) {
    for (auto& stored : read_systems<System>(file))
      problems.push_back(known_problem(file, std::move(stored)));
  }
  return problems;
}

void score_problem_set(const std::filesystem::path& folder, const std::vector<SolverEntry>& entries,
                       const Limits& limits) {
  const std::vector<KnownProblem> problems = read_problem_set(folder);
  std::printf(
      "Problems solved to the least energy known (relative gap 1e-6); elsewhere the median gap; median CPU "
      "time of "
      "a solve\nthat solves its problem [us]. Proven: problems whose least energy is proven to 1e-6.\n\n"
      "| family | problems | proven | solver | solved | gap elsewhere | time "
      "|\n|---|---|---|---|---|---|---|\n");
  std::map<std::string, int> totals;
  for (std::size_t begin = 0, end = 0; begin < problems.size(); begin = end) {
    while (end < problems.size() && problems[end].family == problems[begin].family) ++end;
    std::vector<std::pair<std::string, Score>> scores;
    for (const SolverEntry& entry : entries) {
      Score score;
      for (std::size_t p = begin; p < end; ++p) {
        const KnownProblem& known = problems[p];
        const auto runner = entry.make(known.problem.system.nodes());
        runner->load(known.problem);
        Points x;
        const Summary summary = runner->solve(limits, x);
        const double gap = summary.usable() ? summary.final_energy / std::max(known.minimum, 1e-300) - 1
                                            : std::numeric_limits<double>::infinity();
        if (gap > kSolved) {
          score.gaps.push_back(gap);
          continue;
        }
        ++score.solved;
        score.seconds.push_back(summary.seconds > 0.01 ? summary.seconds : steady_seconds(*runner, limits));
        if (gap < -kSolved) {
          std::fprintf(stderr, "%s: %s finds %.15g, less than the %.15g that was known\n", known.name.c_str(),
                       entry.name.c_str(), summary.final_energy, known.minimum);
        }
      }
      totals[entry.name] += score.solved;
      scores.emplace_back(entry.name, std::move(score));
    }
    const auto proven = std::count_if(problems.begin() + static_cast<std::ptrdiff_t>(begin),
                                      problems.begin() + static_cast<std::ptrdiff_t>(end),
                                      [](const KnownProblem& known) { return known.proven(); });
    print(problems[begin].family, static_cast<int>(end - begin), static_cast<int>(proven), scores);
  }
  std::printf("\n");
  for (const SolverEntry& entry : entries)
    std::printf("%s: %d of %zu solved\n", entry.name.c_str(), totals[entry.name], problems.size());
}

void write_problem_set(const std::filesystem::path& folder, int count,
                       const std::vector<std::filesystem::path>& recorded) {
  std::filesystem::create_directories(folder);
  for (const Family& family : families()) {
    std::ofstream out = open(folder / (family.name + ".jsonl"));
    for (int k = 0; k < count; ++k) write(out, family.name, k, family.problem(k), Json::object());
  }
  if (recorded.empty()) return;
  std::ofstream out = open(folder / "video.jsonl");
  int number = 0;
  for (const std::filesystem::path& file : recorded) {
    const auto systems = read_systems<System>(file);
    if (systems.empty()) throw std::runtime_error(file.string() + ": no systems");
    for (int k = 0; k < count; ++k) {
      const auto& stored =
          systems[static_cast<std::size_t>(k) * systems.size() / static_cast<std::size_t>(count)];
      write(out, "video", number++, {stored.system, stored.start}, stored.origin);
    }
  }
}

}  // namespace asterism::bench
