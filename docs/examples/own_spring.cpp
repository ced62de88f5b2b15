#include <algorithm>
#include <asterism/solver.hpp>
#include <asterism/testing/check_model.hpp>

/// A spring with free play: no force from mu to 1.1 mu.
struct LooseSpring {
  template <typename Scalar>
  asterism::Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    const Scalar stretch = r < mu ? r - mu : std::max(r - Scalar(1.1) * mu, Scalar(0));
    const Scalar bend = stretch != 0 ? 1 : 0;
    return {stretch * stretch / 2, stretch, bend};  // value, first, second derivative
  }
};

int main() {
  if (asterism::check_link_potential(LooseSpring())) return 1;  // in your tests

  using Model = asterism::Model<LooseSpring, asterism::Huber, asterism::AnchorShape::Anisotropic>;
  asterism::SpringSystem<double, 2, 3, 3, Model> system(asterism::Topology<3>::full());
  system.anchors << 0, 10, 50, 0, 0, 30;
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.anchor_loss.scale = 5;  // [px]; beyond, an anchor pulls with constant force
  for (int i = 0; i < 3; ++i) {
    system.set_anchor_information(i, Eigen::Matrix2d{{1.0, 0.2}, {0.2, 0.1}});  // inverse covariance
  }
  system.fix(0);  // stays at its start
  auto x = system.anchors;
  return asterism::solve(system, x).usable() ? 0 : 1;
}
