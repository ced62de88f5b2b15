// Uses each component that it was built with; returns 0 if all do what they should.
#include <asterism/solver.hpp>
#include <iostream>
#include <string>
#ifdef HAVE_SYSTEM
#include <asterism/solver/terms/from_springs.hpp>
#include <asterism/system.hpp>
#endif
#ifdef HAVE_BATCH
#include <asterism/solver/batch/batch_newton.hpp>
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
#ifdef HAVE_PETSC
#include <asterism/solver/distributed/petsc.hpp>
#endif
#ifdef HAVE_JSON
#include <asterism/solver/io/json.hpp>
#include <sstream>
#endif
#ifdef HAVE_PARTS
#include <asterism/parts/models/kcf.hpp>
#endif
#ifdef HAVE_TRACKERS
#include <asterism/trackers/tracker/tracker.hpp>
#endif

namespace {

using System = asterism::SpringSystem<double, 2>;

bool check(bool ok, const std::string& what) {
  if (!ok) std::cerr << "wrong: " << what << "\n";
  return ok;
}

// A triangle whose springs are longer than its anchors allow.
System triangle() {
  System system(asterism::Topology<>::full(3));
  system.anchors << 0, 30, 10, 0, 5, 25;
  system.set_rest_lengths(system.anchors * 1.2);
  system.anchor_stiffness.setConstant(0.5);
  system.link_stiffness.setConstant(2);
  return system;
}

template <typename Solver>
bool solves(Solver solver) {
  const System system = triangle();
  auto x = system.anchors;
  const asterism::Summary summary = solver.solve(system, x);
  auto expected = system.anchors;
  asterism::solve_ida(system, expected);
  return check(summary.status == asterism::Status::Converged && (x - expected).norm() < 1e-5 &&
                   summary.final_energy < summary.initial_energy,
               std::string(summary.solver));
}

#ifdef HAVE_SYSTEM
bool solves_terms() {
  Eigen::MatrixXd x = triangle().anchors;
  const asterism::Summary summary = asterism::solve(asterism::to_system(triangle()), x);
  auto expected = triangle().anchors;
  asterism::solve_ida(triangle(), expected);
  return check(summary.status == asterism::Status::Converged && (x - expected).norm() < 1e-5, "terms");
}
#endif

#ifdef HAVE_BATCH
bool solves_batch() {
  using Batch = asterism::SpringBatch<double, 2>;
  const System system = triangle();
  Batch batch(asterism::Topology<>::full(3), 5);
  for (int s = 0; s < 5; ++s) batch.set(s, system, system.anchors);
  asterism::BatchNewton<Batch> solver;
  solver.solve(batch, asterism::SerialExecutor());
  auto expected = system.anchors;
  asterism::solve_ida(system, expected);
  return check((batch.points(4) - expected).norm() < 1e-5, "batch");
}
#endif

#ifdef HAVE_TRACKERS
bool tracks() {
  cv::Mat image(120, 160, CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<cv::Vec3b>(y, x) =
          cv::Vec3b(cv::saturate_cast<uchar>(x), cv::saturate_cast<uchar>((x * y) % 200),
                    cv::saturate_cast<uchar>((x / 8 + y / 8) % 2 * 200));
    }
  }
  for (const std::string& name : asterism::tracker_names()) {
    asterism::AnyTracker tracker = asterism::make_tracker(name);
    tracker.init(image, {60, 40, 32, 32});
    const cv::Rect2d box = tracker.update(image).box;
    if (!check(std::abs(box.x - 60) < 2 && std::abs(box.y - 40) < 2, name)) return false;
  }
  return true;
}
#endif

}  // namespace

int main() {
  const std::string version = std::to_string(ASTERISM_VERSION_MAJOR) + "." +
                              std::to_string(ASTERISM_VERSION_MINOR) + "." +
                              std::to_string(ASTERISM_VERSION_PATCH);
  bool ok = check(version == VERSION, "version " + version);
  ok = solves(asterism::Ida<System>()) && ok;
#ifdef HAVE_SYSTEM
  ok = solves_terms() && ok;
#endif
#ifdef HAVE_BATCH
  ok = solves_batch() && ok;
#endif
#ifdef HAVE_CHOLMOD
  ok = solves(asterism::CholmodIda<System>()) && ok;
#endif
#ifdef HAVE_CERES
  ok = solves(asterism::reference::Ceres<System>()) && ok;
#endif
#ifdef HAVE_LBFGS
  ok = solves(asterism::reference::Liblbfgs<System>()) && ok;
#endif
#ifdef HAVE_PETSC
  {
    int argc = 0;
    char* none[] = {nullptr};
    char** argv = none;
    const asterism::PetscRuntime runtime(argc, argv);
    asterism::DistributedSystem<2> distributed(MPI_COMM_WORLD,
                                               asterism::whole_share<2>(triangle(), triangle().anchors));
    ok = check(distributed.solve().status == asterism::Status::Converged, "PETSc") && ok;
  }
#endif
#ifdef HAVE_JSON
  std::stringstream file;
  asterism::write_system(file, triangle(), triangle().anchors);
  ok = check(asterism::parse_systems<System>(file.str()).at(0).start == triangle().anchors, "JSON") && ok;
#endif
#ifdef HAVE_PARTS
  ok = check(asterism::PartModel<asterism::Kcf>, "Kcf is a PartModel") && ok;
#endif
#ifdef HAVE_TRACKERS
  ok = tracks() && ok;
#endif
  if (ok) std::cout << "the consumer is content\n";
  return ok ? 0 : 1;
}
