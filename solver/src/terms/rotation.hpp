#pragma once

#include <asterism/solver/base/config.hpp>

namespace asterism {
inline namespace ASTERISM_ABI {
namespace detail {

/// The rotation, or a reflection where that is allowed, that is nearest to a square matrix of finite numbers
/// (Kabsch 1976). <Eigen/SVD> takes five seconds to compile.
Eigen::MatrixXd nearest_rotation(Eigen::MatrixXd M, bool allow_reflection);

}  // namespace detail
}  // namespace ASTERISM_ABI
}  // namespace asterism
