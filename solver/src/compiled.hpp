// Of one type of system: what <asterism/solver/compiled.hpp> declares. A source file defines ASTERISM_SYSTEM
// as the type and includes this.
#include <asterism/solver.hpp>

namespace asterism::inline ASTERISM_ABI {

template class Ida<ASTERISM_SYSTEM>;
template class Newton<ASTERISM_SYSTEM>;
template class Lbfgs<ASTERISM_SYSTEM>;
template class NewtonCg<ASTERISM_SYSTEM>;
template class NonlinearCg<ASTERISM_SYSTEM>;
template class Auto<ASTERISM_SYSTEM>;
template Summary solve_ida(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const IdaOptions&);
template Summary solve(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const AlignedOptions&);

}  // namespace asterism::inline ASTERISM_ABI
