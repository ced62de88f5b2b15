// Positions from ranges.

#include <algorithm>
#include <asterism/solver/ranges/locate.hpp>
#include <cmath>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

namespace asterism::python {

namespace {

std::span<const double> span(const py::array_t<double>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

py::array_t<double> array_of(const std::vector<double>& values, const Shape& shape) {
  py::array_t<double> array(shape);
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

/// For each tag the status's message, whether its minima are proven, their number; and of all minima, tag
/// after tag, positions, covariances, energies and weights.
template <int Dim>
py::tuple locate_all(const RangeBatch& batch, const LocateOptions& options, int threads) {
  const auto tags = static_cast<std::size_t>(batch.tags);
  std::vector<PositionMinimum<Dim>> first(tags);
  std::vector<std::vector<PositionMinimum<Dim>>> others(tags);  // of most tags there are none
  std::vector<Message> messages(tags);
  std::vector<Status> statuses(tags);
  std::vector<char> proven(tags);
  const auto take = [&](int tag, const PositionFix<Dim>& fix) {
    const auto t = static_cast<std::size_t>(tag);
    statuses[t] = fix.status;
    messages[t] = fix.message;
    proven[t] = fix.proven;
    if (fix.count > 0) first[t] = fix.minima[0];
    others[t].assign(fix.minima.begin() + std::min(fix.count, 1), fix.minima.begin() + fix.count);
  };
  // Nearly all searches are short. Where one is not, or there are many, signals are looked for meanwhile.
  constexpr int kShort = 10'000;
  bool is_done = false;
  if (batch.tags <= 16) {
    LocateOptions few = options;
    few.max_cells = std::min(options.max_cells, kShort);
    const py::gil_scoped_release release;
    locate_each<Dim>(batch, few, 1, take);
    is_done =
        few.max_cells == options.max_cells || std::ranges::all_of(proven, [](char p) { return p != 0; });
  }
  if (!is_done) {
    interruptible([&](const std::atomic<bool>& stop) {
      return locate_each<Dim>(batch, options, threads, take, [&stop] { return stop.load(); });
    });
  }
  std::vector<double> x, covariance, energy, weight;
  py::array_t<int> counts(batch.tags);
  py::array_t<bool> is_proven(batch.tags);
  py::list texts;
  const auto append = [&](const PositionMinimum<Dim>& minimum) {
    x.insert(x.end(), minimum.x.begin(), minimum.x.end());
    covariance.insert(covariance.end(), minimum.covariance.begin(), minimum.covariance.end());
    energy.push_back(minimum.energy);
    weight.push_back(minimum.weight);
  };
  for (int tag = 0; tag < batch.tags; ++tag) {
    const auto t = static_cast<std::size_t>(tag);
    const std::string text(std::string_view{messages[t]});
    if (statuses[t] != Status::Converged)
      throw py::value_error(batch.tags == 1 ? text : "tag " + std::to_string(tag) + ": " + text);
    append(first[t]);
    for (const PositionMinimum<Dim>& minimum : others[t]) append(minimum);
    counts.mutable_at(tag) = static_cast<int>(1 + others[t].size());
    is_proven.mutable_at(tag) = proven[t] != 0;
    texts.append(text);
  }
  const auto all = static_cast<py::ssize_t>(energy.size());
  return py::make_tuple(texts, is_proven, counts, array_of(x, {all, Dim}),
                        array_of(covariance, {all, Dim, Dim}), array_of(energy, {all}),
                        array_of(weight, {all}));
}

}  // namespace

void bind_ranges(py::module_& m) {
  m.def(
      "_locate",
      [](const py::array_t<double>& beacons, const py::array_t<double>& ranges,
         const py::array_t<double>& sigma, double within, double cutoff, int max_cells, int threads) {
        if (threads < 0)
          throw py::value_error("threads: expected 0 or more, found " + std::to_string(threads));
        const LocateOptions options{within, cutoff, max_cells};
        if (const char* problem = options.problem()) throw py::value_error(problem);
        const RangeBatch batch{static_cast<int>(ranges.shape(0)), static_cast<int>(ranges.shape(1)),
                               span(beacons), span(ranges), span(sigma)};
        return beacons.shape(beacons.ndim() - 1) == 2 ? locate_all<2>(batch, options, threads)
                                                      : locate_all<3>(batch, options, threads);
      },
      py::arg("beacons"), py::arg("ranges"), py::arg("sigma"), py::arg("within"), py::arg("cutoff"),
      py::arg("max_cells").noconvert(), py::arg("threads").noconvert(),
      "What asterism.locate finds, for arrays of float64 in C order.");
}

}  // namespace asterism::python
