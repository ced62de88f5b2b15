#include "compiled.hpp"

namespace asterism {
inline namespace ASTERISM_ABI {

ASTERISM_COMPILE_SOLVERS(detail::PlaneSystem)
ASTERISM_COMPILE_SPARSE_SOLVERS(detail::PlaneSystem)
template ASTERISM_API void detail::GlobalSearch<2>::run(const detail::PlaneSystem&,
                                                        detail::PlaneSystem::Points&,
                                                        const BranchAndBoundOptions&, Summary&);
template ASTERISM_API detail::FreeMotion detail::MotionSearch<2>::find(const MotionView<2>&);

}  // namespace ASTERISM_ABI
}  // namespace asterism
