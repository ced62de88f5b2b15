#pragma once

#include <asterism/solver/problem/model.hpp>
#include <asterism/solver/terms/system.hpp>
#include <asterism/solver/terms/term.hpp>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// Points and matrices of D coordinates, Eigen::Dynamic for a number known at run time.
inline constexpr int kMaxCoordinates = System::kMaxDim;
template <int D>
using PointOf = Eigen::Matrix<double, D, 1, Eigen::ColMajor, D == Eigen::Dynamic ? kMaxCoordinates : D, 1>;
template <int D>
using BlockOf =
    Eigen::Matrix<double, D, D, (D == 1 ? Eigen::RowMajor : Eigen::ColMajor),
                  D == Eigen::Dynamic ? kMaxCoordinates : D, D == Eigen::Dynamic ? kMaxCoordinates : D>;

/// Calls f.operator()<D>() for the number of coordinates.
template <typename F>
decltype(auto) with_dim(int dim, F&& f) {
  if (dim == 2) return f.template operator()<2>();
  if (dim == 3) return f.template operator()<3>();
  return f.template operator()<Eigen::Dynamic>();
}

/// rho at s and its derivatives, with the parameters of one element; null where the loss needs none.
inline Derivatives<double> loss_at(Loss loss, const double* scale, const double* sharpness, double s) {
  switch (loss) {
    case Loss::Quadratic:
      break;
    case Loss::Huber:
      return Huber{*scale}(s);
    case Loss::GemanMcClure:
      if (!(*scale * *scale > 0)) return {0, 0, 0};  // so narrow that its square is 0: it has no force
      return GemanMcClure{*scale}(s);
    case Loss::Truncated:
      return Truncated{*scale, *sharpness}(s);
  }
  return {s, 1, 0};
}

/// The energy 1/2 k rho(s^2) of a scalar residual s as a function of s, and its derivatives, for k = 1.
inline Derivatives<double> of_residual(const Derivatives<double>& rho, double s) {
  return {rho.value / 2, rho.first * s, rho.first + 2 * s * s * rho.second};
}

/// Adds the derivatives of factor rho' by the scale and the sharpness to the last two of a term's columns.
inline void add_by_loss(Loss loss, const double* scale, const double* sharpness, double s,
                        const Derivatives<double>& rho, double factor, int element,
                        std::span<Eigen::MatrixXd> by) {
  if (loss == Loss::Quadratic || rho.second == 0) return;
  const auto add = [&](Eigen::MatrixXd& column, double value) {
    column(0, column.cols() == 1 ? 0 : element) += factor * value;
  };
  // rho is the square of the scale times a function of s over that square.
  add(by[by.size() - 2], -2 * s * rho.second / *scale);
  if (loss != Loss::Truncated) return;
  const double root = rho.first + *sharpness;  // see Truncated
  add(by[by.size() - 1], *scale * *scale * (2 * *sharpness + 1) / (2 * s * root) - 1);
}

/// The least of the derivative rho' + 2 s rho'' over all s, in any direction the least curvature of
/// 1/2 rho(|d|^2): 0 where that is convex.
inline double least_curvature(Loss loss, const double* sharpness) {
  if (loss == Loss::GemanMcClure) return -0.25;
  return loss == Loss::Truncated ? -*sharpness : 0.0;
}

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
