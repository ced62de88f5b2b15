// Systems of terms: every kind against finite differences, plain formulas and bounds; all methods; the tie to
// SpringSystem; what is asked about solutions; edits; and bad input.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/solver/terms/registry.hpp>
#include <asterism/system.hpp>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "matrices.hpp"
#include "random_values.hpp"

namespace asterism {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::random_points;
using testing::random_shapes;
using testing::random_values;
using testing::Rng;

Eigen::MatrixXi random_elements(Rng& rng, int n, int arity, int count) {
  Eigen::MatrixXi nodes(arity, count);
  for (int e = 0; e < count; ++e) {
    for (int a = 0; a < arity; ++a) {
      bool is_new = false;
      while (!is_new) {
        nodes(a, e) = static_cast<int>(rng.uniform(0, n - 1e-9));
        is_new = true;
        for (int b = 0; b < a; ++b) is_new = is_new && nodes(b, e) != nodes(a, e);
      }
    }
  }
  return nodes;
}

constexpr int kNodes = 6;

// A kind of term with one law and loss: adds elements to a system of kNodes nodes.
struct Kind {
  const char* name;
  std::function<Term&(System&, Rng&)> add;
};
std::ostream& operator<<(std::ostream& out, const Kind& kind) { return out << kind.name; }

void add_loss(Term& term, Rng& rng, Loss loss) {
  term.set_loss(loss, random_values(rng, term.size(), 2, 6),
                loss == Loss::Truncated ? random_values(rng, term.size(), 1, 3) : VectorXd());
}

template <typename Add>
Kind with_loss(const char* name, Loss loss, Add add) {
  return {name, [=](System& system, Rng& rng) -> Term& {
            Term& term = add(system, rng);
            add_loss(term, rng, loss);
            return term;
          }};
}

Anchors& anchors(System& system, Rng& rng) {
  const auto nodes = random_elements(rng, kNodes, 1, 8);
  return system.add_anchors(nodes.row(0), random_points(rng, system.dim(), 8), random_values(rng, 8, 0.1, 2));
}
Links& links(System& system, Rng& rng) {
  return system.add_links(random_elements(rng, kNodes, 2, 9), random_values(rng, 9, 2, 15),
                          random_values(rng, 9, 0.1, 2));
}

std::vector<Kind> kinds() {
  std::vector<Kind> all{
      {"anchors", [](System& s, Rng& rng) -> Term& { return anchors(s, rng); }},
      {"rays",
       [](System& s, Rng& rng) -> Term& {
         Term& term = anchors(s, rng);
         term.values("information") = random_shapes(rng, s.dim(), term.size(), false);
         return term;
       }},
      {"links", [](System& s, Rng& rng) -> Term& { return links(s, rng); }},
      {"links with offsets and information",
       [](System& s, Rng& rng) -> Term& {
         Term& term = links(s, rng);
         term.values("offset") = random_points(rng, s.dim(), term.size());
         term.values("information") = random_shapes(rng, s.dim(), term.size(), true);
         return term;
       }},
      {"bendings",
       [](System& s, Rng& rng) -> Term& {
         return s.add_bendings(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 0, 15),
                               random_values(rng, 7, 0.1, 2));
       }},
      {"offsets",
       [](System& s, Rng& rng) -> Term& {
         return s.add_offsets(random_elements(rng, kNodes, 2, 7), random_points(rng, s.dim(), 7),
                              System::all(0.7));
       }},
      {"loads",
       [](System& s, Rng& rng) -> Term& {
         return s.add_loads(random_elements(rng, kNodes, 1, 5).row(0), random_points(rng, s.dim(), 5, 1));
       }},
      {"second differences",
       [](System& s, Rng& rng) -> Term& {
         return s.add_differences(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 0.1, 2));
       }},
      {"differences with matrices",
       [](System& s, Rng& rng) -> Term& {
         Term& term = s.add_differences(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 0.1, 2));
         term.values("target") = random_points(rng, s.dim(), 7);
         term.values("a") = random_points(rng, s.dim() * s.dim(), 7, 1);
         term.values("c") = random_points(rng, s.dim() * s.dim(), 1, 1);
         term.values("information") = random_shapes(rng, s.dim(), 7, true);
         return term;
       }},
      {"common length",
       [](System& s, Rng& rng) -> Term& {
         return s.add_common_length(random_elements(rng, kNodes, 2, 8), random_values(rng, 8, 0.1, 2));
       }},
      {"common bias with a prior",
       [](System& s, Rng& rng) -> Term& {
         Term& term =
             s.add_common_length(random_elements(rng, kNodes, 2, 8), random_values(rng, 8, 0.1, 2), 1, 3);
         term.values("length") = random_values(rng, 8, 2, 15).transpose();
         term.set_loss(Loss::Huber, 4);
         return term;
       }},
      {"elements of the user's",
       [](System& s, Rng& rng) -> Term& {
         // (|x_i|^2 - |x_j|^2)^2 / 200
         const int d = s.dim();
         return s.add_elements(
             random_elements(rng, kNodes, 2, 6),
             [d](const MatrixXd& points, const MatrixXd&, bool second, ElementValues& values) {
               const auto count = points.cols();
               values.energy.resize(count);
               values.gradient.resize(2 * d, count);
               values.second.resize(4 * d * d, count);
               for (Eigen::Index e = 0; e < count; ++e) {
                 VectorXd by = 2 * points.col(e);
                 by.tail(d) *= -1;
                 const double f = points.col(e).head(d).squaredNorm() - points.col(e).tail(d).squaredNorm();
                 values.energy[e] = f * f / 200;
                 values.gradient.col(e) = f * by / 100;
                 if (!second) continue;
                 MatrixXd h = by * by.transpose() / 100;
                 for (int r = 0; r < 2 * d; ++r) h(r, r) += f * (r < d ? 2 : -2) / 100;
                 values.second.col(e) = h.reshaped();
               }
             },
             true);
       }},
      {"angles",
       [](System& s, Rng& rng) -> Term& {
         return s.add_angles(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 0, 3),
                             random_values(rng, 7, 0.1, 20));
       }},
      {"areas",
       [](System& s, Rng& rng) -> Term& {
         return s.add_areas(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 5, 60),
                            random_values(rng, 7, 0.001, 0.02));
       }},
      {"a potential of the user's",
       [](System& s, Rng& rng) -> Term& {
         Links& term = links(s, rng);
         term.set_function([](std::size_t count, const double* r, const double* rest, double* value,
                              double* first, double* second) {
           for (std::size_t l = 0; l < count; ++l) {  // log cosh, a smooth absolute value
             const double t = std::tanh(r[l] - rest[l]);
             value[l] = std::log(std::cosh(r[l] - rest[l]));
             first[l] = t;
             second[l] = 1 - t * t;
           }
         });
         return term;
       }},
  };
  const struct {
    const char* name;
    LinkLaw law;
  } laws[] = {{"ropes", LinkLaw::Rope},
              {"repulsions", LinkLaw::Repulsion},
              {"intervals", LinkLaw::Interval},
              {"logarithms", LinkLaw::Logarithm}};
  for (const auto& [name, law] : laws) {
    all.push_back({name, [law = law](System& s, Rng& rng) -> Term& {
                     Links& term = links(s, rng);
                     term.set_law(law);
                     term.values("upper") = term.values("length").array() + 3;
                     return term;
                   }});
  }
  const struct {
    const char *anchors, *links, *angles;
    Loss loss;
  } losses[] = {{"Huber anchors", "Huber links", "Huber angles", Loss::Huber},
                {"Geman-McClure anchors", "Geman-McClure links", "Geman-McClure angles", Loss::GemanMcClure},
                {"truncated anchors", "truncated links", "truncated angles", Loss::Truncated}};
  for (const auto& each : losses) {
    all.push_back(with_loss(each.anchors, each.loss, anchors));
    all.push_back(with_loss(each.links, each.loss, links));
    all.push_back(with_loss(each.angles, each.loss, [](System& s, Rng& rng) -> Term& {
      return s.add_angles(random_elements(rng, kNodes, 3, 7), random_values(rng, 7, 0, 3), System::all(5));
    }));
  }
  return all;
}

class EveryKind : public ::testing::TestWithParam<Kind> {
 protected:
  // Calls check(system, rng) for systems with this term in several dimensions.
  template <typename Check>
  void for_systems(Check&& check) const {
    for (const int dim : {1, 2, 3, 5}) {
      for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        SCOPED_TRACE(::testing::Message() << GetParam() << ", dimension " << dim << ", seed " << seed);
        if (dim == 1 && std::string(GetParam().name).find("angles") != std::string::npos) continue;
        if (dim == 1 && std::string(GetParam().name) == "areas") continue;  // derivatives on a line are 0
        Rng rng(seed);
        System system(kNodes, dim);
        GetParam().add(system, rng);
        if (seed == 3) system.fix(2);
        check(system, rng);
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(Terms, EveryKind, ::testing::ValuesIn(kinds()), [](const auto& test) {
  std::string name = test.param.name;
  for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return name;
});

TEST_P(EveryKind, GradientIsThatOfTheEnergy) {
  for_systems([](const System& system, Rng& rng) {
    const MatrixXd x = random_points(rng, system.dim(), kNodes);
    ASSERT_EQ(validate(system, x, false), "");
    MatrixXd gradient;
    EXPECT_EQ(energy_and_gradient(system, x, gradient), energy(system, x));
    const double scale = 1 + gradient.cwiseAbs().maxCoeff();
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      if (system.is_fixed(static_cast<int>(c) / system.dim())) {
        EXPECT_EQ(gradient.reshaped()[c], 0);
        continue;
      }
      const double h = 1e-5;
      MatrixXd up = x, down = x;
      up.reshaped()[c] += h;
      down.reshaped()[c] -= h;
      EXPECT_NEAR(gradient.reshaped()[c], (energy(system, up) - energy(system, down)) / (2 * h),
                  2e-6 * scale);
    }
  });
}

TEST_P(EveryKind, HessianIsThatOfTheGradient) {
  for_systems([](const System& system, Rng& rng) {
    const MatrixXd x = random_points(rng, system.dim(), kNodes);
    const MatrixXd h = hessian(system, x);
    const double scale = 1 + h.cwiseAbs().maxCoeff();
    EXPECT_LE((h - h.transpose()).cwiseAbs().maxCoeff(), 1e-12 * scale);
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      if (system.is_fixed(static_cast<int>(c) / system.dim())) {
        EXPECT_EQ(h.col(c), VectorXd(VectorXd::Unit(x.size(), c)));
        continue;
      }
      const double step = 1e-6;
      MatrixXd up = x, down = x, above, below;
      up.reshaped()[c] += step;
      down.reshaped()[c] -= step;
      energy_and_gradient(system, up, above);
      energy_and_gradient(system, down, below);
      EXPECT_LE((h.col(c) - (above - below).reshaped() / (2 * step)).cwiseAbs().maxCoeff(), 1e-5 * scale);
    }
  });
}

// Clamped matrices are positive semi-definite; the bounds hold between random points.
TEST_P(EveryKind, QuadraticOnesHaveOneHessian) {
  for_systems([](const System& system, Rng& rng) {
    const MatrixXd x = random_points(rng, system.dim(), kNodes);
    if (!system.term(0).is_quadratic() || system.term(0).problem_with(Curvature::True) != nullptr) return;
    const MatrixXd here = hessian(system, x), there = hessian(system, 2 * x);
    EXPECT_LE((here - there).norm(), 1e-12 * here.norm());
  });
}

TEST_P(EveryKind, CurvaturesAreWhatTheySay) {
  for_systems([](const System& system, Rng& rng) {
    const Term& term = system.term(0);
    const MatrixXd x = random_points(rng, system.dim(), kNodes);
    const MatrixXd clamped = hessian(system, x, Curvature::Clamped);
    const double scale = 1 + clamped.cwiseAbs().maxCoeff();
    EXPECT_GE(testing::eigenvalues(clamped)[0], -1e-12 * scale);
    MatrixXd gradient;
    const double here = energy_and_gradient(system, x, gradient);
    for (const Curvature bound : {Curvature::Majorising, Curvature::Minorising}) {
      if (term.problem_with(bound) != nullptr) {
        EXPECT_THROW(hessian(system, x, bound), std::invalid_argument);
        continue;
      }
      const MatrixXd m = hessian(system, x, bound);
      for (int trial = 0; trial < 50; ++trial) {
        MatrixXd move = random_points(rng, system.dim(), kNodes, std::pow(10, rng.uniform(-3, 2)));
        for (int i = 0; i < kNodes; ++i) {
          if (system.is_fixed(i)) move.col(i).setZero();
        }
        const VectorXd v = move.reshaped();
        const double model = here + gradient.reshaped().dot(v) + v.dot(m * v) / 2;
        const double there = energy(system, x + move);
        const double rounding = 1e-12 * (std::abs(here) + std::abs(there) + std::abs(model));
        if (bound == Curvature::Majorising) {
          EXPECT_LE(there, model + rounding);
        } else {
          EXPECT_GE(there, model - rounding);
        }
      }
    }
  });
}

// The least of a term's numbers: their derivatives by finite differences of solutions.
// In more dimensions: the same energy and gradient where the further coordinates are 0, and the same again if
// the whole is turned there; or a reason why not.
TEST_P(EveryKind, IsLiftedOrSaysWhyNot) {
  for_systems([&](System& system, Rng& rng) {
    const Term& term = system.term(0);
    if (const char* why = term.why_not_liftable()) {
      EXPECT_GT(std::string(why).size(), 10U);
      return;
    }
    const int dim = system.dim(), more = dim + 3;
    const std::unique_ptr<Term> lifted = term.lifted(more);
    EXPECT_EQ(lifted->dim(), more);
    EXPECT_EQ(lifted->kind(), term.kind());
    EXPECT_EQ(lifted->nodes(), term.nodes());
    EXPECT_EQ(lifted->defect(kNodes), "");
    System larger(kNodes, more);
    larger.add(term.lifted(more));
    const MatrixXd x = random_points(rng, dim, kNodes);
    MatrixXd y = MatrixXd::Zero(more, kNodes), gradient, larger_gradient;
    y.topRows(dim) = x;
    System alone(kNodes, dim);
    alone.add(term.clone());
    const double expected = energy_and_gradient(alone, x, gradient);
    EXPECT_NEAR(energy_and_gradient(larger, y, larger_gradient), expected, 1e-12 * std::abs(expected));
    EXPECT_LE((larger_gradient.topRows(dim) - gradient).norm(), 1e-9 * (1 + gradient.norm()));
    EXPECT_EQ(larger_gradient.bottomRows(3).norm(), 0);
    // Stiffness in the further dimensions is no more than in any of the given ones.
    if (term.problem_with(Curvature::Minorising) != nullptr) return;
    const MatrixXd all = hessian(larger, y, Curvature::Majorising);
    for (int i = 0; i < kNodes; ++i) {
      const MatrixXd block = all.block(more * i, more * i, more, more);
      const double least = testing::eigenvalues(block.topLeftCorner(dim, dim))[0];
      EXPECT_LE(block(dim, dim), least * (1 + 1e-9) + 1e-12);
    }
  });
}

TEST_P(EveryKind, SolutionsAreDifferentiated) {
  for_systems([](System& system, Rng& rng) {
    if (system.term(0).why_not_differentiable() != nullptr) return;
    system.add_anchors(random_points(rng, system.dim(), kNodes, 8), System::all(3));
    const MatrixXd start = random_points(rng, system.dim(), kNodes, 8);
    AlignedOptions options;
    options.tolerance = 1e-13;
    options.align = false;
    MatrixXd x = start;
    const Summary summary = solve(system, x, options);
    ASSERT_TRUE(summary.usable()) << summary;
    const Solution solution(system, x);
    if (!solution) return;  // at a kink of a loss
    const MatrixXd by_x = random_points(rng, system.dim(), kNodes, 1);
    const auto gradients = solution.gradients(by_x);
    for (int t = 0; t < system.term_count(); ++t) {
      for (std::size_t c = 0; c < system.term(t).columns().size(); ++c) {
        const std::string name(system.term(t).columns()[c].name);
        MatrixXd& values = system.term(t).values(name);
        const MatrixXd& found = gradients[static_cast<std::size_t>(t)][c];
        ASSERT_EQ(found.size(), values.size());
        for (Eigen::Index v = 0; v < std::min<Eigen::Index>(values.size(), 3); ++v) {
          // Entries of a symmetric matrix change in pairs.
          const int dim = system.dim(), entry = static_cast<int>(v);
          const Eigen::Index twin = name == "information" ? entry % dim * dim + entry / dim : v;
          const double before = values.reshaped()[v], step = 1e-5 * std::max(1.0, std::abs(before));
          double ends[2];
          bool is_smooth = true;
          for (const int side : {0, 1}) {
            values.reshaped()[v] = values.reshaped()[twin] = before + (side == 0 ? step : -step);
            MatrixXd moved = x;
            is_smooth = solve(system, moved, options).usable() && (moved - x).norm() < 0.1 && is_smooth;
            ends[side] = by_x.cwiseProduct(moved).sum();
          }
          values.reshaped()[v] = values.reshaped()[twin] = before;
          if (!is_smooth) continue;
          const double expected = (ends[0] - ends[1]) / (2 * step);
          const double both = found.reshaped()[v] + (twin == v ? 0.0 : found.reshaped()[twin]);
          EXPECT_NEAR(both, expected, 2e-4 * (1 + std::abs(expected)))
              << system.term(t).kind() << " " << name << " " << v;
        }
      }
    }
  });
}

// E, its gradient and Hessian in other units are the same but for the factors of the units: for coordinates
// of 1e-60 and 1e60, whose squares and cubes leave the range of a double in a careless formula.
TEST_P(EveryKind, HasTheSameValuesInAnyUnit) {
  const std::string kind = GetParam().name;
  if (kind.find("user") != std::string::npos) return;  // functions of numbers without units
  for_systems([&](const System& system, Rng& rng) {
    const MatrixXd x = random_points(rng, system.dim(), kNodes);
    MatrixXd gradient, scaled_gradient;
    const double expected = energy_and_gradient(system, x, gradient);
    const MatrixXd curvature = hessian(system, x);
    for (const double length : {1e-60, 1e60}) {
      System scaled = system;
      Term& term = scaled.term(0);
      const bool is_angle = term.kind() == "angles", is_area = term.kind() == "areas";
      const bool is_log = kind == "logarithms";
      for (const Column& column : system.term(0).columns()) {
        double unit = 1;
        const bool is_parameter = column.name == "scale" || column.name == "rest";
        if (column.name == "position" || column.name == "offset" || column.name == "target" ||
            column.name == "length" || column.name == "upper" || column.name == "prior" || is_parameter)
          unit = is_angle ? 1 : is_area ? length * length : length;
        if (column.name == "stiffness") unit = is_angle || is_log ? length * length : 1;
        if (column.name == "stiffness" && is_area) unit = 1 / length / length;
        if (column.name == "force") unit = length;
        term.values(column.name) *= unit;
      }
      const double there = energy_and_gradient(scaled, length * x, scaled_gradient);
      EXPECT_NEAR(there / length / length, expected, 1e-10 * std::abs(expected));
      EXPECT_LE((scaled_gradient / length - gradient).norm(), 1e-10 * gradient.norm());
      // Of a loss that is linear, on a line, the curvature is rounding.
      EXPECT_LE((hessian(scaled, length * x) - curvature).norm(), 1e-10 * curvature.norm() + 1e-14);
    }
  });
}

// The numbers of an element that is switched off, however far off, are as if it were not there.
TEST_P(EveryKind, ElementsWithoutStiffnessMeanNothing) {
  for_systems([](const System& given, Rng& rng) {
    System with = given, without = given;
    Term &off = with.term(0), &gone = without.term(0);
    const auto columns = off.columns();
    if (std::none_of(columns.begin(), columns.end(), [](const Column& c) { return c.name == "stiffness"; }))
      return;
    for (const Column& column : columns) {
      if (column.values.size() == 0 || column.name.starts_with("prior")) continue;
      MatrixXd each = column.values;
      if (each.cols() == 1) each = each.replicate(1, off.size()).eval();
      gone.values(column.name) = each;
      if (column.name == "stiffness") each(0, 1) = 0;
      const bool is_length = column.name == "position" || column.name == "offset" ||
                             column.name == "length" || column.name == "upper" || column.name == "target" ||
                             column.name == "rest";
      if (is_length) each.col(1).setConstant(1e200);
      off.values(column.name) = each;
    }
    gone.remove(std::vector<int>{1});
    for (System* system : {&with, &without})
      system->add_anchors(MatrixXd::Identity(system->dim(), kNodes), System::all(0.1));
    const MatrixXd x = random_points(rng, given.dim(), kNodes);
    ASSERT_EQ(validate(with, x), "");
    MatrixXd one, other;
    const double energy_with = energy_and_gradient(with, x, one);
    const double energy_without = energy_and_gradient(without, x, other);
    EXPECT_NEAR(energy_with, energy_without, 1e-14 * energy_without);  // sums may be in another order
    EXPECT_LE((one - other).norm(), 1e-14 * other.norm());
    EXPECT_EQ(node_stiffness(with, x), node_stiffness(without, x));
    const double expected_length = characteristic_length(without, x);
    EXPECT_NEAR(characteristic_length(with, x), expected_length, 1e-14 * expected_length);
    if (with.term(0).problem_with(Curvature::True) == nullptr) {
      const MatrixXd expected = hessian(without, x);
      EXPECT_LE((hessian(with, x) - expected).norm(), 1e-14 * expected.norm());
    }
  });
}

// Whatever the start, and the stiffness of terms there: at the x returned, stationarity() is in the
// tolerance.
TEST_P(EveryKind, ConvergedMeansStationaryAtX) {
  for_systems([](System& system, Rng& rng) {
    system.add_anchors(random_points(rng, system.dim(), kNodes), System::all(0.02));
    const MatrixXd start = random_points(rng, system.dim(), kNodes, 100);
    for (const std::string_view method : system_methods()) {
      MatrixXd x = start;
      AlignedOptions options;
      options.tolerance = 1e-6;
      options.max_iterations = 500;
      const Summary summary = solve(method, system, x, options);
      if (summary.status != Status::Converged) continue;
      EXPECT_LE(stationarity(system, x), options.tolerance * (1 + 1e-9)) << method << " " << summary;
      EXPECT_NEAR(summary.stationarity, stationarity(system, x), 1e-9 * options.tolerance) << method;
    }
  });
}

// All terms at once, with anchors that hold every node.
// The energy and the gradient of links by the formula of each, in long double; links of coincident nodes pull
// at none here, as their direction is a matter of choice.
long double sum_of_links(const Links& links, const MatrixXd& x,
                         Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>& gradient) {
  long double sum = 0;
  gradient.setZero(x.rows(), x.cols());
  const auto at = [](const MatrixXd& values, int e) {
    return static_cast<long double>(values(0, values.cols() == 1 ? 0 : e));
  };
  for (int e = 0; e < links.size(); ++e) {
    const int i = links.nodes()(0, e), j = links.nodes()(1, e);
    const Eigen::Matrix<long double, Eigen::Dynamic, 1> d =
        x.col(i).cast<long double>() - x.col(j).cast<long double>();
    const long double r = std::sqrt(d.squaredNorm()), mu = at(links.values("length"), e),
                      k = at(links.values("stiffness"), e);
    long double s = r - mu;
    if (links.law() == LinkLaw::Rope) s = std::max(s, 0.0L);
    if (links.law() == LinkLaw::Repulsion) s = std::min(s, 0.0L);
    if (links.law() == LinkLaw::Interval)
      s = std::min(s, 0.0L) + std::max(r - at(links.values("upper"), e), 0.0L);
    sum += k * s * s / 2;
    if (!(r > 0)) continue;
    gradient.col(i) += k * s / r * d;
    gradient.col(j) -= k * s / r * d;
  }
  return sum;
}

class SumOfLinks : public ::testing::TestWithParam<LinkLaw> {};

INSTANTIATE_TEST_SUITE_P(Terms, SumOfLinks,
                         ::testing::Values(LinkLaw::Hooke, LinkLaw::Rope, LinkLaw::Repulsion,
                                           LinkLaw::Interval));

// Links of all pairs are summed by rows of many at a time: rows of every length, with gaps, and in any order.
TEST_P(SumOfLinks, IsThatOfEachByItself) {
  enum Order { kInRows, kWithGaps, kShuffled, kOrders };
  for (const int dim : {1, 2, 3, 5, 10}) {
    for (const int n : {2, 6, 7, 8, 9, 10, 13, 33, 130}) {
      for (int order = 0; order < kOrders; ++order) {
        for (const double scale : {1.0, 1e-120, 1e120, 1e-160}) {
          for (const bool same : {false, true}) {
            Rng rng(static_cast<std::uint64_t>(n) * 10 + static_cast<std::uint64_t>(order));
            const Eigen::Matrix2Xi all = all_pairs(n);
            std::vector<int> chosen;
            for (int l = 0; l < all.cols(); ++l) {
              if (order != kWithGaps || rng.uniform(0, 1) < 0.9) chosen.push_back(l);
            }
            for (std::size_t l = 0; order == kShuffled && l < chosen.size(); ++l)
              std::swap(chosen[l],
                        chosen[static_cast<std::size_t>(rng.uniform(0, 1) * static_cast<double>(l))]);
            const Eigen::Matrix2Xi pairs = all(Eigen::all, chosen);
            MatrixXd x = scale * random_points(rng, dim, n);
            const bool is_coincident = n >= 9 && scale >= 1e-120;
            if (is_coincident) x.col(3) = x.col(7);
            Links links(dim);
            links.set_nodes(pairs);
            const Eigen::Index count = same ? 1 : pairs.cols();
            links.values("length") = scale * random_points(rng, 1, static_cast<int>(count)).cwiseAbs();
            links.values("upper") = 1.5 * links.values("length");
            links.values("stiffness") = random_points(rng, 1, static_cast<int>(count)).cwiseAbs();
            links.set_law(GetParam());

            MatrixXd gradient = MatrixXd::Zero(dim, n);
            const double energy = links.energy(x, &gradient);
            Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic> expected;
            const long double sum = sum_of_links(links, x, expected);
            const std::string where = std::to_string(dim) + " coordinates, " + std::to_string(n) +
                                      " nodes, order " + std::to_string(order) + ", scale " +
                                      std::to_string(std::log10(scale));
            // The stretch is a difference of lengths, which may be nearly as long.
            const double tolerance = static_cast<double>(sum) * 1e-13 + 1e-15 * scale * scale + 1e-320;
            EXPECT_NEAR(energy, static_cast<double>(sum), tolerance) << where;
            EXPECT_NEAR(links.energy(x, nullptr), static_cast<double>(sum), tolerance) << where;
            for (int i = 0; i < n; ++i) {
              if (is_coincident && (i == 3 || i == 7)) continue;
              EXPECT_LE((gradient.col(i) - expected.col(i).cast<double>()).norm(), 1e-12 * scale * 100 * n)
                  << where << ", node " << i;
            }
            EXPECT_LE(gradient.rowwise().sum().norm(), 1e-12 * scale * 100 * n * n) << where;
          }
        }
      }
    }
  }
}

// The same as elements come and go, with nodes that no link has.
TEST(LinksOfAllPairs, AreFollowedAsTheyComeAndGo) {
  Rng rng(5);
  const MatrixXd x = random_points(rng, 2, 14);
  Links links(2);
  links.set_nodes(all_pairs(10));
  links.values("length") = random_points(rng, 1, links.size()).cwiseAbs();
  links.values("stiffness") = random_points(rng, 1, links.size()).cwiseAbs();
  const auto expect_sum = [&](const char* after) {
    MatrixXd gradient = MatrixXd::Zero(2, 14);
    Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic> expected;
    const auto sum = static_cast<double>(sum_of_links(links, x, expected));
    EXPECT_NEAR(links.energy(x, &gradient), sum, 1e-13 * sum) << after;
    EXPECT_LE((gradient - expected.cast<double>()).norm(), 1e-12 * gradient.norm()) << after;
  };
  expect_sum("all pairs");
  const MatrixXd one = MatrixXd::Ones(1, 1);
  links.append(Eigen::Vector2i(2, 12), {{"length", one}, {"stiffness", one}});
  expect_sum("one more");
  links.remove(std::vector<int>{links.size() - 1});
  expect_sum("that one gone");
  links.remove(std::vector<int>{3});
  expect_sum("another gone");
  links.append(Eigen::Vector2i(0, 4), {{"length", one}, {"stiffness", one}});
  expect_sum("that one back, as the last");
  Eigen::MatrixXi turned = links.nodes();
  turned.row(0).swap(turned.row(1));
  links.set_nodes(turned);
  expect_sum("turned");
}

TEST(Terms, AppendAfterTheLastElementWasRemoved) {
  for (const int count : {1, 3}) {
    System system(5, 2);
    const Eigen::Matrix2Xi pairs = all_pairs(3).leftCols(count);
    Links& links = system.add_links(pairs, VectorXd::Constant(count, 3), VectorXd::Constant(count, 2));
    std::vector<int> all(static_cast<std::size_t>(count));
    std::iota(all.begin(), all.end(), 0);
    links.remove(all);
    links.append(Eigen::Vector2i(0, 4),
                 {{"stiffness", MatrixXd::Constant(1, 1, 7)}, {"length", MatrixXd::Constant(1, 1, 5)}});
    MatrixXd x = MatrixXd::Zero(2, 5);
    x(0, 4) = 4;
    EXPECT_EQ(links.size(), 1);
    EXPECT_DOUBLE_EQ(links.energy(x, nullptr), 3.5);
  }
}

TEST(Terms, AppendTheirOwnElements) {
  Rng rng(3);
  const MatrixXd x = random_points(rng, 2, 4);
  System system(4, 2);
  Links& links = system.add_links(all_pairs(3), random_values(rng, 3, 1, 2), random_values(rng, 3, 1, 2));
  const double once = links.energy(x, nullptr);
  links.append(links.nodes(), {{"length", links.values("length")}, {"stiffness", links.values("stiffness")}});
  EXPECT_EQ(links.size(), 6);
  EXPECT_NEAR(links.energy(x, nullptr), 2 * once, 1e-12 * once);
}

TEST(Terms, AppendToASingleElement) {
  System system(4, 2);
  CommonLength& limbs = system.add_common_length(Eigen::Vector2i(0, 1), System::all(2), 3, 0.5);
  limbs.append(Eigen::Vector2i(2, 3), {});  // there is one prior for all
  EXPECT_EQ(limbs.defect(4), "");
  System expected(4, 2);
  Eigen::Matrix2Xi pairs(2, 2);
  pairs << 0, 2, 1, 3;
  Rng rng(4);
  const MatrixXd x = random_points(rng, 2, 4);
  EXPECT_EQ(limbs.energy(x, nullptr),
            expected.add_common_length(pairs, System::all(2), 3, 0.5).energy(x, nullptr));
}

TEST(Terms, StayAsTheyAreIfWrongElementsAreAppended) {
  System system(4, 2);
  Links& links = system.add_links(all_pairs(3), VectorXd::Constant(3, 5), System::all(2));
  const Eigen::Vector2i pair(0, 3);
  const MatrixXd one = MatrixXd::Ones(1, 1);
  EXPECT_THROW(links.append(pair, {}), std::invalid_argument);
  EXPECT_THROW(links.append(pair, {{"lenght", one}}), std::invalid_argument);
  EXPECT_THROW(links.append(pair, {{"length", one}, {"stiffness", one}}), std::invalid_argument);
  EXPECT_THROW(links.append(pair, {{"length", MatrixXd::Ones(1, 2)}}), std::length_error);
  EXPECT_THROW(links.append(pair, {{"length", MatrixXd::Ones(2, 1)}}), std::length_error);
  EXPECT_THROW(links.append(Eigen::Vector3i(0, 1, 2), {{"length", one}}), std::length_error);
  EXPECT_EQ(links.size(), 3);
  EXPECT_EQ(links.values("length"), MatrixXd::Constant(1, 3, 5));
}

System mixture(Rng& rng, int dim, bool smooth) {
  System system(kNodes, dim);
  for (const Kind& kind : kinds()) {
    const std::string name = kind.name;
    if (!smooth || (name != "angles" && name != "areas" && name.find("truncated") == std::string::npos))
      kind.add(system, rng);
  }
  system.add_anchors(random_points(rng, dim, kNodes), System::all(2));
  return system;
}

TEST(SystemMethods, AllStopAtStationaryPointsOfAnyMixture) {
  int converged = 0, solves = 0;
  for (const int dim : {2, 3, 4}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      Rng rng(seed);
      const System system = mixture(rng, dim, false);
      const MatrixXd start = random_points(rng, dim, kNodes);
      for (const std::string_view method : system_methods()) {
        SCOPED_TRACE(::testing::Message() << method << ", dimension " << dim << ", seed " << seed);
        MatrixXd x = start;
        AlignedOptions options;
        options.max_iterations = 500;
        const Summary summary = solve(method, system, x, options);
        if (method == "ida" || method == "staircase") {  // with angles, and areas or loads
          EXPECT_EQ(summary.status, Status::InvalidInput);
          EXPECT_EQ(x, start);
          continue;
        }
        // Angles and lengths have kinks, at which no method can meet the tolerance.
        EXPECT_TRUE(summary.usable()) << summary;
        converged += summary.status == Status::Converged ? 1 : 0;
        ++solves;
        EXPECT_LE(summary.final_energy, energy(system, start));
        EXPECT_EQ(summary.final_energy, energy(system, x));
        MatrixXd gradient;
        energy_and_gradient(system, x, gradient);
        EXPECT_NEAR(summary.gradient_norm, gradient.norm(), 1e-12 * (1 + gradient.norm()));
      }
    }
  }
  EXPECT_GE(converged, solves * 9 / 10) << "of " << solves;
}

TEST(SystemMethods, FindTheMinimumOfAConvexSystem) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Rng rng(seed);
    const int dim = 1 + static_cast<int>(seed % 4);
    System system(kNodes, dim);
    anchors(system, rng);
    system.add_anchors(random_points(rng, dim, kNodes), System::all(0.3)).set_loss(Loss::Huber, 2);
    system.add_differences(random_elements(rng, kNodes, 3, 5), System::all(2));
    Offsets& offsets =
        system.add_offsets(random_elements(rng, kNodes, 2, 7), random_points(rng, dim, 7), System::all(0.7));
    offsets.values("information") = random_shapes(rng, dim, 7, false);
    double least = std::numeric_limits<double>::infinity();
    for (const std::string_view method : system_methods()) {
      MatrixXd x = random_points(rng, dim, kNodes, 50);
      const Summary summary = solve(method, system, x);
      EXPECT_EQ(summary.status, Status::Converged) << method << " " << summary;
      if (!std::isfinite(least)) least = summary.final_energy;
      EXPECT_NEAR(summary.final_energy, least, 1e-9 * least) << method;
    }
  }
}

// The same springs, of both kinds of systems.
TEST(SystemTie, AgreesWithSpringSystem) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Rng rng(seed);
    const int n = 2 + static_cast<int>(seed % 7);
    SpringSystem<double, 2> springs(Topology<>::full(n));
    springs.anchors = random_points(rng, 2, n, 30);
    springs.set_rest_lengths(random_points(rng, 2, n, 30));
    springs.link_stiffness = random_values(rng, springs.link_count(), 0.1, 3);
    springs.anchor_stiffness = random_values(rng, n, 0.01, 1);
    if (seed % 3 == 0) springs.fix(0);
    if (seed % 4 == 0) springs.loads = random_points(rng, 2, n, 1);
    System system(n, 2);
    system.add_anchors(springs.anchors, springs.anchor_stiffness);
    system.add_links(all_pairs(n), springs.rest_length, springs.link_stiffness);
    if (seed % 3 == 0) system.fix(0);
    if (seed % 4 == 0) system.add_loads(Eigen::RowVectorXi::LinSpaced(n, 0, n - 1), springs.loads);
    const MatrixXd start = random_points(rng, 2, n, 30);
    const SpringSystem<double, 2>::Points at = start;
    EXPECT_NEAR(energy(system, start), energy(springs, at), 1e-12 * energy(springs, at));
    MatrixXd gradient;
    energy_and_gradient(system, start, gradient);
    EXPECT_LE((gradient - asterism::gradient(springs, at)).norm(), 1e-12 * gradient.norm());
    EXPECT_NEAR(characteristic_length(system, start), characteristic_length(springs, at), 1e-12 * 100);
    EXPECT_NEAR(stationarity(system, start), stationarity(springs, at), 1e-12 * stationarity(springs, at));
    MatrixXd x = start;
    SpringSystem<double, 2>::Points y = start;
    const Summary summary = solve(system, x);
    Lbfgs<SpringSystem<double, 2>>().solve(springs, y);
    ASSERT_EQ(summary.status, Status::Converged) << summary;
    // From the same start they may find different minima: each is one of the other's as well.
    EXPECT_LE(stationarity(springs, SpringSystem<double, 2>::Points(x)), 1e-7);
    EXPECT_LE(stationarity(system, y), 1e-7);
    const Certificate ours = certify(system, x),
                      theirs = certify(springs, SpringSystem<double, 2>::Points(x));
    if (ours.certified()) {
      EXPECT_LE(ours.energy, energy(system, y) * (1 + 1e-9));
    }
    EXPECT_TRUE(!ours.certified() || theirs.proof != Proof::NotCertified);
    if (const Solution solution(system, x); solution) {
      const auto expected = covariance(springs, SpringSystem<double, 2>::Points(x));
      if (expected.status == CovarianceStatus::Computed) {
        EXPECT_LE((solution.joint_covariance() - expected.matrix).norm(), 1e-9 * expected.matrix.norm());
      }
    }
  }
}

// Algorithm 1 of the paper, for both kinds of systems, in dimensions and sizes that terms solve in other
// ways.
template <int kDim>
void expect_the_steps_of_ida() {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    for (const double relaxation : {1.0, 1.7}) {
      SCOPED_TRACE(::testing::Message() << kDim << "-D, seed " << seed << ", relaxation " << relaxation);
      Rng rng(seed);
      const int n = seed % 4 == 0 ? 30 : 2 + static_cast<int>(seed);
      SpringSystem<double, kDim> springs(Topology<>::full(n));
      springs.anchors = random_points(rng, kDim, n, 30);
      springs.set_rest_lengths(random_points(rng, kDim, n, 30));
      springs.link_stiffness = random_values(rng, springs.link_count(), 0.1, 3);
      springs.anchor_stiffness = random_values(rng, n, 0.01, 1);
      if (seed % 3 == 0) springs.fix(0);
      const MatrixXd start = random_points(rng, kDim, n, 30);
      MatrixXd x = start;
      typename SpringSystem<double, kDim>::Points y = start;
      AnySolver<System> ida =
          system_solvers().make("ida", {{"relaxation", relaxation}, {"max_iterations", 40}});
      IdaOptions options;
      options.relaxation = relaxation;
      options.max_iterations = 40;
      const Summary ours = ida.solve(to_system(springs), x), theirs = Ida(springs, options).solve(springs, y);
      EXPECT_EQ(ours.iterations, theirs.iterations);
      EXPECT_EQ(ours.status, theirs.status);
      EXPECT_LE((x - y).cwiseAbs().maxCoeff(), 1e-9);
      EXPECT_EQ(x.col(0) == start.col(0), seed % 3 == 0);
    }
  }
}
TEST(SystemTie, IdaTakesTheStepsOfThePaper) {
  expect_the_steps_of_ida<1>();
  expect_the_steps_of_ida<2>();
  expect_the_steps_of_ida<3>();
}

TEST(SystemSolution, CovarianceIsTheInverseOfTheHessian) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Rng rng(seed);
    const int dim = 2 + static_cast<int>(seed % 2);
    System system = mixture(rng, dim, true);
    if (seed % 2 == 0) system.fix(1);
    MatrixXd x = random_points(rng, dim, kNodes);
    ASSERT_TRUE(solve(system, x).usable());
    const Solution solution(system, x);
    MatrixXd inverse = testing::inverse(hessian(system, x));
    if (!solution) continue;
    if (seed % 2 == 0) inverse.middleRows(dim, dim).setZero();
    const MatrixXd joint = solution.joint_covariance(), blocks = solution.covariances();
    EXPECT_LE((joint - inverse).norm(), 1e-9 * inverse.norm());
    for (int i = 0; i < kNodes; ++i) {
      EXPECT_LE((solution.covariance(i) - joint.block(dim * i, dim * i, dim, dim)).norm(),
                1e-12 * joint.norm());
      EXPECT_LE((blocks.middleCols(dim * i, dim) - solution.covariance(i)).norm(), 1e-12 * joint.norm());
    }
    EXPECT_THROW(solution.covariance(kNodes), std::out_of_range);
  }
}

// Links at rest between n nodes in a random order, so that the matrix of the anchors' minimum is positive
// definite; `shape` says which.
System at_rest(Rng& rng, int dim, int n, const std::string& shape, MatrixXd& x) {
  std::vector<int> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), 0);
  for (int i = n; i-- > 1;)
    std::swap(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(rng.uniform(0, i + 1))]);
  std::vector<std::pair<int, int>> pairs;
  const auto link = [&](int a, int b) {
    if (a >= 0 && a != b)
      pairs.emplace_back(order[static_cast<std::size_t>(a)], order[static_cast<std::size_t>(b)]);
  };
  const int side = static_cast<int>(std::sqrt(n));
  for (int i = 1; i < n; ++i) {
    if (shape == "chain") link(i - 1, i);
    if (shape == "star") link(0, i);
    if (shape == "tree") link((i - 1) / 2, i);
    if (shape == "two chains") link(i - 2, i);
    if (shape == "grid" && i % side > 0) link(i - 1, i);
    if (shape == "grid") link(i - side, i);
    if (shape == "random") link(static_cast<int>(rng.uniform(0, i)), i);
    if (shape == "random" && i % 3 > 0) link(static_cast<int>(rng.uniform(0, i)), i);
  }
  x = random_points(rng, dim, n);
  System system(n, dim);
  system.add_anchors(x, System::all(0.5));
  Eigen::Matrix2Xi nodes(2, static_cast<Eigen::Index>(pairs.size()));
  Eigen::VectorXd lengths(nodes.cols());
  for (Eigen::Index l = 0; const auto& [a, b] : pairs) {
    nodes.col(l) << a, b;
    lengths[l++] = (x.col(a) - x.col(b)).norm();
  }
  system.add_links(nodes, lengths, System::all(3));
  return system;
}

// Factors of sparse matrices, of a few rows to some hundred, against those of dense ones.
TEST(SystemSolution, SparseFactorsOfAllShapes) {
  for (const std::string shape : {"none", "chain", "star", "tree", "two chains", "grid", "random"}) {
    for (const int dim : {1, 2, 3, 4}) {
      for (const int n : {1, 2, 3, 5, 9, 16, 90}) {
        SCOPED_TRACE(::testing::Message() << shape << ", " << dim << "-D, " << n << " nodes");
        Rng rng(static_cast<std::uint64_t>(100 * dim + n));
        MatrixXd x;
        System system = at_rest(rng, dim, n, shape, x);
        const bool has_fixed = n > 2 && dim % 2 == 0;
        if (has_fixed) system.fix(n / 2);
        const Solution solution(system, x);
        ASSERT_TRUE(solution) << solution.problem();
        const MatrixXd H = hessian(system, x);
        MatrixXd inverse = testing::inverse(H);
        if (has_fixed) inverse.middleRows(dim * (n / 2), dim).setZero();
        const MatrixXd blocks = solution.covariances();
        EXPECT_LE((solution.joint_covariance() - inverse).norm(), 1e-11 * inverse.norm());
        for (int i = 0; i < n; ++i) {
          const auto block = inverse.block(dim * i, dim * i, dim, dim);
          EXPECT_LE((blocks.middleCols(dim * i, dim) - block).norm(), 1e-11 * inverse.norm());
        }
        EXPECT_NEAR(solution.log_determinant(),
                    2 * Eigen::LLT<MatrixXd>(H).matrixL().toDenseMatrix().diagonal().array().log().sum(),
                    1e-10 * dim * n);
      }
    }
  }
}

// Two parts that turn about each other freely, and a system without anchors.
TEST(SystemSolution, FreeMotionsHaveNoCovariance) {
  System system(2, 2);
  system.add_anchors(Eigen::RowVectorXi::Constant(1, 0), Eigen::Vector2d(1, 2), System::all(1));
  system.add_links(all_pairs(2), System::all(5), System::all(1));
  MatrixXd x(2, 2);
  x << 1, 4, 2, 6;
  const Summary summary = solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_EQ(summary.positive_definite, false);
  const Solution solution(system, x);
  EXPECT_FALSE(solution);
  EXPECT_THROW(solution.covariance(0), std::logic_error);
  EXPECT_EQ(certify(system, x).proof, Proof::GlobalMinimum) << "one of many, as its energy is 0";
}

// A shape that is free to turn about one place, as far as a loose tolerance leaves it there; and one that
// anchors hold, however weakly.
TEST(SystemSolution, IsNoneOfAShapeThatIsFreeToTurn) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Rng rng(seed);
    const int dim = seed % 2 == 0 ? 2 : 3;
    const MatrixXd shape = random_points(rng, dim, 5, 20);
    const auto stretched = [&](const MatrixXd& places, double stiffness) {
      System system(5, dim);
      system.add_anchors(places, System::all(stiffness));
      system.add_links(all_pairs(5), 1.1 * lengths_at(shape, all_pairs(5)), random_values(rng, 10, 0.5, 2));
      return system;
    };
    for (const std::string_view method : {"lbfgs", "newton", "newton-cg"}) {
      AlignedOptions options;
      options.tolerance = 1e-7;
      const System free = stretched(MatrixXd::Zero(dim, 5), 0.1);
      MatrixXd x = shape;
      ASSERT_EQ(solve(method, free, x, options).status, Status::Converged) << method << ", seed " << seed;
      EXPECT_FALSE(Solution(free, x)) << method << ", seed " << seed;
      const System held = stretched(shape, 1e-3);
      x = shape;
      ASSERT_EQ(solve(method, held, x, options).status, Status::Converged) << method << ", seed " << seed;
      const Solution solution(held, x);
      EXPECT_TRUE(solution) << solution.problem() << ", " << method << ", seed " << seed;
    }
  }
}

// No certified placement lies above what many starts find; a chain of offsets and anchors is always
// certified.
TEST(SystemSolution, CertifiedMinimaAreGlobal) {
  int certified = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Rng rng(seed);
    System system(5, 2);
    system.add_anchors(random_points(rng, 2, 5, 20), random_values(rng, 5, 0.05, 0.5));
    system.add_links(all_pairs(5), random_values(rng, 10, 5, 40), System::all(1));
    if (seed % 2 == 0) system.add_differences(random_elements(rng, 5, 3, 3), System::all(0.5));
    MatrixXd x = random_points(rng, 2, 5, 20);
    ASSERT_TRUE(solve(system, x).usable());
    const Certificate certificate = certify(system, x);
    certified += certificate.certified() ? 1 : 0;
    AnySolver<System> starts = system_solvers().make("multi-start", {{"starts", 40}, {"spread", 2.0}});
    MatrixXd y = x;
    const Summary lowest = starts.solve(system, y);
    if (certificate.certified()) {
      EXPECT_GE(lowest.final_energy, certificate.lower_bound - 1e-12 * certificate.energy);
      EXPECT_LE((x - y).colwise().norm().maxCoeff(), certificate.distance + 1e-6);
    }
  }
  EXPECT_GE(certified, 10);
  System truncated(2, 2);
  truncated.add_anchors(MatrixXd::Zero(2, 2), System::all(1));
  truncated.add_links(all_pairs(2), System::all(3), System::all(1)).set_loss(Loss::Huber, 1);
  const Certificate refused = certify(truncated, MatrixXd::Identity(2, 2));
  EXPECT_EQ(refused.proof, Proof::NotApplicable);
  EXPECT_NE(std::string(std::string_view(refused.reason)).find("links"), std::string::npos);
}

TEST(SystemSolution, CertifiesAPlacementWithoutStrain) {
  const MatrixXd square{{0, 10, 0, 10}, {0, 0, 10, 10}};
  System system(4, 2);
  system.add_anchors(square, System::all(1));
  system.add_links(all_pairs(4), lengths_at(square, all_pairs(4)), System::all(1));
  EXPECT_TRUE(certify(system, square).certified());
  MatrixXd x = square + MatrixXd::Constant(2, 4, 0.3);
  EXPECT_TRUE(solve(system, x).usable());
  EXPECT_TRUE(certify(system, x).certified()) << certify(system, x);
}

TEST(SystemSolution, CommonLengthIsTheWeightedMeanAndMinimisesJointly) {
  Rng rng(3);
  System system(4, 2);
  CommonLength& limbs = system.add_common_length(all_pairs(4), random_values(rng, 6, 0.1, 2));
  const MatrixXd x = random_points(rng, 2, 4);
  const VectorXd r = lengths_at(x, all_pairs(4)), k = limbs.values("stiffness").transpose();
  EXPECT_NEAR(limbs.estimate(x), r.dot(k) / k.sum(), 1e-12);
  limbs.set_loss(Loss::Huber, 0.5);
  const double best = energy(system, x);
  for (const double b : {0.0, 1.0, 5.0, limbs.estimate(x) + 1e-3, limbs.estimate(x) - 1e-3}) {
    System fixed(4, 2);
    fixed.add_links(all_pairs(4), System::all(b), k).set_loss(Loss::Huber, 0.5);
    EXPECT_GE(energy(fixed, x), best - 1e-12);
  }
}

template <typename Springs>
void expect_same(const Springs& springs, const MatrixXd& x) {
  const typename Springs::Points at = x;
  const System system = to_system(springs);
  ASSERT_EQ(validate(system, x), "");
  MatrixXd gradient;
  const double e = energy_and_gradient(system, x, gradient);
  EXPECT_NEAR(e, energy(springs, at), 1e-12 * std::abs(e));
  EXPECT_LE((gradient - asterism::gradient(springs, at)).norm(), 1e-11 * gradient.norm());
  EXPECT_LE((hessian(system, x) - hessian(springs, at)).norm(), 1e-11 * hessian(springs, at).norm());
  EXPECT_NEAR(stationarity(system, x), stationarity(springs, at), 1e-11 * stationarity(springs, at));
}

template <typename Model, int Dim = 2>
void expect_same_model(const Model& model, std::uint64_t seed) {
  Rng rng(seed);
  SpringSystem<double, Dim, Eigen::Dynamic, Eigen::Dynamic, Model> springs(Topology<>::full(5));
  static_cast<void>(model);
  springs.anchors = random_points(rng, Dim, 5);
  springs.anchor_stiffness = random_values(rng, 5, 0.1, 1);
  springs.rest_length = random_values(rng, 10, 2, 15);
  springs.link_stiffness = random_values(rng, 10, 0.1, 1);
  if constexpr (requires { springs.anchor_loss.scale; }) springs.anchor_loss.scale = 4;
  if constexpr (requires { springs.link_potential.loss.scale; }) springs.link_potential.loss.scale = 3;
  for (int i = 0; i < 5; ++i) {
    if constexpr (requires { springs.anchor_shape.cols(); }) {
      const MatrixXd root = random_points(rng, Dim, Dim, 1);
      springs.set_anchor_information(i, Eigen::Matrix<double, Dim, Dim>(root * root.transpose()));
    }
  }
  if (seed % 2 == 0) springs.rest_offset = random_points(rng, Dim, 10, 3);
  if (seed % 3 == 0) springs.loads = random_points(rng, Dim, 5, 1);
  expect_same(springs, random_points(rng, Dim, 5));
}

// However weak a link is beside the anchors of its nodes, they are linked.
TEST(SystemTie, LengthsAreThoseOfSpringsWithWeakLinks) {
  for (const double weakness : {1.0, 1e-9, 1e-13, 1e-15}) {
    SpringSystem<double, 2> springs(Topology<>::full(2));
    springs.anchors << 0, 10, 0, 0;
    springs.anchor_stiffness.setOnes();
    springs.rest_length.setConstant(3);
    springs.link_stiffness.setConstant(weakness);
    const SpringSystem<double, 2>::Points x = springs.anchors;
    EXPECT_NEAR(characteristic_length(to_system(springs), MatrixXd(x)), characteristic_length(springs, x),
                1e-12)
        << weakness;
  }
}

TEST(SystemTie, TakesEveryModel) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    expect_same_model(Model<>(), seed);
    expect_same_model<Model<>, 3>(Model<>(), seed);
    expect_same_model(Model<Rope, Huber>(), seed);
    expect_same_model(Model<Repulsion, Truncated>(), seed);
    expect_same_model(Model<RobustHooke<GemanMcClure>, Huber>(), seed);
    expect_same_model(Model<Hooke, GemanMcClure, AnchorShape::Anisotropic>(), seed);
  }
}

// A law with a name is one for Term::choose, and stays out of others' way.
TEST(SystemTie, ALawWithANameIsAsTheLibrarysOwn) {
  add_link_law(
      "a second hooke",
      [](std::size_t count, const double* r, const double* rest, double* value, double* first,
         double* second) {
        for (std::size_t l = 0; l < count; ++l) {
          first[l] = r[l] - rest[l];
          value[l] = first[l] * first[l] / 2;
          second[l] = 1;
        }
      },
      true);
  EXPECT_THROW(add_link_law("a second hooke", {}), std::invalid_argument);
  EXPECT_THROW(add_link_law("rope", {}), std::invalid_argument);
  Rng rng(1);
  System system(kNodes, 2);
  Links& term = links(system, rng);
  system.add_anchors(random_points(rng, 2, kNodes), System::all(1));
  const MatrixXd x = random_points(rng, 2, kNodes);
  const double expected = energy(system, x);
  const MatrixXd curvature = hessian(system, x, Curvature::Minorising);
  term.choose("law", "a second hooke");
  EXPECT_EQ(term.chosen("law"), "a second hooke");
  EXPECT_NEAR(energy(system, x), expected, 1e-12 * expected);
  EXPECT_LE((hessian(system, x, Curvature::Minorising) - curvature).norm(), 1e-12 * curvature.norm());
  EXPECT_EQ(energy(System(system), x), energy(system, x));
}

// A triangle with next to no height h, turned in space: what leaves its plane has the curvature that follows
// from area = |a x b| / 2 and from the angle's, by hand.
TEST(SystemTriangles, NextToALine) {
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -2).normalized()).toRotationMatrix();
  for (const double h : {1e-2, 1e-4, 1e-6}) {
    Eigen::Matrix3d corners{{0, 1, 2}, {0, 0, h}, {0, 0, 0}};
    const MatrixXd x = turn * corners;
    for (const bool is_area : {true, false}) {
      // s = 0 but for a rest of -1, so that the Hessian is g g^T + d2 f.
      System system(3, 3);
      const double f = is_area ? h / 2 : std::atan2(h, 2);
      const Eigen::Matrix3Xi nodes = is_area ? Eigen::Vector3i(0, 1, 2) : Eigen::Vector3i(1, 0, 2);
      if (is_area) {
        system.add_areas(nodes, System::all(0), System::all(1));
      } else {
        system.add_angles(nodes, System::all(0), System::all(1));
      }
      // Node 1 along z: a = (1, 0, 0), b = (2, h, 0); the gradient has no z.
      const Eigen::Vector3d z = turn.col(2);
      const MatrixXd all = hessian(system, x);
      const double along_z = z.dot(all.block<3, 3>(3, 3) * z);
      const double expected = is_area ? f * (4 + h * h) / (2 * h) : f * 2 / h;
      EXPECT_NEAR(along_z, expected, 1e-8 * expected) << h << (is_area ? " area" : " angle");
    }
  }
}

// On a line nothing is across, however near the nodes are: k, and for an estimated length k less its share.
TEST(SystemLine, HasNoCurvatureAcross) {
  MatrixXd x(1, 2);
  x << 0.3, 0.3 + 1e-12;
  System system(2, 1);
  system.add_links(all_pairs(2), System::all(5), System::all(0.7));
  EXPECT_LE((hessian(system, x) - MatrixXd{{0.7, -0.7}, {-0.7, 0.7}}).cwiseAbs().maxCoeff(), 1e-14);
  System estimated(2, 1);
  estimated.add_common_length(all_pairs(2), System::all(0.7), 5, 0.3);  // k p / (k + p)
  EXPECT_LE((hessian(estimated, x) - MatrixXd{{0.21, -0.21}, {-0.21, 0.21}}).cwiseAbs().maxCoeff(), 1e-14);
}

// The paper's line: nodes that start on a line leave it, and a triangle does not stay flat.
TEST(SystemMethods, NewtonLeavesALine) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Rng rng(seed);
    const int n = 3 + static_cast<int>(seed % 8);
    System system(n, 2);
    MatrixXd flat = random_points(rng, 2, n);
    flat.row(1).setZero();
    system.add_anchors(flat, System::all(0.01));
    system.add_links(all_pairs(n), System::all(5), System::all(1));
    MatrixXd x = flat;
    const Summary summary = solve("newton", system, x);
    EXPECT_EQ(summary.status, Status::Converged) << summary;
    EXPECT_EQ(summary.positive_definite, true) << summary;
    EXPECT_GT(x.row(1).cwiseAbs().maxCoeff(), 1);
  }
}

// The second start is from the anchors; the result is the best of all starts, and the same each time.
TEST(SystemMethods, AutoChoosesByUnknownsAndLinks) {
  const auto chosen = [](int nodes, const Eigen::Matrix2Xi& pairs, LinkLaw law) {
    Rng rng(1);
    const MatrixXd places = random_points(rng, 2, nodes);
    System system(nodes, 2);
    system.add_anchors(places, System::all(0.1));
    system.add_links(pairs, System::all(5), System::all(1)).set_law(law);
    MatrixXd x = places;
    return solve(system, x).solver;
  };
  EXPECT_EQ(chosen(32, all_pairs(32), LinkLaw::Hooke), "Newton, sparse LDL^T");
  EXPECT_EQ(chosen(33, all_pairs(33), LinkLaw::Hooke), "L-BFGS");
  EXPECT_EQ(chosen(33, all_pairs(33).leftCols(33 * 32 / 6), LinkLaw::Hooke), "L-BFGS");
  EXPECT_EQ(chosen(33, all_pairs(33).leftCols(33 * 32 / 6 - 1), LinkLaw::Hooke), "Newton-CG");
  EXPECT_EQ(chosen(33, all_pairs(33), LinkLaw::Logarithm), "Newton-CG") << "nothing to start L-BFGS from";
}

TEST(SystemMethods, MultiStartIsTheBestOfItsStarts) {
  int gained = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Rng rng(seed);
    System system(8, 2);
    const MatrixXd seen = random_points(rng, 2, 8), start = random_points(rng, 2, 8);
    system.add_anchors(seen, System::all(0.05));
    system.add_links(all_pairs(8), lengths_at(random_points(rng, 2, 8), all_pairs(8)), System::all(1));
    if (seed % 3 == 0) system.fix(2);
    MatrixXd from_start = start, from_anchors = seen;
    if (seed % 3 == 0) from_anchors.col(2) = start.col(2);
    const double alone =
        std::min(solve(system, from_start).final_energy, solve(system, from_anchors).final_energy);
    double before = std::numeric_limits<double>::infinity();
    for (const int starts : {2, 20, 20}) {
      AnySolver<System> solver = system_solvers().make("multi-start", {{"starts", starts}});
      MatrixXd x = start;
      const Summary summary = solver.solve(system, x);
      EXPECT_TRUE(summary.usable()) << summary;
      EXPECT_EQ(summary.initial_energy, energy(system, start));
      if (starts == 2) {
        EXPECT_NEAR(summary.final_energy, alone, 1e-9 * alone);
      }
      EXPECT_LE(summary.final_energy, before * (1 + 1e-12));
      gained += starts == 20 && summary.final_energy < before * (1 - 1e-6);
      before = summary.final_energy;
      if (seed % 3 == 0) {
        EXPECT_EQ(x.col(2), start.col(2));
      }
    }
  }
  EXPECT_GT(gained, 3);
}

// A valid system is solved from its start where the changed parameters of graduated losses leave the range of
// a double.
struct Extreme {
  const char* name;
  double scale, sharpness;  // GemanMcClure's loss without sharpness
};
std::ostream& operator<<(std::ostream& out, const Extreme& extreme) { return out << extreme.name; }

class GraduatedSolves : public ::testing::TestWithParam<Extreme> {};

INSTANTIATE_TEST_SUITE_P(Numbers, GraduatedSolves,
                         ::testing::Values(Extreme{"widest_scale", 1e307, 0},
                                           Extreme{"narrowest_scale", 1e-200, 0},
                                           Extreme{"least_sharpness", 3, 5e-324}),
                         [](const auto& test) { return test.param.name; });

TEST_P(GraduatedSolves, WhateverTheParameters) {
  System system(2, 2);
  MatrixXd seen = MatrixXd::Identity(2, 2);
  system.add_anchors(seen, System::all(1));
  seen(0, 0) = 5;
  Anchors& robust = system.add_anchors(seen, System::all(1));
  const bool is_truncated = GetParam().sharpness > 0;
  robust.set_loss(is_truncated ? Loss::Truncated : Loss::GemanMcClure, GetParam().scale,
                  GetParam().sharpness);
  if (!is_truncated) robust.values("sharpness").resize(0, 0);
  MatrixXd x = MatrixXd::Zero(2, 2);
  const double before = energy(system, x);
  const Summary summary = solve("graduated", system, x);
  EXPECT_EQ(summary.status, Status::Converged) << summary;
  EXPECT_LE(summary.final_energy, before);
  EXPECT_EQ(summary.initial_energy, before);
}

TEST(SystemMethods, GraduatedTellsTheEnergyOfTheStart) {
  System system(2, 2);
  system.add_anchors(MatrixXd::Constant(2, 2, 10), System::all(1)).set_loss(Loss::GemanMcClure, 3);
  system.add_anchors(MatrixXd::Constant(2, 2, 10), System::all(1));
  system.add_loads(Eigen::RowVectorXi::Constant(1, 0), Eigen::Vector2d(100, 100));
  MatrixXd x = MatrixXd::Constant(2, 2, 10);
  const double before = energy(system, x);  // the loads', -2000
  EXPECT_EQ(solve("graduated", system, x).initial_energy, before);
}

// Where nodes coincide and no length is at rest, forces tell how far there is to go: the start is no minimum.
TEST(SystemMethods, LeaveAStartWithoutExtent) {
  const Eigen::Vector2d goal(3, -4);
  const auto square = [&](const MatrixXd& points, const MatrixXd&, bool second, ElementValues& values) {
    values.gradient = points.colwise() - goal;
    values.energy = values.gradient.colwise().squaredNorm() / 2;
    if (second) values.second = MatrixXd::Identity(2, 2).reshaped();
  };
  for (const bool has_second : {true, false}) {
    System system(1, 2);
    system.add_elements(Eigen::RowVectorXi::Zero(1), square, has_second);
    for (const std::string_view method : system_methods()) {
      const bool needs_second = method.starts_with("newton") || method.starts_with("schwarz");
      if (method == "ida" || method == "staircase" || (needs_second && !has_second)) continue;
      MatrixXd x = Eigen::Vector2d(1, 1);
      const Summary summary = solve(method, system, x);
      EXPECT_EQ(summary.status, Status::Converged) << method << " " << summary;
      EXPECT_LE((x - goal).norm(), 1e-6) << method;
    }
  }
  System system(3, 2);
  Differences& sums = system.add_differences(Eigen::Vector3i(0, 1, 2), System::all(1));
  sums.values("target") = goal;
  sums.values("b").setConstant(1);
  MatrixXd x = MatrixXd::Zero(2, 3);
  EXPECT_EQ(solve(system, x).status, Status::Converged);
  EXPECT_LE((x.rowwise().sum() - goal).norm(), 1e-6);
}

// Forces of 1e160, whose squares overflow.
TEST(SystemMethods, SummariesAreFinite) {
  System system(2, 2);
  system.add_anchors(MatrixXd::Identity(2, 2) * 1e60, System::all(1e100));
  for (const std::string_view method : system_methods()) {
    MatrixXd x = MatrixXd::Constant(2, 2, 2e60);
    AlignedOptions options;
    options.max_iterations = 0;
    const Summary summary = solve(method, system, x, options);
    ASSERT_TRUE(summary.usable()) << method << " " << summary;
    EXPECT_TRUE(std::isfinite(summary.gradient_norm)) << method;
    if (method == "multi-start") continue;  // has other starts
    EXPECT_NEAR(summary.gradient_norm, std::sqrt(10) * 1e160, 1e148) << method;
  }
}

// Information that rounding has left a little short of semi-definite does not make energies negative.
TEST(SystemMethods, EnergyOfARayIsNotNegative) {
  System system(1, 2);
  system.add_anchors(MatrixXd::Zero(2, 1), System::all(1)).values("information") =
      Eigen::Vector4d(1, 1, 1, 1 - 1e-15);
  ASSERT_EQ(validate(system, MatrixXd::Zero(2, 1)), "");
  EXPECT_EQ(energy(system, Eigen::Vector2d(1e9, -1e9)), 0);
}

TEST(SystemSolution, IsRefusedWhereItsNumbersWouldOverflow) {
  System system(2, 2);
  system.add_anchors(MatrixXd::Identity(2, 2), System::all(5e-324));
  const MatrixXd x = MatrixXd::Identity(2, 2);
  EXPECT_EQ(Solution(system, x).problem(), "the Hessian leaves the range of a double");
  const Certificate certificate = certify(system, 2 * x);
  EXPECT_FALSE(std::isnan(certificate.lower_bound) || std::isnan(certificate.distance)) << certificate;
  // A loss that is so narrow that its square is 0 has no force, and no NaN.
  System narrow(2, 2);
  narrow.add_anchors(MatrixXd::Identity(2, 2), System::all(1));
  narrow.add_anchors(MatrixXd::Identity(2, 2), System::all(1)).set_loss(Loss::GemanMcClure, 1e-200);
  EXPECT_EQ(hessian(narrow, 2 * x), MatrixXd(MatrixXd::Identity(4, 4)));
}

// Nodes that coincide are on a peak of a link that pushes: the forces in balance there are no minimum.
TEST(SystemSolution, APeakIsNotCertified) {
  for (const bool is_swapped : {false, true}) {
    System system(2, 1);
    const double side = is_swapped ? -1 : 1;
    system.add_anchors(MatrixXd{{-side, side}}, System::all(1));
    system.add_links(all_pairs(2), System::all(1), System::all(1));
    const Certificate certificate = certify(system, MatrixXd::Zero(1, 2));
    EXPECT_FALSE(certificate.certified()) << certificate;
    EXPECT_LE(certificate.lower_bound, 1.0 / 6);  // at -2/3 and 2/3: 1/9 + 1/18
  }
}

// The least energies by hand, in long double: rounding makes no bound too high.
TEST(SystemSolution, BoundsAllowForRounding) {
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    Rng rng(seed);
    {  // far from the origin, with loads that all but cancel
      System system(1, 1);
      const double at = rng.uniform(1e8, 1e9), pull = rng.uniform(1, 1000), rest = rng.uniform(-1, 1);
      system.add_anchors(MatrixXd::Constant(1, 1, at), System::all(1));
      system.add_loads(Eigen::RowVectorXi::Zero(2), MatrixXd{{pull, rest - pull}});
      const long double sum = static_cast<long double>(pull) + (rest - pull);
      MatrixXd x = MatrixXd::Constant(1, 1, at);
      solve(system, x);
      const Certificate certificate = certify(system, x);
      EXPECT_LE(certificate.lower_bound, -sum * at - sum * sum / 2) << seed;
    }
    {  // a long spring without much strain, from a fixed node at the origin
      System system(2, 2);
      system.fix(0);
      const Eigen::Vector2d place(rng.uniform(100, 1000), rng.uniform(100, 1000));
      const long double away = std::hypot(static_cast<long double>(place[0]), place[1]);
      const auto length = static_cast<double>(away * (1 - 1e-10L));
      system.add_anchors(Eigen::RowVectorXi::Constant(1, 1), place, System::all(1));
      system.add_links(all_pairs(2), System::all(length), System::all(1));
      MatrixXd x(2, 2);
      x << Eigen::Vector2d::Zero(), place;
      solve(system, x);
      const Certificate certificate = certify(system, x);
      ASSERT_TRUE(certificate.certified()) << certificate;
      EXPECT_LE(certificate.lower_bound, (away - length) * (away - length) / 4) << seed;  // both as stiff
    }
  }
}

// Whether a minimum is certified does not depend on the unit of stiffness, with a fixed node or without.
// Offsets that contradict each other on weak anchors: a quadratic energy whose matrix is nearly singular. Its
// minimum is found in long double.
TEST(SystemSolution, NoBoundIsAboveTheLeastEnergy) {
  using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  int bounds = 0;
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    Rng rng(seed);
    const int n = 2 + static_cast<int>(seed % 9);
    const MatrixXd x = random_points(rng, 2, n, 10), places = random_points(rng, 2, n, 10);
    const Eigen::Matrix2Xi pairs = all_pairs(n);
    const int count = static_cast<int>(pairs.cols());
    const MatrixXd offsets = random_points(rng, 2, count, 10);
    const Eigen::VectorXd k = random_values(rng, count, 0.1, 2);
    const double weak = std::pow(10, -rng.uniform(9, 12.5));
    System system(n, 2);
    system.add_anchors(places, System::all(weak));
    system.add_offsets(pairs, offsets, k);
    const Certificate certificate = certify(system, x);
    if (!(certificate.lower_bound > 0)) continue;
    ++bounds;
    Matrix a = Matrix::Identity(n, n) * weak, b = weak * places.transpose().cast<long double>();
    for (int l = 0; l < count; ++l) {
      Eigen::Matrix<long double, Eigen::Dynamic, 1> difference =
          Eigen::Matrix<long double, Eigen::Dynamic, 1>::Zero(n);
      difference[pairs(0, l)] = 1, difference[pairs(1, l)] = -1;
      a += k[l] * difference * difference.transpose();
      b += k[l] * difference * offsets.col(l).transpose().cast<long double>();
    }
    const Matrix y = a.ldlt().solve(b);
    long double least = 0;
    for (int i = 0; i < n; ++i)
      least += weak / 2 * (y.row(i) - places.col(i).transpose().cast<long double>()).squaredNorm();
    for (int l = 0; l < count; ++l)
      least += k[l] / 2 *
               (y.row(pairs(0, l)) - y.row(pairs(1, l)) - offsets.col(l).transpose().cast<long double>())
                   .squaredNorm();
    EXPECT_LE(certificate.lower_bound, static_cast<double>(least)) << seed;
  }
  EXPECT_GT(bounds, 200);
}

TEST(SystemSolution, IsCertifiedInAnyUnit) {
  for (const double unit : {1e-30, 1.0, 1e30}) {
    System system(2, 2);
    system.fix(0);
    system.add_anchors(MatrixXd{{0, 4}, {0, 4}}, System::all(unit));
    system.add_links(all_pairs(2), System::all(5), System::all(unit));
    MatrixXd x(2, 2);
    x << 0, 4, 0, 4;
    ASSERT_TRUE(solve(system, x).usable());
    const Certificate certificate = certify(system, x);
    EXPECT_TRUE(certificate.certified()) << unit << " " << certificate;
    // M of node 1: k and k (r - mu) / r.
    const double expected = unit * (2 - 5 / x.col(1).norm());
    EXPECT_NEAR(certificate.least_eigenvalue, expected, 1e-5 * expected);
  }
}

// The curvature of log(r / mu)^2 / 2 at rest is 1 / mu^2, whatever the offset.
TEST(SystemMethods, StiffnessOfALogarithmIsThatAtRest) {
  System system(2, 2);
  Links& link = system.add_links(all_pairs(2), System::all(2), System::all(8));
  link.set_law(LinkLaw::Logarithm);
  link.values("offset") = Eigen::Vector2d(30, 40);
  EXPECT_EQ(node_stiffness(system, MatrixXd::Identity(2, 2)), Eigen::Vector2d(2, 2));
}

TEST(SystemEdits, AreRefusedAsAWhole) {
  System system(3, 2);
  system.add_anchors(MatrixXd::Identity(2, 3), System::all(1));
  Links& links = system.add_links(Eigen::Matrix2Xi{{0, 1}, {1, 2}}, System::all(1), System::all(1));
  EXPECT_THROW(links.set_nodes(Eigen::MatrixXi::Zero(3, 2)), std::invalid_argument);
  EXPECT_THROW(links.set_nodes(Eigen::MatrixXi::Zero(1, 2)), std::invalid_argument);
  EXPECT_EQ(links.arity(), 2);
  EXPECT_THROW(system.add_elements(Eigen::MatrixXi(0, 2), {}, false), std::invalid_argument);
  links.set_nodes(Eigen::Matrix2Xi{{0, 1}, {1, 7}});
  EXPECT_THROW(system.remove_nodes(std::vector<int>{0}), std::out_of_range);
  EXPECT_THROW(system.remove_nodes(std::vector<int>{-1}), std::out_of_range);
  EXPECT_EQ(system.nodes(), 3);
  EXPECT_EQ(system.term(0).size(), 3);
  EXPECT_EQ(links.size(), 2);
}

// What is added, changed and removed between solves is as if the system had been made so.
TEST(SystemEdits, AreThoseOfASystemMadeAtOnce) {
  Rng rng(5);
  const MatrixXd positions = random_points(rng, 2, 7);
  const VectorXd lengths = random_values(rng, 4, 2, 9);
  Eigen::Matrix2Xi pairs(2, 4);
  pairs << 0, 1, 2, 5, 1, 2, 5, 6;
  System system(5, 2);
  Anchors& held = system.add_anchors(positions.leftCols(5), System::all(0.5));
  Links& chain = system.add_links(pairs.leftCols(2), lengths.head(2), System::all(2));
  system.add_loads(Eigen::RowVectorXi::Constant(1, 3), Eigen::Vector2d(1, 1));
  MatrixXd x = positions.leftCols(5);
  EXPECT_TRUE(solve(system, x).usable());
  system.add_nodes(2);
  const MatrixXd more = positions.rightCols(2);
  held.append(Eigen::RowVector2i(5, 6), {{"position", more}});
  chain.append(pairs.rightCols(2), {{"length", lengths.tail(2).transpose()}});
  const std::vector<int> gone{3};
  system.remove_nodes(gone);

  System expected(6, 2);
  MatrixXd left(2, 6);
  left << positions.leftCols(3), positions.rightCols(3);
  expected.add_anchors(left, System::all(0.5));
  pairs << 0, 1, 2, 4, 1, 2, 4, 5;
  expected.add_links(pairs, lengths, System::all(2));
  expected.add_loads(Eigen::RowVectorXi(0), MatrixXd::Zero(2, 1));
  EXPECT_EQ(energy(system, left), energy(expected, left));
  EXPECT_EQ(hessian(system, left), hessian(expected, left));
  MatrixXd a = left, b = left;
  EXPECT_EQ(solve(system, a).status, solve(expected, b).status);
  EXPECT_EQ(a, b);

  const System copy = system;
  chain.values("length").setConstant(1);
  EXPECT_EQ(energy(copy, left), energy(expected, left));
  EXPECT_NE(energy(system, left), energy(expected, left));
  system.remove(chain);
  EXPECT_EQ(system.term_count(), 2);
  EXPECT_THROW(system.remove(copy.term(0)), std::invalid_argument);
}

// A system of one bad number, and a word of what is said of it.
struct BadInput {
  const char* name;
  std::function<void(System&, MatrixXd&)> spoil;
  const char* word;
};
std::ostream& operator<<(std::ostream& out, const BadInput& bad) { return out << bad.name; }

class Refused : public ::testing::TestWithParam<BadInput> {};

INSTANTIATE_TEST_SUITE_P(
    BadInput, Refused,
    ::testing::Values(
        BadInput{"nan_position", [](System& s, MatrixXd&) { s.term(0).values("position")(1, 2) = NAN; },
                 "position of element 2 is not finite"},
        BadInput{"negative_stiffness", [](System& s, MatrixXd&) { s.term(1).values("stiffness")(0, 0) = -1; },
                 "links: stiffness of element 0 is negative or not finite: -1"},
        BadInput{"wrong_count", [](System& s, MatrixXd&) { s.term(1).values("length").resize(1, 2); },
                 "length must have one entry for each element, or one for all: 2 of "},
        BadInput{"node_out_of_range",
                 [](System& s, MatrixXd&) {
                   Eigen::MatrixXi nodes = s.term(1).nodes();
                   nodes(1, 3) = 17;
                   s.term(1).set_nodes(nodes);
                 },
                 "element 3 has a node out of range: 17 of "},
        BadInput{"self_link",
                 [](System& s, MatrixXd&) {
                   Eigen::MatrixXi nodes = s.term(1).nodes();
                   nodes(1, 3) = nodes(0, 3);
                   s.term(1).set_nodes(nodes);
                 },
                 "element 3 has one node twice"},
        BadInput{"no_scale", [](System& s, MatrixXd&) { s.term(0).choose("loss", "huber"); },
                 "needs a scale"},
        BadInput{"zero_scale", [](System& s, MatrixXd&) { s.term(0).set_loss(Loss::Huber, 0.0); },
                 "scale of element 0 is not positive"},
        BadInput{"upper_below_length",
                 [](System& s, MatrixXd&) {
                   s.term(1).choose("law", "interval");
                   s.term(1).values("upper").setConstant(1, 1, 0.5);
                 },
                 "upper length is less"},
        BadInput{"indefinite_information",
                 [](System& s, MatrixXd&) { s.term(0).values("information") = Eigen::Vector4d(1, 0, 0, -1); },
                 "positive semi-definite"},
        BadInput{"x_of_another_size", [](System&, MatrixXd& x) { x.resize(2, 3); }, "x must have"},
        BadInput{"infinite_x", [](System&, MatrixXd& x) { x(0, 1) = INFINITY; }, "x of node 1 is not finite"},
        BadInput{"nothing_holds",
                 [](System& s, MatrixXd&) {
                   s.add_nodes(1);
                   s.remove(s.term(0));
                 },
                 "x must have"},
        BadInput{"floating", [](System& s, MatrixXd&) { s.term(0).values("stiffness").setZero(); },
                 "connected component that nothing holds"},
        BadInput{"common_length_with_a_robust_loss",
                 [](System& s, MatrixXd&) {
                   s.add_common_length(all_pairs(4), System::all(1)).set_loss(Loss::GemanMcClure, 1);
                 },
                 "quadratic or huber"}),
    [](const auto& test) { return test.param.name; });

TEST_P(Refused, ByAllMethodsAndQuestions) {
  Rng rng(1);
  System system(4, 2);
  MatrixXd x = random_points(rng, 2, 4);
  system.add_anchors(x, random_values(rng, 4, 0.5, 1));
  system.add_links(all_pairs(4), random_values(rng, 6, 2, 9), random_values(rng, 6, 1, 2));
  GetParam().spoil(system, x);
  const MatrixXd before = x;
  for (const std::string_view method : system_methods()) {
    const Summary summary = solve(method, system, x);
    EXPECT_EQ(summary.status, Status::InvalidInput) << method;
    EXPECT_NE(std::string(std::string_view(summary.message)).find(GetParam().word), std::string::npos)
        << method << ": " << summary.message;
    EXPECT_TRUE(x.cwiseEqual(before).all() || !x.allFinite());
  }
  const Certificate certificate = certify(system, x);
  EXPECT_EQ(certificate.proof, Proof::NotApplicable);
  EXPECT_FALSE(std::string_view(certificate.reason).empty());
}

TEST(SystemErrors, NameWhatIsNear) {
  System system(2, 2);
  Links& one = system.add_links(all_pairs(2), System::all(1), System::all(1));
  const auto message = [](auto&& f) -> std::string {
    try {
      f();
    } catch (const std::logic_error& error) {
      return error.what();
    }
    return "nothing was thrown";
  };
  EXPECT_EQ(message([&] { system.fix(-1); }), "node -1 is out of range (2 nodes)");
  EXPECT_EQ(message([&] { system.term(7); }),
            "term 7 is out of range (" + std::to_string(system.term_count()) + " terms)");
  EXPECT_EQ(message([&] { one.choose("loss", "cauchy"); }),
            "links: unknown loss 'cauchy' (known: quadratic, huber, geman-mcclure, truncated)");
  EXPECT_EQ(message([&] { one.values("lenght"); }), "links: unknown column 'lenght', did you mean 'length'?");
  EXPECT_EQ(message([&] { one.choose("law", "hook"); }), "links: unknown law 'hook', did you mean 'hooke'?");
  MatrixXd x = MatrixXd::Zero(2, 2);
  EXPECT_NE(message([&] { solve("newtn", system, x); }).find("did you mean 'newton'"), std::string::npos);
  EXPECT_NE(message([] { make_term("springs", 2); }).find("known: anchors links"), std::string::npos);
  EXPECT_THROW(System(1, 0), std::invalid_argument);
  EXPECT_THROW(System(-1, 2), std::invalid_argument);
  EXPECT_THROW(system.add(Links(3)), std::invalid_argument);
  EXPECT_THROW(system.add_links(all_pairs(2), VectorXd::Ones(5), System::all(1)), std::invalid_argument);
}

// What a user's function throws reaches the caller, and x is as it was.
TEST(SystemErrors, OfAUsersFunctionReachTheCaller) {
  System system(2, 2);
  system.add_anchors(MatrixXd::Identity(2, 2), System::all(1));
  int calls = 0;
  system.add_elements(
      all_pairs(2),
      [&calls](const MatrixXd& points, const MatrixXd&, bool, ElementValues& values) {
        if (++calls == 3) throw std::runtime_error("my own");
        values.energy = points.colwise().squaredNorm();
        values.gradient = 2 * points;
      },
      false);
  MatrixXd x = MatrixXd::Constant(2, 2, 5);
  const MatrixXd start = x;
  EXPECT_THROW(solve(system, x), std::runtime_error);
  EXPECT_EQ(x, start);
  EXPECT_EQ(solve("newton", system, x).status, Status::InvalidInput);
  const Summary summary = solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_LE((x - MatrixXd::Identity(2, 2) / 3).norm(), 1e-6);
}

TEST(SystemMethods, CanBeStoppedAndObserved) {
  Rng rng(1);
  const System system = mixture(rng, 2, true);
  for (const std::string_view method : system_methods()) {
    if (method == "ida" || method == "staircase") continue;  // which do not take it
    int calls = 0;
    auto stop_at_2 = [&calls](const Iteration& at) {
      ++calls;
      return at.number < 2;
    };
    AlignedOptions options;
    options.on_iteration = stop_at_2;
    MatrixXd x = random_points(rng, 2, kNodes);
    const double before = energy(system, x);
    const Summary summary = solve(method, system, x, options);
    EXPECT_EQ(summary.status, Status::Interrupted) << method << " " << summary;
    EXPECT_LE(energy(system, x), before);
    EXPECT_GE(calls, 3);
  }
}

TEST(SystemMethods, GroundComponentsThatNothingHolds) {
  System system(3, 2);
  system.add_links(all_pairs(3), System::all(4), System::all(1));
  MatrixXd x(2, 3);
  x << 1, 3, 2, 1, 1, 3;
  const MatrixXd start = x;
  EXPECT_EQ(solve(system, x).status, Status::InvalidInput);
  AlignedOptions options;
  options.hold_floating = true;
  const Summary summary = solve(system, x, options);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_LE((lengths_at(x, all_pairs(3)).array() - 4).abs().maxCoeff(), 1e-6);
  EXPECT_EQ(x.col(0), start.col(0));
}

// docs/models.md has the table of what each term allows, as the code says it.
TEST(SystemTable, StandsInTheDocs) {
  const auto cell = [](const char* problem) {
    return problem == nullptr ? std::string("yes") : "no: " + std::string(problem);
  };
  std::string table =
      "| term | lbfgs, ncg | newton, newton-cg, schwarz, covariance | ida | certificate | staircase | "
      "gradients | files, pickle |\n"
      "|---|---|---|---|---|---|---|---|\n";
  for (const Kind& kind : kinds()) {
    Rng rng(1);
    System system(kNodes, 3);
    const Term& term = kind.add(system, rng);
    std::string stored = "yes";
    try {
      make_term(term.kind(), 3);
      if (term.kind() == "links" && term.chosen("law") == "own")
        stored = "no: only a law with a name is stored";
    } catch (const std::invalid_argument&) {
      stored = "no: its function cannot be stored";
    }
    table += std::string("| ") + kind.name + " | yes | " + cell(term.problem_with(Curvature::True)) + " | " +
             cell(term.problem_with(Curvature::Majorising)) + " | " +
             cell(term.problem_with(Curvature::Minorising)) + " | " + cell(term.why_not_liftable()) + " | " +
             cell(term.why_not_differentiable()) + " | " + stored + " |\n";
  }
  std::ifstream file(ASTERISM_DOCS "/models.md");
  const std::string page((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  EXPECT_NE(page.find(table), std::string::npos) << "the table is now\n" << table;
}

// How long a system is does not depend on how it is stored, however weak its links are beside an anchor.
TEST(Scales, AreTheSameInEveryFormOfASystem) {
  for (const double weak : {1e-18, 1.1e-16, 2.3e-16, 1e-15, 1e-9, 1.0}) {
    using Four = SpringSystem<double, 2, 4>;
    Four four(Four::TopologyType::full(4));
    four.anchor_stiffness << 1, weak, weak, weak;
    four.link_stiffness.setConstant(weak);
    four.rest_length << 7, 2, 3, 4, 5, 6;
    four.anchors << 1, 0, 3, 0, 0, 2, 0, -1;
    SpringSystem<double, 2> any(Topology<>::full(4));
    any.anchor_stiffness = four.anchor_stiffness;
    any.link_stiffness = four.link_stiffness;
    any.rest_length = four.rest_length;
    any.anchors = four.anchors;
    // Of all springs: the first anchor is the strongest, those below 1e-4 of it count in proportion.
    const double share = std::min(1.0, weak / 1e-4), total = 1 + 9 * share;
    Eigen::Vector2d centroid = four.anchors.col(0);
    for (int i = 1; i < 4; ++i) centroid += share * four.anchors.col(i);
    centroid /= 1 + 3 * share;
    double sum = (four.anchors.col(0) - centroid).squaredNorm() + share * four.rest_length.squaredNorm();
    for (int i = 1; i < 4; ++i) sum += share * (four.anchors.col(i) - centroid).squaredNorm();
    const double expected = std::sqrt(sum / total);
    SCOPED_TRACE(weak);
    const double length = characteristic_length(four, Four::Points(four.anchors));
    EXPECT_NEAR(length, expected, 1e-12 * (expected + length));
    EXPECT_NEAR(characteristic_length(any, any.anchors), length, 1e-12 * length);
    EXPECT_NEAR(characteristic_length(to_system(any), any.anchors), length, 1e-12 * length);
  }
}

}  // namespace
}  // namespace asterism
