// Header-only, and with COMPILED also of the compiled library: its objects hold Eigen members of fixed size, which AVX moves.
#include <asterism/solver/ida.hpp>
#include <iostream>
#ifdef COMPILED
#include <asterism/parts/response.hpp>
#endif

int main() {
  asterism::SpringSystem<double, 2, 2> system(asterism::Topology<2>::full());
  system.anchors << 0, 10, 0, 0;
  system.anchor_stiffness.setOnes();
  system.rest_length.setConstant(20);
  system.link_stiffness.setOnes();
  auto x = system.anchors;
  // By symmetry the nodes part by d with 2 k (20 - d) = d - 10, so d = 50 / 3.
  bool ok = asterism::solve_ida(system, x).status == asterism::Status::Converged &&
            std::abs(x(0, 1) - x(0, 0) - 50.0 / 3) < 1e-5;
#ifdef COMPILED
  asterism::ResponseMap map;
  map.values = Eigen::ArrayXXf::Constant(3, 3, 0.5f);
  map.values(1, 1) = 1;
  const asterism::Evidence evidence = asterism::evidence_of(map);
  ok = ok && evidence.peak == 1;
#endif
  std::cout << EIGEN_MAX_STATIC_ALIGN_BYTES << (ok ? " is content\n" : " is wrong\n");
  return ok ? 0 : 1;
}
