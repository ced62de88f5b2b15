// Includes each ```cpp fragment of the pages, unchanged, in the context that its page names.
#include <gtest/gtest.h>

#include <asterism/parts/concept/part_registry.hpp>
#include <asterism/parts/concept/state.hpp>
#include <asterism/parts/features/dnn_channels.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/parts/models/scale_filter.hpp>
#include <asterism/parts/models/strcf.hpp>
#include <asterism/solver/batch/batch_newton.hpp>
#include <asterism/solver/batch/batch_sensitivity.hpp>
#include <asterism/solver/discrete/loopy_structure.hpp>
#include <asterism/solver/discrete/m_best_placements.hpp>
#include <asterism/solver/discrete/pictorial_structure.hpp>
#include <asterism/solver/energy/certificate.hpp>
#include <asterism/solver/method/auto.hpp>
#include <asterism/solver/method/newton.hpp>
#include <asterism/solver/problem/spring_system.hpp>
#include <asterism/solver/problem/topology.hpp>
#include <asterism/solver/run/status.hpp>
#include <asterism/solver/run/summary.hpp>
#include <asterism/trackers/around/gated.hpp>
#include <asterism/trackers/dpt/dpt.hpp>
#include <asterism/trackers/tracker/multi_tracker.hpp>
#include <asterism/trackers/tracker/opencv_tracker.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <span>
#include <vector>

#include "own_part.cpp"
#include "statistics.hpp"
#include "supervised_measures.hpp"
#include "trax_client.hpp"

using namespace asterism;

namespace {

cv::Mat texture(const cv::Size& size, std::uint64_t seed) {
  cv::Mat image(size, CV_8U);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {9, 9}, 0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

// A textured object at (60, 50) in the first frame that moves right by 2 px per frame.
const cv::Rect2d box(60, 50, 64, 64);
cv::Mat draw(int frame) {
  static const cv::Mat background = texture({240, 180}, 1), object = texture({64, 64}, 2);
  cv::Mat image = background.clone();
  object.copyTo(image(cv::Rect(60 + 2 * frame, 50, 64, 64)));
  return image;
}

TEST(Batch, Page) {
  const int count = 10;
  std::vector<SpringSystem<double, 2, 4>> systems;
  std::vector<SpringSystem<double, 2, 4>::Points> starts;
  for (int s = 0; s < count; ++s) {
    auto& system = systems.emplace_back(Topology<4>::full());
    system.anchors << 0, 40 + s, 0, 40, 0, 0, 40, 40;
    system.link_stiffness.setOnes();
    system.anchor_stiffness.setOnes();
    system.rest_length.setConstant(40);
    starts.push_back(system.anchors);
  }
  int used = 0;
  const auto use = [&](const auto& x, Status status, double final_energy) {
    auto expected = starts[static_cast<std::size_t>(used)];
    const Summary summary = solve(systems[static_cast<std::size_t>(used)], expected);
    EXPECT_EQ(status, Status::Converged);
    EXPECT_NEAR(final_energy, summary.final_energy, 1e-9 * summary.final_energy);
    EXPECT_LT((x - expected).norm(), 1e-4);
    ++used;
  };
#include "docs_batch_1.inc"
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_EQ(used, count);

  const std::vector<Batch::Points> grad_x(count, Batch::Points::Ones());
  const auto learn = [&](double slope, SensitivityStatus status) {
    EXPECT_EQ(status, SensitivityStatus::Computed);
    const auto at = static_cast<std::size_t>(used++ - count);
    EXPECT_NEAR(slope,
                sensitivity(systems[at], batch.points(static_cast<int>(at)), grad_x[at]).link_stiffness[0],
                1e-9);
  };
#include "docs_batch_2.inc"
  EXPECT_TRUE(result);
  EXPECT_EQ(used, 2 * count);
}

TEST(Solver, Gap) {
  using System = SpringSystem<double, 2>;
  System system(Topology<>::full(4));
  system.anchors << 0, 40, 0, 40, 0, 0, 40, 40;
  system.set_rest_lengths(system.anchors);
  system.link_stiffness.setOnes();
  system.anchor_stiffness.setOnes();
  Newton<System> newton;
#include "docs_global-minimum_1.inc"
  System::Points x = system.anchors.array() + 1;
  const Summary summary = newton.solve(system, x);
  EXPECT_EQ(summary.status, Status::Converged);
  EXPECT_GE(summary.lower_bound, 0);
}

TEST(ComingFromVideo, Page) {
  struct {
    int frame = 0;
    bool read(cv::Mat& next) { return next = draw(++frame), frame < 4; }
  } video;
  cv::Mat image = draw(0);
  int shown = 0;
  const auto show = [&](const cv::Rect2d& found, bool ok) {
    EXPECT_TRUE(ok);
    EXPECT_NEAR(found.x, 60 + 2 * video.frame, 1);
    ++shown;
  };
#include "docs_coming-from-video_1.inc"
  EXPECT_EQ(shown, 3);
}

TEST(EvaluationMeasures, Page) {
  using namespace asterism::bench;
  // Two trackers on four sequences of 400 frames: one overlaps by 0.8, the other by 0.3.
  const auto sequences = [](double overlap) {
    SupervisedRun run{std::vector<Outcome>(400, Outcome::Tracked), std::vector<double>(400, overlap)};
    run.outcomes[0] = Outcome::Started;
    return std::vector<SupervisedSequence>(4, {{run}, {}, {}});
  };
  const auto sequences_of_a = sequences(0.8), sequences_of_b = sequences(0.3);
  const std::vector<std::size_t> starts(4, 1);
  const Bootstrapped b = bootstrap(starts, [&](std::span<const Draw> draws) {
    return eao(resampled(sequences_of_b, draws), {166, 377}, Toolkit::Legacy);
  });
#include "docs_evaluation-measures_1.inc"
  EXPECT_TRUE(significant);
  EXPECT_NEAR(a.value - b.value, 0.5, 0.01);
}

TEST(InPractice, SeveralObjects) {
  const cv::Mat image = draw(0), next = draw(1);
  int drawn = 0;
  const auto draw = [&](int id, const TrackResult& result) {
    EXPECT_EQ(id, 7);
    EXPECT_NEAR(result.box.x, 62, 1);
    ++drawn;
  };
#include "docs_in-practice_1.inc"
  EXPECT_EQ(drawn, 1);
}

TEST(InPractice, FramesThatShowNothing) {
#include "docs_in-practice_2.inc"
  tracker.init(draw(0), box);
  EXPECT_TRUE(tracker.update(cv::Mat::zeros(draw(0).size(), CV_8U)).interrupted);
  EXPECT_EQ(tracker.update(draw(1)).parts.size(), 6u);
}

TEST(InPractice, Saving) {
  AnyTracker tracker = make_tracker("dpt");
  tracker.init(draw(0), box);
  tracker.update(draw(1));
#include "docs_in-practice_3.inc"
  EXPECT_EQ(later.update(draw(2)).box, tracker.update(draw(2)).box);
}

struct Saved {
#include "docs_in-practice_4.inc"
  GrayPatchOptions options_;
  Size2 size_ = Size2::Ones();
  Eigen::Array33f learned_ = Eigen::Array33f::Zero();
};

TEST(InPractice, Range) {
  AnyTracker tracker = make_tracker("kcf");
  cv::Mat image, next;
  draw(0).convertTo(image, CV_16U, 4095.0 / 255);
  draw(1).convertTo(next, CV_16U, 4095.0 / 255);
#include "docs_in-practice_5.inc"
  EXPECT_FALSE(result.lost);
  EXPECT_EQ(suggested_range(image), range);
}

TEST(InPractice, StartRegion) {
  AnyTracker tracker = make_tracker("kcf");
  const cv::Mat image = draw(0);
#include "docs_in-practice_6.inc"
  EXPECT_FALSE(tracker.update(draw(1)).lost);
}

TEST(InPractice, StateOfAModel) {
  Saved saved, later;
  saved.size_ << 3, 4;
  saved.learned_.setConstant(5);
  restore_state(later, save_state(saved));
  EXPECT_EQ(later.size_.y(), 4);
  EXPECT_EQ(later.learned_(2, 2), 5);
}

TEST(OpenCv, OurTracker) {
  const cv::Mat image = draw(0), next = draw(1);
  cv::Rect object(60, 50, 64, 64);
#include "docs_opencv_1.inc"
  EXPECT_TRUE(found);
  EXPECT_NEAR(object.x, 62, 1);
}

TEST(OpenCv, ItsTracker) {
  const cv::Mat image = draw(0), next = draw(1);
#include "docs_opencv_2.inc"
  EXPECT_FALSE(result.lost);
  EXPECT_NEAR(result.box.x, 62, 8);
}

TEST(OpenCv, FeaturesOfANetwork) {
  const std::string file = ASTERISM_TINY_NETWORK;
#include "docs_opencv_3.inc"
  tracker.init(draw(0), box);
  EXPECT_NEAR(tracker.update(draw(1)).box.x, 62, 1);
}

TEST(CheatSheet, Page) {
  const cv::Mat image = draw(0);
#include "docs_cheat-sheet_1.inc"
  EXPECT_NEAR(found.position.x(), 160, 0.5);
  EXPECT_NEAR(result.box.x, 140, 0.5);
}

TEST(OwnPart, Page) {
#include "docs_own-part_1.inc"
  tracker.init(draw(0), box);
  EXPECT_NEAR(tracker.update(draw(1)).box.x, 62, 1);
}

TEST(PictorialStructures, Page) {
  std::vector<float> costs(25, 1);
  costs[7] = 0;
  const std::vector<MapView<const float>> maps(3, MapView<const float>(costs.data(), 5, 5));
  const std::vector<Joint> joints{{0, 1, {}}, {1, 2, {}}, {2, 0, {}}};
  PartPlacement best;
  const auto use = [&](double energy, double lower_bound) {
    EXPECT_EQ(energy, 0);
    EXPECT_NEAR(lower_bound, 0, 1e-3);
  };
#include "docs_pictorial-structures_1.inc"
  EXPECT_EQ(summary.status, Status::Converged);

  const std::vector<Joint> tree(joints.begin(), joints.begin() + 2);
  const double length = 2;
#include "docs_pictorial-structures_2.inc"
  ASSERT_TRUE(by_length.usable());
  // One part at the valley, and its neighbours two pixels away; or all there, which costs 2 x 0.5 x 2^2.
  EXPECT_NEAR(by_length.energy, 1, 1e-6);

  SpringSystem<double, 2> system(Topology<>::star(3, 1));
  system.link_stiffness.setOnes();
  system.rest_length.setConstant(length);
  system.anchor_stiffness.setConstant(0.1);
  system.anchors = best.positions.cast<double>();
  Auto<SpringSystem<double, 2>> solver;
  int kept = 0;
  const auto keep_the_best = [&](double energy, const auto& x) {
    EXPECT_TRUE(std::isfinite(energy) && x.allFinite());
    ++kept;
  };
#include "docs_pictorial-structures_3.inc"
  EXPECT_GE(kept, 1);
}

TEST(Parts, ScaleFilter) {
  const Frame first(draw(0)), frame(draw(1));
  Point2 x(92, 82);
  Size2 size(64, 64);
  Kcf part;
  ScaleFilter scale;
  part.init(first, x, size);
  scale.init(first, x, size);
#include "docs_parts_1.inc"
  EXPECT_NEAR(x.x(), 94, 1);
  EXPECT_NEAR(size.x(), 64, 3);
}

// Compiled but not run: it needs a tracker to talk to (tests/trackers/trax_test.cpp has one).
[[maybe_unused]] bool trax() {
  using namespace asterism::tools;
#include "docs_trax_1.inc"
  return reply.region.has_value();
}

}  // namespace
