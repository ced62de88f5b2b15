#include <asterism/solver.hpp>
#include <asterism/testing/check_model.hpp>

/// A cable of length mu: pulls when it is taut, does not push.
struct Cable {
  template <typename Scalar>
  asterism::Derivatives<Scalar> operator()(Scalar r, Scalar mu) const {
    if (r <= mu) return {0, 0, 0};
    return {(r - mu) * (r - mu) / 2, r - mu, 1};  // value, first, second derivative
  }
};

int main() {
  if (asterism::check_link_potential(Cable())) return 1;  // in your tests

  using Model = asterism::Model<Cable, asterism::Huber, asterism::AnchorShape::Anisotropic>;
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
