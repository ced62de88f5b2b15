// The multidimensional minimisers of the GNU Scientific Library that use gradients.
#include <gsl/gsl_errno.h>
#include <gsl/gsl_multimin.h>
#include <gsl/gsl_version.h>

#include <memory>
#include <new>

#include "objective.hpp"

namespace asterism::bench {
namespace {

double energy(const gsl_vector* x, void* objective) {
  return (*static_cast<Objective*>(objective))(x->data, nullptr);
}
void gradient(const gsl_vector* x, void* objective, gsl_vector* g) {
  (*static_cast<Objective*>(objective))(x->data, g->data);
}
void both(const gsl_vector* x, void* objective, double* f, gsl_vector* g) {
  *f = (*static_cast<Objective*>(objective))(x->data, g->data);
}

template <const gsl_multimin_fdfminimizer_type* const& kType, bool kBfgs>
struct Gsl {
  static constexpr std::string_view name() {
    return kBfgs ? "GSL, BFGS (vector_bfgs2)" : "GSL, nonlinear CG (conjugate_pr)";
  }

  static Status minimise(Objective& objective, const Points& start, int max_iterations, Summary& summary) {
    gsl_set_error_handler_off();
    const auto size = static_cast<std::size_t>(objective.size());
    const std::unique_ptr<gsl_vector, void (*)(gsl_vector*)> x(gsl_vector_alloc(size), gsl_vector_free);
    const std::unique_ptr<gsl_multimin_fdfminimizer, void (*)(gsl_multimin_fdfminimizer*)> minimizer(
        gsl_multimin_fdfminimizer_alloc(kType, size), gsl_multimin_fdfminimizer_free);
    if (x == nullptr || minimizer == nullptr) throw std::bad_alloc();
    objective.write(start, x->data);
    gsl_multimin_function_fdf function{energy, gradient, both, size, &objective};
    // First step and accuracy of the line minimisation as in GSL's manual.
    constexpr double kStep = 0.01;
    constexpr double kLineTolerance = 0.1;
    int code = gsl_multimin_fdfminimizer_set(minimizer.get(), &function, x.get(), kStep, kLineTolerance);
    while (code == GSL_SUCCESS && !objective.done() && summary.iterations < max_iterations) {
      code = gsl_multimin_fdfminimizer_iterate(minimizer.get());
      if (objective.iterated()) break;
    }
    summary.message.assign(gsl_strerror(code));
    return code == GSL_SUCCESS ? Status::MaxIterations : Status::NoProgress;
  }
};

using Bfgs = PeerSolver<Gsl<gsl_multimin_fdfminimizer_vector_bfgs2, true>>;
using Cg = PeerSolver<Gsl<gsl_multimin_fdfminimizer_conjugate_pr, false>>;
const Registration kBfgs({"gsl-bfgs", std::string(Bfgs::name()), "GSL " GSL_VERSION, 100, 0,
                          make_runner<Bfgs>});
const Registration kCg({"gsl-cg", std::string(Cg::name()), "GSL " GSL_VERSION, 100, 0, make_runner<Cg>});

}  // namespace
}  // namespace asterism::bench
