#pragma once

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/concept/part_model.hpp>
#include <asterism/parts/concept/state.hpp>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace asterism::testing {

/// A smooth random BGR texture, the same on every platform.
inline cv::Mat texture(int rows, int cols, std::uint32_t seed = 1) {
  cv::Mat image(rows, cols, CV_8UC3);
  std::uint32_t state = seed * 2654435761u + 1;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      for (int k = 0; k < 3; ++k) {
        state = state * 1664525u + 1013904223u;
        image.at<cv::Vec3b>(r, c)[k] = static_cast<std::uint8_t>(state >> 24);
      }
  cv::GaussianBlur(image, image, {}, 2.5);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

/// The image moved by (dx, dy) whole pixels; what comes in from outside is the replicated border.
inline cv::Mat shifted(const cv::Mat& image, int dx, int dy) {
  cv::Mat result;
  const cv::Matx23d move(1, 0, dx, 0, 1, dy);
  cv::warpAffine(image, result, move, image.size(), cv::INTER_NEAREST, cv::BORDER_REPLICATE);
  return result;
}

/// The image moved by a fraction of a pixel (Lanczos interpolation, good to 1/32 px on a texture).
inline cv::Mat displaced(const cv::Mat& image, double dx, double dy) {
  cv::Mat result;
  const cv::Matx23d move(1, 0, dx, 0, 1, dy);
  cv::warpAffine(image, result, move, image.size(), cv::INTER_LANCZOS4, cv::BORDER_REPLICATE);
  return result;
}

/// The axioms of PartModel, for any model: call it from a test with a fresh, uninitialised part.
/// tolerance: how far an estimate may be from the truth [px].
template <PartModel Part>
void check_part_axioms(const Part& fresh, double tolerance = 0.5) {
  const cv::Mat image = texture(240, 320);
  const Frame frame(image);
  const Point2 centre(160, 120);
  const Size2 size(48, 40);

  Part part = fresh;
  part.init(frame, centre, size);
  const Evidence still = part.localize(frame, centre);
  EXPECT_LT((still.position - centre).norm(), tolerance) << "the frame it was learned from";
  EXPECT_GT(still.peak, 0);
  EXPECT_GT(still.covariance.determinant(), 0);
  EXPECT_GT(still.covariance.trace(), 0);
  EXPECT_NEAR(part.similarity_at(still.position), still.peak, 0.2 * still.peak + 1e-6);
  EXPECT_EQ(part.similarity_at({1e6, 1e6}), 0) << "outside the search window";

  // Shift the frame, shift the evidence: searched at the moved position, all of it moves along.
  const Frame moved(shifted(image, 7, -5));
  const Point2 shift(7, -5);
  const Evidence after = part.localize(moved, centre + shift);
  EXPECT_LT((after.position - still.position - shift).norm(), 1e-3);
  EXPECT_NEAR(after.peak, still.peak, 1e-4);
  EXPECT_TRUE(after.covariance.isApprox(still.covariance, 1e-3));
  // Searched at the old position, it is found where it went.
  EXPECT_LT((part.localize(moved, centre).position - centre - shift).norm(), tolerance);

  // Localising learns nothing: after any number of searches elsewhere the answer is the same, bit for bit.
  const Evidence again = part.localize(frame, centre);
  EXPECT_EQ(again.position, still.position);
  EXPECT_EQ(again.peak, still.peak);
  EXPECT_EQ(again.covariance, still.covariance);

  // Copies are independent, and the same calls give the same results.
  Part copy = part, twin = part;
  copy.adapt(moved, centre);
  EXPECT_EQ(part.localize(frame, centre).peak, still.peak);
  twin.adapt(moved, centre);
  EXPECT_EQ(copy.localize(moved, centre).position, twin.localize(moved, centre).position);

  // init forgets all that was before.
  copy.init(frame, centre, size);
  EXPECT_EQ(copy.localize(frame, centre).position, still.position);

  // What was saved and restored, into a new part or one of another size, is the same part, bit for bit.
  [[maybe_unused]] const bool stateful = [&] {
    if constexpr (std::same_as<Part, AnyPart>)
      return part.stateful();
    else
      return Stateful<Part>;
  }();
  if constexpr (Stateful<Part>)
    if (stateful) {
      EXPECT_THROW(save_state(fresh), std::logic_error);
      Part learned = part, restored = fresh, other = fresh;
      learned.adapt(moved, centre);
      const std::vector<std::byte> state = save_state(learned);
      other.init(moved, centre, {20, 90});
      for (Part* const p : {&restored, &other}) {
        restore_state(*p, state);
        for (int i = 0; i < 3; ++i) {
          const Evidence expected = learned.localize(frame, centre), found = p->localize(frame, centre);
          EXPECT_EQ(found.position, expected.position);
          EXPECT_EQ(found.peak, expected.peak);
          EXPECT_EQ(found.covariance, expected.covariance);
          Part next = learned;
          next.adapt(moved, centre + shift / 2);
          p->adapt(moved, centre + shift / 2);
          EXPECT_EQ(save_state(*p), save_state(next));
          restore_state(*p, state);
        }
      }
    }

  // Hostile places and frames have an answer.
  for (const Point2& far : {Point2(-500, -500), Point2(0, 0), Point2(319, 239), Point2(5000, 120)}) {
    const Evidence evidence = part.localize(frame, far);
    EXPECT_TRUE(evidence.position.allFinite());
    EXPECT_TRUE(std::isfinite(evidence.peak));
    EXPECT_TRUE(evidence.covariance.allFinite());
  }
  const Frame flat(cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(128)));
  EXPECT_TRUE(part.localize(flat, centre).position.allFinite());
  Part on_flat = fresh;
  on_flat.init(flat, centre, size);
  EXPECT_TRUE(on_flat.localize(flat, centre).position.allFinite());
  EXPECT_TRUE(on_flat.localize(frame, centre).position.allFinite());

  // Sizes that are no sizes are refused.
  EXPECT_THROW(on_flat.init(frame, centre, {0, 10}), std::invalid_argument);
  EXPECT_THROW(on_flat.init(frame, centre, {10, -1}), std::invalid_argument);
  EXPECT_THROW(on_flat.init(frame, centre, {std::nan(""), 10}), std::invalid_argument);
  EXPECT_THROW(on_flat.init(frame, {std::nan(""), 10}, size), std::invalid_argument);
}

/// Tests bad input and faults, for any model: called like `check_part_axioms`.
template <PartModel Part>
void check_part_faults(const Part& fresh) {
  const cv::Mat image = texture(120, 160);
  const Frame frame(image);
  const Point2 centre(80, 60);
  const Size2 size(30, 24);
  const auto expect_sound = [](const Evidence& evidence, const auto& what) {
    EXPECT_TRUE(evidence.position.allFinite()) << what;
    EXPECT_TRUE(std::isfinite(evidence.peak) && evidence.peak >= 0) << what;
    EXPECT_TRUE(evidence.covariance.allFinite()) << what;
    EXPECT_EQ(evidence.covariance(0, 1), evidence.covariance(1, 0)) << what;
    EXPECT_GT(evidence.covariance.trace(), 0) << what;
    EXPECT_GT(evidence.covariance.determinant(), 0) << what;
  };
  Part part = fresh;

  // Tiny, thin and huge parts, in the middle, at a corner and far outside; init again at any time.
  for (const Size2& odd : {Size2(1, 1), Size2(2, 3), Size2(0.01, 0.01), Size2(1, 60), Size2(300, 2),
                           Size2(160, 120), Size2(1e6, 1e6)})
    for (const Point2& at : {centre, Point2(0, 0), Point2(-500, 700), Point2(1e9, -1e9)}) {
      part.init(frame, at, odd);
      expect_sound(part.localize(frame, at), odd.transpose());
      part.adapt(frame, at);
      expect_sound(part.localize(frame, centre), odd.transpose());
    }

  // Any type of frame that Frame takes, and frames that change type or size under way.
  cv::Mat gray, wide, real;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  image.convertTo(wide, CV_16U, 257);
  gray.convertTo(real, CV_32F, 1.0 / 255);
  const cv::Mat speck(1, 1, CV_8UC3, cv::Scalar(10, 200, 90)), strip = image.rowRange(3, 5);
  for (const cv::Mat& learned : {image, gray, wide, real, speck, strip}) {
    part.init(Frame(learned), centre, size);
    for (const cv::Mat& seen : {image, gray, wide, real, speck, strip}) {
      expect_sound(part.localize(Frame(seen), centre), learned.size());
      part.adapt(Frame(seen), centre);
    }
  }

  // What is not finite is refused, and nothing learned is lost.
  part.init(frame, centre, size);
  const Evidence before = part.localize(frame, centre);
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    EXPECT_EQ(part.similarity_at({bad, 60}), 0);
    EXPECT_THROW(part.localize(frame, {bad, 60}), std::invalid_argument);
    EXPECT_THROW(part.adapt(frame, {80, bad}), std::invalid_argument);
    EXPECT_THROW(part.init(frame, {80, bad}, size), std::invalid_argument);
    EXPECT_THROW(part.init(frame, centre, {bad, 24}), std::invalid_argument);
  }
  const Evidence after = part.localize(frame, centre);
  EXPECT_EQ(after.position, before.position);
  EXPECT_EQ(after.peak, before.peak);
  EXPECT_EQ(after.covariance, before.covariance);
}

}  // namespace asterism::testing
