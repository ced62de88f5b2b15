// Calls something of the solver and of each library that it was built with: what links and runs has found
// them all.
#include <asterism/solver/energy/energy.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <iostream>
#ifdef HAVE_SOLVER_COMPILED
#include <asterism/solver/method/ida.hpp>
#endif
#ifdef HAVE_BATCH
#include <asterism/solver/batch/batch_kernels.hpp>
#endif
#ifdef HAVE_CHOLMOD
#include <asterism/solver/method/cholmod.hpp>
#endif
#ifdef HAVE_CERES
#include <asterism/solver/reference/ceres.hpp>
#endif
#ifdef HAVE_LBFGS
#include <asterism/solver/reference/liblbfgs.hpp>
#endif
#ifdef HAVE_JSON
#include <asterism/solver/io/json.hpp>
#endif
#ifdef HAVE_PARTS
#include <asterism/parts/concept/response.hpp>
#endif
#ifdef HAVE_TRACKERS
#include <asterism/trackers/tracker/tracker.hpp>
#endif

int main() {
  asterism::SpringSystem<double, 2, 2> system(asterism::Topology<2>::full());
  system.anchors << 0, 3, 0, 4;
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(7);
  system.link_stiffness.setConstant(3);
  bool ok = std::abs(asterism::energy(system, system.anchors) - 6) < 1e-12;  // 3 (7 - 5)^2 / 2
#ifdef HAVE_SOLVER_COMPILED
  asterism::SpringSystem<double, 2> pair(asterism::Topology<>::full(2));
  pair.anchors << 0, 3, 0, 4;
  pair.anchor_stiffness.setOnes();
  pair.rest_length.setConstant(7);
  pair.link_stiffness.setConstant(3);
  auto x = pair.anchors;
  ok = ok && asterism::solve_ida(pair, x).status == asterism::Status::Converged;
#endif
#ifdef HAVE_BATCH
  ok = ok && asterism::lanes_v0_1::kernels(asterism::lanes_v0_1::kPortable) != nullptr;
#endif
#ifdef HAVE_CHOLMOD
  int version[3];
  ok = ok && cholmod_version(version) >= CHOLMOD_VER_CODE(3, 0);
#endif
#ifdef HAVE_CERES
  ok = ok && *asterism::reference::ceres_version() >= '1';
#endif
#ifdef HAVE_LBFGS
  lbfgsfloatval_t* numbers = lbfgs_malloc(8);
  ok = ok && numbers != nullptr;
  lbfgs_free(numbers);
#endif
#ifdef HAVE_JSON
  ok = ok && asterism::parse_systems("").empty();
#endif
#ifdef HAVE_PARTS
  asterism::ResponseMap map;
  map.values.setConstant(3, 3, 0.5f);
  map.values(1, 1) = 1;
  ok = ok && (asterism::evidence_of(map).position - map.position(1, 1)).norm() < 1e-6;
#endif
#ifdef HAVE_TRACKERS
  ok = ok && asterism::tracker_names().size() > 5;
#endif
  std::cout << (ok ? "the consumer is content\n" : "wrong\n");
  return ok ? 0 : 1;
}
