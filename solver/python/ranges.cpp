// Positions from ranges.

#include <pybind11/stl.h>

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <asterism/solver/ranges/locate.hpp>
#include <asterism/solver/ranges/path.hpp>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "bindings.hpp"
#include "interrupts.hpp"

template <>
inline constexpr bool kIsBoundToPython<asterism::PathStream> = true;

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

/// For each tag the status's message, whether its minima are proven, up to which energy above the least one
/// they are listed, their number; and of all minima, tag after tag, positions, covariances, energies and
/// weights.
template <int Dim>
py::tuple locate_all(const RangeBatch& batch, const LocateOptions& options, int threads) {
  const auto tags = static_cast<std::size_t>(batch.tags);
  std::vector<PositionMinimum<Dim>> first(tags);
  std::vector<std::vector<PositionMinimum<Dim>>> others(tags);  // of most tags there are none
  std::vector<Message> messages(tags);
  std::vector<Status> statuses(tags);
  std::vector<char> proven(tags);
  std::vector<double> within(tags);
  const auto take = [&](int tag, const PositionFix<Dim>& fix) {
    const auto t = static_cast<std::size_t>(tag);
    statuses[t] = fix.status;
    messages[t] = fix.message;
    proven[t] = fix.proven;
    within[t] = fix.within;
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
    const std::string text(messages[t]);
    if (statuses[t] != Status::Converged)
      throw py::value_error(batch.tags == 1 ? text : "tag " + std::to_string(tag) + ": " + text);
    append(first[t]);
    for (const PositionMinimum<Dim>& minimum : others[t]) append(minimum);
    counts.mutable_at(tag) = static_cast<int>(1 + others[t].size());
    is_proven.mutable_at(tag) = proven[t] != 0;
    texts.append(text);
  }
  const auto all = static_cast<py::ssize_t>(energy.size());
  return py::make_tuple(texts, is_proven, array_of(within, {batch.tags}), counts, array_of(x, {all, Dim}),
                        array_of(covariance, {all, Dim, Dim}), array_of(energy, {all}),
                        array_of(weight, {all}));
}

/// What asterism.locate_path finds.
py::dict path(const py::array_t<double>& steps, const py::array_t<double>& beacons,
              const py::array_t<double>& pose, const py::array_t<int>& beacon,
              const py::array_t<double>& range, const py::array_t<double>& sigma, PathOptions options) {
  const std::span<const int> to{beacon.data(), static_cast<std::size_t>(beacon.size())};
  const PathMeasurements measurements{span(steps), span(beacons), span(pose), to, span(range), span(sigma)};
  const PathEstimate found = interruptible([&](const std::atomic<bool>& stop) {
    options.stop = &stop;
    return locate_path(measurements, options);
  });
  const std::string text(found.message);
  if (found.status == Status::InvalidInput || found.status == Status::NumericalFailure)
    throw py::value_error(text);
  const auto poses = static_cast<py::ssize_t>(found.heading.size()), count = beacons.shape(0);
  py::dict result;
  result["x"] = array_of(found.x, {poses, 2});
  result["heading"] = array_of(found.heading, {poses});
  result["covariance"] = array_of(found.covariance, {poses, 2, 2});
  result["beacons"] = array_of(found.beacons, {count, 2});
  result["beacon_covariance"] = array_of(found.beacon_covariance, {count, 2, 2});
  result["residuals"] = array_of(found.residuals, {static_cast<py::ssize_t>(found.residuals.size())});
  result["energy"] = found.energy;
  result["lower_bound"] = found.lower_bound;
  result["evidence"] = found.evidence;
  result["turn_sigma"] = found.turn_sigma;
  result["scale"] = found.scale;
  result["scale_deviation"] = found.scale_deviation;
  result["converged"] = found.status == Status::Converged;
  result["message"] = text;
  return result;
}

void checked(const Message& message) {
  if (!message.empty()) throw py::value_error(std::string(message));
}

py::array_t<double> positions_of(const std::vector<double>& values) {
  return array_of(values, {static_cast<py::ssize_t>(values.size() / 2), 2});
}

void bind_path(py::module_& m) {
  m.def(
      "_locate_path",
      [](const py::array_t<double>& steps, const py::array_t<double>& beacons,
         const py::array_t<double>& pose, const py::array_t<int>& beacon, const py::array_t<double>& range,
         const py::array_t<double>& sigma, double cutoff, double turn_sigma, double step_sigma,
         double scale_sigma, double shortest, const std::array<double, 3>& start,
         const std::array<double, 2>& start_sigma, bool lower_bound, int max_iterations) {
        PathOptions options;
        options.cutoff = cutoff;
        options.turn_sigma = turn_sigma;
        options.step_sigma = step_sigma;
        options.scale_sigma = scale_sigma;
        options.shortest = shortest;
        options.start = start;
        options.start_sigma = start_sigma;
        options.lower_bound = lower_bound;
        options.max_iterations = max_iterations;
        return path(steps, beacons, pose, beacon, range, sigma, options);
      },
      py::arg("steps"), py::arg("beacons"), py::arg("pose"), py::arg("beacon"), py::arg("range"),
      py::arg("sigma"), py::arg("cutoff"), py::arg("turn_sigma"), py::arg("step_sigma"),
      py::arg("scale_sigma"), py::arg("shortest"), py::arg("start"), py::arg("start_sigma"),
      py::arg("lower_bound"), py::arg("max_iterations").noconvert(),
      "What asterism.locate_path finds, for arrays of float64 in C order.");

  py::class_<PathStream>(
      m, "PathStream",
      "The path of a robot in the plane as odometry and ranges to known beacons come in, in constant "
      "memory.\n\n"
      "The energy is that of locate_path, over a window of the last positions; older ones are marginalised. "
      "After every\n"
      "settle_every ranges, and after settle(), the estimate is at the minimum: see docs/locate.md.")
      .def(py::init([](double shortest, const py::object& start, const py::object& start_sigma, int window,
                       std::optional<double> cutoff, double turn_sigma, double step_sigma, int settle_every) {
             PathStreamOptions options;
             options.window = window;
             if (cutoff) options.cutoff = *cutoff;
             options.turn_sigma = turn_sigma;
             options.step_sigma = step_sigma;
             options.shortest = shortest;
             if (!start.is_none()) options.start = numbers<3>(start, "start");
             if (!start_sigma.is_none()) options.start_sigma = numbers<2>(start_sigma, "start_sigma");
             options.settle_every = settle_every;
             if (const char* problem = options.problem()) throw py::value_error(problem);
             return PathStream(options);
           }),
           py::kw_only(), py::arg("shortest"), py::arg("start") = py::none(),
           py::arg("start_sigma") = py::none(), py::arg("window").noconvert() = 10'000,
           py::arg("cutoff") = py::none(), py::arg("turn_sigma") = 0.003, py::arg("step_sigma") = 0.1,
           py::arg("settle_every").noconvert() = 100,
           "shortest, cutoff, turn_sigma, step_sigma: as locate_path's, which estimates turn_sigma from a "
           "recording.\n"
           "start: x, y [m] and heading [rad] of the first pose; None: (0, 0, 0).\n"
           "start_sigma: standard deviations of its place [m] and heading [rad]; None: (1, 0.5).\n"
           "window: positions that are kept at least, >= 16; up to a tenth more are.\n"
           "settle_every: ranges, >= 1.\n\n"
           "ValueError for numbers that are out of range.")
      .def(
          "move",
          [](PathStream& stream, double x, double y, double turn) { checked(stream.move(x, y, turn)); },
          py::arg("x"), py::arg("y"), py::arg("turn"),
          "The robot moves by (x, y) in its own frame [m] and then turns [rad]. ValueError for numbers that "
          "are not finite.")
      .def(
          "range",
          [](PathStream& stream, const py::object& beacon, double range, double sigma) {
            const auto [x, y] = numbers<2>(beacon, "beacon");
            checked(stream.range(x, y, range, sigma));
          },
          py::arg("beacon"), py::arg("range"), py::arg("sigma"),
          "A range to the beacon at (x, y), and its standard deviation [m]; NaN if nothing was heard. "
          "ValueError, and nothing changes,\n"
          "for a negative range, a sigma that is not > 0, or numbers that are not finite.")
      .def("settle", &PathStream::settle, "Goes to the minimum.")
      .def(
          "batch", [](const PathStream& stream) { return positions_of(stream.batch()); },
          "The window's positions (N, 2) at the minimum of the same energy, by locate_path's descent over\n"
          "the whole window: what `positions` has to be after settle().")
      .def_property_readonly("pose", &PathStream::pose, "Where the robot is now: x, y [m] and heading [rad].")
      .def_property_readonly(
          "covariance",
          [](PathStream& stream) {
            const std::array<double, 4> s = stream.covariance();
            return array_of({s.begin(), s.end()}, {2, 2});
          },
          "The covariance (2, 2) of x and y [m^2]; infinite before the robot has moved by `shortest`.")
      .def_property_readonly(
          "positions", [](const PathStream& stream) { return positions_of(stream.positions()); },
          "The window's positions (N, 2) [m].")
      .def_property_readonly("energy", &PathStream::energy, "The window's energy.")
      .def("__repr__", [](const PathStream& stream) {
        const std::array<double, 3> at = stream.pose();
        return py::str("<asterism.PathStream: {} in the window, pose ({:g}, {:g}, {:g})>")
            .format(detail::counted(stream.positions().size() / 2, "position"), at[0], at[1], at[2]);
      });
}

}  // namespace

void bind_ranges(py::module_& m) {
  bind_path(m);
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
