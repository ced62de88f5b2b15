#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::SpaceSystem)
ASTERISM_COMPILE_SPARSE_SOLVERS(detail::SpaceSystem)
template ASTERISM_API void detail::GlobalSearch<3>::run(const detail::SpaceSystem&,
                                                        detail::SpaceSystem::Points&,
                                                        const BranchAndBoundOptions&, Summary&);
template ASTERISM_API detail::FreeMotion detail::MotionSearch<3>::find(const MotionView<3>&);

}  // namespace ASTERISM_ABI
}  // namespace asterism
