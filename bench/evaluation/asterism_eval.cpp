// asterism-eval: trackers on annotated sequences, by the protocols of VOT and OTB.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "analysis.hpp"
#include "campaign.hpp"
#include "frame_export.hpp"
#include "got10k_export.hpp"
#include "range_option.hpp"
#include "report.hpp"
#include "run_tool.hpp"
#include "text.hpp"
#include "tool_main.hpp"

namespace {

using namespace asterism::bench;

constexpr std::string_view kName = "asterism-eval";

/// `asterism-eval run`.
class RunCommand {
 public:
  explicit RunCommand(CLI::App& parent)
      : app_(*parent.add_subcommand("run", "runs trackers on a data set and stores their results")) {
    app_.add_option("DATASET", dataset_, "a sequence, or a folder of sequences")->required();
    app_.add_option("--trackers", trackers_,
                    "names as `asterism-eval trackers` lists them, or dpt_net:FOLDER or nanotrack:FOLDER, "
                    "with their networks")
        ->delimiter(',');
    app_.add_option(
            "--tracker", described_,
            "NAME=DESCRIPTION, one of our trackers with options, or nanotrack:FOLDER; may be repeated")
        ->allow_extra_args(false);
    app_.add_option("--external", external_,
                    "NAME=COMMAND, a tracker that speaks TraX, or NAME=python:MODULE:CLASS, a class in "
                    "Python; may be repeated")
        ->allow_extra_args(false);
    app_.add_option("--protocol", protocols_,
                    "vot (supervised), otb (one pass), tre, sre, multistart; several separated by commas")
        ->delimiter(',')
        ->capture_default_str();
    app_.add_option("--out", folder_, "folder of the results; results in it are kept, not computed again")
        ->required();
    app_.add_option("--layout", layout_, "layout of the data set: " + layout_names())->capture_default_str();
    app_.add_option("--sequences", only_, "only these, separated by commas")->delimiter(',');
    app_.add_option("--starts", options_.starts,
                    "vot, otb: number of runs on each sequence; all but the first start on a moved box")
        ->check(CLI::Range(1, kMostStarts))
        ->capture_default_str();
    app_.add_option("--jitter", options_.jitter, "greatest move of a start box on each axis [px]")
        ->check(CLI::Range(0.0, kMostJitter))
        ->capture_default_str();
    app_.add_option("--seed", options_.seed, "seed of the moves")->capture_default_str();
    app_.add_option("--overlap", overlap_,
                    "overlap that defines failures: vot-python, trax, trax-legacy (VOT2013-15), exact")
        ->capture_default_str();
    app_.add_flag("--bounded", options_.bounded, "compute overlaps within the image only");
    app_.add_flag("--boxes", options_.boxes,
                  "replace ground truth polygons by their axis-aligned bounding boxes");
    app_.add_option("--jpeg", options_.jpeg, "compress all images again, by JPEG of this quality")
        ->check(CLI::Range(1, 100));
    asterism::tools::add_range_options(app_, options_.range);
    app_.add_option("--workers", workers_, "number of runs at the same time; use 1 to measure speed")
        ->check(CLI::Range(1, 1024))
        ->capture_default_str();
    app_.add_option("--timeout", timeout_, "time limit for each answer of an external tracker [s]")
        ->check(CLI::Range(0.001, 100'000.0))
        ->capture_default_str();
    app_.add_option("--retries", retries_,
                    "how often to repeat a run in which an external tracker ended or did not answer")
        ->check(CLI::Range(0, 1000))
        ->capture_default_str();
    app_.add_option("--rerun", rerun_, "delete all results of these trackers first")->delimiter(',');
  }

  bool parsed() const { return app_.parsed(); }

  int run(const Processes& processes, const std::string& command) {
    stop_on_signals();
    // The command line's range checks let NaN pass.
    if (std::isnan(options_.jitter)) throw std::invalid_argument("--jitter: not a number");
    if (std::isnan(timeout_)) throw std::invalid_argument("--timeout: not a number");
    Campaign campaign;
    campaign.folder = folder_;
    campaign.dataset = std::filesystem::weakly_canonical(dataset_);
    campaign.layout = parse_layout(layout_);
    campaign.options = options_;
    campaign.options.overlap = parse_overlap_rule(overlap_);
    for (const std::string& name : protocols_) campaign.protocols.push_back(parse_protocol(name));
    for (const std::string& name : trackers_) add_tracker(campaign, name_of(name), name);
    const auto add_named = [&](const std::string& named, const std::string& prefix, const std::string& form) {
      const std::size_t equals = named.find('=');
      if (equals == std::string::npos || equals + 1 == named.size())
        throw std::invalid_argument(form + ", not \"" + named + '"');
      add_tracker(campaign, named.substr(0, equals), prefix + named.substr(equals + 1));
    };
    for (const std::string& named : described_) add_named(named, "", "--tracker takes NAME=DESCRIPTION");
    for (const std::string& named : external_)
      add_named(named, "trax:", "--external takes NAME=COMMAND or NAME=python:MODULE:CLASS");
    std::vector<std::string> names;
    for (const auto& [name, tracker] : campaign.trackers) names.push_back(name);
    if (names.empty())
      throw std::invalid_argument(
          "no tracker: give --trackers, such as --trackers dpt_plus,opencv-csrt, or --tracker or --external");
    for (const std::string& name : rerun_)
      if (!campaign.trackers.contains(name))
        throw std::invalid_argument("--rerun " + name + ": no tracker of this run");
    if (!is_utf8(campaign.dataset.string()))
      throw std::invalid_argument(printable(campaign.dataset.string()) +
                                  ": the path is not UTF-8, as campaign.json needs it: rename it");
    Dataset dataset = open_dataset(campaign.dataset, campaign.layout, only_);
    if (processes.shard().index == 0) print_notes(dataset);
    campaign.sequences = std::move(dataset.sequences);
    read_as(campaign.sequences, options_);
    campaign.record.push_back({{"command", printable(command)},
                               {"started", utc_now()},
                               {"version", ASTERISM_VERSION},
                               {"machine", process_machine()},
                               {"workers", workers_},
                               {"processes", processes.shard().count}});
    if (!dataset.notes.empty()) campaign.record.back()["notes"] = dataset.notes;
    const std::vector<Protocol> protocols = campaign.protocols;
    if (processes.shard().index == 0) {
      for (const std::string& name : rerun_) drop_results(campaign, name);
      write_campaign(campaign);
    }
    if (processes.shard().index == 0)
      for (const Sequence& sequence : campaign.sequences)
        for (const Protocol protocol : protocols)
          if (const std::string line = reason_for_no_run(sequence, protocol, options_); !line.empty())
            std::fprintf(stderr, "%s\n", line.c_str());
    // No process starts runs before the campaign has been checked.
    if (const auto wait = processes.barrier()) wait();

    const CampaignTally tally =
        run_campaign(campaign, names, protocols,
                     {workers_, processes.shard(), [] { return stop_signal() != 0; }, timeout_, retries_});
    std::fprintf(stderr, "%s made, %zu stored before", asterism::detail::counted(tally.runs, "run").c_str(),
                 tally.kept);
    if (tally.failed > 0)
      std::fprintf(stderr, "; trackers threw in %zu: *_errors.log beside their results", tally.failed);
    if (!tally.interrupted) std::fprintf(stderr, "; asterism-eval report %s scores them", folder_.c_str());
    std::fprintf(stderr, "\n");
    record_unreadable(campaign, tally.unreadable);
    for (const std::string& line : unreadable_lines(tally.unreadable))
      std::fprintf(stderr, "%s\n", line.c_str());
    if (tally.interrupted) {
      std::fprintf(stderr, "interrupted; the same command goes on%s\n",
                   rerun_.empty() ? "" : ", without --rerun");
      return 128 + stop_signal();
    }
    return tally.unreadable.size() == campaign.sequences.size() ? 1 : 0;
  }

 private:
  static void add_tracker(Campaign& campaign, const std::string& name, const std::string& tracker) {
    if (const std::string reason = reason_against_name(name); !reason.empty())
      throw std::invalid_argument(reason);
    if (!is_utf8(tracker))
      throw std::invalid_argument(printable(tracker) + ": a tracker's description is UTF-8");
    evaluated_tracker(tracker);  // unknown names fail before the first run
    campaign.trackers[name] = tracker;
  }

  CLI::App& app_;
  std::string dataset_, folder_, layout_ = "auto", overlap_ = "vot-python";
  std::vector<std::string> trackers_, external_, described_, protocols_ = {"vot", "otb"}, only_, rerun_;
  ProtocolOptions options_;
  int workers_ = std::max(1, static_cast<int>(std::thread::hardware_concurrency())), retries_ = 0;
  double timeout_ = 30;
};

/// `asterism-eval report`.
class ReportCommand {
 public:
  explicit ReportCommand(CLI::App& parent)
      : app_(*parent.add_subcommand(
            "report", "scores the results that `run` has stored; writes a page, JSON and CSV")) {
    app_.add_option("DIR", folder_, "folder of the results")->required();
    app_.add_option("--out", out_, "folder of the report; by default DIR/report");
    app_.add_option("--dataset", dataset_, "path of the data set, if it has moved");
    app_.add_option("--sequences", only_, "only these, separated by commas")->delimiter(',');
    app_.add_option("--interval", interval_,
                    "LOW:HIGH, interval of lengths of the supervised EAO; default: from the density of "
                    "the lengths of the sequences");
    app_.add_flag("--paper", options_.paper, "add the figures of the DPT paper");
    app_.add_option("--baseline", options_.baseline, "tracker with which the others are compared");
  }

  bool parsed() const { return app_.parsed(); }

  int run() const {
    AnalysisOptions options;
    if (!interval_.empty()) options.interval = parse_interval(interval_);
    Campaign campaign = read_campaign(folder_, dataset_);
    if (!only_.empty()) keep_sequences(campaign);
    const Analysis analysis = analyse(campaign, options);
    const std::filesystem::path out = out_.empty() ? std::filesystem::path(folder_) / "report" : out_;
    write_report(campaign, analysis, out, options_);
    std::printf("%s", summary_text(analysis).c_str());
    std::fprintf(stderr, "%s has plots and intervals\n", (out / "report.html").c_str());
    for (const std::string& line : analysis.left_out) std::fprintf(stderr, "%s\n", line.c_str());
    return 0;
  }

 private:
  void keep_sequences(Campaign& campaign) const {
    for (const std::string& name : only_) {
      if (campaign.unreadable.contains(name))
        throw std::invalid_argument("--sequences " + name + ": " + campaign.unreadable.at(name));
      if (std::ranges::find(campaign.sequences, name, &Sequence::name) == campaign.sequences.end())
        throw std::invalid_argument("--sequences " + name + ": the results are not of such a sequence");
    }
    std::erase_if(campaign.sequences, [this](const Sequence& sequence) {
      return std::ranges::find(only_, sequence.name) == only_.end();
    });
  }

  static LengthInterval parse_interval(const std::string& text) {
    LengthInterval interval;
    const char* const end = text.data() + text.size();
    const auto low = std::from_chars(text.data(), end, interval.low);
    if (low.ec == std::errc() && low.ptr != end && *low.ptr == ':') {
      const auto high = std::from_chars(low.ptr + 1, end, interval.high);
      if (high.ec == std::errc() && high.ptr == end && interval.low > 0 && interval.low <= interval.high)
        return interval;
    }
    throw std::invalid_argument("--interval takes LOW:HIGH, two numbers of frames, not \"" + text + "\"");
  }

  CLI::App& app_;
  std::string folder_, interval_;
  std::vector<std::string> only_;
  std::filesystem::path out_, dataset_;
  ReportOptions options_;
};

/// A command that writes stored results in another form: of all trackers, or of those named.
class ExportCommand {
 public:
  bool parsed() const { return app_.parsed(); }

 protected:
  ExportCommand(CLI::App& app, const std::string& out) : app_(app) {
    app_.add_option("DIR", folder_, "folder of the results")->required();
    app_.add_option("--out", out_, out)->required();
    app_.add_option("--dataset", dataset_, "path of the data set, if it has moved");
    app_.add_option("--trackers", trackers_, "only these, separated by commas")->delimiter(',');
  }

  Campaign campaign() const {
    Campaign campaign = read_campaign(folder_, dataset_);
    for (const std::string& line : unreadable_lines(campaign.unreadable))
      std::fprintf(stderr, "%s\n", line.c_str());
    return campaign;
  }
  std::vector<std::string> names(const Campaign& campaign) const {
    std::vector<std::string> names = trackers_;
    if (names.empty())
      for (const auto& [name, tracker] : campaign.trackers) names.push_back(name);
    return names;
  }
  const std::filesystem::path& out() const { return out_; }

 private:
  CLI::App& app_;
  std::string folder_;
  std::filesystem::path out_, dataset_;
  std::vector<std::string> trackers_;
};

/// `asterism-eval export-got10k`.
class ExportGot10kCommand : public ExportCommand {
 public:
  explicit ExportGot10kCommand(CLI::App& parent)
      : ExportCommand(
            *parent.add_subcommand("export-got10k",
                                   "writes the results of protocol otb in the format of GOT-10k's server"),
            "folder of the files, with a subfolder for each tracker") {}

  int run() const {
    const Campaign results = campaign();
    for (const std::string& name : names(results)) {
      const std::size_t repeated = export_got10k(results, name, out() / name);
      std::printf("%s: to be sent are the contents of it, zipped\n", (out() / name).c_str());
      if (repeated > 0)
        std::fprintf(stderr, "%s has no box in %s: the box of the frame before stands there\n", name.c_str(),
                     asterism::detail::counted(repeated, "frame").c_str());
    }
    return 0;
  }
};

/// `asterism-eval export-frames`.
class ExportFramesCommand : public ExportCommand {
 public:
  explicit ExportFramesCommand(CLI::App& parent)
      : ExportCommand(*parent.add_subcommand("export-frames",
                                             "writes overlap and confidence of every frame as CSV, of "
                                             "protocols vot and otb"),
                      "the file") {}

  int run() const {
    const Campaign results = campaign();
    std::printf("%s: %s\n", out().c_str(),
                asterism::detail::counted(export_frames(results, names(results), out()), "frame").c_str());
    return 0;
  }
};

int list_trackers() {
  for (const std::string& name : evaluated_tracker_names()) std::printf("%s\n", name.c_str());
  return 0;
}

int run_command_line(const Processes& processes, int argc, char** argv) {
  std::string command(kName);
  for (int a = 1; a < argc; ++a) command += std::string(" ") + argv[a];

  CLI::App app("Evaluates trackers on annotated sequences by the protocols of VOT and OTB.",
               std::string(kName));
  app.require_subcommand(1);
  app.set_version_flag("--version", ASTERISM_VERSION);
  RunCommand run(app);
  ReportCommand report(app);
  ExportGot10kCommand got10k(app);
  ExportFramesCommand frames(app);
  const CLI::App* trackers = app.add_subcommand("trackers", "lists the trackers that can be run");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    return asterism::tools::fail(kName, asterism::tools::problem_with(app, error), 2);
  }
  if (run.parsed()) return run.run(processes, command);
  if (report.parsed()) return processes.shard().index == 0 ? report.run() : 0;
  if (got10k.parsed()) return processes.shard().index == 0 ? got10k.run() : 0;
  if (frames.parsed()) return processes.shard().index == 0 ? frames.run() : 0;
  if (trackers->parsed()) return list_trackers();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  asterism::tools::silence_libraries();
  std::signal(SIGPIPE, SIG_IGN);  // an external tracker that dies is an error of its run, not the end of ours
  const Processes processes(argc, argv);
  try {
    const int code = run_command_line(processes, argc, argv);
    asterism::tools::flush_output();
    return code;
  } catch (const std::exception& error) {
    asterism::tools::fail(kName, error.what(), 1);
    processes.abort();
    return 1;
  }
}
