#include "got10k_export.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

template <class... Values>
std::string formatted(const char* format, Values... values) {
  std::array<char, 1600> text;
  const int length = std::snprintf(text.data(), text.size(), format, values...);
  return {text.data(), static_cast<std::size_t>(length)};
}

}  // namespace

std::size_t export_got10k(const Campaign& campaign, const std::string& tracker, const fs::path& folder) {
  if (!campaign.trackers.contains(tracker))
    throw std::invalid_argument("no tracker " + tracker + " in " + campaign.folder.string());
  std::size_t repeated = 0;
  for (const Sequence& sequence : campaign.sequences) {
    fs::create_directories(folder / sequence.name);
    std::vector<std::string> times(sequence.length());
    for (const Run& run : runs_of(sequence, Protocol::Otb, campaign.options)) {
      const Trajectory trajectory = campaign.result(tracker, sequence, run);
      const auto seconds = trajectory.values.find("time");
      cv::Rect2d box = start_region(sequence, run, campaign.options).box();
      std::string boxes;
      for (std::size_t t = 0; t < sequence.length(); ++t) {
        const auto& region = trajectory.frames[t].region;
        if (region) box = region->box();
        if (!region && t > run.first) ++repeated;
        boxes += formatted("%.3f,%.3f,%.3f,%.3f\n", box.x, box.y, box.width, box.height);
        const bool timed = seconds != trajectory.values.end() && !std::isnan(seconds->second[t]);
        if (run.number > 1) times[t] += ',';
        times[t] += formatted("%.8f", timed ? seconds->second[t] : 0.0);
      }
      write_atomically(folder / sequence.name / run.file(sequence), boxes);
    }
    std::string text;
    for (const std::string& line : times) text += line + "\n";
    write_atomically(folder / sequence.name / (sequence.name + "_time.txt"), text);
  }
  return repeated;
}

}  // namespace asterism::bench
