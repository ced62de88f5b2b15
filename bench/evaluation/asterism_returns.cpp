// asterism-returns: whether trackers find an object that has left the image and comes back; and how much
// their results change with the start or the compression of the images.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "made_videos.hpp"
#include "overlap.hpp"
#include "peers.hpp"
#include "run_tool.hpp"

namespace {

using namespace asterism;
using bench::Region;
using bench::Video;

// For how many frames the object is away, at most a quarter of the sequence where its scene goes on.
constexpr std::size_t kAway = 60;
// The sequence that is shown meanwhile: so many further in the data set.
constexpr std::size_t kOther = 7;

// A tracker's name in the table and its description, of NAME=DESCRIPTION or of a description alone.
std::pair<std::string, std::string> named(const std::string& tracker) {
  const std::size_t equals = tracker.find('='), brace = tracker.find('{');
  if (equals == std::string::npos || equals > brace) return {tracker, tracker};
  return {tracker.substr(0, equals), tracker.substr(equals + 1)};
}

void follow(const std::string& line, const bench::EvaluatedTracker& tracker, const Video& video,
            std::ostream& out) {
  const bench::Step step =
      tracker.start(bench::Image(video.at(0).image), Region::rectangle(video[0].truth.value()));
  bool was_absent = false;
  for (std::size_t t = 1; t < video.size(); ++t) {
    const bench::Shown& shown = video[t];
    const std::clock_t begin = std::clock();  // of the processor, as others may be at work
    const bench::Report report = step(bench::Image(shown.image));
    const double milliseconds = 1000.0 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
    was_absent = was_absent || shown.absent;
    const char* const state = shown.absent ? "absent" : was_absent ? "after" : "before";
    out << line << ',' << t << ',' << state << ',';
    // Empty where it does not count.
    if (shown.truth)
      out << (report.region ? bench::overlap(Region::rectangle(report.region->equal_area_box()),
                                             Region::rectangle(*shown.truth), bench::OverlapRule::Exact)
                            : 0);
    out << ',' << milliseconds << '\n';
  }
  out.flush();
}

}  // namespace

int main(int argc, char** argv) {
  std::string dataset, file;
  std::vector<std::string> trackers{"dpt_plus"}, kinds{"pass", "covered", "masked", "cut", "elsewhere"}, only;
  std::size_t most = 1000000;
  CLI::App app(
      "Writes the overlap of trackers' boxes with the object, and the milliseconds of the processor for each "
      "frame, in videos "
      "that are made of annotated sequences: the object leaves and comes back, or the start or the images "
      "are slightly different. returns.py and perturbations.py make tables of it.",
      "asterism-returns");
  app.add_option("DATASET", dataset, "a sequence, or a folder of sequences")->required();
  app.add_option("--tracker", trackers,
                 "a tracker as for asterism-eval, or NAME=DESCRIPTION, to store it under a name; may be "
                 "repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->capture_default_str();
  app.add_option("--kinds", kinds, "kinds of videos, separated by commas: docs/evaluation.md")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--frames", most, "of a sequence, at most")->capture_default_str();
  app.add_option("--out", file, "the CSV file to write")->required();
  app.add_option("--sequences", only, "only these, separated by commas")->delimiter(',');
  return asterism::tools::run_tool(app, argc, argv, [&] {
    std::vector<bench::EvaluatedTracker> used;
    for (const std::string& tracker : trackers) {
      const auto [name, description] = named(tracker);
      used.push_back({name, bench::evaluated_tracker(description).start});
    }
    std::ranges::for_each(kinds, bench::check_kind);
    const bench::Dataset data = bench::open_dataset(dataset);
    print_notes(data);
    for (const std::string& name : only)
      if (std::ranges::none_of(data.sequences, [&](const auto& sequence) { return sequence.name == name; }))
        throw std::runtime_error("--sequences: there is no sequence " + name);
    std::ofstream out(file);
    out << "tracker,kind,sequence,frame,state,overlap,milliseconds\n";
    for (std::size_t s = 0; s < data.sequences.size(); ++s) {
      const bench::Sequence& sequence = data.sequences[s];
      // The other sequence is the same, whatever is selected.
      if (!only.empty() && std::ranges::find(only, sequence.name) == only.end()) continue;
      const Video video = bench::shown(sequence, most);
      const Video other = bench::shown(data.sequences[(s + kOther) % data.sequences.size()], kAway);
      for (const std::string& kind : kinds) {
        const Video made = bench::made_video(kind, video, other, kAway);
        for (const bench::EvaluatedTracker& tracker : used)
          follow(tracker.name + ',' + kind + ',' + sequence.name, tracker, made, out);
      }
    }
    if (!out) throw std::runtime_error("cannot write " + file);
  });
}
