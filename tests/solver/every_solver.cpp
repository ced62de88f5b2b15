// Tests of the guarantees of every solver.
#include "every_solver.hpp"

#include <gtest/gtest.h>

#include <asterism/testing/random_system.hpp>
#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <type_traits>
#include <utility>

namespace asterism {
namespace {

template <typename System>
class EverySolver : public ::testing::Test {
 public:
  using Test = void (EverySolver::*)();

  EverySolver(const SolverKind<System>& kind, Test test) : kind_(kind), test_(test) {}
  void TestBody() override { (this->*test_)(); }

  static const std::vector<std::pair<const char*, Test>>& tests() {
    static const std::vector<std::pair<const char*, Test>> all = {
        {"ReachesTheSameMinimumAsIda", &EverySolver::ReachesTheSameMinimumAsIda},
        {"ReachesStationaryPointsOfThePapersSystems",
         &EverySolver::ReachesStationaryPointsOfThePapersSystems},
        {"SummaryTellsTheTruth", &EverySolver::SummaryTellsTheTruth},
        {"RunsOutOfIterations", &EverySolver::RunsOutOfIterations},
        {"EndsWhereItIsAskedToStop", &EverySolver::EndsWhereItIsAskedToStop},
        {"TellsOfEachIteration", &EverySolver::TellsOfEachIteration},
        {"EndsWhereTheCallbackSaysSo", &EverySolver::EndsWhereTheCallbackSaysSo},
        {"LooserToleranceStopsSooner", &EverySolver::LooserToleranceStopsSooner},
        {"StaysAtAStationaryPoint", &EverySolver::StaysAtAStationaryPoint},
        {"CollapsedSystemIsStationary", &EverySolver::CollapsedSystemIsStationary},
        {"PartsCoincidentNodes", &EverySolver::PartsCoincidentNodes},
        {"SolvesUnanchoredNodesOfAnAnchoredComponent",
         &EverySolver::SolvesUnanchoredNodesOfAnAnchoredComponent},
        {"HoldsFixedNodes", &EverySolver::HoldsFixedNodes},
        {"Translates", &EverySolver::Translates},
        {"Rotates", &EverySolver::Rotates},
        {"ScalesWithTheUnitOfLength", &EverySolver::ScalesWithTheUnitOfLength},
        {"ScalesWithTheUnitOfStiffness", &EverySolver::ScalesWithTheUnitOfStiffness},
        {"RelabelsNodes", &EverySolver::RelabelsNodes},
        {"RefusesBadInputAndLeavesXAlone", &EverySolver::RefusesBadInputAndLeavesXAlone},
        {"RefusesXInTheSystemsMemory", &EverySolver::RefusesXInTheSystemsMemory},
        {"RefusesBadOptions", &EverySolver::RefusesBadOptions},
        {"SpringsWithoutStiffnessAreOff", &EverySolver::SpringsWithoutStiffnessAreOff},
        {"JudgesThePointThatItReturns", &EverySolver::JudgesThePointThatItReturns},
        {"SaysThatTheRoundingIsAboveTheTolerance", &EverySolver::SaysThatTheRoundingIsAboveTheTolerance},
        {"AnchorsThatHoldNothingDoNotLoosenTheRule", &EverySolver::AnchorsThatHoldNothingDoNotLoosenTheRule},
        {"OverflowIsAFailureThatLeavesXAlone", &EverySolver::OverflowIsAFailureThatLeavesXAlone},
        {"PrintsNothing", &EverySolver::PrintsNothing},
        {"IsDeterministic", &EverySolver::IsDeterministic},
        {"AgreesWithIdaInDouble", &EverySolver::AgreesWithIdaInDouble},
    };
    return all;
  }

 private:
  using Scalar = typename System::Scalar;
  using Points = typename System::Points;

  static constexpr bool kDouble = std::is_same_v<Scalar, double>;
  static constexpr int kNodes = System::kNodes == Eigen::Dynamic ? 6 : System::kNodes;

  static testing::RandomSystem<System> random(std::uint64_t seed) {
    testing::Rng rng(seed);
    return testing::random_system<System>(rng, System::TopologyType::full(kNodes));
  }

  // A system with a start in the basin of a minimum.
  static testing::RandomSystem<System> near_minimum(std::uint64_t seed) {
    auto result = random(seed);
    EXPECT_EQ(DenseIda<System>().solve(result.system, result.start).status, Status::Converged);
    testing::Rng rng(seed);
    result.start += testing::random_points<System>(rng, kNodes, -0.02, 0.02);
    return result;
  }

  // These compare energies, whose rounding hides the last digits of x.
  bool loose() const {
    return kind_.name.starts_with("Ceres") || kind_.name.starts_with("liblbfgs") ||
           kind_.name.ends_with("differences");
  }
  double tolerance() const { return loose() ? 1e-6 : 1e-8; }
  // Allowed differences between two solves to that tolerance: relative for energies, in units of the system
  // for positions.
  double energy_tolerance() const { return kDouble ? (loose() ? 1e-7 : 1e-9) : 1e-3; }
  double point_tolerance() const { return kDouble ? (loose() ? 1e-4 : 1e-5) : 2e-3; }

  Summary solve(const System& system, Points& x) const {
    auto solver = kind_.make();
    solver.options().tolerance = tolerance();
    return solver.solve(system, x);
  }

  void ReachesTheSameMinimumAsIda() {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      const auto [system, start] = near_minimum(seed);
      Points by_ida = start;
      DenseIda<System>().solve(system, by_ida);
      Points x = start;
      const Summary summary = solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << "seed " << seed << ": " << summary;
      const double expected = energy(system, by_ida);
      EXPECT_NEAR(summary.final_energy, expected, std::min(1e-5, energy_tolerance()) * expected) << summary;
    }
  }

  // From the paper's start solvers may end in different minima; mostly they do not.
  void ReachesStationaryPointsOfThePapersSystems() {
    int same = 0;
    constexpr int kSystems = 30;
    for (std::uint64_t seed = 1; seed <= kSystems; ++seed) {
      const auto [system, start] = random(seed);
      Points by_ida = start;
      DenseIda<System>().solve(system, by_ida);
      Points x = start;
      const Summary summary = solve(system, x);
      EXPECT_EQ(summary.status, Status::Converged) << "seed " << seed << ": " << summary;
      EXPECT_LE(stationarity(system, x), kDouble ? 1.0001 * tolerance() : 1e-5);
      EXPECT_LT(summary.final_energy, summary.initial_energy);
      if (std::abs(summary.final_energy - double(energy(system, by_ida))) < 1e-3 * summary.final_energy)
        ++same;
    }
    EXPECT_GE(same, kSystems * 7 / 10);
  }

  void SummaryTellsTheTruth() {
    const auto [system, start] = random(3);
    Points x = start;
    auto solver = kind_.make();
    solver.options().tolerance = tolerance();
    solver.options().measure_seconds = true;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.solver, kind_.name);
    EXPECT_FALSE(summary.message.empty());
    EXPECT_TRUE(summary.usable());
    EXPECT_EQ(summary.initial_energy, double(energy(system, start)));
    EXPECT_EQ(summary.final_energy, double(energy(system, x)));
    EXPECT_EQ(summary.gradient_norm, gradient(system, x).template cast<double>().norm());
    EXPECT_NEAR(summary.stationarity, stationarity(system, x), 1e-6 * summary.stationarity);
    EXPECT_GT(summary.iterations, 0);
    EXPECT_GE(summary.gradient_evaluations, 0);
    EXPECT_GE(summary.energy_evaluations, 0);
    EXPECT_GT(summary.gradient_evaluations + summary.energy_evaluations, summary.iterations);
    EXPECT_GE(summary.linear_solves, 0);
    EXPECT_GE(summary.factorizations, 0);
    EXPECT_GT(summary.seconds, 0);
    EXPECT_LT(summary.seconds, 10);
  }

  void RunsOutOfIterations() {
    const auto [system, start] = random(4);
    auto solver = kind_.make();
    solver.options().max_iterations = 2;
    Points x = start;
    const Summary two = solver.solve(system, x);
    EXPECT_EQ(two.status, Status::MaxIterations) << two;
    EXPECT_LE(two.iterations, 2);
    EXPECT_LT(two.final_energy, two.initial_energy);
    solver.options().max_iterations = 0;
    x = start;
    const Summary none = solver.solve(system, x);
    EXPECT_EQ(none.status, Status::MaxIterations) << none;
    EXPECT_EQ(none.iterations, 0);
    EXPECT_EQ(x, start);
    EXPECT_EQ(none.final_energy, none.initial_energy);
  }

  void EndsWhereItIsAskedToStop() {
    const auto [system, start] = random(4);
    Points x = start;
    const Summary unasked = kind_.make().solve(system, x);
    std::atomic<bool> stop{true};
    auto solver = kind_.make();
    solver.options().stop = &stop;
    Points stopped = start;
    const Summary summary = solver.solve(system, stopped);
    EXPECT_EQ(summary.status, Status::Interrupted) << summary;
    EXPECT_TRUE(summary.usable());
    EXPECT_LE(summary.iterations, 1);
    EXPECT_TRUE(stopped.allFinite());
    EXPECT_LE(summary.final_energy, summary.initial_energy);
    stop = false;
    stopped = start;
    EXPECT_EQ(solver.solve(system, stopped).status, unasked.status);
    expect_same(unasked, stopped, x);
    stop = true;  // a stationary start still counts as converged
    if (unasked.status == Status::Converged) {
      EXPECT_EQ(solver.solve(system, stopped).status, Status::Converged);
    }
  }

  void TellsOfEachIteration() {
    const auto [system, start] = random(3);
    auto solver = kind_.make();
    solver.options().tolerance = tolerance();
    int last = -1;
    Points last_x = start;
    double last_energy = 0;
    auto look = [&, &system = system](const Iteration& at) {
      EXPECT_GT(at.number, last);
      if (last < 0) {
        EXPECT_EQ(at.number, 0);
      }
      last = at.number;
      last_x = at.x.template cast<Scalar>();
      last_energy = at.energy;
      EXPECT_EQ(at.energy, static_cast<double>(energy(system, last_x)));
      const double norm = gradient(system, last_x).template cast<double>().norm();
      EXPECT_NEAR(at.gradient_norm, norm, (kDouble ? 1e-9 : 1e-3) * (1 + norm));
      return true;
    };
    solver.options().on_iteration = look;
    Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(last, summary.iterations);
    EXPECT_NEAR(last_energy, summary.final_energy, energy_tolerance() * (1 + summary.final_energy));
    EXPECT_LT((last_x - x).norm(), point_tolerance() * x.norm());
    // Observing changes nothing but roundings.
    Points alone = start;
    solver.options().on_iteration = {};
    EXPECT_EQ(solver.solve(system, alone).iterations, summary.iterations);
    expect_same(summary, alone, x);
  }

  // Newton takes four nodes in vectors, whose rounding is another, only where no one watches.
  static void expect_same(const Summary& by, const Points& a, const Points& b) {
    if (detail::kHasFourNodes<System> && b.cols() == 4 && by.solver == Newton<System>::name()) {
      EXPECT_LE((a - b).norm(), 1e-12 * b.norm());
    } else {
      EXPECT_EQ(a, b);
    }
  }

  void EndsWhereTheCallbackSaysSo() {
    const auto [system, start] = random(3);
    auto solver = kind_.make();
    solver.options().tolerance = 0;
    int calls = 0;
    auto stop = [&](const Iteration& at) {
      ++calls;
      return at.number < 1;
    };
    solver.options().on_iteration = stop;
    Points x = start;
    const Summary summary = solver.solve(system, x);
    EXPECT_EQ(summary.status, Status::Interrupted) << summary;
    EXPECT_LE(summary.iterations, 2);
    EXPECT_EQ(calls, 2);
    EXPECT_LT(summary.final_energy, summary.initial_energy);
  }

  void LooserToleranceStopsSooner() {
    const auto [system, start] = random(5);
    auto solver = kind_.make();
    solver.options().tolerance = 1e-2;
    Points x = start;
    const Summary coarse = solver.solve(system, x);
    EXPECT_EQ(coarse.status, Status::Converged);
    EXPECT_LE(coarse.stationarity, 1e-2);
    if (!kind_.name.starts_with("Newton")) {  // its last step squares the error
      EXPECT_GT(coarse.stationarity, 1e-5);
    }
    x = start;
    EXPECT_LT(coarse.iterations, solve(system, x).iterations);
  }

  void StaysAtAStationaryPoint() {
    auto system = random(6).system;
    system.set_rest_lengths(system.anchors);
    Points x = system.anchors;
    const Points start = x;
    const Summary summary = solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(summary.iterations, 0);
    EXPECT_EQ(x, start);
  }

  void CollapsedSystemIsStationary() {
    auto system = random(6).system;
    system.rest_length.setZero();
    system.anchors.setConstant(3);
    Points x = system.anchors;
    EXPECT_EQ(solve(system, x).status, Status::Converged);
    x.setConstant(4);
    x(0, 0) = 5;
    EXPECT_EQ(solve(system, x).status, Status::Converged);
    EXPECT_LT((x - system.anchors).norm(), 1e-4);
  }

  void PartsCoincidentNodes() {
    const auto [system, start] = random(7);
    Points x = start;
    x.colwise() = start.col(0).eval();
    const Summary summary = solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT(summary.final_energy, 0.5 * summary.initial_energy);
  }

  void SolvesUnanchoredNodesOfAnAnchoredComponent() {
    auto [system, start] = random(8);
    system.anchor_stiffness[1] = 0;
    system.anchors.col(1).setConstant(1000);  // must be ignored
    system.link_stiffness[system.link_count() - 1] = 0;
    const Summary summary = solve(system, start);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_LT(start.cwiseAbs().maxCoeff(), 10);
  }

  void HoldsFixedNodes() {
    auto [system, start] = near_minimum(14);
    system.fix(1);
    system.fix(kNodes - 1);
    Points by_ida = start;
    ASSERT_EQ(DenseIda<System>().solve(system, by_ida).status, Status::Converged);
    Points x = start;
    const Summary summary = solve(system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(x.col(1), start.col(1));
    EXPECT_EQ(x.col(kNodes - 1), start.col(kNodes - 1));
    EXPECT_LT((x - by_ida).norm(), point_tolerance());
    EXPECT_GT((x - start).norm(), 1e-3);
  }

  // Equivariance: the solution moves with the system, in as many iterations.
  template <typename Change>
  void expect_equivariant(Change&& change, double scale_of_length, double scale_of_energy) {
    for (std::uint64_t seed = 31; seed <= 35; ++seed) {
      const auto [system, start] = near_minimum(seed);
      Points x = start;
      const Summary summary = solve(system, x);
      auto changed = system;
      Points changed_x = start;
      change(changed, changed_x);
      const Summary changed_summary = solve(changed, changed_x);
      ASSERT_EQ(changed_summary.status, Status::Converged) << changed_summary;
      Points expected = x;
      auto unused = system;
      change(unused, expected);
      EXPECT_LT(double((changed_x - expected).norm()), point_tolerance() * scale_of_length);
      EXPECT_NEAR(changed_summary.final_energy, summary.final_energy * scale_of_energy,
                  energy_tolerance() * summary.final_energy * scale_of_energy);
      // Solvers that restart because of rounding may take other numbers of iterations.
      if (kDouble && !loose()) {
        EXPECT_NEAR(changed_summary.iterations, summary.iterations, 3 + summary.iterations / 10);
      }
    }
  }

  void Translates() {
    expect_equivariant(
        [](auto& system, auto& x) {
          system.anchors.array() += 4;
          x.array() += 4;
        },
        1, 1);
  }

  void Rotates() {
    expect_equivariant(
        [](auto& system, auto& x) {
          Eigen::Matrix<Scalar, Points::RowsAtCompileTime, Points::RowsAtCompileTime> rotation;
          rotation.setIdentity();
          rotation(0, 0) = rotation(1, 1) = Scalar(0.28);
          rotation(0, 1) = Scalar(-0.96);
          rotation(1, 0) = Scalar(0.96);
          system.anchors = (rotation * system.anchors).eval();
          x = (rotation * x).eval();
        },
        1, 1);
  }

  void ScalesWithTheUnitOfLength() {
    for (const double s : {1e-6, 1e5}) {
      expect_equivariant(
          [s](auto& system, auto& x) {
            const auto factor = static_cast<Scalar>(s);
            system.anchors *= factor;
            system.rest_length *= factor;
            x *= factor;
          },
          s, s * s);
    }
  }

  void ScalesWithTheUnitOfStiffness() {
    for (const double s : {1e-6, 1e5}) {
      expect_equivariant(
          [s](auto& system, auto&) {
            const auto factor = static_cast<Scalar>(s);
            system.anchor_stiffness *= factor;
            system.link_stiffness *= factor;
          },
          1, s);
    }
  }

  void RelabelsNodes() {
    const auto [system, start] = near_minimum(41);
    Points x = start;
    ASSERT_EQ(solve(system, x).status, Status::Converged);

    const auto other = [](int i) { return kNodes - 1 - i; };
    std::vector<Link> links;
    for (const Link& link : system.links()) links.push_back({other(link.i), other(link.j)});
    System relabelled(System::TopologyType::from_links(kNodes, links));
    relabelled.anchors = system.anchors.rowwise().reverse();
    relabelled.anchor_stiffness = system.anchor_stiffness.reverse();
    relabelled.rest_length = system.rest_length;
    relabelled.link_stiffness = system.link_stiffness;
    Points relabelled_x = start.rowwise().reverse();
    ASSERT_EQ(solve(relabelled, relabelled_x).status, Status::Converged);
    EXPECT_LT((relabelled_x.rowwise().reverse() - x).norm(), kDouble ? 1e-5 : 2e-3);
  }

  void RefusesBadInputAndLeavesXAlone() {
    constexpr Scalar kNan = std::numeric_limits<Scalar>::quiet_NaN();
    constexpr Scalar kInf = std::numeric_limits<Scalar>::infinity();
    struct BadInput {
      std::string message;
      std::function<void(System&, Points&)> spoil;
    };
    std::vector<BadInput> table = {
        {"anchor 2 is not finite", [](System& s, Points&) { s.anchors(1, 2) = kNan; }},
        {"anchor 0 is not finite", [](System& s, Points&) { s.anchors(0, 0) = -kInf; }},
        {"anchor stiffness 3 is negative or not finite",
         [](System& s, Points&) { s.anchor_stiffness[3] = -1; }},
        {"anchor stiffness 1 is negative or not finite",
         [](System& s, Points&) { s.anchor_stiffness[1] = kNan; }},
        {"anchor stiffness 0 is negative or not finite",
         [](System& s, Points&) { s.anchor_stiffness[0] = kInf; }},
        {"rest length 5 is negative or not finite",
         [](System& s, Points&) { s.rest_length[5] = Scalar(-1e-9); }},
        {"rest length 4 is negative or not finite", [](System& s, Points&) { s.rest_length[4] = kNan; }},
        {"rest length 0 is negative or not finite", [](System& s, Points&) { s.rest_length[0] = kInf; }},
        {"link stiffness 2 is negative or not finite", [](System& s, Points&) { s.link_stiffness[2] = -3; }},
        {"link stiffness 3 is negative or not finite",
         [](System& s, Points&) { s.link_stiffness[3] = kNan; }},
        {"link stiffness 1 is negative or not finite",
         [](System& s, Points&) { s.link_stiffness[1] = kInf; }},
        {"x of node 1 is not finite", [](System&, Points& x) { x(0, 1) = kNan; }},
        {"x of node 3 is not finite", [](System&, Points& x) { x(1, 3) = kInf; }},
        {"node 0 is in a connected component without anchor stiffness",
         [](System& s, Points&) { s.anchor_stiffness.setZero(); }},
        {"node 2 is in a connected component without anchor stiffness",
         [](System& s, Points&) {
           s.anchor_stiffness[2] = s.anchor_stiffness[3] = 0;
           int l = 0;
           for (const Link& link : s.links()) {  // 2 and 3 linked only to each other
             if ((link.i == 2 || link.i == 3) != (link.j == 2 || link.j == 3)) s.link_stiffness[l] = 0;
             ++l;
           }
         }},
        {"anchors were not set (anchor 0 is NaN)", [](System& s, Points&) { s = System(s.topology()); }},
        {"anchor stiffness was not set (entry 0 is NaN)",
         [](System& s, Points&) { s.anchor_stiffness.setConstant(Scalar(kNan)); }},
        {"rest length was not set (entry 0 is NaN)",
         [](System& s, Points&) { s.rest_length.setConstant(Scalar(kNan)); }},
        {"link stiffness was not set (entry 0 is NaN)",
         [](System& s, Points&) { s.link_stiffness.setConstant(Scalar(kNan)); }},
    };
    const auto from_list = [](std::vector<Link> links) {
      return [links](System& s, Points&) { s = System(System::TopologyType::from_links(kNodes, links)); };
    };
    table.push_back({"link 1 has an end that is out of range", from_list({{0, 1}, {1, kNodes}})});
    table.push_back({"link 0 has an end that is out of range", from_list({{-1, 1}})});
    table.push_back({"link 2 joins a node to itself", from_list({{0, 1}, {1, 2}, {3, 3}})});
    if constexpr (System::kNodes == Eigen::Dynamic) {
      table.push_back({"x must have one column for each node",
                       [](System&, Points& x) { x.conservativeResize(Eigen::NoChange, 5); }});
      table.push_back({"anchors must have one column for each node",
                       [](System& s, Points&) { s.anchors.setZero(System::kDim, 3); }});
      table.push_back({"anchor stiffness must have one entry for each node",
                       [](System& s, Points&) { s.anchor_stiffness.setOnes(7); }});
      table.push_back({"system has no nodes", [](System& s, Points& x) {
                         s = System(System::TopologyType::full(0));
                         x.resize(Eigen::NoChange, 0);
                       }});
    }
    table.push_back({"rest length must have one entry for each link",
                     [](System& s, Points&) { s.rest_length.setOnes(1); }});
    table.push_back({"link stiffness must have one entry for each link",
                     [](System& s, Points&) { s.link_stiffness.setOnes(2); }});

    auto solver = kind_.make();  // reused: bad input must not spoil it
    for (const auto& [message, spoil] : table) {
      auto [system, x] = random(9);
      spoil(system, x);
      const Points before = x;
      const Summary summary = solver.solve(system, x);
      EXPECT_EQ(summary.status, Status::InvalidInput) << message;
      EXPECT_EQ(std::string_view(summary.message), message);
      EXPECT_FALSE(summary.usable());
      ASSERT_EQ(x.size(), before.size());
      for (Eigen::Index c = 0; c < x.size(); ++c) {  // bitwise, as NaN != NaN
        EXPECT_EQ(std::memcmp(x.data() + c, before.data() + c, sizeof(Scalar)), 0) << message;
      }
      EXPECT_EQ(summary.final_energy, -1);
      EXPECT_EQ(summary.iterations, -1);
    }
    auto [system, x] = random(9);
    solver.options().tolerance = tolerance();
    EXPECT_EQ(solver.solve(system, x).status, Status::Converged);
  }

  // Otherwise the anchors would be overwritten with the solution, whose energy would then be zero.
  void RefusesXInTheSystemsMemory() {
    auto [system, start] = random(9);
    const Points anchors = system.anchors;
    auto solver = kind_.make();
    const Summary summary = solver.solve(system, system.anchors);
    EXPECT_EQ(summary.status, Status::InvalidInput) << summary;
    EXPECT_EQ(summary.message, "x shares memory with the system, such as its anchors: pass a copy");
    EXPECT_EQ(system.anchors, anchors);
    solver.options().tolerance = tolerance();
    EXPECT_EQ(solver.solve(system, start).status, Status::Converged);
  }

  // Results are the same bit for bit whatever anchor position or rest length a spring without stiffness has,
  // even where the direction between coincident nodes is determined.
  void SpringsWithoutStiffnessAreOff() {
    constexpr Scalar kMost = std::numeric_limits<Scalar>::max();
    const Scalar square = 10 * std::sqrt(kMost);  // its square overflows
    for (const bool coincide : {false, true}) {
      auto [system, start] = random(15);
      system.anchor_stiffness[1] = 0;
      system.link_stiffness[2] = 0;
      if (coincide) start.col(1) = start.col(0);
      Points expected = start;
      const Summary plain = solve(system, expected);
      EXPECT_EQ(plain.status, Status::Converged) << plain;
      for (const Scalar idle : {Scalar(0), Scalar(1000), square, kMost}) {
        system.rest_length[2] = idle;
        system.anchors.col(1).setConstant(-idle);
        system.anchors(1, 1) = idle;
        Points x = start;
        const Summary summary = solve(system, x);
        EXPECT_EQ(summary.status, Status::Converged) << idle << ": " << summary;
        EXPECT_EQ(x, expected) << idle;
        EXPECT_EQ(summary.final_energy, plain.final_energy) << idle;
        EXPECT_EQ(summary.stationarity, plain.stationarity) << idle;
      }
    }
  }

  // The tolerance that the stopping rule applies, see SolverOptions.
  double counted_tolerance() const {
    return std::max(tolerance(), 64.0 * double(std::numeric_limits<Scalar>::epsilon()));
  }
  // The status must be Converged exactly if the returned x is stationary; any other needs a reason.
  void expect_honest(const System& system, const Points& x, const Summary& summary, double what) const {
    EXPECT_TRUE(summary.usable()) << what << ": " << summary;
    EXPECT_TRUE(x.allFinite()) << what;
    EXPECT_EQ(summary.status == Status::Converged,
              stationarity(system, x) <= counted_tolerance() * (1 + 1e-6))
        << what << ": " << summary;
    EXPECT_FALSE(summary.message.empty());
  }

  // Far from the origin the start loses its digits and its shape, but not the stopping rule's scale.
  void JudgesThePointThatItReturns() {
    for (const double off : {1e2, 1e5, 1e10, 1e15, 1e18}) {
      if (!kDouble && off > 1e10) continue;  // the square times the stiffness overflows
      const auto [system, start] = near_minimum(16);
      Points x = start.array() + static_cast<Scalar>(off);
      const Summary summary = solve(system, x);
      expect_honest(system, x, summary, off);
      if (!loose()) {
        EXPECT_EQ(summary.status, Status::Converged) << off << ": " << summary;
      }
    }
  }

  // The whole system is far from the origin.
  void SaysThatTheRoundingIsAboveTheTolerance() {
    for (const double off : {1e2, 1e4, 1e7, 1e10, 1e13}) {
      if (!kDouble && off > 1e4) continue;
      auto [system, x] = near_minimum(17);
      system.anchors.array() += static_cast<Scalar>(off);
      x.array() += static_cast<Scalar>(off);
      const Summary summary = solve(system, x);
      expect_honest(system, x, summary, off);
      if (loose() || summary.status == Status::Converged) continue;
      EXPECT_EQ(summary.status, Status::NoProgress) << off << ": " << summary;
      EXPECT_EQ(summary.message,
                "the rounding of the coordinates is above the tolerance: loosen it, or move the origin near "
                "the nodes")
          << off << ": " << summary;
    }
  }

  void AnchorsThatHoldNothingDoNotLoosenTheRule() {
    constexpr int kLast = kNodes - 1;
    for (const double stiffness : {1e-12, 1e-3, 1.0}) {
      for (const double at : {1e4, 1e8, 1e12}) {
        if (!kDouble && (at > 1e4 || stiffness < 1e-3)) continue;
        auto [system, start] = near_minimum(18);
        for (int l = 0; const Link& link : system.links()) {  // isolates the last node
          if (link.j == kLast) system.link_stiffness[l] = 0;
          ++l;
        }
        Points expected = start;
        EXPECT_EQ(solve(system, expected).status, Status::Converged);
        system.anchor_stiffness[kLast] = static_cast<Scalar>(stiffness);
        system.anchors.col(kLast).setConstant(static_cast<Scalar>(at));
        Points x = start;
        x.col(kLast) = system.anchors.col(kLast);
        const Summary summary = solve(system, x);
        expect_honest(system, x, summary, at);
        if (!loose()) {
          EXPECT_EQ(summary.status, Status::Converged) << at << ": " << summary;
        }
        if (summary.status != Status::Converged) continue;
        EXPECT_LT((x - expected).leftCols(kLast).norm(), 2 * point_tolerance()) << stiffness << " " << at;
        EXPECT_LT((x - system.anchors).col(kLast).norm(), 1e-6 * at) << stiffness << " " << at;
      }
    }
  }

  void RefusesBadOptions() {
    const auto [system, start] = random(10);
    for (const SolverOptions& options :
         {SolverOptions{-1e-9, 10}, SolverOptions{std::nan(""), 10}, SolverOptions{1, -1}}) {
      auto solver = kind_.make_with(system, options);
      Points x = start;
      EXPECT_EQ(solver.solve(system, x).status, Status::InvalidInput);
      EXPECT_EQ(x, start);
    }
  }

  void OverflowIsAFailureThatLeavesXAlone() {
    constexpr Scalar kHuge = std::numeric_limits<Scalar>::max() / 2;
    for (int what = 0; what < 4; ++what) {
      auto [system, x] = random(11);
      if (what == 0) system.anchors.setConstant(kHuge);
      if (what == 1) system.rest_length.setConstant(kHuge);
      if (what == 2) system.link_stiffness.setConstant(kHuge);
      if (what == 3) x *= kHuge;
      const Points before = x;
      const Summary summary = solve(system, x);
      EXPECT_EQ(summary.status, Status::NumericalFailure) << what << ": " << summary;
      EXPECT_EQ(x, before);
    }
  }

  void PrintsNothing() {
    ::testing::internal::CaptureStdout();
    ::testing::internal::CaptureStderr();
    for (std::uint64_t seed = 50; seed < 60; ++seed) {
      auto [system, x] = random(seed);
      system.anchor_stiffness *= Scalar(1e-3);
      auto solver = kind_.make();
      solver.options().max_iterations = 300;
      solver.options().tolerance = 0;
      solver.solve(system, x);
      x.colwise() = x.col(0).eval();
      solver.solve(system, x);
      system.anchors.setConstant(std::numeric_limits<Scalar>::max());
      solver.solve(system, x);
    }
    EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  }

  void IsDeterministic() {
    const auto [system, start] = random(12);
    Points first = start;
    Points second = start;
    auto solver = kind_.make();
    solver.solve(system, first);
    solver.solve(system, second);
    EXPECT_EQ(first, second);
  }

  void AgreesWithIdaInDouble() {
    const auto [system, start] = near_minimum(13);
    Points x = start;
    EXPECT_EQ(solve(system, x).status, Status::Converged);
    using Double = SpringSystem<double, System::kDim>;
    Double in_double(Topology<>::from_links(kNodes, system.links()));
    in_double.anchors = system.anchors.template cast<double>();
    in_double.anchor_stiffness = system.anchor_stiffness.template cast<double>();
    in_double.rest_length = system.rest_length.template cast<double>();
    in_double.link_stiffness = system.link_stiffness.template cast<double>();
    typename Double::Points expected = start.template cast<double>();
    EXPECT_EQ(solve_ida(in_double, expected).status, Status::Converged);
    EXPECT_LT((x.template cast<double>() - expected).norm(), kDouble ? 1e-4 : 1e-3);
  }

  SolverKind<System> kind_;
  Test test_;
};

}  // namespace

template <typename System>
void register_solvers(const std::string& system, const std::vector<SolverKind<System>>& kinds) {
  for (const SolverKind<System>& kind : kinds) {
    const std::string suite = "EverySolver/" + std::string(kind.name) + " (" + system + ")";
    for (const auto& [name, test] : EverySolver<System>::tests()) {
      ::testing::RegisterTest(
          suite.c_str(), name, nullptr, nullptr, __FILE__, __LINE__,
          [kind, test = test]() -> ::testing::Test* { return new EverySolver<System>(kind, test); });
    }
  }
}

template void register_solvers(const std::string&, const std::vector<SolverKind<Fixed2>>&);
template void register_solvers(const std::string&, const std::vector<SolverKind<Dynamic2>>&);
template void register_solvers(const std::string&, const std::vector<SolverKind<Dynamic3>>&);
template void register_solvers(const std::string&, const std::vector<SolverKind<Fixed2f>>&);
template void register_solvers(const std::string&, const std::vector<SolverKind<Bounded3f>>&);

}  // namespace asterism
