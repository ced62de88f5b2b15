#include "evaluation.hpp"

#include <algorithm>
#include <chrono>
#include <numeric>
#include <random>
#include <stdexcept>

#include "image_source.hpp"

namespace asterism::bench {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kBurnIn = 10;     // frames from a start on that do not count for accuracy
constexpr std::size_t kRestartGap = 5;  // frames from a failure to the next start

// The box to start with in frame t; a sequence that cannot be started there is an error of its own.
cv::Rect2d start_box(const LoadedSequence& sequence, std::size_t t, const cv::Point2d& offset) {
  if (!sequence.truth[t])
    throw std::runtime_error(sequence.name + ": no object to start on in frame " + std::to_string(t + 1));
  const cv::Rect2d& box = sequence.truth[t]->box();
  return {box.x + offset.x, box.y + offset.y, box.width, box.height};
}

double overlap_in(const LoadedSequence& sequence, std::size_t t, const cv::Rect2d& box) {
  return sequence.truth[t] ? tools::overlap(box, sequence.truth[t]->box()) : 0;
}

}  // namespace

std::vector<fs::path> find_sequences(const fs::path& folder, const std::vector<std::string>& only) {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(folder))
    if (fs::exists(entry.path() / "groundtruth.txt") &&
        (only.empty() || std::ranges::count(only, entry.path().filename().string()) > 0))
      found.push_back(entry.path());
  if (found.empty()) throw std::runtime_error("no sequence with a groundtruth.txt in " + folder.string());
  std::ranges::sort(found);
  return found;
}

LoadedSequence load_sequence(const fs::path& folder) {
  LoadedSequence sequence{.name = folder.filename().string(),
                          .images = {},
                          .truth = tools::read_ground_truth(folder / "groundtruth.txt")};
  tools::ImageSource source = tools::ImageSource::open(folder.string());
  for (cv::Mat image; source.next(image);) sequence.images.push_back(image.clone());
  if (sequence.images.size() != sequence.truth.size())
    throw std::runtime_error(folder.string() + ": " + std::to_string(sequence.images.size()) +
                             " images, but " + std::to_string(sequence.truth.size()) + " boxes");
  return sequence;
}

std::vector<cv::Point2d> start_offsets(int count) {
  std::mt19937 random(1);
  const auto uniform = [&] { return static_cast<double>(random()) / 2147483648.0 - 1; };
  std::vector<cv::Point2d> offsets(1);
  while (static_cast<int>(offsets.size()) < count) {
    const double x = uniform(), y = uniform();
    offsets.emplace_back(x, y);
  }
  return offsets;
}

double OnePass::average_overlap() const {
  return overlaps.empty()
             ? 0
             : std::reduce(overlaps.begin(), overlaps.end()) / static_cast<double>(overlaps.size());
}

OnePass run_one_pass(const Start& start, const LoadedSequence& sequence, const cv::Point2d& offset) {
  OnePass result;
  const Step step = start(sequence.images[0], start_box(sequence, 0, offset));
  for (std::size_t t = 1; t < sequence.images.size(); ++t) {
    const auto before = std::chrono::steady_clock::now();
    const cv::Rect2d box = step(sequence.images[t]);
    result.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    result.overlaps.push_back(overlap_in(sequence, t, box));
  }
  return result;
}

Supervised run_supervised(const Start& start, const LoadedSequence& sequence, const cv::Point2d& offset) {
  Supervised result;
  for (std::size_t first = 0; first < sequence.images.size();) {
    const Step step = start(sequence.images[first], start_box(sequence, first, offset));
    std::size_t t = first + 1;
    for (; t < sequence.images.size(); ++t) {
      const double overlap = overlap_in(sequence, t, step(sequence.images[t]));
      if (overlap <= 0) {
        ++result.failures;
        break;
      }
      if (t >= first + kBurnIn) result.overlaps.push_back(overlap);
    }
    first = t + kRestartGap;
  }
  return result;
}

}  // namespace asterism::bench
