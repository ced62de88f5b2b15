// asterism-calibration: how far part models are from the annotated target, and whether their uncertainty is
// right: the error in units of the standard deviation that they state.

#include <CLI/CLI.hpp>
#include <Eigen/LU>
#include <algorithm>
#include <asterism/parts/concept/part_registry.hpp>
#include <cmath>
#include <cstdio>
#include <map>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "dataset.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism;
using bench::Sequence;

/// One search of a part.
struct Search {
  double error;        ///< [mean sides of the target]
  double mahalanobis;  ///< of the covariance
  double isotropic;    ///< of the scalar variance, half the covariance's trace
};

// In every frame the part is searched around the target's annotated centre in the frame before, and then
// adapted at the annotated centre, so that no error carries over.
std::vector<Search> searches(AnyPart part, const Sequence& sequence) {
  std::vector<Search> result;
  bench::FrameReader reader(sequence);
  bool started = false;
  Point2 centre = Point2::Zero();
  for (std::size_t t = 0; t < sequence.length(); ++t) {
    if (!sequence.truth[t]) {
      started = false;
      continue;
    }
    const cv::Mat image = reader(t);
    const Frame frame(image);
    const cv::Rect2d box = sequence.truth[t]->equal_area_box();
    const Point2 truth = centre_of(box);
    if (!started) {
      part.init(frame, truth, {box.width, box.height});
      started = true;
    } else {
      const Evidence evidence = part.localize(frame, centre);
      const Point2 error = truth - evidence.position;
      result.push_back({error.norm() / std::sqrt(box.area()),
                        std::sqrt(error.dot(evidence.covariance.inverse() * error)),
                        std::sqrt(error.squaredNorm() / (evidence.covariance.trace() / 2))});
      part.adapt(frame, truth);
    }
    centre = truth;
  }
  return result;
}

template <typename Member>
std::vector<double> sorted(const std::vector<Search>& searches, Member member) {
  std::vector<double> values;
  for (const Search& search : searches) values.push_back(search.*member);
  std::sort(values.begin(), values.end());
  return values;
}
double quantile(const std::vector<double>& values, double share) {
  return values[std::min(values.size() - 1,
                         static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}
double percent_below(const std::vector<double>& values, double bound) {
  return 100 * static_cast<double>(std::lower_bound(values.begin(), values.end(), bound) - values.begin()) /
         static_cast<double>(values.size());
}

void report(const std::vector<std::string>& models, const std::vector<Sequence>& sequences) {
  PartRegistry registry;
  std::map<std::string, std::map<std::string, double>> medians;  // of the error, by sequence and model
  std::printf("%-28s %8s %8s | %6s %6s %6s %7s | %6s %6s %6s %7s\n", "errors [% of the side]", "median",
              "90 %", "< 1", "< 2", "< 2.45", "factor", "< 1", "< 2", "< 2.45", "factor");
  std::printf("%-28s %8s %8s | %6.1f %6.1f %6.1f %7.2f | %6.1f %6.1f %6.1f %7.2f\n", "(normally distributed)",
              "", "", 39.3, 86.5, 95.0, 1.0, 39.3, 86.5, 95.0, 1.0);
  for (const std::string& model : models) {
    std::vector<Search> all;
    for (const Sequence& sequence : sequences) {
      const std::vector<Search> found = searches(registry.make(model), sequence);
      if (found.empty()) continue;
      medians[sequence.name][model] = quantile(sorted(found, &Search::error), 0.5);
      all.insert(all.end(), found.begin(), found.end());
    }
    if (all.empty()) throw std::runtime_error("no two frames in a row have ground truth");
    const auto errors = sorted(all, &Search::error);
    std::printf("%-28s %8.2f %8.2f", model.c_str(), 100 * quantile(errors, 0.5), 100 * quantile(errors, 0.9));
    for (const auto member : {&Search::mahalanobis, &Search::isotropic}) {
      const auto distances = sorted(all, member);
      // A normal distribution in the plane has the median distance sqrt(2 ln 2).
      std::printf(" | %6.1f %6.1f %6.1f %7.2f", percent_below(distances, 1), percent_below(distances, 2),
                  percent_below(distances, 2.4477), quantile(distances, 0.5) / std::sqrt(2 * std::log(2)));
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf("\nmedian error [%% of the side]\n%-28s", "");
  for (const std::string& model : models) std::printf(" %10.10s", model.c_str());
  std::printf("  least\n");
  for (const auto& [sequence, errors] : medians) {
    std::printf("%-28s", sequence.c_str());
    for (const std::string& model : models) std::printf(" %10.2f", 100 * errors.at(model));
    const auto least = std::min_element(errors.begin(), errors.end(),
                                        [](const auto& a, const auto& b) { return a.second < b.second; });
    std::printf("  %s\n", least->first.c_str());
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset;
  std::vector<std::string> models = PartRegistry().names(), only;
  CLI::App app(
      "Errors of part models on annotated sequences, in pixels and in units of the deviation that they "
      "report: "
      "first that of the covariance, then that of the scalar variance.",
      "asterism-calibration");
  app.add_option("DATASET", dataset, "a sequence, or a folder of sequences")->required();
  app.add_option("--models", models, "part models, with or without options")->capture_default_str();
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  return asterism::tools::run_tool(app, argc, argv, [&] {
    cv::setNumThreads(1);
    PartRegistry registry;
    for (const std::string& model : models)
      registry.make(model);  // unknown ones fail before the first search
    const bench::Dataset data = bench::open_dataset(dataset, bench::Layout::Auto, only);
    print_notes(data);
    report(models, data.sequences);
  });
}
