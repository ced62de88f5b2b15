// The chains of joints over time, for asterism.pose.
#include <pybind11/stl.h>

#include <Eigen/LU>
#include <asterism/solver/linear/difference_chains.hpp>
#include <limits>
#include <optional>

#include "bindings.hpp"

namespace asterism::python {
namespace {

using Floats = py::array_t<double, py::array::c_style>;

template <int Dim>
py::tuple chains(const Floats& information, const Floats& right_side, const Floats& coefficients,
                 const Floats& weight, bool covariance, const Floats& prior) {
  const auto points = information.shape(0), joints = information.shape(1);
  const auto differences = std::max<py::ssize_t>(points - 2, 0);
  constexpr int kEntries = DifferenceChains<Dim>::kEntries;
  Floats x(shape_of(right_side)), spread({differences, joints}),
      of_points({covariance ? points : 0, joints, py::ssize_t{kEntries}});
  Floats log_det(joints);
  std::copy_n(right_side.data(), right_side.size(), x.mutable_data());
  bool is_definite = false;
  {
    const double *a = information.data(), *c = coefficients.data(), *w = weight.data();
    const double* past = prior.size() > 0 ? prior.data() : nullptr;
    double *to = x.mutable_data(), *of = of_points.mutable_data(), *s = spread.mutable_data();
    double* det = log_det.mutable_data();
    const py::gil_scoped_release release;
    DifferenceChains<Dim> factors;
    is_definite =
        factors.factorize(static_cast<std::size_t>(points), static_cast<std::size_t>(joints), a, c, w, past);
    if (is_definite) {
      factors.solve(to);
      std::copy_n(factors.log_det().data(), joints, det);
      if (covariance) factors.covariance(c, of, s);
    }
  }
  if (!is_definite)
    throw py::value_error("detections: numbers that are too large or too small for their joint's path");
  return py::make_tuple(x, of_points, spread, log_det);
}

/// The views of the joints: pixels of one image for all, or cameras.
template <int Dim>
class Views {
 public:
  using Point = Eigen::Matrix<double, Dim, 1>;
  using Rows = Eigen::Matrix<double, 2, Dim>;

  /// sights (views, frames, joints, 6): the point in the image, in a camera's normalised coordinates where
  /// there are cameras, and the pixels for a unit of them (2 x 2). cameras (views, 12): R by rows and t.
  /// offsets (views, joints, 2): what a view is off by [px], added to its errors.
  Views(const Floats& sights, const Floats& cameras, const double* offsets = nullptr)
      : sights_(sights.data()),
        cameras_(cameras.data()),
        offsets_(offsets),
        joints_(sights.shape(2)),
        size_(sights.shape(1) * joints_) {}

  /// The error [px] of a joint if it is at x, and its derivative.
  struct Residual {
    Rows rows;
    Eigen::Vector2d error;
  };
  /// That of point i, counted frame by frame. Along the ray of what was seen the error does not change if
  /// along_ray, so that a start may be far off.
  Residual residual(py::ssize_t view, py::ssize_t i, const Point& x, bool along_ray = false) const {
    Residual result;
    const double* p = sights_ + (view * size_ + i) * 6;
    const Eigen::Map<const Eigen::Vector2d> seen(p);
    if constexpr (Dim == 2) {
      result.rows.setIdentity();
      result.error = x - seen;
    } else {
      const double* c = cameras_ + view * 12;
      const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> rotation(c);
      const Eigen::Map<const Eigen::Matrix<double, 2, 2, Eigen::RowMajor>> pixels(p + 2);
      const Eigen::Map<const Eigen::Vector3d> translation(c + 9);
      const Eigen::Vector3d at = rotation * x + translation;
      const double depth = std::max(at(2), 1e-3 * translation.norm());  // in front of the camera
      const Eigen::Vector2d image = at.template head<2>() / depth;
      result.error = pixels * (image - seen);
      result.rows =
          pixels * (rotation.template topRows<2>() - (along_ray ? seen : image) * rotation.row(2)) / depth;
    }
    if (offsets_ != nullptr)
      result.error += Eigen::Map<const Eigen::Vector2d>(offsets_ + (view * joints_ + i % joints_) * 2);
    return result;
  }

 private:
  const double *sights_, *cameras_, *offsets_;
  py::ssize_t joints_, size_;
};

template <int Dim>
py::tuple evidence(const Floats& points, const Floats& sights, const Floats& cameras, const Floats& weight,
                   const Floats& offset, bool along_ray) {
  const auto frames = points.shape(0), joints = points.shape(1), views = sights.shape(0);
  constexpr int kEntries = DifferenceChains<Dim>::kEntries;
  Floats information({frames, joints, py::ssize_t{kEntries}}), right_side({frames, joints, py::ssize_t{Dim}});
  double *to_information = information.mutable_data(), *to_right_side = right_side.mutable_data();
  {
    const py::gil_scoped_release release;
    const Views<Dim> of(sights, cameras, offset.data());
    for (py::ssize_t i = 0; i < frames * joints; ++i) {
      const Eigen::Map<const Eigen::Matrix<double, Dim, 1>> x(points.data() + i * Dim);
      Eigen::Matrix<double, Dim, Dim> a = Eigen::Matrix<double, Dim, Dim>::Zero();
      Eigen::Matrix<double, Dim, 1> b = Eigen::Matrix<double, Dim, 1>::Zero();
      for (py::ssize_t v = 0; v < views; ++v) {
        const double w = weight.data()[v * frames * joints + i];
        if (w == 0) continue;
        const auto [rows, error] = of.residual(v, i, x, along_ray);
        a.noalias() += w * rows.transpose() * rows;
        b.noalias() += w * rows.transpose() * (rows * x - error);
      }
      for (int r = 0, k = 0; r < Dim; ++r) {
        for (int c = r; c < Dim; ++c, ++k) to_information[i * kEntries + k] = a(r, c);
      }
      Eigen::Map<Eigen::Matrix<double, Dim, 1>>(to_right_side + i * Dim) = b;
    }
  }
  return py::make_tuple(information, right_side);
}

template <int Dim>
Floats squares(const Floats& points, const Floats& covariance, const Floats& sights, const Floats& cameras,
               const Floats& offset) {
  const auto frames = points.shape(0), joints = points.shape(1), views = sights.shape(0);
  constexpr int kEntries = DifferenceChains<Dim>::kEntries;
  Floats expected({views, frames, joints});
  double* to = expected.mutable_data();
  {
    const py::gil_scoped_release release;
    const Views<Dim> of(sights, cameras, offset.data());
    for (py::ssize_t i = 0; i < frames * joints; ++i) {
      const Eigen::Map<const Eigen::Matrix<double, Dim, 1>> x(points.data() + i * Dim);
      Eigen::Matrix<double, Dim, Dim> s;
      for (int r = 0, k = 0; r < Dim; ++r) {
        for (int c = r; c < Dim; ++c, ++k) s(r, c) = s(c, r) = covariance.data()[i * kEntries + k];
      }
      for (py::ssize_t v = 0; v < views; ++v) {
        const auto [rows, error] = of.residual(v, i, x);
        to[v * frames * joints + i] = error.squaredNorm() + (rows * s * rows.transpose()).trace();
      }
    }
  }
  return expected;
}

template <int Dim>
py::tuple residuals(const Floats& points, const Floats& sights, const Floats& cameras) {
  const auto frames = points.shape(0), joints = points.shape(1), views = sights.shape(0);
  Floats all({views, frames, joints, py::ssize_t{2}, py::ssize_t{Dim}}),
      errors({views, frames, joints, py::ssize_t{2}});
  double *to_rows = all.mutable_data(), *to_errors = errors.mutable_data();
  {
    const py::gil_scoped_release release;
    const Views<Dim> of(sights, cameras);
    for (py::ssize_t k = 0; k < views * frames * joints; ++k) {
      const auto i = k % (frames * joints);
      const auto [rows, error] = of.residual(
          k / (frames * joints), i, Eigen::Map<const Eigen::Matrix<double, Dim, 1>>(points.data() + i * Dim));
      Eigen::Map<Eigen::Matrix<double, 2, Dim, Eigen::RowMajor>>(to_rows + k * 2 * Dim) = rows;
      Eigen::Map<Eigen::Vector2d>(to_errors + k * 2) = error;
    }
  }
  return py::make_tuple(all, errors);
}

/// OpenCV's lens: where a point in normalised coordinates is seen, and the derivative.
struct Lens {
  double k1, k2, p1, p2, k3;

  Eigen::Vector2d distorted(const Eigen::Vector2d& at, Eigen::Matrix2d& slope) const {
    const double x = at(0), y = at(1), r = x * x + y * y;
    const double radial = 1 + r * (k1 + r * (k2 + r * k3)), rise = k1 + r * (2 * k2 + 3 * k3 * r);
    const double mixed = 2 * (x * y * rise + p1 * x + p2 * y);
    slope << radial + 2 * x * x * rise + 2 * p1 * y + 6 * p2 * x, mixed, mixed,
        radial + 2 * y * y * rise + 6 * p1 * y + 2 * p2 * x;
    return {x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
            y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y};
  }
};

py::tuple undistorted(const Floats& pixels, const Floats& matrix, const Floats& distortions) {
  const auto count = pixels.shape(0);
  Floats images({count, py::ssize_t{2}}), slopes({count, py::ssize_t{2}, py::ssize_t{2}});
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> camera(matrix.data());
  const Eigen::Matrix2d scale = camera.topLeftCorner<2, 2>();
  const Eigen::Matrix2d inverse = scale.inverse();
  const double* k = distortions.data();
  const Lens lens{k[0], k[1], k[2], k[3], k[4]};
  for (py::ssize_t i = 0; i < count; ++i) {
    const Eigen::Map<const Eigen::Vector2d> seen(pixels.data() + i * 2);
    const Eigen::Vector2d goal = inverse * (seen - camera.topRightCorner<2, 1>());
    Eigen::Vector2d image = goal;
    Eigen::Matrix2d slope;
    Eigen::Vector2d error = goal - lens.distorted(image, slope);
    for (int step = 0; step < 12 && error.lpNorm<Eigen::Infinity>() > 1e-13; ++step) {  // Newton's method
      image += slope.inverse() * error;
      error = goal - lens.distorted(image, slope);
    }
    const bool is_found = error.lpNorm<Eigen::Infinity>() < 1e-9 && slope.determinant() > 0;
    if (!is_found) image.setConstant(std::numeric_limits<double>::quiet_NaN());
    Eigen::Map<Eigen::Vector2d>(images.mutable_data() + i * 2) = image;
    Eigen::Map<Eigen::Matrix<double, 2, 2, Eigen::RowMajor>>(slopes.mutable_data() + i * 4) = scale * slope;
  }
  return py::make_tuple(images, slopes);
}

}  // namespace

void bind_pose(py::module_& m) {
  m.def(
      "_difference_chains",
      [](const Floats& information, const Floats& right_side, const Floats& coefficients,
         const Floats& weight, bool covariance, const std::optional<Floats>& given_prior) {
        const Floats prior = given_prior.value_or(Floats(0));
        const auto points = right_side.shape(0), joints = right_side.shape(1), dim = right_side.shape(2);
        const auto differences = std::max<py::ssize_t>(points - 2, 0);
        if (shape_of(information) != Shape{points, joints, dim * (dim + 1) / 2} ||
            shape_of(coefficients) != Shape{differences, 3} ||
            shape_of(weight) != Shape{differences, joints} ||
            (prior.size() > 0 && shape_of(prior) != Shape{joints, 2 * dim, 2 * dim}))
          throw py::value_error("arrays of these shapes do not belong together");
        return dim == 2 ? chains<2>(information, right_side, coefficients, weight, covariance, prior)
                        : chains<3>(information, right_side, coefficients, weight, covariance, prior);
      },
      py::arg("information"), py::arg("right_side"), py::arg("coefficients"), py::arg("weight"),
      py::arg("covariance") = true, py::arg("prior") = py::none());
  m.def(
      "_pose_evidence",
      [](const Floats& points, const Floats& sights, const Floats& cameras, const Floats& weight,
         const Floats& offset, bool along_ray) {
        return points.shape(2) == 2 ? evidence<2>(points, sights, cameras, weight, offset, along_ray)
                                    : evidence<3>(points, sights, cameras, weight, offset, along_ray);
      },
      py::arg("points"), py::arg("sights"), py::arg("cameras"), py::arg("weight"), py::arg("offset"),
      py::arg("along_ray"));
  m.def(
      "_pose_squares",
      [](const Floats& points, const Floats& covariance, const Floats& sights, const Floats& cameras,
         const Floats& offset) {
        return points.shape(2) == 2 ? squares<2>(points, covariance, sights, cameras, offset)
                                    : squares<3>(points, covariance, sights, cameras, offset);
      },
      py::arg("points"), py::arg("covariance"), py::arg("sights"), py::arg("cameras"), py::arg("offset"));
  m.def(
      "_pose_residuals",
      [](const Floats& points, const Floats& sights, const Floats& cameras) {
        return points.shape(2) == 2 ? residuals<2>(points, sights, cameras)
                                    : residuals<3>(points, sights, cameras);
      },
      py::arg("points"), py::arg("sights"), py::arg("cameras"));
  m.def("_pose_undistorted", &undistorted, py::arg("pixels"), py::arg("matrix"), py::arg("distortions"));
}

}  // namespace asterism::python
