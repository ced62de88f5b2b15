#include <asterism/solver.hpp>
#include <iostream>

using namespace asterism;

/// Five landmarks of a face. Links prefer the offsets of a mean shape; an anchor far from the shape counts
/// for nothing.
using Face = SpringSystem<double, 2, 5, 5, Model<Hooke, Truncated>>;

int main() {
  Face::Points mean;  // eyes, nose, corners of the mouth [px]
  mean << -20, 20, 0, -15, 15, /* y */ -15, -15, 5, 25, 25;
  Face face(Topology<5>::full());
  face.set_rest_offsets(mean);
  face.link_stiffness.setConstant(0.3);
  face.anchor_stiffness.setOnes();
  face.anchor_loss.scale = 6;  // [px]

  // Detections: the shape at (100, 80) with errors of a pixel, but the right eye was found in the background.
  Face::Points errors;
  errors << -1, 0, 1, -1, 0, /* y */ 0, 0, -1, 1, 0;
  face.anchors = (mean + errors).colwise() + Eigen::Vector2d(100, 80);
  face.anchors.col(1) << 190, 10;

  Face::Points cold = face.anchors;
  solve(face, cold);
  Graduated<Face, Auto<Face>> solver;
  Face::Points x = face.anchors;
  const Summary summary = solver.solve(face, x);
  std::cout << "from the detections, energy " << energy(face, cold) << ", right eye at "
            << cold.col(1).transpose() << "\n"
            << "graduated, energy " << summary.final_energy << ", right eye at " << x.col(1).transpose()
            << "\n";
}
