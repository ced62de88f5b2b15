#include "frame_export.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "peers.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

// Whether the tracker has answered in any frame.
bool tracks_any(const Trajectory& trajectory) {
  return std::ranges::any_of(trajectory.frames, [](const auto& frame) { return frame.region.has_value(); });
}

// Appends the run's frames as lines that begin with `head`; returns their number.
std::size_t append_frames(const std::string& head, const Trajectory& trajectory, const Sequence& sequence,
                          const ProtocolOptions& options, const std::vector<double>& confidence,
                          std::string& lines) {
  std::size_t count = 0;
  for (std::size_t t = 0; t < sequence.length(); ++t) {
    const auto truth = truth_of(sequence, t, options);
    if (!truth || std::isnan(confidence[t])) continue;
    const auto& region = trajectory.frames[t].region;
    const double common = region ? overlap(Region::rectangle(region->equal_area_box()),
                                           Region::rectangle(truth->equal_area_box()), OverlapRule::Exact)
                                 : 0;
    std::array<char, 80> text;
    std::snprintf(text.data(), text.size(), ",%zu,%.6f,%.9g\n", t + 1, common, confidence[t]);
    lines += head + text.data();
    ++count;
  }
  return count;
}

}  // namespace

std::size_t export_frames(const Campaign& campaign, const std::vector<std::string>& trackers,
                          const fs::path& file) {
  std::string lines = "tracker,protocol,sequence,run,frame,overlap,confidence\n";
  std::size_t count = 0;
  for (const std::string& tracker : trackers) {
    if (!campaign.trackers.contains(tracker))
      throw std::invalid_argument("no tracker " + tracker + " in " + campaign.folder.string());
    for (const Protocol protocol : {Protocol::Vot, Protocol::Otb}) {
      if (std::ranges::find(campaign.protocols, protocol) == campaign.protocols.end()) continue;
      for (const Sequence& sequence : campaign.sequences)
        for (const Run& run : runs_of(sequence, protocol, campaign.options)) {
          const Trajectory trajectory = campaign.result(tracker, sequence, run);
          const auto confidence = trajectory.values.find("confidence");
          if (confidence == trajectory.values.end()) {
            if (!tracks_any(trajectory)) continue;  // it was never asked for one
            throw std::runtime_error(campaign.file(tracker, sequence, run).string() +
                                     ": stored without confidences; " +
                                     (has_confidence(campaign.trackers.at(tracker))
                                          ? "make it again with --rerun " + tracker
                                          : "the tracker gives none: leave it out by --trackers"));
          }
          count += append_frames(tracker + "," + std::string(to_string(protocol)) + "," + sequence.name +
                                     "," + std::to_string(run.number),
                                 trajectory, sequence, campaign.options, confidence->second, lines);
        }
    }
  }
  if (file.has_parent_path()) fs::create_directories(file.parent_path());
  write_atomically(file, lines);
  return count;
}

}  // namespace asterism::bench
