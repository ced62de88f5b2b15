#pragma once

#include <string>
#include <vector>

namespace asterism::bench {

/// CPU time of this thread [s]: the only clock of the laboratory.
double cpu_seconds();
double median(std::vector<double> values);
/// The value below which the share p of `values` lies.
double percentile(std::vector<double> values, double p);
/// A median and its 95 % confidence interval by order statistics (in the normal approximation of the binomial
/// distribution); the extremes for fewer than six values.
struct MedianInterval {
  double median, low, high;
};
MedianInterval median_interval(std::vector<double> values);
/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

}  // namespace asterism::bench
