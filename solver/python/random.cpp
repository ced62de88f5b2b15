// Random systems of the kinds that the solver laboratory measures, for asterism.bench.
#include <asterism/testing/random_system.hpp>

#include "bindings.hpp"

namespace asterism::python {
namespace {

template <int Dim>
py::tuple made(testing::Kind kind, int nodes, std::uint64_t seed) {
  testing::Rng rng(seed);
  const auto topology = Topology<>::full(nodes);
  auto random = kind == testing::Kind::Track ? testing::random_track_system<System<Dim>>(rng, topology)
                                             : testing::random_paper_system<System<Dim>>(rng, topology, kind);
  const Eigen::MatrixXd start = random.start;
  return py::make_tuple(AnySystem{std::move(random.system)}, owned(start, {start.cols(), start.rows()}));
}

}  // namespace

void bind_random(py::module_& m) {
  m.def(
      "random_system",
      [](const std::string& kind, int nodes, std::uint64_t seed, int dim) {
        if (nodes < 1 || nodes > 10000)
          throw py::value_error("nodes: expected 1 to 10000, found " + std::to_string(nodes));
        if (dim != 2 && dim != 3) throw py::value_error("dim: expected 2 or 3, found " + std::to_string(dim));
        for (const testing::Kind known : testing::kKinds) {
          if (kind == to_string(known))
            return dim == 2 ? made<2>(known, nodes, seed) : made<3>(known, nodes, seed);
        }
        throw py::value_error("kind: expected 'lit', 'orig', 'disp' or 'track', found '" + kind + "'");
      },
      py::arg("kind"), py::arg("nodes").noconvert(), py::arg("seed").noconvert(),
      py::arg("dim").noconvert() = 2,
      "A random system of fully linked nodes, and its start (N, dim). kind: 'lit', 'orig' and 'disp' are\n"
      "the three readings of the paper's Sec. 3.2.1, 'track' a grid of parts that moved together, one in\n"
      "ten found far off. The same seed gives the same system.");
}

}  // namespace asterism::python
