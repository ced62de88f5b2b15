// Pictorial structures: what structures.py calls.

#include <algorithm>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <cstdint>
#include <cstring>

#include "bindings.hpp"

namespace asterism::python {

namespace {

using Floats = py::array_t<float, py::array::forcecast>;

py::array_t<int> positions_of(const PartPlacement& placement) {
  py::array_t<int> result({placement.positions.cols(), Eigen::Index{2}});
  std::memcpy(result.mutable_data(), placement.positions.data(), static_cast<std::size_t>(result.nbytes()));
  return result;
}

// The map in place if its numbers can be addressed, else of a copy, which `kept` holds.
MapView<const float> view_of(const py::handle& given, int number, std::vector<py::array>& kept) {
  const std::string name = "map " + std::to_string(number);
  auto map = Floats::ensure(given);
  if (!map) {
    PyErr_Clear();
    throw py::type_error(name + ": expected numbers, found " + type_name(given));
  }
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

// `costs`: for each joint, along x and y: weight, offset, 1 for an absolute cost, truncation.
py::tuple solve(const py::list& maps, const py::object& ends, const py::object& costs, int count,
                double distance) {
  const auto joint_count = static_cast<py::ssize_t>(py::len(ends));
  const auto of_ends = numbers(ends, "ends", {joint_count, 2});
  const auto of_costs = numbers(costs, "costs", {joint_count, 2, 4});
  std::vector<py::array> kept;
  std::vector<MapView<const float>> views;
  for (const py::handle& map : maps) views.push_back(view_of(map, static_cast<int>(views.size()), kept));
  std::vector<Joint> joints(static_cast<std::size_t>(joint_count));
  for (py::ssize_t k = 0; k < joint_count; ++k) {
    Joint& joint = joints[static_cast<std::size_t>(k)];
    const auto part = [&](int end) { return static_cast<int>(std::clamp(of_ends.at(k, end), -1.0, 1e9)); };
    joint.parent = part(0);
    joint.child = part(1);
    for (int axis = 0; axis < 2; ++axis) {
      AxisCost& cost = axis == 0 ? joint.cost.x : joint.cost.y;
      cost.weight = of_costs.at(k, axis, 0);
      cost.offset = of_costs.at(k, axis, 1);
      cost.shape = of_costs.at(k, axis, 2) > 0 ? CostShape::Absolute : CostShape::Quadratic;
      cost.truncation = of_costs.at(k, axis, 3);
    }
  }
  PictorialStructure structure;
  PartPlacement best;
  std::vector<PartPlacement> placements;
  PictorialSummary summary;
  int found = 0;
  {
    const py::gil_scoped_release release;
    summary = structure.solve(joints, views, best);
    found = structure.best_placements(count, distance, placements);
  }
  if (summary.status == Status::OutOfMemory) throw std::bad_alloc();
  if (!summary.usable()) throw py::value_error(std::string(std::string_view(summary.message)));
  const MapView<const float> marginals = structure.root_min_marginals();
  py::array_t<float> of_root({marginals.height, marginals.width});
  std::memcpy(of_root.mutable_data(), marginals.data, static_cast<std::size_t>(of_root.nbytes()));
  py::list all;
  for (int k = 0; k < found; ++k) {
    const PartPlacement& one = placements[static_cast<std::size_t>(k)];
    all.append(py::make_tuple(one.energy, positions_of(one)));
  }
  return py::make_tuple(best.energy, positions_of(best), structure.root(), of_root, all);
}

}  // namespace

void bind_discrete(py::module_& m) {
  m.def("_pictorial_structure", &solve, py::arg("maps"), py::arg("ends"), py::arg("costs"), py::arg("count"),
        py::arg("distance"));
}

}  // namespace asterism::python
