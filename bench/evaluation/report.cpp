#include "report.hpp"

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <cctype>
#include <cmath>
#include <set>
#include <stdexcept>

#include "plots.hpp"
#include "report_internal.hpp"

namespace asterism::bench {
namespace {

using detail::counted;

constexpr std::string_view kStyle = R"(
:root {
  color-scheme: light dark;
  --page: #f4f3ef; --card: #fcfcfb; --text: #0b0b0b; --quiet: #52514e; --border: #e1e0d9; --mark: #dcebdd; --worse: #f6e0da;
}
@media (prefers-color-scheme: dark) {
  :root { --page: #0f0f0e; --card: #1a1a19; --text: #ffffff; --quiet: #c3c2b7; --border: #33332f; --mark: #1d3b2a;
          --worse: #4a2420; }
}
body { margin: 0 auto; padding: 1rem; max-width: 60rem; background: var(--page); color: var(--text);
       font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0.5rem 0; }
h2 { font-size: 1.2rem; margin: 2rem 0 0.5rem; }
section, details { background: var(--card); border: 1px solid var(--border); border-radius: 6px;
                   padding: 0.75rem 1rem; margin: 0.75rem 0; }
details > details { padding: 0.4rem 0.8rem; }
summary { cursor: pointer; font-weight: 600; }
p { margin: 0.5rem 0; max-width: 46rem; }
.note, figcaption, dt { color: var(--quiet); font-size: 0.87rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0.1rem 1rem; margin: 0; }
dd { margin: 0; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: 0.5rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: 0.25rem 0; }
th, td { padding: 0.2rem 0.6rem; border-bottom: 1px solid var(--border); text-align: right; white-space: nowrap;
         vertical-align: top; }
th:first-child, td:first-child { text-align: left; }
thead th { border-bottom: 2px solid var(--border); }
tbody th { font-weight: 500; }
.best { background: var(--mark); font-weight: 700; }
.worse { background: var(--worse); font-weight: 700; }
.interval { display: block; color: var(--quiet); font-size: 0.75rem; font-weight: 400; }
.unclear { color: var(--quiet); }
.printed th, .printed td { font-style: italic; }
thead th { white-space: normal; vertical-align: bottom; }
.charts { display: flex; flex-direction: column; gap: 1rem; overflow-x: auto; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem; }
figure { margin: 0; }
figure img { width: 100%; height: auto; border-radius: 4px; display: block; }
abbr { text-decoration: none; }
@media (max-width: 40rem) { body { padding: 0.5rem; font-size: 14px; } dl { grid-template-columns: 1fr; }
                            section, details { padding: 0.5rem; }
                            .charts .plot { max-width: none; width: 36rem; } }
)";

std::string element(const std::string& name, const std::string& content, const std::string& classes = {}) {
  return "<" + name + (classes.empty() ? "" : " class=\"" + classes + "\"") + ">" + content + "</" + name +
         ">\n";
}

std::string paragraph(const std::string& text) { return element("p", escaped(text)); }
std::string note(const std::string& text) { return element("p", escaped(text), "note"); }

std::string section(const std::string& heading, const std::string& content) {
  if (content.empty()) return {};
  return element("h2", escaped(heading)) + element("section", "\n" + content);
}

std::string details(const std::string& heading, const std::string& content) {
  return element("details", element("summary", escaped(heading)) + content);
}

std::string joined(const std::vector<std::string>& parts, const std::string& separator = ", ") {
  std::string result;
  for (std::size_t i = 0; i < parts.size(); ++i) result += (i > 0 ? separator : "") + parts[i];
  return result;
}

std::string lengths_text(const StatedInterval& interval) {
  const auto& [low, high] = interval.lengths;
  return (low == high ? std::to_string(low) : std::to_string(low) + " to " + std::to_string(high)) +
         " frames (" + interval.origin + ")";
}

std::string overlap_text(const ProtocolOptions& options) {
  const auto meaning = [&]() -> std::string {
    switch (options.overlap) {
      case OverlapRule::Exact:
        return "areas of the polygons themselves";
      case OverlapRule::VotPython:
        return "pixels as today's VOT toolkit counts them";
      case OverlapRule::Trax:
        return "pixels as libtrax counts them, VOT2016 to VOT2019";
      case OverlapRule::TraxLegacy:
        return "pixels as libtrax counts them with its legacy flag, VOT2013 to VOT2015";
    }
    return {};
  };
  return std::string(to_string(options.overlap)) + " (" + meaning() + "), " +
         (options.bounded ? "bounded to the image" : "not bounded to the image") + "; ground truth " +
         (options.boxes ? "as axis-aligned boxes" : "as annotated") +
         ". One-pass figures: exact overlap of upright boxes, of a polygon's area.";
}

std::string list_entry(const std::string& name, const std::string& value) {
  return element("dt", escaped(name)) + element("dd", escaped(value));
}

// How many runs the recorded processes made at the same time.
std::string workers_text(const Campaign& campaign) {
  std::set<int> numbers;
  for (const Json& record : campaign.record)
    numbers.insert(record.value("workers", 1) * record.value("processes", 1));
  if (numbers.empty()) return {};
  if (numbers.size() == 1)
    return *numbers.begin() == 1 ? "one run at a time"
                                 : std::to_string(*numbers.begin()) + " runs at the same time";
  return std::to_string(*numbers.begin()) + " to " + std::to_string(*numbers.rbegin()) +
         " runs at the same time";
}

std::string what_was_run(const Campaign& campaign, const Analysis& analysis) {
  std::size_t frames = 0;
  for (const Sequence& sequence : campaign.sequences) frames += sequence.length();
  std::vector<std::string> protocols;
  for (const Protocol protocol : campaign.protocols) protocols.emplace_back(to_string(protocol));
  const ProtocolOptions& options = campaign.options;
  std::string list =
      list_entry("data set", campaign.dataset.string()) +
      list_entry("sequences", std::to_string(campaign.sequences.size()) + ", " + counted(frames, "frame")) +
      list_entry("protocols", joined(protocols)) +
      list_entry("starts", options.starts == 1 ? "one run on each sequence"
                                               : std::to_string(options.starts) +
                                                     " runs on each sequence, start boxes moved by up to " +
                                                     number_text(options.jitter, 3) + " px, seed " +
                                                     std::to_string(options.seed)) +
      list_entry("overlap", overlap_text(options));
  if (std::ranges::any_of(analysis.trackers,
                          [](const auto& tracker) { return tracker.supervised.has_value(); }))
    list += list_entry("EAO over lengths of", lengths_text(analysis.supervised));
  if (std::ranges::any_of(analysis.trackers,
                          [](const auto& tracker) { return tracker.multi_start.has_value(); }))
    list += list_entry("multi-start EAO over", lengths_text(analysis.multi_start));
  for (const Json& record : campaign.record) {
    const Json machine = record.value("machine", Json::object());
    const auto said = [&](const char* key) {
      const Json value = machine.value(key, Json());
      return value.is_string() ? value.get<std::string>() : value.dump();
    };
    const int count = record.value("processes", 1);
    const std::string processes = count == 1 ? "" : " in each of " + std::to_string(count) + " processes";
    list += list_entry("run", record.value("started", "") + ", version " + record.value("version", "") +
                                  ", " + said("cpu") + ", " + said("cores") + " cores, " + said("compiler") +
                                  ", " + said("build") + "; " +
                                  counted(record.value("workers", std::size_t{1}), "worker") + processes) +
            list_entry("by", record.value("command", ""));
  }
  std::string content = element("dl", list);
  for (const TrackerScores& tracker : analysis.trackers) {
    if (tracker.foreign)
      content += note(tracker.name + ": results of another origin, up to " +
                      counted(tracker.most_starts, "run") + " on a sequence");
    if (tracker.errors > 0)
      content += note(tracker.name + " threw in " + counted(tracker.errors, "run") +
                      ": *_errors.log beside its results");
  }
  for (const std::string& line : analysis.left_out) content += note(line);
  std::set<std::string> notes;  // on the data set, from when it was read
  for (const Json& record : campaign.record)
    for (const Json& line : record.value("notes", Json::array())) notes.insert(line.get<std::string>());
  for (const std::string& line : notes) content += note(line);
  return content;
}

NumberTable table_of(const std::vector<SummaryColumn>& columns, const Analysis& analysis) {
  NumberTable table{.corner = "tracker", .columns = {}, .rows = {}};
  for (const SummaryColumn& column : columns)
    table.columns.push_back({column.name, column.decimals, column.less_is_better, column.meaning});
  for (const TrackerScores& tracker : analysis.trackers) {
    NumberTable::Row row{.name = tracker.name, .values = {}};
    for (const SummaryColumn& column : columns) {
      const auto value = column.values.find(tracker.name);
      row.values.push_back(value == column.values.end() ? plain(kNone) : value->second);
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::string summary(const Analysis& analysis) {
  std::string content;
  for (const bool main : {true, false}) {
    std::vector<SummaryColumn> columns = summary_columns(analysis);
    std::erase_if(columns, [&](const SummaryColumn& column) { return column.main != main; });
    if (columns.empty()) continue;
    std::vector<std::string> meanings;
    for (const SummaryColumn& column : columns) meanings.push_back(column.name + ": " + column.meaning);
    content += html(table_of(columns, analysis)) + note(joined(meanings, "; ") + ".");
  }
  std::string remark = "The best value of each column is marked.";
  if (std::ranges::any_of(analysis.trackers, [](const auto& tracker) { return !tracker.estimates.empty(); }))
    remark +=
        " The small figures are the 95 % interval of a bootstrap over sequences and starts; with few "
        "sequences it is somewhat too short.";
  return content + note(remark);
}

/// An EAO curve from length 2 on: for a single frame it has no meaning.
Series by_length(const std::string& name, const std::vector<double>& curve, std::size_t tracker) {
  Series series{name, {}, {}, tracker};
  for (std::size_t n = 2; n <= curve.size(); ++n) {
    series.x.push_back(static_cast<double>(n));
    series.y.push_back(curve[n - 1]);
  }
  return series;
}

std::string supervised(const Analysis& analysis) {
  NumberTable today{.corner = "tracker",
                    .columns = {{"A", 3},
                                {"F", 2, true, "failures of a sequence, weighted by length"},
                                {"AR", 3, false, "probability of still tracking after 30 frames"},
                                {"EAO", 3}},
                    .rows = {}};
  const auto rank = [&](const std::string& of) {  // best at the right and at the top, as in the other plot
    return PlotAxis{of + " rank", 0.5, static_cast<double>(analysis.trackers.size()) + 0.5, true};
  };
  ScatterChart raw{"AR plot (legacy toolkit)",
                   {"no failure in 30 frames, exp(-30 F / frames)", {}, 1.0},
                   {"accuracy"},
                   {}};
  ScatterChart ranks{"AR ranks on all frames", rank("robustness"), rank("accuracy"), {}};
  ScatterChart mean_ranks{
      "AR ranks, mean over attributes (VOT2014)", rank("robustness"), rank("accuracy"), {}};
  LineChart curves{.title = "Expected average overlap (legacy toolkit)",
                   .x = {"sequence length [frames]", 1},
                   .y = {"expected average overlap", 0, 1},
                   .series = {},
                   .shaded = std::pair(static_cast<double>(analysis.supervised.lengths.low),
                                       static_cast<double>(analysis.supervised.lengths.high))};
  LineChart python_curves{.title = "Expected average overlap (Python toolkit)",
                          .x = curves.x,
                          .y = curves.y,
                          .series = {},
                          .shaded = curves.shaded};
  BarChart ranking{"EAO ranking (legacy toolkit)", {"expected average overlap", 0}, {}};
  for (std::size_t i = 0; i < analysis.trackers.size(); ++i) {
    const TrackerScores& tracker = analysis.trackers[i];
    if (!tracker.supervised) continue;
    const SupervisedScores& scores = *tracker.supervised;
    today.rows.push_back({tracker.name,
                          {plain(scores.python.accuracy), plain(scores.python.failures),
                           plain(scores.python.reliability()), plain(scores.python_eao)}});
    raw.points.push_back({tracker.name, scores.legacy.reliability(), scores.legacy.accuracy, i});
    ranks.points.push_back({tracker.name, scores.robustness_rank, scores.accuracy_rank, i});
    mean_ranks.points.push_back({tracker.name, scores.mean_robustness_rank, scores.mean_accuracy_rank, i});
    curves.series.push_back(by_length(tracker.name, scores.legacy_curve, i));
    python_curves.series.push_back(by_length(tracker.name, scores.python_curve, i));
    Bar bar{tracker.name, scores.legacy_eao, {}, i};
    if (const auto estimate = tracker.estimates.find(Measure::Eao); estimate != tracker.estimates.end())
      bar.interval = std::pair(estimate->second.low, estimate->second.high);
    ranking.bars.push_back(bar);
  }
  if (today.rows.empty()) return {};
  std::string charts = svg(raw);
  charts += svg(ranks);
  if (!analysis.tags.empty()) charts += svg(mean_ranks);
  charts += svg(ranking) + svg(curves);
  return element("div", charts, "charts") +
         note(
             std::string(
                 "Rank 1 is best; trackers that do not differ significantly share the mean of their ranks ") +
             (analysis.practical
                  ? "(accuracy must also differ by more than the practical difference)."
                  : "(some sequences have no practical differences, so these do not count).")) +
         details("As the Python toolkit defines them",
                 html(today) + element("div", svg(python_curves), "charts"));
}

std::string one_pass(const Analysis& analysis) {
  std::string charts;
  const auto chart = [&](Protocol protocol, const std::string& title) {
    LineChart success{
        "Success: " + title, {"overlap threshold", 0, 1}, {"share of frames above the threshold", 0, 1}, {}};
    LineChart precision{"Precision: " + title,
                        {"threshold of the centre error [px]", 0, 50},
                        {"share of frames within the threshold", 0, 1},
                        {}};
    for (std::size_t i = 0; i < analysis.trackers.size(); ++i) {
      const auto found = analysis.trackers[i].one_pass.find(protocol);
      if (found == analysis.trackers[i].one_pass.end()) continue;
      const auto add = [&](LineChart& to, const auto& values, double step, double figure) {
        Series series{
            analysis.trackers[i].name + " " + fixed(figure, 3), {}, {values.begin(), values.end()}, i};
        for (std::size_t k = 0; k < values.size(); ++k) series.x.push_back(step * static_cast<double>(k));
        to.series.push_back(std::move(series));
      };
      add(success, found->second.success, 0.05, found->second.auc());
      add(precision, found->second.precision, 1, found->second.precision_at_20());
    }
    if (!success.series.empty()) charts += svg(success) + svg(precision);
  };
  chart(Protocol::Otb, "one pass (OPE)");
  chart(Protocol::Tre, "temporal robustness (TRE)");
  chart(Protocol::Sre, "spatial robustness (SRE)");
  if (charts.empty()) return {};
  return element("div", charts, "charts") +
         note("The number after a name is the area under the success curve, or the precision at 20 px.");
}

std::string multi_start(const Analysis& analysis) {
  const auto& [low, high] = analysis.multi_start.lengths;
  LineChart chart{.title = "Multi-start: expected average overlap",
                  .x = {"sequence length [frames]", 1},
                  .y = {"expected average overlap", 0, 1},
                  .series = {},
                  .shaded = std::pair(static_cast<double>(low), static_cast<double>(high))};
  for (std::size_t i = 0; i < analysis.trackers.size(); ++i) {
    const TrackerScores& tracker = analysis.trackers[i];
    if (!tracker.multi_start) continue;
    chart.series.push_back(by_length(tracker.name, tracker.multi_start->curve, i));
  }
  return chart.series.empty() ? std::string() : element("div", svg(chart), "charts");
}

/// "+0.012 *", with its interval below.
std::string difference_cell(Measure measure, const Estimate& estimate, bool significant) {
  const bool fails = measure == Measure::Failures;
  const auto text = [&](double value) {
    return std::string(value > 0 ? "+" : "") + fixed(value, fails ? 2 : 3);
  };
  const bool better = fails ? estimate.value < 0 : estimate.value > 0;
  return element("td",
                 text(estimate.value) + (significant ? " *" : "") + "<span class=\"interval\">" +
                     text(estimate.low) + " to " + text(estimate.high) + "</span>",
                 !significant ? "unclear"
                 : better     ? "best"
                              : "worse");
}

Estimate negated(const Estimate& estimate) { return {-estimate.value, -estimate.high, -estimate.low}; }

/// Differences of rows minus columns, or of all trackers minus the baseline.
std::string differences(const Analysis& analysis, const std::string& baseline) {
  if (analysis.differences.empty()) return {};
  std::string tables;
  const auto find = [&](Measure measure, std::size_t a, std::size_t b) -> std::string {
    for (const Difference& difference : analysis.differences) {
      if (difference.measure != measure) continue;
      if (difference.a == a && difference.b == b)
        return difference_cell(measure, difference.estimate, difference.significant);
      if (difference.a == b && difference.b == a)
        return difference_cell(measure, negated(difference.estimate), difference.significant);
    }
    return "<td></td>\n";
  };
  const auto header = [](const std::string& text) { return element("th", escaped(text)); };
  const auto table = [&](const std::string& caption, const std::string& head, const std::string& body) {
    tables += element("div",
                      element("table", element("caption", escaped(caption)) +
                                           element("thead", element("tr", head)) + element("tbody", body)),
                      "scroll");
  };
  const std::vector<TrackerScores>& trackers = analysis.trackers;
  std::vector<Measure> measures;
  for (const Measure measure : kMeasures)
    if (std::ranges::count(analysis.differences, measure, &Difference::measure) > 0)
      measures.push_back(measure);

  const auto base = static_cast<std::size_t>(std::ranges::find(trackers, baseline, &TrackerScores::name) -
                                             trackers.begin());
  if (!baseline.empty()) {
    std::string head = header("tracker"), body;
    for (const Measure measure : measures) head += header(std::string(to_string(measure)));
    for (std::size_t i = 0; i < trackers.size(); ++i) {
      if (i == base) continue;
      std::string row = header(trackers[i].name);
      for (const Measure measure : measures) row += find(measure, i, base);
      body += element("tr", row);
    }
    table("Tracker minus " + baseline, head, body);
  } else {
    for (const Measure measure : measures) {
      std::string head = header("row minus column"), body;
      for (const TrackerScores& tracker : trackers) head += header(tracker.name);
      for (std::size_t a = 0; a < trackers.size(); ++a) {
        std::string row = header(trackers[a].name);
        for (std::size_t b = 0; b < trackers.size(); ++b) row += find(measure, a, b);
        body += element("tr", row);
      }
      table(std::string(to_string(measure)), head, body);
    }
  }
  return tables +
         note(
             "Paired bootstrap: both trackers on the same resamples of sequences and starts. Small figures: "
             "95 % interval of the difference; where it excludes 0, the difference has a * and a color, "
             "green if the row is better. Of many comparisons, one in 20 does so by chance.");
}

/// The pairs that do not differ significantly.
std::string insignificant(const Analysis& analysis, const std::string& baseline) {
  std::string content;
  if (analysis.measured < kFewestSequences && !analysis.differences.empty())
    content = paragraph("With fewer than " + std::to_string(kFewestSequences) +
                        " sequences no difference is called significant.");
  for (const Measure measure : kMeasures) {
    std::vector<std::string> pairs;
    for (const Difference& difference : analysis.differences) {
      const std::string& a = analysis.trackers[difference.a].name;
      const std::string& b = analysis.trackers[difference.b].name;
      if (difference.measure == measure && !difference.significant &&
          (baseline.empty() || a == baseline || b == baseline))
        pairs.push_back(a + " and " + b);
    }
    if (!pairs.empty())
      content +=
          paragraph("Not significant in " + std::string(to_string(measure)) + ": " + joined(pairs) + ".");
  }
  return content;
}

std::string attributes(const Analysis& analysis) {
  std::string content;
  const auto add = [&](const std::string& caption, int decimals, bool less, const auto& value) {
    NumberTable table{.corner = caption, .columns = {}, .rows = {}};
    for (const std::string& tag : analysis.tags) table.columns.push_back({spaced(tag), decimals, less});
    for (const TrackerScores& tracker : analysis.trackers) {
      if (!tracker.supervised) continue;
      NumberTable::Row row{.name = tracker.name, .values = {}};
      for (const std::string& tag : analysis.tags)
        row.values.push_back(plain(value(tracker.supervised->attributes.at(tag))));
      table.rows.push_back(std::move(row));
    }
    content += html(table);
  };
  if (analysis.tags.empty()) return {};
  add("EAO", 3, false, [](const LegacyScores& scores) { return scores.eao; });
  add("A", 3, false, [](const LegacyScores& scores) { return scores.score.accuracy; });
  add("F", 2, true, [](const LegacyScores& scores) { return scores.score.failures; });
  return content + note("By the legacy toolkit; \"empty\" are frames without attribute.");
}

std::string speed(const Campaign& campaign, const Analysis& analysis) {
  BarChart chart{"Frames per second", {"frames per second", 0}, {}};
  for (std::size_t i = 0; i < analysis.trackers.size(); ++i)
    if (const double fps = analysis.trackers[i].frames_per_second; !std::isnan(fps))
      chart.bars.push_back({analysis.trackers[i].name, fps, {}, i});
  if (chart.bars.empty()) return {};
  const std::string workers = workers_text(campaign);
  return element("div", svg(chart), "charts") +
         note(
             "Frames over seconds in all supervised and one-pass runs, starts and reading of images left "
             "out" +
             (workers.empty()
                  ? "."
                  : "; " + workers + (workers.starts_with("one") ? "." : ", which costs speed.")));
}

std::string sequences(const Campaign& campaign, const Analysis& analysis) {
  std::string content;
  const auto add = [&](const std::string& caption, int decimals, bool less, double SequenceScores::*value) {
    NumberTable table{.corner = caption, .columns = {}, .rows = {}, .best = NumberTable::Best::OfRow};
    bool any = false;
    for (const TrackerScores& tracker : analysis.trackers)
      table.columns.push_back({tracker.name, decimals, less});
    for (std::size_t s = 0; s < campaign.sequences.size(); ++s) {
      NumberTable::Row row{.name = campaign.sequences[s].name, .values = {}};
      for (const TrackerScores& tracker : analysis.trackers) {
        row.values.push_back(plain(tracker.sequences[s].*value));
        any = any || !std::isnan(row.values.back().value);
      }
      table.rows.push_back(std::move(row));
    }
    if (any) content += html(table);
  };
  add("A", 3, false, &SequenceScores::accuracy);
  add("F", 2, true, &SequenceScores::failures);
  add("AO", 3, false, &SequenceScores::average_overlap);
  return content;
}

std::string timelines(const Campaign& campaign, const Analysis& analysis) {
  std::string content;
  for (std::size_t s = 0; s < campaign.sequences.size(); ++s) {
    Timeline timeline{campaign.sequences[s].name, {}};
    for (std::size_t i = 0; i < analysis.trackers.size(); ++i) {
      const SequenceScores& scores = analysis.trackers[i].sequences[s];
      if (!scores.overlaps.empty())
        timeline.strips.push_back({analysis.trackers[i].name, scores.overlaps, scores.failed, i});
    }
    if (!timeline.strips.empty())
      content += details(campaign.sequences[s].name + ", " + counted(campaign.sequences[s].length(), "frame"),
                         element("div", svg(timeline), "charts"));
  }
  if (content.empty()) return {};
  return note(
             "Overlap in each frame of the first supervised run, or else of the first pass; failures in "
             "red.") +
         content;
}

std::string pictures(const Campaign& campaign, const Analysis& analysis) {
  std::string content;
  for (const Picture& picture : worst_pictures(campaign, analysis)) {
    const Loss& loss = picture.loss;
    const std::string caption = picture.tracker + ", " + campaign.sequences[loss.sequence].name + ", frame " +
                                std::to_string(loss.frame + 1) +
                                (loss.failure ? ": failure, " + fixed(loss.cost, 0) + " frames before the end"
                                              : ": overlap " + fixed(loss.overlap, 2)) +
                                (loss.region ? "" : "; no region");
    content += element("figure", "<img alt=\"" + escaped(caption) + "\" src=\"data:image/jpeg;base64," +
                                     picture.jpeg + "\">" + element("figcaption", escaped(caption)));
  }
  if (content.empty()) return {};
  return element("div", "\n" + content, "pictures") +
         note(
             "A tracker's first failure on a sequence, or else its frame of least overlap, in its first run; "
             "those first that leave most frames behind. White: ground truth; orange: the last region that "
             "the tracker gave.");
}

// The charts of a page by the names of their files: the titles in lower case, with '-' for other characters.
std::map<std::string, std::string> chart_files(std::string_view page) {
  constexpr std::string_view kBegin = "<svg ", kEnd = "</svg>\n", kTitle = "aria-label=\"";
  std::map<std::string, std::string> files;
  for (std::size_t begin = 0; (begin = page.find(kBegin, begin)) != std::string_view::npos;) {
    const std::size_t end = page.find(kEnd, begin) + kEnd.size();
    const std::string_view chart = page.substr(begin, end - begin);
    const std::size_t title = chart.find(kTitle) + kTitle.size();
    std::string name;
    for (const char c : chart.substr(title, chart.find('"', title) - title)) {
      if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
        name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      } else if (!name.empty() && name.back() != '-') {
        name += '-';
      }
    }
    while (name.ends_with('-')) name.pop_back();
    const std::size_t content = chart.find('>') + 1;
    files[name + ".svg"] = std::string(chart.substr(0, content)) + "<style>" + plot_style() + "</style>" +
                           std::string(chart.substr(content));
    begin = end;
  }
  return files;
}

}  // namespace

std::string spaced(std::string tag) {
  std::ranges::replace(tag, '_', ' ');
  return tag;
}

std::string html(const NumberTable& table) {
  const auto better = [](double a, double b, bool less) { return less ? a < b : a > b; };
  const auto best_of = [&](std::size_t column, const std::vector<Estimate>& values) {
    double best = kNone;
    for (const Estimate& estimate : values)
      if (!std::isnan(estimate.value) &&
          (std::isnan(best) || better(estimate.value, best, table.columns[column].less_is_better)))
        best = estimate.value;
    return best;
  };
  std::vector<double> best_of_column;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    std::vector<Estimate> values;
    for (const NumberTable::Row& row : table.rows) values.push_back(row.values[c]);
    best_of_column.push_back(best_of(c, values));
  }
  std::string head = element("th", escaped(table.corner)), body;
  for (const NumberTable::Column& column : table.columns)
    head += element("th", column.meaning.empty() ? escaped(column.name)
                                                 : "<abbr title=\"" + escaped(column.meaning) + "\">" +
                                                       escaped(column.name) + "</abbr>");
  for (const NumberTable::Row& row : table.rows) {
    std::string cells = element("th", escaped(row.name));
    const double best_of_row = row.values.empty() ? kNone : best_of(0, row.values);
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const Estimate& estimate = row.values[c];
      const int decimals = table.columns[c].decimals;
      const bool best = (table.best == NumberTable::Best::OfColumn && table.rows.size() > 1 &&
                         estimate.value == best_of_column[c]) ||
                        (table.best == NumberTable::Best::OfRow && table.columns.size() > 1 &&
                         estimate.value == best_of_row);
      std::string text = fixed(estimate.value, decimals);
      if (!std::isnan(estimate.low))
        text += "<span class=\"interval\">" + fixed(estimate.low, decimals) + "–" +
                fixed(estimate.high, decimals) + "</span>";
      cells += element("td", text, best ? "best" : "");
    }
    body += element("tr", cells, row.classes);
  }
  return element("div", element("table", element("thead", element("tr", head)) + element("tbody", body)),
                 "scroll");
}

void write_report(const Campaign& campaign, const Analysis& analysis, const std::filesystem::path& folder,
                  const ReportOptions& options) {
  if (!options.baseline.empty() &&
      std::ranges::count(analysis.trackers, options.baseline, &TrackerScores::name) == 0)
    throw std::invalid_argument("no tracker " + options.baseline + " to compare with");
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>Evaluation of "
      "trackers</title>\n"
      "<style>" +
      std::string(kStyle) + plot_style() + "</style>\n</head>\n<body>\n" +
      element("h1", "Evaluation of trackers");
  page += element("section", what_was_run(campaign, analysis));
  page += section("Summary", summary(analysis));
  page += section("Differences",
                  insignificant(analysis, options.baseline) + differences(analysis, options.baseline));
  page += section("Supervised: accuracy, robustness, EAO", supervised(analysis));
  page += section("One pass: success and precision", one_pass(analysis));
  page += section("Multi-start", multi_start(analysis));
  page += section("Attributes", attributes(analysis));
  if (options.paper) page += section("Printed in the paper", paper_section(campaign, analysis));
  page += section("Speed", speed(campaign, analysis));
  const std::map<std::string, std::string> charts = chart_files(page);
  page += section("Worst moments", pictures(campaign, analysis));
  page += section("Sequences", sequences(campaign, analysis));
  page += section("Along the sequences", timelines(campaign, analysis));
  page += "</body>\n</html>\n";

  std::filesystem::create_directories(folder / "charts");
  for (const auto& [name, text] : charts) write_atomically(folder / "charts" / name, text);
  for (const auto& [name, text] : report_csv(campaign, analysis)) write_atomically(folder / name, text);
  write_atomically(folder / "report.json", report_json(campaign, analysis, options).dump(1) + "\n");
  write_atomically(folder / "report.html", page);
}

}  // namespace asterism::bench
