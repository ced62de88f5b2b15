// The chains of joints over time, for asterism.pose.
#include <pybind11/stl.h>

#include <asterism/solver/linear/difference_chains.hpp>
#include <limits>
#include <optional>

#include "bindings.hpp"
#include "pose_path.hpp"
#include "pose_window.hpp"

namespace asterism::python {
namespace {

using Floats = py::array_t<double, py::array::c_style>;
using Flags = py::array_t<bool, py::array::c_style>;
using pose::Index;
using pose::Numbers;

template <int Dim>
py::tuple chains(const Floats& information, const Floats& right_side, const Floats& coefficients,
                 const Floats& weight, const Floats& prior) {
  const auto points = information.shape(0), joints = information.shape(1);
  Floats x(shape_of(right_side)), spread({std::max<Index>(points - 2, 0), joints}),
      covariance({points, joints, Index{DifferenceChains<Dim>::kEntries}}), log_det(joints);
  std::copy_n(right_side.data(), right_side.size(), x.mutable_data());
  DifferenceChains<Dim> factors;
  if (!factors.factorize(static_cast<std::size_t>(points), static_cast<std::size_t>(joints),
                         information.data(), coefficients.data(), weight.data(),
                         prior.size() > 0 ? prior.data() : nullptr))
    throw py::value_error("not positive definite");
  factors.solve(x.mutable_data());
  factors.covariance(coefficients.data(), covariance.mutable_data(), spread.mutable_data());
  std::copy_n(factors.log_det().data(), joints, log_det.mutable_data());
  return py::make_tuple(x, covariance, spread, log_det);
}

void expect_shape(const py::array& array, const Shape& shape) {
  if (shape_of(array) != shape) throw py::value_error("arrays of these shapes do not belong together");
}

Floats array_of(const Numbers& numbers, const Shape& shape) {
  Floats result(shape);
  std::copy(numbers.begin(), numbers.end(), result.mutable_data());
  return result;
}

/// A pose::Recording and the arrays that it is on.
class PoseRecording {
 public:
  PoseRecording(Floats sights, Flags is_seen, Floats belief, Floats times, Floats cameras, Floats area,
                std::optional<Floats> deviation)
      : sights_(std::move(sights)),
        is_seen_(std::move(is_seen)),
        belief_(std::move(belief)),
        times_(std::move(times)),
        cameras_(std::move(cameras)),
        area_(std::move(area)),
        deviation_(std::move(deviation)) {
    if (sights_.ndim() != 4) throw py::value_error("sights: expected shape (views, frames, joints, 6)");
    const auto views = sights_.shape(0), frames = sights_.shape(1), joints = sights_.shape(2);
    const bool is_flat = cameras_.size() == 0;
    expect_shape(sights_, {views, frames, joints, 6});
    expect_shape(is_seen_, {views, frames, joints});
    expect_shape(belief_, {views, frames, joints});
    expect_shape(times_, {frames});
    expect_shape(cameras_, {is_flat ? 0 : views, 12});
    expect_shape(area_, {views});
    if (deviation_) expect_shape(*deviation_, {views, frames, joints});
    of_ = {is_flat ? 2 : 3,
           views,
           frames,
           joints,
           sights_.data(),
           is_seen_.data(),
           belief_.data(),
           times_.data(),
           cameras_.data(),
           area_.data(),
           deviation_ ? deviation_->data() : nullptr};
  }

  py::array_t<double> centre() const {
    pose::Middle middle;
    {
      const py::gil_scoped_release release;
      middle = pose::Part(of_, 0, of_.frames).middle();
    }
    return py::array_t<double>(of_.dim, middle.point);
  }

  py::object estimate(Index begin, Index end, double settled, int steps) const {
    if (begin < 0 || end > of_.frames || begin >= end) throw py::value_error("no such frames");
    std::optional<pose::Estimate> found;
    {
      const py::gil_scoped_release release;
      found = pose::estimated(of_, begin, end, settled, steps);
    }
    if (!found) return py::none();
    const Index frames = end - begin, joints = static_cast<Index>(found->joints.size()), views = of_.views;
    const pose::Scales& scales = found->scales;
    return py::make_tuple(
        py::array_t<Index>(joints, found->joints.data()),
        py::make_tuple(array_of(scales.noise, {views, joints}), array_of(scales.motion, {joints}),
                       array_of(scales.offset, {views, joints, 2}), scales.disagreement, scales.extent),
        array_of(found->points, {frames, joints, of_.dim}),
        array_of(found->covariance, {frames, joints, pose::entries_of(of_.dim)}),
        array_of(found->probability, {views, frames, joints}),
        array_of(found->weight, {views, frames, joints}), array_of(found->curvature, {views, frames, joints}),
        array_of(found->stiffness, {std::max<Index>(frames - 2, 0), joints}));
  }

  py::tuple path(const Floats& points, const Floats& weight, const Floats& curvature, const Floats& stiffness,
                 const Floats& offset, const Floats& centre, double extent, int threads) const {
    Floats found = checked_points(points), covariance(entries_shape());
    const pose::Weights weights = checked(weight, curvature, stiffness, offset, centre, extent);
    double *to = found.mutable_data(), *to_covariance = covariance.mutable_data();
    {
      const py::gil_scoped_release release;
      pose::solve_path(of_, weights, threads, to, to_covariance);
    }
    return py::make_tuple(found, covariance);
  }

  Floats lasting(const Floats& points, const Floats& weight, const Floats& stiffness, double extent,
                 int threads) const {
    const Floats at = checked_points(points);
    const Floats offset = zeros({of_.views, of_.joints, 2}), centre = zeros({of_.dim});
    Floats covariance = zeros(entries_shape());
    const pose::Weights weights = checked(weight, weight, stiffness, offset, centre, extent);
    if (!deviation_) return covariance;
    double* to = covariance.mutable_data();
    {
      const py::gil_scoped_release release;
      pose::lasting_covariance(of_, weights, threads, at.data(), to);
    }
    return covariance;
  }

  Floats systematic(const Floats& points, double disagreement, int threads) const {
    const Floats at = checked_points(points);
    Floats covariance = zeros(entries_shape());
    double* to = covariance.mutable_data();
    if (disagreement != 0) {
      const py::gil_scoped_release release;
      pose::add_systematic(of_, disagreement, threads, at.data(), to);
    }
    return covariance;
  }

 private:
  static Floats zeros(const Shape& shape) {
    Floats result(shape);
    std::fill_n(result.mutable_data(), result.size(), 0.0);
    return result;
  }
  Shape entries_shape() const { return {of_.frames, of_.joints, pose::entries_of(of_.dim)}; }

  /// A copy.
  Floats checked_points(const Floats& points) const {
    expect_shape(points, {of_.frames, of_.joints, of_.dim});
    Floats result(shape_of(points));
    std::copy_n(points.data(), points.size(), result.mutable_data());
    return result;
  }

  pose::Weights checked(const Floats& weight, const Floats& curvature, const Floats& stiffness,
                        const Floats& offset, const Floats& centre, double extent) const {
    expect_shape(curvature, {of_.views, of_.frames, of_.joints});
    expect_shape(weight, {of_.views, of_.frames, of_.joints});
    expect_shape(stiffness, {std::max<Index>(of_.frames - 2, 0), of_.joints});
    expect_shape(offset, {of_.views, of_.joints, 2});
    expect_shape(centre, {of_.dim});
    return {weight.data(), curvature.data(), stiffness.data(), offset.data(), centre.data(), extent};
  }

  Floats sights_;
  Flags is_seen_;
  Floats belief_, times_, cameras_, area_;
  std::optional<Floats> deviation_;
  pose::Recording of_;
};

std::vector<pose::Lens> lenses(const Floats& matrices, const Floats& distortions) {
  const auto views = matrices.shape(0);
  expect_shape(matrices, {views, 3, 3});
  expect_shape(distortions, {views, 5});
  std::vector<pose::Lens> result;
  for (Index v = 0; v < views; ++v) result.emplace_back(matrices.data() + v * 9, distortions.data() + v * 5);
  return result;
}

/// pixels (views, .., 2) -> sights (views, .., 6).
Floats sights(const Floats& pixels, const Floats& matrices, const Floats& distortions, int threads) {
  const std::vector<pose::Lens> of = lenses(matrices, distortions);
  const auto views = static_cast<Index>(of.size());
  Shape shape = shape_of(pixels);
  if (shape.size() < 2 || shape.front() != views || shape.back() != 2)
    throw py::value_error("pixels: expected shape (views, .., 2)");
  shape.back() = 6;
  Floats found(shape);
  const Index each = views == 0 ? 0 : pixels.size() / (2 * views);
  const double* from = pixels.data();
  double* to = found.mutable_data();
  const py::gil_scoped_release release;
  detail::for_each_task(threads, static_cast<int>(views), [&](int, int view) {
    for (Index i = view * each; i < (view + 1) * each; ++i)
      of[static_cast<std::size_t>(view)].undistort(from + i * 2, to + i * 6);
  });
  return found;
}

/// A pose::Window, which is used with the GIL held.
class PoseWindow {
 public:
  PoseWindow(int frames, const py::tuple& scales, const Floats& cameras, const Floats& matrices,
             const Floats& distortions, const Floats& area, const Floats& slope, const Floats& centre)
      : window_(setting(frames, scales, cameras, matrices, distortions, area, slope, centre)) {}

  py::tuple push(const Floats& pixels, const Floats& belief, double time) {
    expect_shape(pixels, {views_, joints_, 2});
    expect_shape(belief, {views_, joints_});
    const pose::Window::Newest found = window_.push(pixels.data(), belief.data(), time);
    Floats covariance({joints_, Index{dim_}, Index{dim_}});
    double* to = covariance.mutable_data();
    for (Index j = 0, k = 0; j < joints_; ++j, to += dim_ * dim_) {
      for (int r = 0; r < dim_; ++r) {
        for (int c = r; c < dim_; ++c, ++k)
          to[r * dim_ + c] = to[c * dim_ + r] = found.covariance[static_cast<std::size_t>(k)];
      }
    }
    Flags outlier({views_, joints_});
    std::copy(found.outlier.begin(), found.outlier.end(), outlier.mutable_data());
    return py::make_tuple(array_of(found.points, {joints_, dim_}), covariance, outlier);
  }

  Floats points() { return array_of(window_.points(), {window_.frames(), joints_, dim_}); }

  py::tuple evidence() {
    const auto [information, right, stiffness, coefficients] = window_.evidence();
    const Index frames = window_.frames(), changes = std::max<Index>(frames - 2, 0);
    return py::make_tuple(array_of(information, {frames, joints_, pose::entries_of(dim_)}),
                          array_of(right, {frames, joints_, dim_}), array_of(stiffness, {changes, joints_}),
                          array_of(coefficients, {changes, 3}));
  }

 private:
  pose::Window::Setting setting(int frames, const py::tuple& scales, const Floats& cameras,
                                const Floats& matrices, const Floats& distortions, const Floats& area,
                                const Floats& slope, const Floats& centre) {
    const auto numbers = [](const Floats& array) {
      return Numbers(array.data(), array.data() + array.size());
    };
    const auto noise = scales[0].cast<Floats>(), motion = scales[1].cast<Floats>();
    const auto offset = scales[2].cast<Floats>(), jitter = scales[5].cast<Floats>();
    dim_ = cameras.size() == 0 ? 2 : 3;
    if (noise.ndim() != 2) throw py::value_error("noise: expected shape (views, joints)");
    views_ = noise.shape(0);
    joints_ = noise.shape(1);
    expect_shape(motion, {joints_});
    expect_shape(jitter, {joints_});
    expect_shape(offset, {views_, joints_, 2});
    expect_shape(cameras, {dim_ == 2 ? 0 : views_, 12});
    expect_shape(matrices, {dim_ == 2 ? 0 : views_, 3, 3});
    expect_shape(area, {views_});
    expect_shape(slope, {views_, 4});
    expect_shape(centre, {dim_});
    return {dim_,
            frames,
            views_,
            joints_,
            {numbers(noise), numbers(motion), numbers(offset), scales[3].cast<double>(),
             scales[4].cast<double>()},
            numbers(cameras),
            lenses(matrices, distortions),
            numbers(area),
            numbers(slope),
            numbers(jitter),
            numbers(centre)};
  }

  int dim_ = 0;
  Index views_ = 0, joints_ = 0;
  pose::Window window_;
};

}  // namespace

void bind_pose(py::module_& m) {
  m.def(
      "_difference_chains",
      [](const Floats& information, const Floats& right_side, const Floats& coefficients,
         const Floats& weight, const std::optional<Floats>& given_prior) {
        const Floats prior = given_prior.value_or(Floats(0));
        const auto points = right_side.shape(0), joints = right_side.shape(1), dim = right_side.shape(2);
        const auto differences = std::max<py::ssize_t>(points - 2, 0);
        expect_shape(information, {points, joints, dim * (dim + 1) / 2});
        expect_shape(coefficients, {differences, 3});
        expect_shape(weight, {differences, joints});
        if (prior.size() > 0) expect_shape(prior, {joints, 2 * dim, 2 * dim});
        return dim == 2 ? chains<2>(information, right_side, coefficients, weight, prior)
                        : chains<3>(information, right_side, coefficients, weight, prior);
      },
      py::arg("information"), py::arg("right_side"), py::arg("coefficients"), py::arg("weight"),
      py::arg("prior") = py::none());
  py::class_<PoseRecording>(m, "_PoseRecording", "Detections, for asterism.pose.fuse.")
      .def(py::init<Floats, Flags, Floats, Floats, Floats, Floats, std::optional<Floats>>(),
           py::arg("sights"), py::arg("is_seen"), py::arg("belief"), py::arg("times"), py::arg("cameras"),
           py::arg("area"), py::arg("deviation") = py::none())
      .def("centre", &PoseRecording::centre, "A point in the middle of what is seen.")
      .def("estimate", &PoseRecording::estimate, py::arg("begin"), py::arg("end"), py::arg("settled"),
           py::arg("steps"), "The estimate of the frames begin .. end - 1; None if no joint is seen in them.")
      .def("path", &PoseRecording::path, py::arg("points"), py::arg("weight"), py::arg("curvature"),
           py::arg("stiffness"), py::arg("offset"), py::arg("centre"), py::arg("extent"), py::arg("threads"),
           "The path of all frames and its covariance, given the weights.")
      .def("lasting", &PoseRecording::lasting, py::arg("points"), py::arg("weight"), py::arg("stiffness"),
           py::arg("extent"), py::arg("threads"),
           "The covariance of the points if each view is off by its deviation.")
      .def("systematic", &PoseRecording::systematic, py::arg("points"), py::arg("disagreement"),
           py::arg("threads"), "The covariance of the points if each view is off by this in all frames.");
  m.def("_pose_sights", &sights, py::arg("pixels"), py::arg("matrices"), py::arg("distortions"),
        py::arg("threads") = 1);
  m.def("_pose_lanes", &pose_kernels::limit_lanes, py::arg("most"));
  py::class_<PoseWindow>(m, "_PoseWindow", "The last frames, for asterism.pose.Stream.")
      .def(py::init<int, const py::tuple&, const Floats&, const Floats&, const Floats&, const Floats&,
                    const Floats&, const Floats&>(),
           py::arg("frames"), py::arg("scales"), py::arg("cameras"), py::arg("matrices"),
           py::arg("distortions"), py::arg("area"), py::arg("slope"), py::arg("centre"))
      .def("push", &PoseWindow::push, py::arg("pixels"), py::arg("belief"), py::arg("time"),
           "The points, covariance and outliers of the next frame.")
      .def_property_readonly("points", &PoseWindow::points, "The points of the window.")
      .def_property_readonly("evidence", &PoseWindow::evidence, "What the last points were computed from.");
}

}  // namespace asterism::python
