// Of one type of system: what <asterism/solver/compiled.hpp> declares. A source file defines ASTERISM_SYSTEM
// as the type and includes this.
#include <asterism/solver.hpp>

namespace asterism::inline ASTERISM_ABI {

template ASTERISM_API Summary detail::Compiled::solve(Ida<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary detail::Compiled::solve(Newton<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary detail::Compiled::solve(Lbfgs<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary detail::Compiled::solve(NewtonCg<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary detail::Compiled::solve(NonlinearCg<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary detail::Compiled::solve(Auto<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&,
                                                      ASTERISM_SYSTEM::Points&);
template ASTERISM_API Summary solve_ida(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const IdaOptions&);
template ASTERISM_API Summary solve(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const AlignedOptions&);

}  // namespace asterism::inline ASTERISM_ABI
