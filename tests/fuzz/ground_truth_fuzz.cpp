// Fuzzes the reading of ground truth and results: what is read must be finite and survive writing; every
// error must be a std::runtime_error.

#include <cmath>
#include <cstdlib>
#include <ground_truth.hpp>
#include <stdexcept>
#include <trajectory.hpp>

#include "bytes.hpp"

using namespace asterism;

namespace {

void read_truth(const std::filesystem::path& file) {
  for (const auto& region : tools::read_ground_truth(file)) {
    if (!region) continue;
    const cv::Rect2d box = region->box();
    if (!(box.width > 0 && box.height > 0)) std::abort();
    const double overlap = tools::overlap(box, box);
    if (!(overlap >= 0 && overlap <= 1 + 1e-9)) std::abort();
  }
}

void read_results(const fuzz::ScratchFolder& folder, const std::filesystem::path& file) {
  const bench::Trajectory read = bench::read_trajectory(file);
  const std::filesystem::path again = folder.path() / "again.txt";
  bench::write_trajectory(again, read);
  if (bench::read_trajectory(again).frames.size() != read.frames.size()) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFolder folder("ground_truth");
  if (size == 0) return 0;
  const std::string_view content = fuzz::text(data + 1, size - 1);
  try {
    switch (data[0]) {
      case 't':
        read_truth(folder.write("truth.txt", content));
        break;
      case 'r':
        read_results(folder, folder.write("run.txt", content));
        break;
      case 'b':
        folder.write("binary.bin", content);
        read_results(folder, folder.path() / "binary.txt");
    }
  } catch (const std::runtime_error&) {
  }
  return 0;
}
