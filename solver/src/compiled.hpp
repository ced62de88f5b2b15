// Of one type of system: what <asterism/solver/compiled.hpp> declares. A source file defines ASTERISM_SYSTEM
// as the type and includes this.
#include <asterism/solver.hpp>

namespace asterism::inline ASTERISM_ABI {

#define ASTERISM_COMPILE(Solver)                                                                          \
  template ASTERISM_API Summary detail::Compiled::solve(Solver<ASTERISM_SYSTEM>&, const ASTERISM_SYSTEM&, \
                                                        ASTERISM_SYSTEM::Points&);
ASTERISM_COMPILE(Ida)
ASTERISM_COMPILE(Newton)
ASTERISM_COMPILE(Lbfgs)
ASTERISM_COMPILE(NewtonCg)
ASTERISM_COMPILE(NonlinearCg)
ASTERISM_COMPILE(Auto)
template ASTERISM_API Summary solve_ida(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const IdaOptions&);
template ASTERISM_API Summary solve(const ASTERISM_SYSTEM&, ASTERISM_SYSTEM::Points&, const AlignedOptions&);

}  // namespace asterism::inline ASTERISM_ABI
