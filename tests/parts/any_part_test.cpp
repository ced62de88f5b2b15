#include <gtest/gtest.h>

#include <asterism/parts/concept/any_part.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <asterism/testing/part_axioms.hpp>
#include <memory>
#include <vector>

namespace asterism {
namespace {

static_assert(PartModel<AnyPart> && PartModel<Kcf>);
static_assert(!std::constructible_from<AnyPart, int> && !std::constructible_from<AnyPart, Frame>);

TEST(AnyPart, FulfilsThePartAxioms) { testing::check_part_axioms(AnyPart(Kcf())); }
TEST(AnyPart, WithstandsFaults) { testing::check_part_faults(AnyPart(Kcf())); }

TEST(AnyPart, AnswersAsThePartInIt) {
  const cv::Mat image = testing::texture(120, 160);
  const Frame frame(image);
  const Point2 centre(80, 60), near(84, 57);
  Kcf kcf;
  AnyPart any = kcf;
  kcf.init(frame, centre, {30, 24});
  any.init(frame, centre, {30, 24});
  kcf.adapt(frame, near);
  any.adapt(frame, near);
  const Evidence expected = kcf.localize(frame, near), evidence = any.localize(frame, near);
  EXPECT_EQ(evidence.position, expected.position);
  EXPECT_EQ(evidence.peak, expected.peak);
  EXPECT_EQ(evidence.covariance, expected.covariance);
  EXPECT_EQ(any.similarity_at(near), kcf.similarity_at(near));
}

// A part that reports how often it was adapted.
struct Counter {
  std::vector<int> adapted;
  void init(const Frame&, const Point2&, const Size2&) { adapted.clear(); }
  Evidence localize(const Frame&, const Point2&) { return {.peak = double(adapted.size())}; }
  double similarity_at(const Point2&) const { return 0; }
  void adapt(const Frame&, const Point2&) { adapted.push_back(1); }
};

TEST(AnyPart, CopiesAreDeepAndMovesAreNot) {
  const Frame frame(cv::Mat(4, 4, CV_8UC1, cv::Scalar(9)));
  const auto count = [&](AnyPart& part) { return part.localize(frame, {0, 0}).peak; };
  AnyPart first = Counter();
  first.adapt(frame, {0, 0});
  AnyPart second = first;
  second.adapt(frame, {0, 0});
  EXPECT_EQ(count(first), 1);
  EXPECT_EQ(count(second), 2);
  first = second;
  second.adapt(frame, {0, 0});
  EXPECT_EQ(count(first), 2);
  const AnyPart& same = second;
  second = same;
  EXPECT_EQ(count(second), 3);
  AnyPart third = std::move(second);
  EXPECT_EQ(count(third), 3);
  second = first;
  EXPECT_EQ(count(second), 2);
  first = Kcf();  // another model in the same variable
  std::vector<AnyPart> mixed{first, third};
  mixed.resize(1, third);
  mixed[0].init(frame, {1, 1}, {2, 2});
  EXPECT_TRUE(mixed[0].localize(frame, {1, 1}).position.allFinite());
}

TEST(AnyPart, ShowsTheModelThatItHolds) {
  KcfOptions options;
  options.cell_size = 2;
  const AnyPart part = Kcf(options);
  ASSERT_NE(part.target<Kcf>(), nullptr);
  EXPECT_EQ(part.target<Kcf>()->options().cell_size, 2);
  EXPECT_EQ(part.target<Counter>(), nullptr);
}

}  // namespace
}  // namespace asterism
