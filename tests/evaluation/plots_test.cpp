#include "plots.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace asterism::bench {
namespace {

using Values = std::vector<double>;

void expect_near(const Values& actual, const Values& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(actual[i], expected[i], 1e-12);
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t number = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++number;
  return number;
}

TEST(Plots, TicksAreRound) {
  expect_near(round_ticks(0, 1, 5), {0, 0.2, 0.4, 0.6, 0.8, 1});
  expect_near(round_ticks(0.13, 0.62, 5), {0.2, 0.3, 0.4, 0.5, 0.6});
  expect_near(round_ticks(1, 1210, 6), {500, 1000});
  expect_near(round_ticks(-0.07, 0.05, 6), {-0.06, -0.04, -0.02, 0, 0.02, 0.04});
  expect_near(round_ticks(0, 3e-7, 3), {0, 1e-7, 2e-7, 3e-7});
  EXPECT_THROW(round_ticks(1, 1, 5), std::invalid_argument);
  EXPECT_THROW(round_ticks(0, std::nan(""), 5), std::invalid_argument);
}

TEST(Plots, NumbersLoseZerosAtTheEnd) {
  EXPECT_EQ(number_text(0.5, 3), "0.5");
  EXPECT_EQ(number_text(100, 2), "100");
  EXPECT_EQ(number_text(100, 0), "100");
  EXPECT_EQ(number_text(-0.001, 2), "0");
  EXPECT_EQ(number_text(1.0 / 3, 2), "0.33");
}

TEST(Plots, TextIsEscaped) { EXPECT_EQ(escaped("a<b>&\"c\"\x01\x1b"), "a&lt;b&gt;&amp;&quot;c&quot;"); }

TEST(Plots, NaNInterruptsALine) {
  const double nan = std::nan("");
  const LineChart chart = {.title = "", .x = {}, .y = {}, .series = {{"a", {1, 2, 3, 4}, {1, nan, 2, 3}, 0}}};
  const std::string drawn = svg(chart);
  const std::size_t path = drawn.find(" d=\"");
  const std::string data = drawn.substr(path, drawn.find('"', path + 4) - path);
  EXPECT_EQ(count(data, "M"), 2U);
  EXPECT_EQ(count(data, "L"), 1U);
  EXPECT_EQ(count(drawn, "nan"), 0U);
}

TEST(Plots, HaveAnAxisForAnyData) {
  for (const Values& values : {Values{}, Values{0}, Values{5, 5}, Values{std::nan("")}, Values{-3e9, 4e-9}}) {
    LineChart chart{.title = "", .x = {}, .y = {}, .series = {{"a", values, values, 0}}};
    const std::string drawn = svg(chart);
    EXPECT_GE(count(drawn, "tick middle"), 2U);
    EXPECT_EQ(count(drawn, "nan") + count(drawn, "inf"), 0U);
  }
  EXPECT_THROW(svg(LineChart{.title = "", .x = {}, .y = {}, .series = {{"a", {1, 2}, {1}, 0}}}),
               std::invalid_argument);
  BarChart bars;
  bars.bars = {{"a", std::nan(""), {}, 0}};
  EXPECT_EQ(count(svg(bars), "nan"), 0U);
  EXPECT_EQ(count(svg(Timeline{.title = "", .strips = {{"a", {}, {}, 0}}}), "nan"), 0U);
}

}  // namespace
}  // namespace asterism::bench
