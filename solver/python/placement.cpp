// What asterism.MDS and the starts of asterism.mds need of points that are placed one by one: distances,
// the place of a point among others that are held, and isotonic regression.

#include <Eigen/Core>
#include <algorithm>
#include <asterism/solver/graph/placement.hpp>
#include <asterism/solver/run/executor.hpp>
#include <atomic>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

namespace asterism::python {

namespace {

using Numbers = py::array_t<double, py::array::c_style>;
using Table = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

/// f(worker, row) for all rows, on threads that Ctrl-C ends.
template <typename F>
void for_each_row(Eigen::Index rows, int threads, F&& f) {
  constexpr Eigen::Index kChunk = 64;
  const int chunks = static_cast<int>((rows + kChunk - 1) / kChunk);
  interruptible([&](const std::atomic<bool>& stop) {
    detail::for_each_task(detail::thread_count(threads), chunks, [&](int worker, int chunk) {
      const Eigen::Index first = chunk * kChunk;
      for (Eigen::Index row = first; row < std::min(rows, first + kChunk) && !stop; ++row) f(worker, row);
    });
    return true;
  });
}

Table map(const Numbers& array) { return {array.data(), array.shape(0), array.shape(1)}; }

/// (M, dim): a place for each row of the distances.
py::array_t<double> place(const Numbers& held, const Numbers& distances, const Numbers& weights,
                          const Numbers& starts, int threads) {
  // A row of an array here is a column there.
  const auto columns = [](const Numbers& a) {
    return Eigen::Map<const Eigen::MatrixXd>(a.data(), a.shape(1), a.shape(0));
  };
  const Eigen::MatrixXd places = interruptible([&](const std::atomic<bool>& stop) {
    return place_points(columns(held), columns(distances), columns(weights), columns(starts),
                        {.threads = threads, .stop = &stop});
  });
  return py::array_t<double>(Shape{places.cols(), places.rows()}, places.data());
}

/// (M, K): Euclidean distances of the rows of a from those of b; equal rows have the distance 0.
py::array_t<double> distances(const Numbers& a, const Numbers& b, int threads) {
  if (a.shape(1) != b.shape(1)) throw py::value_error("as many columns in both");
  py::array_t<double> result(Shape{a.shape(0), b.shape(0)});
  const auto from = map(a), to = map(b);
  const Eigen::MatrixXd columns = to;  // K x features: the loop along it is over memory
  double* const out = result.mutable_data();
  for_each_row(a.shape(0), threads, [&](int, Eigen::Index row) {
    Eigen::Map<Eigen::ArrayXd> sum(out + row * columns.rows(), columns.rows());
    sum.setZero();
    for (Eigen::Index f = 0; f < columns.cols(); ++f) sum += (columns.col(f).array() - from(row, f)).square();
    sum = sum.sqrt();
  });
  return result;
}

/// The non-decreasing sequence nearest to the values, in the sense of weighted squares: pool adjacent
/// violators (Kruskal 1964).
py::array_t<double> isotonic(const Numbers& values, const Numbers& weights) {
  if (values.size() != weights.size()) throw py::value_error("a weight for each value");
  struct Block {
    double mean, weight;
    py::ssize_t count;
  };
  std::vector<Block> blocks;
  for (py::ssize_t i = 0; i < values.size(); ++i) {
    Block block{values.data()[i], weights.data()[i], 1};
    while (!blocks.empty() && blocks.back().mean >= block.mean) {
      const Block& last = blocks.back();
      const double weight = last.weight + block.weight;
      block = {last.mean + block.weight / weight * (block.mean - last.mean), weight,
               last.count + block.count};
      blocks.pop_back();
    }
    blocks.push_back(block);
  }
  py::array_t<double> result(values.size());
  double* next = result.mutable_data();
  for (const Block& block : blocks) next = std::fill_n(next, block.count, block.mean);
  return result;
}

}  // namespace

void bind_placement(py::module_& m) {
  m.def("_place", &place, py::arg("held"), py::arg("distances"), py::arg("weights"), py::arg("starts"),
        py::arg("threads"));
  m.def("_distances", &distances, py::arg("a"), py::arg("b"), py::arg("threads"));
  m.def("_isotonic", &isotonic, py::arg("values"), py::arg("weights"));
}

}  // namespace asterism::python
