// DPT on real sequences, one pass from the first box. Skipped, with a line that says so, where they are
// absent.
#include <gtest/gtest.h>

#include <asterism/trackers/dpt.hpp>
#include <filesystem>
#include <opencv2/core/utility.hpp>

#include "ground_truth.hpp"
#include "image_source.hpp"

namespace asterism {
namespace {

namespace fs = std::filesystem;

struct Sequence {
  const char* name;
  double least_overlap;  // of the whole run; measured values are in docs/results/evaluation.md
};

void PrintTo(const Sequence& sequence, std::ostream* out) { *out << sequence.name; }

class RealSequence : public ::testing::TestWithParam<Sequence> {};

TEST_P(RealSequence, IsTrackedFromTheFirstBox) {
  const fs::path folder = fs::path(ASTERISM_SEQUENCES) / GetParam().name;
  if (!fs::exists(folder / "groundtruth.txt"))
    GTEST_SKIP() << "no sequence " << GetParam().name << " in " << ASTERISM_SEQUENCES
                 << " (configure with -DASTERISM_SEQUENCES=FOLDER to name another)";

  tools::ImageSource source = tools::ImageSource::open(folder.string());
  const auto truth = tools::read_ground_truth(folder / "groundtruth.txt");
  Dpt tracker;
  cv::Mat image;
  ASSERT_TRUE(source.next(image));
  tracker.init(image, truth[0]->box());
  double sum = 0;
  std::size_t frames = 0, usable = 0;
  for (std::size_t t = 1; t < truth.size() && source.next(image); ++t, ++frames) {
    sum += tools::overlap(tracker.update(image).box, truth[t]->box());
    usable +=
        tracker.summary().usable() && tracker.summary().final_energy <= tracker.summary().initial_energy;
  }
  ASSERT_EQ(frames + 1, truth.size());
  const double average = sum / static_cast<double>(frames);
  std::cout << GetParam().name << ": average overlap " << average << " over " << frames << " frames\n";
  EXPECT_GE(average, GetParam().least_overlap);
  EXPECT_EQ(usable, frames) << "every constellation was solved, and no energy rose";
}

// Margins below the measured averages are those of start boxes that differ by up to a pixel.
INSTANTIATE_TEST_SUITE_P(Development, RealSequence,
                         ::testing::Values(Sequence{"FaceOcc1", 0.70}, Sequence{"david", 0.65},
                                           Sequence{"woman", 0.60}),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace asterism
