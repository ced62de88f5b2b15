// Solvers chosen at run time, their options by name, and a user-defined solver.
#include <gtest/gtest.h>

#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/testing/random_system.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace asterism {
namespace {

using System = SpringSystem<double, 2>;
using Points = System::Points;

/// A user's solver: gradient descent with the step that IDA's majoriser allows everywhere.
class Descent {
 public:
  struct Options : SolverOptions {
    double share = 1;
    friend void visit_options(OptionVisitor& visit, Options& all) {
      visit_options(visit, static_cast<SolverOptions&>(all));
      visit("share", all.share, {0.01, 1});
    }
  };

  Options options;

  static constexpr std::string_view name() { return "descent"; }

  Summary solve(const System& given, Points& x) {
    return session_.run(name(), options, given, x, [&](const System& system, Summary& summary) {
      const double most = 2 * node_stiffness(system).maxCoeff();
      while (true) {
        const Points g = gradient(system, x);
        ++summary.gradient_evaluations;
        if (session_.done(x, g, summary.iterations)) return Status::Converged;
        if (summary.iterations == options.max_iterations) return Status::MaxIterations;
        x -= options.share / most * g;
        ++summary.iterations;
      }
    });
  }

 private:
  Session<System> session_;
};

testing::RandomSystem<System> problem() {
  testing::Rng rng(7);
  return testing::random_system<System>(rng, Topology<>::full(5));
}

std::string refusal(std::string_view name, const std::vector<NamedOption>& options = {}) {
  try {
    make_solver<System>(name, options);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "taken";
}

TEST(AnySolver, EveryNameSolvesAsItsTypeDoes) {
  const auto [system, start] = problem();
  for (const std::string& name : solver_registry<System>().names()) {
    AnySolver<System> solver = make_solver<System>(name, {{"tolerance", 1e-6}});
    Points x = start;
    EXPECT_EQ(solver.solve(system, x).status, Status::Converged) << name;
  }
  AnySolver<System> any = make_solver<System>("newton");
  Newton<System> newton;
  Points by_any = start, by_newton = start;
  EXPECT_EQ(any.solve(system, by_any).iterations, newton.solve(system, by_newton).iterations);
  EXPECT_EQ(by_any, by_newton);
  EXPECT_EQ(any.name(), Newton<System>::name());
}

TEST(AnySolver, BoundedSystemsHaveNoSparseTemplates) {
  const auto names = solver_registry<SpringSystem<double, 2, 4>>().names();
  EXPECT_NE(std::find(names.begin(), names.end(), "newton"), names.end());
  EXPECT_EQ(std::find(names.begin(), names.end(), "ida-sparse"), names.end());
}

TEST(AnySolver, OptionsByName) {
  const auto [system, start] = problem();
  Points x = start;
  EXPECT_EQ(
      make_solver<System>("ida", {{"max_iterations", 3}, {"relaxation", 1.5}}).solve(system, x).iterations,
      3);
  AnySolver<System> solver = make_solver<System>(
      "multi-start", {{"starts", 2}, {"spread", 1}, {"seed", 5}, {"align", false}, {"tolerance", 1e-3}});
  EXPECT_EQ(solver.options().tolerance, 1e-3);

  constexpr std::pair<const char*, const char*> kMeant[] = {
      {"newtom", ", did you mean 'newton'? (known: auto, ida, "},
      {"Levenberg-Marquardt", ": use 'newton' for small systems, "},
      {"dogleg", ": use 'newton' for"},
      {"LBFGS", ", did you mean 'lbfgs'?"},
      {"L-BFGS", ", did you mean 'lbfgs'?"},
      {"bfgs", ": use 'lbfgs' (known: "},
      {"CG", ": use 'ncg' (known: "},
      {"SMACOF", ": use 'ida' (known: "},
      {"adam", " (known: "},
      {"quux", " (known: "}};
  for (const auto& [wrong, answer] : kMeant)
    EXPECT_TRUE(refusal(wrong).starts_with("unknown method '" + std::string(wrong) + "'" + answer))
        << refusal(wrong);
  EXPECT_EQ(refusal("newton", {{"max_iteration", 3}}),
            "newton: unknown option 'max_iteration', did you mean 'max_iterations'?");
  EXPECT_EQ(refusal("newton", {{"max_iter", 3}}),
            "newton: unknown option 'max_iter', did you mean 'max_iterations'?");
  EXPECT_TRUE(refusal("newton", {{"eps", 1e-3}})
                  .starts_with("newton: unknown option 'eps' (known: tolerance, gap, max_iterations, "));
  EXPECT_EQ(refusal("newton", {{"max_iterations", 2.5}}),
            "newton: option 'max_iterations' must be an integer");
  EXPECT_EQ(refusal("newton", {{"max_iterations", -1}}),
            "newton: option 'max_iterations' must be in [0, 1000000000], is -1");
  EXPECT_EQ(refusal("ida", {{"relaxation", 2.5}}),
            "ida: option 'relaxation' must be in [1e-09, 1.999999999], is 2.5");
  EXPECT_EQ(refusal("newton", {{"max_iterations", true}}),
            "newton: option 'max_iterations' must be an integer");
  EXPECT_EQ(refusal("newton", {{"tolerance", true}}), "newton: option 'tolerance' must be a number");
  EXPECT_EQ(refusal("newton", {{"align", 1}}), "newton: option 'align' must be true or false");
  EXPECT_EQ(refusal("multi-start", {{"seed", -1}}),
            "multi-start: option 'seed' must be an integer that is not negative");
}

TEST(AnySolver, TheHeadersAloneNameTheLibraryThatHasTheOtherMethods) {
  std::vector<std::string> known = {"auto", "ida", "newton", "lbfgs", "ncg"};
  for (const std::string& name : solver_registry<System>().names()) {
    const std::string message = detail::unknown_method(name, known, detail::compiled_method);
    const bool is_template = std::ranges::find(known, name) != known.end() || name.starts_with("ncg-") ||
                             name == "ida-sparse" || name == "lbfgs-jacobi";
    EXPECT_EQ(
        message.starts_with("unknown method '" + name + "': use asterism::solver_compiled, which has '" +
                            name + "' (known: auto, "),
        !is_template)
        << message;
  }
}

// Without the compiled library, a registry knows no names of other libraries.
TEST(AnySolver, NearNamesInARegistryOfOnesOwn) {
  SolverRegistry<System> registry;
  const auto message = [&](const char* name) {
    try {
      registry.make(name);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("made");
  };
  EXPECT_EQ(message("lm"), "unknown method 'lm'");
  registry.add<Newton<System>>("newton");
  registry.add<Descent>("descent");
  EXPECT_EQ(message("Newtn"), "unknown method 'Newtn', did you mean 'newton'? (known: newton, descent)");
  EXPECT_EQ(message("lm"), "unknown method 'lm' (known: newton, descent)");
}

TEST(AnySolver, MethodsElsewhereNameMethodsHere) {
  const std::vector<std::string> known = solver_registry<System>().names();
  for (const char* name : {"lm", "bfgs", "tnc", "cg", "smacof", "gnc", "global", "best", "sfdp", "ceres"}) {
    const std::string answer = method_elsewhere(name, known);
    EXPECT_FALSE(answer.empty()) << name;
    for (std::size_t at = 0; (at = answer.find('\'', at)) != std::string::npos; ++at) {
      const std::size_t end = answer.find('\'', ++at);
      EXPECT_NE(std::ranges::find(known, answer.substr(at, end - at)), known.end()) << answer;
      at = end;
    }
  }
  EXPECT_EQ(method_elsewhere("ceres", {"ceres-cg", "ida", "ceres-dense"}),
            "'auto'; as a reference: 'ceres-cg' or 'ceres-dense'");
  for (const char* name : {"", "newton", "lm bfgs", "quux"})
    EXPECT_EQ(method_elsewhere(name, known), "") << name;
}

TEST(AnySolver, OfOnesOwn) {
  const auto [system, start] = problem();
  SolverRegistry<System> registry = solver_registry<System>();
  registry.add<Descent>("descent");
  EXPECT_THROW(registry.add<Descent>("descent"), std::invalid_argument);
  EXPECT_EQ(registry.names().back(), "descent");

  AnySolver<System> solver = registry.make({"descent", {{"share", 0.9}, {"max_iterations", 100000}}});
  int iterations = 0;
  auto count = [&iterations](const Iteration& at) {
    iterations = at.number;
    return true;
  };
  solver.options().on_iteration = count;
  Points x = start, by_ida = start;
  const Summary summary = solver.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_EQ(summary.solver, "descent");
  EXPECT_EQ(summary.iterations, iterations);
  Ida<System>().solve(system, by_ida);
  EXPECT_NEAR(summary.final_energy, energy(system, by_ida), 1e-9);
  EXPECT_THROW(registry.make("descent", {{"share", 2.0}}), std::invalid_argument);
  // The session refuses bad input.
  System bad = system;
  bad.anchors(0, 0) = std::numeric_limits<double>::quiet_NaN();
  x = start;
  EXPECT_EQ(solver.solve(bad, x).status, Status::InvalidInput);
  EXPECT_EQ(x, start);
}

}  // namespace
}  // namespace asterism
