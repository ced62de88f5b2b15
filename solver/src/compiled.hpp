// Of one type of system: what <asterism/solver/compiled.hpp> declares. A source file defines ASTERISM_SYSTEM
// as the type and includes this.
#include <asterism/solver.hpp>

namespace asterism::inline ASTERISM_ABI {

template class ASTERISM_API Ida<ASTERISM_SYSTEM>;
template class ASTERISM_API Newton<ASTERISM_SYSTEM>;
template class ASTERISM_API Lbfgs<ASTERISM_SYSTEM>;
template class ASTERISM_API NewtonCg<ASTERISM_SYSTEM>;
template class ASTERISM_API NonlinearCg<ASTERISM_SYSTEM>;
template class ASTERISM_API Auto<ASTERISM_SYSTEM>;
template ASTERISM_API Summary solve_ida(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const IdaOptions&);
template ASTERISM_API Summary solve(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const AlignedOptions&);

}  // namespace asterism::inline ASTERISM_ABI
