// Pictorial structures: what structures.py calls.

#include <algorithm>
#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/solver/discrete/m_best_placements.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/discrete/scaled_structure.hpp>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>

#include "bindings.hpp"
#include "interrupts.hpp"

namespace asterism::python {

namespace {

using Floats = py::array_t<float, py::array::forcecast>;

constexpr double kForbidden = std::numeric_limits<double>::infinity();  // also the cost of masked positions

py::array_t<int> positions_of(const PartPlacement& placement) {
  py::array_t<int> result({placement.positions.cols(), Eigen::Index{2}});
  std::memcpy(result.mutable_data(), placement.positions.data(), static_cast<std::size_t>(result.nbytes()));
  return result;
}

// ValueError for a number that would become infinite, which forbids a position.
void require_floats(const py::array& map, const std::string& name) {
  if (map.dtype().kind() != 'f' || map.itemsize() <= static_cast<py::ssize_t>(sizeof(float))) return;
  const py::module_ numpy = py::module_::import("numpy");
  const py::object is_large =
      numpy.attr("greater")(numpy.attr("abs")(map), std::numeric_limits<float>::max());
  const py::object is_beyond = numpy.attr("logical_and")(is_large, numpy.attr("isfinite")(map));
  if (!py::bool_(is_beyond.attr("any")())) return;
  const py::object first = map.attr("__getitem__")(is_beyond).attr("__getitem__")(0);
  throw py::value_error(name + ": " + py::str(first).cast<std::string>() + " is beyond float32");
}

// The map in place if its numbers can be addressed, else of a copy, which `kept` holds.
MapView<const float> view_of(const py::handle& given, int number, std::vector<py::array>& kept) {
  const std::string name = "map " + std::to_string(number);
  const auto found =
      real_numbers(unmasked(py::reinterpret_borrow<py::object>(given), name, kForbidden), name);
  require_floats(found, name);
  auto map = Floats::ensure(found);
  if (!map) throw std::bad_alloc();
  if (map.ndim() != 2)
    throw py::value_error(name + ": expected two dimensions, found shape " + text_of(shape_of(map)));
  constexpr auto kNumber = static_cast<py::ssize_t>(sizeof(float));
  const bool is_aligned = reinterpret_cast<std::uintptr_t>(map.data()) % alignof(float) == 0;
  if (!is_aligned || map.strides(0) % kNumber != 0 || map.strides(1) % kNumber != 0) map = map.attr("copy")();
  kept.push_back(map);
  constexpr py::ssize_t kMost = (1 << 20) + 1;  // more is refused
  const auto size = [&](int axis) { return static_cast<int>(std::min(map.shape(axis), kMost)); };
  return {map.data(), size(1), size(0), map.strides(0) / kNumber, map.strides(1) / kNumber};
}

// The maps of a call, and its joints.
struct Problem {
  std::vector<py::array> kept;
  std::vector<MapView<const float>> maps;
  std::vector<Joint> joints;
  std::vector<AxisCost> layers;  // costs of changes of layers
};

// `costs`: for each joint along x, y and layers: weight, offset, 1 for an absolute cost, truncation; then the
// weight, length and reach (-1 for no window) of the cost of its length, and 0.
Problem problem_of(const py::list& maps, const py::object& ends, const py::object& costs) {
  Problem problem;
  const auto joint_count = static_cast<py::ssize_t>(py::len(ends));
  const auto of_ends = numbers(ends, "ends", {joint_count, 2});
  const auto of_costs = numbers(costs, "costs", {joint_count, 4, 4});
  for (const py::handle& map : maps) {
    problem.maps.push_back(view_of(map, static_cast<int>(problem.maps.size()), problem.kept));
  }
  for (py::ssize_t k = 0; k < joint_count; ++k) {
    const auto whole = [](double value) { return static_cast<int>(std::clamp(value, -1.0, 1e9)); };
    const auto axis = [&](int number) {
      AxisCost cost;
      cost.weight = of_costs.at(k, number, 0);
      cost.offset = of_costs.at(k, number, 1);
      cost.shape = of_costs.at(k, number, 2) > 0 ? CostShape::Absolute : CostShape::Quadratic;
      cost.truncation = of_costs.at(k, number, 3);
      return cost;
    };
    Joint joint{whole(of_ends.at(k, 0)), whole(of_ends.at(k, 1)), {axis(0), axis(1)}};
    joint.cost.length = {of_costs.at(k, 3, 0), of_costs.at(k, 3, 1), whole(of_costs.at(k, 3, 2))};
    problem.joints.push_back(joint);
    problem.layers.push_back(axis(2));
  }
  return problem;
}

// Throws what a summary without a placement says.
template <typename Summary>
void require_placement(const Summary& summary) {
  if (summary.status == Status::OutOfMemory) throw std::bad_alloc();
  if (!summary.usable()) throw py::value_error(std::string(summary.message));
}

py::array_t<float> array_of(const MapView<const float>& map) {
  py::array_t<float> result({map.height, map.width});
  std::memcpy(result.mutable_data(), map.data, static_cast<std::size_t>(result.nbytes()));
  return result;
}

py::list list_of(const std::vector<PartPlacement>& placements, int found) {
  py::list all;
  for (int k = 0; k < found; ++k) {
    const PartPlacement& one = placements[static_cast<std::size_t>(k)];
    all.append(py::make_tuple(one.energy, positions_of(one)));
  }
  return all;
}

py::tuple solve(const py::list& maps, const py::object& ends, const py::object& costs, int count,
                double distance) {
  const Problem problem = problem_of(maps, ends, costs);
  PictorialStructure structure;
  PartPlacement best;
  std::vector<PartPlacement> placements;
  PictorialSummary summary;
  int found = 0;
  interruptible([&](const std::atomic<bool>& stop) {
    structure.stop = &stop;
    summary = structure.solve(problem.joints, problem.maps, best);
    found = structure.best_placements(count, distance, placements);
  });
  require_placement(summary);
  return py::make_tuple(best.energy, positions_of(best), structure.root(),
                        array_of(structure.root_min_marginals()), list_of(placements, found));
}

py::list solve_m_best(const py::list& maps, const py::object& ends, const py::object& costs, int count,
                      double distance) {
  const Problem problem = problem_of(maps, ends, costs);
  MBestPlacements search;
  std::vector<PartPlacement> placements;
  PictorialSummary summary;
  interruptible([&](const std::atomic<bool>& stop) {
    search.stop = &stop;
    summary = search.solve(problem.joints, problem.maps, count, distance, placements);
  });
  require_placement(summary);
  return list_of(placements, search.found());
}

py::tuple solve_scaled(const py::list& maps, const py::object& ends, const py::object& costs,
                       const py::object& given_scales, int count, double distance) {
  const Problem problem = problem_of(maps, ends, costs);
  const auto of_scales = numbers(given_scales, "scales", {static_cast<py::ssize_t>(py::len(given_scales))});
  const std::vector<double> scales(of_scales.data(), of_scales.data() + of_scales.size());
  std::vector<ScaledJoint> joints;
  for (std::size_t k = 0; k < problem.joints.size(); ++k) {
    joints.push_back({problem.joints[k], problem.layers[k]});
  }
  ScaledStructure structure;
  ScaledPlacement best;
  std::vector<ScaledPlacement> placements;
  PictorialSummary summary;
  int found = 0;
  interruptible([&](const std::atomic<bool>& stop) {
    structure.stop = &stop;
    summary = structure.solve(joints, scales, problem.maps, best);
    found = structure.best_placements(count, distance, placements);
  });
  require_placement(summary);
  const auto layers_of = [](const ScaledPlacement& placement) {
    return py::array_t<int>(placement.layers.size(), placement.layers.data());
  };
  py::list marginals, all;
  for (int l = 0; l < static_cast<int>(scales.size()); ++l) {
    marginals.append(array_of(structure.root_min_marginals(l)));
  }
  for (int k = 0; k < found; ++k) {
    const ScaledPlacement& one = placements[static_cast<std::size_t>(k)];
    all.append(py::make_tuple(one.energy, positions_of(one), layers_of(one)));
  }
  return py::make_tuple(best.energy, positions_of(best), layers_of(best), structure.root(), marginals, all);
}

py::tuple solve_loopy(const py::list& maps, const py::object& ends, const py::object& costs, double tolerance,
                      double progress, int max_iterations) {
  const Problem problem = problem_of(maps, ends, costs);
  LoopyStructure structure;
  structure.options = {.tolerance = tolerance, .progress = progress, .max_iterations = max_iterations};
  PartPlacement best;
  LoopySummary summary;
  interruptible([&](const std::atomic<bool>& stop) {
    structure.options.stop = &stop;
    summary = structure.solve(problem.joints, problem.maps, best);
  });
  require_placement(summary);
  return py::make_tuple(summary.status, summary.iterations, summary.energy, summary.lower_bound,
                        positions_of(best));
}

}  // namespace

void bind_discrete(py::module_& m) {
  m.def("_pictorial_structure", &solve, py::arg("maps"), py::arg("ends"), py::arg("costs"), py::arg("count"),
        py::arg("distance"));
  m.def("_m_best_placements", &solve_m_best, py::arg("maps"), py::arg("ends"), py::arg("costs"),
        py::arg("count"), py::arg("distance"));
  m.def("_scaled_structure", &solve_scaled, py::arg("maps"), py::arg("ends"), py::arg("costs"),
        py::arg("scales"), py::arg("count"), py::arg("distance"));
  m.def("_loopy_structure", &solve_loopy, py::arg("maps"), py::arg("ends"), py::arg("costs"),
        py::arg("tolerance"), py::arg("progress"), py::arg("max_iterations"));
}

}  // namespace asterism::python
