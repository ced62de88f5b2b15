// Solves any spring systems by any of the library's methods: bad input must be refused with a reason, leaving
// x unchanged; results must be finite and no worse than the start; converged ones must be stationary.

#include <algorithm>
#include <asterism/solver/energy/stationarity.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "../../bench/laboratory/laboratory.hpp"
#include "bytes.hpp"

using namespace asterism;
using bench::Points;
using bench::System;

namespace {

// Magnitudes from 1e-16 to 1e12 and, rarely, any double.
double number(fuzz::Bytes& bytes) {
  const auto kind = bytes.take<std::uint8_t>();
  if (kind == 255) return bytes.take<double>();
  return bytes.take<std::int16_t>() * std::pow(10.0, kind % 25 - 16);
}
// The same, but mostly not negative.
double magnitude(fuzz::Bytes& bytes) {
  const bool any = bytes.take<std::uint8_t>() == 255;
  const double value = number(bytes);
  return any ? value : std::abs(value);
}

bench::Problem problem(fuzz::Bytes& bytes) {
  const int nodes = bytes.take<std::uint8_t>() % 10;
  const int count = bytes.take<std::uint8_t>() % 32;
  std::vector<Link> links;
  const auto node = [&] {  // mostly an existing one
    const auto value = bytes.take<std::uint8_t>();
    return value > 250 || nodes == 0 ? value - 253 : value % nodes;
  };
  bool sound = true;
  for (int l = 0; l < count; ++l) {
    const int i = node(), j = node();
    links.push_back({i, j});
    sound = sound && i >= 0 && i < nodes && j >= 0 && j < nodes && i != j;
  }
  using Topology = System::TopologyType;
  bench::Problem result{System(count == 31 ? Topology::full(nodes) : Topology::from_links(nodes, links)),
                        Points(2, nodes)};
  System& system = result.system;
  if (system.defect() ? sound : !sound && count != 31) std::abort();
  for (double& k : system.anchor_stiffness) k = magnitude(bytes);
  for (double& k : system.link_stiffness) k = magnitude(bytes);
  for (double& length : system.rest_length) length = magnitude(bytes);
  for (double& a : system.anchors.reshaped()) a = number(bytes);
  for (double& x : result.start.reshaped()) x = number(bytes);
  const auto fixed = bytes.take<std::uint8_t>();
  for (int i = 0; i < nodes; ++i)
    if (fixed >> i % 8 & 1) system.fix(i);
  if (bytes.take<std::uint8_t>() % 2 == 1) {
    system.rest_offset.resize(2, system.link_count());
    for (double& m : system.rest_offset.reshaped()) m = number(bytes);
  }
  if (bytes.take<std::uint8_t>() % 4 == 1) {
    system.loads.resize(2, nodes);
    for (double& f : system.loads.reshaped()) f = number(bytes);
  }
  return result;
}

// What loads do, and its size.
long double work_of(const System& system, const Points& x, long double& size) {
  long double sum = 0;
  size = 0;
  if (!system.has_loads()) return sum;
  for (int c = 0; c < x.size(); ++c) {
    const long double work = static_cast<long double>(system.loads.data()[c]) * x.data()[c];
    sum += work;
    size += std::abs(work);
  }
  return sum;
}

// An independent implementation of the springs' energy.
long double energy_of(const System& system, const Points& x) {
  long double sum = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const long double u = x(0, i) - static_cast<long double>(system.anchors(0, i));
    const long double v = x(1, i) - static_cast<long double>(system.anchors(1, i));
    sum += system.anchor_stiffness[i] * (u * u + v * v) / 2;
  }
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    long double u = x(0, link.i) - static_cast<long double>(x(0, link.j));
    long double v = x(1, link.i) - static_cast<long double>(x(1, link.j));
    if (system.has_offsets()) {
      u -= system.rest_offset(0, l);
      v -= system.rest_offset(1, l);
    }
    const long double stretch = system.rest_length[l] - std::sqrt(u * u + v * v);
    sum += system.link_stiffness[l] * stretch * stretch / 2;
  }
  return sum;
}

bool is_bad(const bench::Problem& given) {
  const System& system = given.system;
  const auto is_good = [](const auto& values) { return values.allFinite() && (values.array() >= 0).all(); };
  return system.nodes() == 0 || !is_good(system.anchor_stiffness) || !is_good(system.link_stiffness) ||
         !is_good(system.rest_length) || !system.rest_offset.allFinite() || !system.loads.allFinite() ||
         !system.anchors.allFinite() || !given.start.allFinite();
}

void require(bool holds, const Summary& summary, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "%s: %s\n", std::string(summary.solver).c_str(), what);
  std::abort();
}

// By how much sums of forces in other orders may differ, in the rule's units: by the rounding of coordinates,
// of lengths, and of the directions of links whose ends nearly coincide.
double rounding_of_stationarity(const System& system, const Points& x,
                                const detail::StoppingRule<System>& rule) {
  constexpr double kRounding = 16 * std::numeric_limits<double>::epsilon();
  if (!(rule.length() > 0)) return 0;
  Eigen::VectorXd rounding = Eigen::VectorXd::Zero(system.nodes());
  const double extent = x.cwiseAbs().maxCoeff() + system.anchors.cwiseAbs().maxCoeff() +
                        (system.has_offsets() ? system.rest_offset.cwiseAbs().maxCoeff() : 0);
  for (int i = 0; i < system.nodes(); ++i) {
    rounding[i] += system.anchor_stiffness[i] * kRounding * extent;
    if (system.has_loads()) rounding[i] += kRounding * system.loads.col(i).norm();
  }
  for (int l = 0; l < system.link_count(); ++l) {
    const Link link = system.links()[static_cast<std::size_t>(l)];
    Eigen::Vector2d d = x.col(link.i) - x.col(link.j);
    if (system.has_offsets()) d -= system.rest_offset.col(l);
    const double length = d.norm(), rest = system.rest_length[l];
    const double turn = std::min(2.0, kRounding * extent / length);  // of the direction
    const double force =
        system.link_stiffness[l] * (kRounding * (extent + rest) + std::abs(length - rest) * turn);
    rounding[link.i] += force;
    rounding[link.j] += force;
  }
  double most = 0;
  for (int i = 0; i < system.nodes(); ++i) {
    const double stiffness = rule.node_stiffness()[i];
    if (stiffness > 0 && !system.is_fixed(i))
      most = std::max(most, rounding[i] / (stiffness * rule.length()));
  }
  return most;
}

void check(const bench::Problem& given, const Summary& summary, const Points& x, double tolerance) {
  if (!summary.usable()) {
    require(x.size() == given.start.size() &&
                (x.size() == 0 || std::memcmp(x.data(), given.start.data(),
                                              sizeof(double) * static_cast<std::size_t>(x.size())) == 0),
            summary, "x was changed without a result");
    require(!summary.message.empty(), summary, "no reason");
    if (summary.status != Status::InvalidInput) require(!is_bad(given), summary, "bad input was not named");
    return;
  }
  const System& system = given.system;
  require(!is_bad(given), summary, "bad input was solved");
  require(x.allFinite() && std::isfinite(summary.final_energy), summary, "a result that is not finite");
  const long double stored_before = energy_of(system, given.start), stored_after = energy_of(system, x);
  long double size_before = 0, size_after = 0;
  const long double before = stored_before - work_of(system, given.start, size_before);
  const long double after = stored_after - work_of(system, x, size_after);
  // Distances are only as accurate as the rounding of the coordinates.
  constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  const long double extent = std::max(x.cwiseAbs().maxCoeff(), given.start.cwiseAbs().maxCoeff()) +
                             system.anchors.cwiseAbs().maxCoeff() +
                             (system.has_offsets() ? system.rest_offset.cwiseAbs().maxCoeff() : 0);
  const long double stiffness =
      system.anchor_stiffness.cast<long double>().sum() + system.link_stiffness.cast<long double>().sum();
  const long double stored = std::max(stored_before, system.has_loads() ? stored_after : 0);
  const long double force = std::sqrt(2 * stiffness * stored);
  const long double loads = 16 * kEpsilon * (size_before + size_after);
  const long double rounding =
      (system.nodes() + system.link_count()) *
      (loads + 16 * kEpsilon * (stored + extent * force + kEpsilon * stiffness * extent * extent) +
       std::numeric_limits<double>::min() * (1 + stiffness));  // underflow
  require(after <= before + rounding, summary, "the energy rose");
  require(std::abs(after - static_cast<long double>(summary.final_energy)) <= rounding, summary,
          "another energy than the summary's");
  for (int i = 0; i < system.nodes(); ++i) {
    if (system.is_fixed(i)) require(x.col(i) == given.start.col(i), summary, "a fixed node moved");
  }
  if (summary.status == Status::Converged) {
    detail::StoppingRule<System> rule;
    rule.set(system, given.start, tolerance);
    const double measure = rule.stationarity(gradient(system, x));
    const double most = rule.tolerance() * (1 + 1e-9) + rounding_of_stationarity(system, x, rule);
    if (!(measure <= most)) std::fprintf(stderr, "stationarity %.17g, at most %g\n", measure, most);
    require(measure <= most, summary, "converged, but not stationary");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes bytes(data, size);
  const auto& methods = bench::solvers();
  const bench::SolverEntry& method = methods[bytes.take<std::uint8_t>() % methods.size()];
  const bench::Limits limits{std::pow(10.0, -(bytes.take<std::uint8_t>() % 16)), bytes.take<std::uint8_t>()};
  const bench::Problem given = problem(bytes);
  if (given.system.defect()) return 0;  // the laboratory's runners would drop the invalid link
  const auto runner = method.make(given.system.nodes());
  try {
    runner->load(given);
  } catch (const std::invalid_argument&) {
    return 0;
  }
  Points x = given.start;
  const Summary summary = runner->solve(limits, x);
  check(given, summary, x, limits.tolerance);
  return 0;
}
