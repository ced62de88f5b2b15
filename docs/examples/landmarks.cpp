#include <asterism/system.hpp>
#include <iostream>

using namespace asterism;

/// Five landmarks of a face. Springs prefer the offsets of a mean shape; an anchor far from the shape counts
/// for nothing.
int main() {
  const Eigen::MatrixXd mean{{-20, 20, 0, -15, 15},
                             {-15, -15, 5, 25, 25}};  // eyes, nose, corners of the mouth [px]
  // Detections: the shape at (100, 80) with errors of a pixel, but the right eye was found in the background.
  const Eigen::MatrixXd errors{{-1, 0, 1, -1, 0}, {0, 0, -1, 1, 0}};
  Eigen::MatrixXd seen = (mean + errors).colwise() + Eigen::Vector2d(100, 80);
  seen.col(1) << 190, 10;

  System face(5, 2);
  face.add_anchors(seen, System::all(1)).set_loss(Loss::Truncated, 6);  // [px]
  face.add_offsets(all_pairs(5), offsets_at(mean, all_pairs(5)), System::all(0.3));

  for (const char* method : {"auto", "graduated"}) {
    Eigen::MatrixXd x = seen;
    const Summary summary = solve(method, face, x);
    std::cout << method << ": energy " << summary.final_energy << ", right eye at " << x.col(1).transpose()
              << "\n";
  }
}
