// The kinds of systems. Each starts from a plain system, which any solver solves, and makes it difficult.
#include <algorithm>
#include <asterism/testing/random_system.hpp>
#include <cmath>
#include <numeric>

#include "hostile.hpp"

namespace asterism::hostile {

namespace {

using testing::Rng;

int integer(Rng& rng, int low, int high) {  // in [low, high]
  return std::min(high, low + static_cast<int>(rng.uniform(0, high - low + 1)));
}
double decades(Rng& rng, double low, double high) { return std::pow(10, rng.uniform(low, high)); }
bool chance(Rng& rng, double probability) { return rng.uniform(0, 1) < probability; }

enum class Shape { Full, Tree, Star, Chain, Ring };

std::vector<Link> links_of(Rng& rng, int nodes, Shape shape) {
  std::vector<Link> links;
  for (int j = 1; j < nodes; ++j) {
    if (shape == Shape::Full)
      for (int i = 0; i < j; ++i) links.push_back({i, j});
    if (shape == Shape::Tree) links.push_back({integer(rng, 0, j - 1), j});
    if (shape == Shape::Star) links.push_back({0, j});
    if (shape == Shape::Chain || shape == Shape::Ring) links.push_back({j - 1, j});
  }
  if (shape == Shape::Ring && nodes > 2) links.push_back({nodes - 1, 0});
  return links;
}

void displace(Rng& rng, Eigen::MatrixXd& points, double by) {
  for (double& coordinate : points.reshaped()) coordinate += rng.uniform(-by, by);
}

// Nodes about 50 px apart; anchors and start nearby; anchors about as stiff as links.
Problem plain(Rng& rng, Type type, int nodes, Shape shape) {
  Problem problem;
  problem.type = type;
  problem.links = links_of(rng, nodes, shape);
  const auto count = static_cast<Eigen::Index>(problem.links.size());
  Eigen::MatrixXd rest = Eigen::MatrixXd::Zero(dimensions(type), nodes);
  displace(rng, rest, 50);
  problem.anchors = problem.start = rest;
  displace(rng, problem.anchors, 10);
  displace(rng, problem.start, chance(rng, 0.5) ? 10 : 40);
  problem.anchor_stiffness = Eigen::VectorXd::Ones(nodes);
  for (double& k : problem.anchor_stiffness) k = rng.uniform(0.5, 1.5);
  problem.rest_length.resize(count);
  problem.link_stiffness.resize(count);
  for (Eigen::Index l = 0; l < count; ++l) {
    const Link link = problem.links[static_cast<std::size_t>(l)];
    problem.rest_length[l] = (rest.col(link.i) - rest.col(link.j)).norm();
    problem.link_stiffness[l] = rng.uniform(0.2, 2);
  }
  problem.align = chance(rng, 0.8);
  if (type == Type::RobustPlane) {
    problem.scale = decades(rng, 0, 3);
    problem.shapes.resize(2, 2 * nodes);
    for (int i = 0; i < nodes; ++i) {
      const double angle = rng.uniform(0, 3), least = chance(rng, 0.3) ? 0 : rng.uniform(0, 1);
      const Eigen::Vector2d axis(std::cos(angle), std::sin(angle));
      problem.shapes.middleCols(2 * i, 2) =
          least * Eigen::Matrix2d::Identity() + (1 - least) * axis * axis.transpose();
    }
  }
  return problem;
}

Problem plain(Rng& rng, Type type = Type::Plane) {
  constexpr Shape kShapes[] = {Shape::Full, Shape::Full, Shape::Tree, Shape::Star, Shape::Chain, Shape::Ring};
  const int nodes = chance(rng, 0.4) ? 4 : integer(rng, 1, 8);
  return plain(rng, type, nodes, kShapes[integer(rng, 0, 5)]);
}

// The problem with its numbers rounded to the type's scalar.
Problem stored(Problem problem) {
  if (problem.type != Type::PlaneInFloat) return problem;
  const auto round = [](auto& values) {
    values = values.template cast<float>().template cast<double>().eval();
  };
  round(problem.anchors), round(problem.start), round(problem.anchor_stiffness);
  round(problem.rest_length), round(problem.link_stiffness), round(problem.rest_offset);
  round(problem.loads);
  return problem;
}

void move(Problem& problem, const Eigen::VectorXd& by) {
  problem.anchors.colwise() += by;
  problem.start.colwise() += by;
}

void scale(Problem& problem, double length, double stiffness) {
  problem.anchors *= length, problem.start *= length, problem.rest_length *= length;
  problem.rest_offset *= length;
  problem.scale *= length;
  problem.anchor_stiffness *= stiffness, problem.link_stiffness *= stiffness;
  problem.loads *= stiffness * length;
}

Eigen::VectorXd direction(Rng& rng, int dim) {
  Eigen::VectorXd result(dim);
  for (double& coordinate : result) coordinate = rng.normal();
  return result / std::max(result.norm(), 1e-9);
}

Type any_dimension(Rng& rng) {
  constexpr Type kTypes[] = {Type::Plane, Type::Plane, Type::Space, Type::Line};
  return kTypes[integer(rng, 0, 3)];
}

Problem easy(Rng& rng) {
  Problem problem = plain(rng);
  problem.anchor_stiffness *= 10;
  problem.start = problem.anchors;
  displace(rng, problem.start, 5);
  problem.agrees = true;
  return problem;
}
Problem stiffness_ratios(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  for (double& k : problem.link_stiffness) k = decades(rng, -12, 12);
  for (double& k : problem.anchor_stiffness) k = decades(rng, -12, 12);
  problem.may_overflow = true;
  return problem;
}
Problem far_from_the_origin(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  move(problem, decades(rng, 6, 15) * direction(rng, problem.dim()));
  return problem;
}
Problem far_start(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  const double by = decades(rng, 2, 15);
  if (chance(rng, 0.5)) {
    problem.start.colwise() += by * direction(rng, problem.dim());
  } else {
    displace(rng, problem.start, by);
  }
  return problem;
}
Problem coincident_start(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  for (int i = 1; i < problem.nodes(); ++i) {
    if (chance(rng, 0.7)) problem.start.col(i) = problem.start.col(integer(rng, 0, i - 1));
  }
  return problem;
}
Problem coincident_anchors(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  const double apart = chance(rng, 0.5) ? 0 : decades(rng, -14, 0);
  for (int i = 1; i < problem.nodes(); ++i) {
    if (chance(rng, 0.7))
      problem.anchors.col(i) = problem.anchors.col(0) + apart * direction(rng, problem.dim());
  }
  return problem;
}
Problem collinear(Rng& rng) {
  Problem problem = plain(rng, chance(rng, 0.5) ? Type::Plane : Type::Space);
  const Eigen::VectorXd u =
      chance(rng, 0.5) ? Eigen::VectorXd::Unit(problem.dim(), 0) : direction(rng, problem.dim());
  problem.anchors = (u * (u.transpose() * problem.anchors)).eval();
  problem.start = (u * (u.transpose() * problem.start)).eval();
  return problem;
}
Problem switched_off(Rng& rng) {
  Problem problem = plain(rng, chance(rng, 0.3) ? Type::PlaneInFloat : any_dimension(rng));
  const bool is_float = problem.type == Type::PlaneInFloat;
  const auto sentinel = [&] {
    const double largest =
        is_float ? double{std::numeric_limits<float>::max()} : std::numeric_limits<double>::max();
    return chance(rng, 0.5) ? largest : (is_float ? 1e20 : decades(rng, 10, 300));
  };
  for (Eigen::Index l = 0; l < problem.link_stiffness.size(); ++l) {
    if (!chance(rng, 0.4)) continue;
    problem.link_stiffness[l] = 0;
    problem.rest_length[l] = sentinel();
  }
  // Nodes that are no longer connected keep their own anchors.
  const bool is_full =
      (problem.link_stiffness.array() > 0).all() && problem.nodes() > 1 && !problem.links.empty();
  for (int i = 1; is_full && i < problem.nodes(); ++i) {
    if (!chance(rng, 0.5)) continue;
    problem.anchor_stiffness[i] = 0;
    problem.anchors.col(i).setConstant(sentinel());
  }
  return problem;
}
Problem huge_units(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  scale(problem, decades(rng, 10, 160), decades(rng, -60, 150));
  problem.may_overflow = true;
  return problem;
}
Problem tiny_units(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  scale(problem, decades(rng, -170, -10), decades(rng, -150, 60));
  problem.may_overflow = true;
  return problem;
}
Problem one_anchor(Rng& rng) {
  Problem problem =
      plain(rng, any_dimension(rng), integer(rng, 2, 8), chance(rng, 0.5) ? Shape::Full : Shape::Tree);
  const int held = integer(rng, 0, problem.nodes() - 1);
  for (int i = 0; i < problem.nodes(); ++i) {
    if (i != held) problem.anchor_stiffness[i] = 0;
  }
  problem.moves_freely = problem.dim() > 1;
  return problem;
}
Problem fixed_nodes(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  for (int i = 0; i < problem.nodes(); ++i) {
    if (chance(rng, 0.4)) problem.fixed.push_back(i);
  }
  if (!problem.fixed.empty() && chance(rng, 0.5)) {  // only these hold the others
    const bool connected = !problem.links.empty();
    if (connected) problem.anchor_stiffness.setZero();
    problem.moves_freely = connected && problem.fixed.size() == 1 && problem.dim() > 1 && problem.nodes() > 1;
  }
  return problem;
}
Problem components(Rng& rng) {
  const Type type = any_dimension(rng);
  Problem problem = plain(rng, type, integer(rng, 4, 9), Shape::Chain);
  const auto cut = problem.links.begin() + integer(rng, 0, problem.nodes() - 2);
  const auto at = std::distance(problem.links.begin(), cut);
  if (chance(rng, 0.5)) {
    problem.link_stiffness[at] = 0;
  } else {
    for (Eigen::Index l = at; l + 1 < problem.link_stiffness.size(); ++l) {
      problem.link_stiffness[l] = problem.link_stiffness[l + 1];
      problem.rest_length[l] = problem.rest_length[l + 1];
    }
    problem.link_stiffness.conservativeResize(problem.link_stiffness.size() - 1);
    problem.rest_length.conservativeResize(problem.rest_length.size() - 1);
    problem.links.erase(cut);
  }
  if (chance(rng, 0.5)) {  // nothing holds the second one
    problem.hold_floating = true;
    problem.anchor_stiffness.tail(problem.nodes() - 1 - at).setZero();
    problem.moves_freely = problem.dim() > 1 && problem.nodes() - 1 - at > 1;
  }
  return problem;
}
Problem no_rest_lengths(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  problem.rest_length.setZero();
  problem.agrees = true;
  return problem;
}
Problem offsets(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  const auto count = static_cast<Eigen::Index>(problem.links.size());
  problem.rest_offset.setZero(problem.dim(), count);
  const bool alone = chance(rng, 0.4);
  const double size = chance(rng, 0.3) ? decades(rng, -9, 9) : 1;
  for (Eigen::Index l = 0; l < count; ++l) {
    const Link link = problem.links[static_cast<std::size_t>(l)];
    const bool has_offset = alone || chance(rng, 0.7);
    if (has_offset)
      problem.rest_offset.col(l) = size * (problem.anchors.col(link.i) - problem.anchors.col(link.j));
    if (alone || (has_offset && chance(rng, 0.5))) problem.rest_length[l] = 0;
  }
  if (chance(rng, 0.2)) move(problem, decades(rng, 3, 9) * direction(rng, problem.dim()));
  problem.agrees = alone;  // convex
  return problem;
}
Problem loads(Rng& rng) {
  const Type type = chance(rng, 0.2) ? Type::PlaneInFloat : any_dimension(rng);
  Problem problem = plain(rng, type);
  problem.loads.setZero(problem.dim(), problem.nodes());
  const Eigen::VectorXd down = decades(rng, -3, 3) * direction(rng, problem.dim());
  const bool is_weight = chance(rng, 0.5);  // the same on all
  for (int i = 0; i < problem.nodes(); ++i) {
    if (is_weight || chance(rng, 0.5)) problem.loads.col(i) = down;
    if (!is_weight) problem.loads.col(i) += decades(rng, -2, 2) * direction(rng, problem.dim());
  }
  const double shape = rng.uniform(0, 1);
  if (shape < 0.2) {
    problem.rest_length.setZero();
    problem.agrees = true;   // convex
  } else if (shape < 0.6) {  // hangs from a few fixed nodes
    problem.anchor_stiffness.setZero();
    problem.fixed.push_back(0);
    if (problem.nodes() > 2 && chance(rng, 0.5)) problem.fixed.push_back(problem.nodes() - 1);
  }
  if (type != Type::PlaneInFloat && chance(rng, 0.3))
    scale(problem, decades(rng, -6, 6), decades(rng, -6, 6));
  if (chance(rng, 0.2))
    move(problem, decades(rng, 2, type == Type::PlaneInFloat ? 4 : 6) * direction(rng, problem.dim()));
  return problem;
}
Problem robust_anchors(Rng& rng) { return plain(rng, Type::RobustPlane); }
Problem in_float(Rng& rng) {
  Problem problem = plain(rng, Type::PlaneInFloat);
  if (chance(rng, 0.3)) move(problem, decades(rng, 2, 6) * direction(rng, 2));
  if (chance(rng, 0.3)) problem.anchor_stiffness *= decades(rng, -5, 5);
  if (chance(rng, 0.2)) displace(rng, problem.start, decades(rng, 2, 5));
  return problem;
}
Problem on_a_line(Rng& rng) { return plain(rng, Type::Line); }
Problem mirrored(Rng& rng) {
  Problem problem = plain(rng, chance(rng, 0.7) ? Type::Plane : Type::Space);
  problem.start = problem.anchors;
  problem.start.row(0) *= -1;
  if (chance(rng, 0.5)) displace(rng, problem.start, 5);
  return problem;
}
Problem at_a_peak(Rng& rng) {
  // Coincident nodes with their anchors around them: forces cancel, or their direction is arbitrary.
  Problem problem = plain(rng, chance(rng, 0.7) ? Type::Plane : Type::Space);
  const Eigen::VectorXd centre = problem.anchors.rowwise().mean();
  problem.start.colwise() = centre;
  if (chance(rng, 0.5)) problem.anchors.colwise() = centre;
  return problem;
}
Problem parallel_links(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  for (int more = integer(rng, 1, 6); more > 0 && !problem.links.empty(); --more) {
    Link link =
        problem.links[static_cast<std::size_t>(integer(rng, 0, static_cast<int>(problem.links.size()) - 1))];
    if (chance(rng, 0.5)) std::swap(link.i, link.j);
    problem.links.push_back(link);
    const auto l = problem.rest_length.size();
    problem.rest_length.conservativeResize(l + 1);
    problem.link_stiffness.conservativeResize(l + 1);
    problem.rest_length[l] = rng.uniform(0, 100);
    problem.link_stiffness[l] = rng.uniform(0, 2);
  }
  return problem;
}
Problem weak_anchors(Rng& rng) {
  constexpr Shape kShapes[] = {Shape::Full, Shape::Star, Shape::Chain, Shape::Ring};
  Problem problem = plain(rng, chance(rng, 0.7) ? Type::Plane : Type::Space, integer(rng, 3, 14),
                          kShapes[integer(rng, 0, 3)]);
  problem.anchor_stiffness *= decades(rng, -14, -2);
  return problem;
}
Problem far_weak_anchor(Rng& rng) {
  // With links, as isolated nodes are measured by all anchors.
  Problem problem =
      plain(rng, any_dimension(rng), integer(rng, 2, 8), chance(rng, 0.5) ? Shape::Full : Shape::Tree);
  const int n = problem.nodes();
  problem.anchors.conservativeResize(Eigen::NoChange, n + 1);
  problem.start.conservativeResize(Eigen::NoChange, n + 1);
  problem.anchor_stiffness.conservativeResize(n + 1);
  problem.anchors.col(n).setConstant(decades(rng, 4, 9));
  problem.start.col(n) = problem.anchors.col(n);
  problem.anchor_stiffness[n] = decades(rng, -14, -6);
  return problem;
}
Problem contradictory(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  for (double& length : problem.rest_length)
    length *= chance(rng, 0.5) ? decades(rng, -6, 0) : decades(rng, 0, 6);
  return problem;
}
Problem stiff_pair(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng));
  if (problem.links.empty()) return problem;
  const auto l = integer(rng, 0, static_cast<int>(problem.links.size()) - 1);
  problem.rest_length[l] = decades(rng, -12, -2);
  problem.link_stiffness[l] = decades(rng, 4, 14);
  problem.may_overflow = true;
  return problem;
}
// A sheet of springs without bending stiffness, shorter or longer than its anchors require.
Problem cloth(Rng& rng) {
  const int side = integer(rng, 3, 5);
  Problem problem;
  problem.type = Type::Space;
  Eigen::MatrixXd grid = Eigen::MatrixXd::Zero(3, side * side);
  for (int i = 0; i < side * side; ++i) {
    grid(0, i) = i % side, grid(1, i) = i / side;
    if (i % side > 0) problem.links.push_back({i - 1, i});
    if (i >= side) problem.links.push_back({i - side, i});
  }
  problem.anchors = rng.uniform(0.7, 1.3) * grid;
  problem.start = problem.anchors;
  displace(rng, problem.anchors, 0.3);
  displace(rng, problem.start, 0.3);
  problem.anchor_stiffness = Eigen::VectorXd::Constant(side * side, decades(rng, -8, -1));
  const auto count = static_cast<Eigen::Index>(problem.links.size());
  problem.rest_length = Eigen::VectorXd::Ones(count);
  problem.link_stiffness = Eigen::VectorXd::Ones(count);
  return problem;
}
Problem no_system(Rng& rng) {
  Problem problem = plain(rng, any_dimension(rng), integer(rng, 2, 6), Shape::Full);
  problem.refused = true;
  constexpr double kBad[] = {std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(),
                             -std::numeric_limits<double>::infinity()};
  const double bad = kBad[integer(rng, 0, 2)];
  const int node = integer(rng, 0, problem.nodes() - 1);
  const auto link = integer(rng, 0, static_cast<int>(problem.links.size()) - 1);
  const int axis = integer(rng, 0, problem.dim() - 1);
  switch (integer(rng, 0, 9)) {
    case 0:
      problem.anchors(axis, node) = bad;
      break;
    case 1:
      problem.start(axis, node) = bad;
      break;
    case 2:
      problem.anchor_stiffness[node] = bad;
      break;
    case 3:
      problem.rest_length[link] = bad;
      break;
    case 4:
      problem.link_stiffness[link] = bad;
      break;
    case 5:
      problem.anchor_stiffness[node] = -decades(rng, -300, 10);
      break;
    case 6:
      problem.rest_length[link] = -decades(rng, -300, 10);
      break;
    case 7:
      problem.link_stiffness[link] = -decades(rng, -300, 10);
      break;
    case 8:
      problem.links[static_cast<std::size_t>(link)] = {node, chance(rng, 0.5) ? node : problem.nodes()};
      break;
    default:
      problem.anchor_stiffness.setZero();
      break;
  }
  return problem;
}

template <Problem (*kMake)(Rng&)>
Problem seeded(std::uint64_t seed) {
  Rng rng(seed);
  return stored(kMake(rng));
}

}  // namespace

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = {
      {"Easy", seeded<easy>},
      {"StiffnessRatios", seeded<stiffness_ratios>},
      {"FarFromTheOrigin", seeded<far_from_the_origin>},
      {"FarStart", seeded<far_start>},
      {"CoincidentStart", seeded<coincident_start>},
      {"CoincidentAnchors", seeded<coincident_anchors>},
      {"Collinear", seeded<collinear>},
      {"SwitchedOffWithSentinels", seeded<switched_off>},
      {"HugeUnits", seeded<huge_units>},
      {"TinyUnits", seeded<tiny_units>},
      {"OneAnchor", seeded<one_anchor>},
      {"FixedNodes", seeded<fixed_nodes>},
      {"Components", seeded<components>},
      {"NoRestLengths", seeded<no_rest_lengths>},
      {"RobustAnisotropicAnchors", seeded<robust_anchors>},
      {"Float", seeded<in_float>},
      {"Line", seeded<on_a_line>},
      {"Mirrored", seeded<mirrored>},
      {"AtAPeak", seeded<at_a_peak>},
      {"ParallelLinks", seeded<parallel_links>},
      {"WeakAnchors", seeded<weak_anchors>},
      {"FarWeakAnchor", seeded<far_weak_anchor>},
      {"ContradictoryLengths", seeded<contradictory>},
      {"StiffPair", seeded<stiff_pair>},
      {"Cloth", seeded<cloth>},
      {"NoSystem", seeded<no_system>},
      {"Offsets", seeded<offsets>},
      {"Loads", seeded<loads>},
  };
  return all;
}

}  // namespace asterism::hostile
