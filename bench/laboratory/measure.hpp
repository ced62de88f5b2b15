#pragma once

#include <string>
#include <vector>

namespace asterism::bench {

/// CPU time of this thread [s]: the one clock of the laboratory.
double cpu_seconds();
double median(std::vector<double> values);
/// The value below which the share p of `values` lies.
double percentile(std::vector<double> values, double p);
/// A median and where that of the whole population lies with 95 % confidence, by order statistics (the
/// binomial distribution's normal approximation); the extremes for fewer than six values.
struct MedianInterval {
  double median, low, high;
};
MedianInterval median_interval(std::vector<double> values);
/// printf into a string.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

}  // namespace asterism::bench
