#pragma once

#include <gtest/gtest.h>

#include <asterism/trackers/tracker/tracker.hpp>

namespace asterism {

/// Equality bit for bit, except for the times.
inline void expect_same(const TrackResult& a, const TrackResult& b) {
  EXPECT_EQ(a.box, b.box);
  EXPECT_EQ(a.angle, b.angle);
  EXPECT_EQ(a.confidence, b.confidence);
  EXPECT_EQ(a.lost, b.lost);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.links, b.links);
  ASSERT_EQ(a.parts.size(), b.parts.size());
  for (std::size_t i = 0; i < a.parts.size(); ++i) {
    EXPECT_EQ(a.parts[i].position, b.parts[i].position);
    EXPECT_EQ(a.parts[i].weight, b.parts[i].weight);
    EXPECT_EQ(a.parts[i].updated, b.parts[i].updated);
  }
}

}  // namespace asterism
