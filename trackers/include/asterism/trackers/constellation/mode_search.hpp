#pragma once

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/concept/part_model.hpp>
#include <asterism/trackers/constellation/spring_solvers.hpp>
#include <span>

namespace asterism {
inline namespace ASTERISM_ABI {

namespace detail {
struct ASTERISM_API ModeMaps;
extern template class ASTERISM_API SolverWorkspace<ModeMaps>;
}  // namespace detail

/// Chooses, of the maxima of all parts' responses, those that fit together.
///
/// Displacements d_i of the parts and d of the constellation are searched on a grid of one cell of the
/// response, for the least of
///   E(d, d_1, ...) = sum_i -r_i(x_i + d_i) / 2 + s_i / 2 |d_i - d|^2,
/// responses less deformation, the score of the deformable part model (Felzenszwalb et al., PAMI 2010). Parts
/// on a star around the constellation's displacement are a tree, so that the minimum is exact
/// (PictorialStructure). -r / 2 has the curvature of the paper's anchor (Eq. 11) at the peak of a Gaussian
/// response, and is bounded far from it. With d at its best, the star is a spring of stiffness s_i s_j / sum
/// s between each pair of parts, at rest in the shape x.
class ASTERISM_API ModeSearch {
 public:
  /// After each part's `localize` at x (2 x N): replaces the evidence of those parts whose response has
  /// another maximum at the best displacement, the one that a climb from there reaches. Its covariance is
  /// that of the response about the new position. stiffness: s_i, that of all links of a part together
  /// [1/px^2]. A part without a response map (DenseModel) keeps its evidence, but takes part in the search by
  /// its `similarity_at`. Without any map, nothing changes.
  void choose(std::span<const AnyPart> parts, const DptSystem::Points& x, std::span<const double> stiffness,
              std::span<Evidence> evidence);

 private:
  detail::SolverWorkspace<detail::ModeMaps> workspace_;
};

}  // namespace ASTERISM_ABI
}  // namespace asterism
