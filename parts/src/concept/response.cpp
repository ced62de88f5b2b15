#include <Eigen/LU>
#include <asterism/parts/concept/response.hpp>
#include <cmath>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace {

// Vertex of the parabola through (-1, left), (0, centre), (1, right); within [-1/2, 1/2], as centre is the
// largest.
double parabola_vertex(double left, double centre, double right) {
  const double curvature = 2 * centre - left - right;
  return curvature > 0 ? 0.5 * (right - left) / curvature : 0;
}

// Responses whose range is at most this fraction of the largest one count as equal: the difference is
// rounding of the transforms.
constexpr float kOneResponse = 1e-4f;

// The largest response and its grid position; value 0 at the middle of the grid if no response is positive or
// all are equal.
struct Peak {
  double row, col, value;
};

Peak peak_of(const ResponseMap& response, bool sub_pixel) {
  const auto& r = response.values;
  const Eigen::Index rows = r.rows(), cols = r.cols();
  Eigen::Index row = 0, col = 0;
  const float value = r.maxCoeff(&row, &col);
  if (!(value > 0) || value - r.minCoeff() <= kOneResponse * value) {
    row = rows / 2;
    col = cols / 2;
    return {static_cast<double>(row), static_cast<double>(col), 0};
  }
  Peak peak{static_cast<double>(row), static_cast<double>(col), static_cast<double>(value)};
  if (sub_pixel && (response.periodic || (row > 0 && row + 1 < rows)))
    peak.row += parabola_vertex(r((row + rows - 1) % rows, col), r(row, col), r((row + 1) % rows, col));
  if (sub_pixel && (response.periodic || (col > 0 && col + 1 < cols)))
    peak.col += parabola_vertex(r(row, (col + cols - 1) % cols), r(row, col), r(row, (col + 1) % cols));
  return peak;
}

// Second moments of the positive responses about a grid position; with `any` false, those of a constant map.
Eigen::Matrix2d moments(const ResponseMap& response, double row, double col, bool any) {
  const auto& r = response.values;
  const Eigen::Index rows = r.rows(), cols = r.cols();
  // In grid units; each row is summed first.
  double mass = 0, xx = 0, yy = 0, xy = 0;
  for (Eigen::Index i = 0; i < rows; ++i) {
    double row_mass = 0, row_x = 0, row_xx = 0;
    for (Eigen::Index j = 0; j < cols; ++j) {
      const double weight = any ? std::max(0.0f, r(i, j)) : 1.0;
      const double dx = static_cast<double>(j) - col;
      row_mass += weight;
      row_x += weight * dx;
      row_xx += weight * dx * dx;
    }
    const double dy = static_cast<double>(i) - row;
    mass += row_mass;
    xx += row_xx;
    xy += row_x * dy;
    yy += row_mass * dy * dy;
  }
  const double sx = response.spacing.x(), sy = response.spacing.y();
  Eigen::Matrix2d covariance;
  covariance << xx * sx * sx, xy * sx * sy, xy * sx * sy, yy * sy * sy;
  covariance /= mass;
  // Add the variance of the grid's quantisation (uniform over a cell): a peak of one cell has no other
  // spread.
  covariance.diagonal() += response.spacing.cwiseAbs2() / 12;
  return covariance;
}

}  // namespace

double ResponseMap::at(const Point2& where) const {
  Point2 grid = (where - origin).cwiseQuotient(spacing);
  const Point2 last(static_cast<double>(values.cols() - 1), static_cast<double>(values.rows() - 1));
  // Written so that NaN is outside.
  if (!(grid.array() >= -0.5 && (grid - last).array() <= 0.5).all()) return 0;
  grid = grid.cwiseMax(0).cwiseMin(last);
  const auto col = static_cast<Eigen::Index>(grid.x()), row = static_cast<Eigen::Index>(grid.y());
  const Eigen::Index next_col = std::min(col + 1, values.cols() - 1),
                     next_row = std::min(row + 1, values.rows() - 1);
  const double u = grid.x() - static_cast<double>(col), v = grid.y() - static_cast<double>(row);
  const double value = (1 - v) * ((1 - u) * values(row, col) + u * values(row, next_col)) +
                       v * ((1 - u) * values(next_row, col) + u * values(next_row, next_col));
  return std::max(0.0, value);
}

Evidence evidence_of(const ResponseMap& response, bool sub_pixel) {
  const Peak peak = peak_of(response, sub_pixel);
  return {response.position(peak.row, peak.col), peak.value,
          moments(response, peak.row, peak.col, peak.value > 0)};
}

Evidence evidence_of(const ResponseMap& response, const ResponseMap& likelihood) {
  const Peak peak = peak_of(response, true);
  return {response.position(peak.row, peak.col), peak.value,
          moments(likelihood, peak.row, peak.col, peak.value > 0)};
}

double ResponsePeak::at(const Point2& position) const {
  // Written so that NaN is outside.
  if (!((position - centre).cwiseAbs().array() <= window.array() / 2).all()) return 0;
  const Point2 d = position - evidence.position;
  return evidence.peak * std::exp(-0.5 * d.dot(evidence.covariance.inverse() * d));
}

}  // namespace ASTERISM_ABI
}  // namespace asterism
