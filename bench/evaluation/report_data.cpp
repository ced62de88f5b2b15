// The report as data: JSON, CSV, and a table for the terminal.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "report_internal.hpp"

namespace asterism::bench {
namespace {

/// With as many digits as reading it back exactly takes, as in JSON; empty for NaN.
std::string exact(double value) { return std::isnan(value) ? std::string() : Json(value).dump(); }

/// A cell of text, quoted if necessary. Text that a spreadsheet would take for a formula gets an apostrophe
/// before it, which marks it as text.
std::string text_cell(std::string text) {
  constexpr std::string_view kFormula = "=+-@\t\r'";
  if (!text.empty() && kFormula.find(text.front()) != std::string_view::npos)
    text.insert(0, "'");
  else if (text.find_first_of(",\"\n\r") == std::string::npos)
    return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + "\"";
}

/// A line of cells that are already quoted.
std::string csv_line(const std::vector<std::string>& cells) {
  std::string line;
  for (std::size_t i = 0; i < cells.size(); ++i) line += cells[i] + (i + 1 < cells.size() ? "," : "\n");
  return line;
}

Json json_of(const StatedInterval& interval) {
  return {{"low", interval.lengths.low}, {"high", interval.lengths.high}, {"origin", interval.origin}};
}

Json json_of(const AccuracyRobustness& score) {
  return {{"A", score.accuracy}, {"F", score.failures}, {"AR", score.reliability()}};
}

Json json_of(const OnePassScore& score) {
  return {{"AO", score.average_overlap},    {"AUC", score.auc()},
          {"P20", score.precision_at_20()}, {"normalised_P20", score.normalised_precision_at_20()},
          {"success", score.success},       {"precision", score.precision}};
}

Json json_of(const LegacyScores& scores) {
  return {{"A", scores.score.accuracy}, {"F", scores.score.failures}, {"EAO", scores.eao}};
}

Json json_of(const SupervisedScores& scores, std::size_t sequences) {
  Json json = json_of(scores.legacy);
  json["F_per_sequence"] = scores.legacy.failures / static_cast<double>(sequences);
  json["EAO"] = scores.legacy_eao;
  json["curve"] = scores.legacy_curve;
  json["ranks"] = {{"A", scores.accuracy_rank}, {"R", scores.robustness_rank}};
  json["mean_ranks"] = {{"A", scores.mean_accuracy_rank}, {"R", scores.mean_robustness_rank}};
  json["attributes"] = Json::object();
  for (const auto& [tag, attribute] : scores.attributes) json["attributes"][tag] = json_of(attribute);
  for (const LegacyScores& start : scores.starts) json["starts"].push_back(json_of(start));
  json["mixed_starts"] = Json::array();
  for (const LegacyScores& mixed : scores.mixed_starts) json["mixed_starts"].push_back(json_of(mixed));
  json["python"] = json_of(scores.python);
  json["python"]["EAO"] = scores.python_eao;
  json["python"]["curve"] = scores.python_curve;
  return json;
}

Json json_of(const TrackerScores& tracker, const Campaign& campaign, std::size_t measured) {
  Json json{{"name", tracker.name},
            {"foreign", tracker.foreign},
            {"starts", tracker.most_starts},
            {"runs_with_errors", tracker.errors},
            {"fps", tracker.frames_per_second}};
  if (tracker.supervised) json["vot"] = json_of(*tracker.supervised, measured);
  for (const auto& [protocol, score] : tracker.one_pass)
    json[std::string(to_string(protocol))] = json_of(score);
  if (const auto& scores = tracker.multi_start)
    json["multistart"] = {{"EAO", scores->eao},
                          {"A", scores->score.accuracy},
                          {"R", scores->score.robustness},
                          {"curve", scores->curve}};
  json["intervals"] = Json::object();
  for (const auto& [measure, estimate] : tracker.estimates)
    json["intervals"][std::string(to_string(measure))] = {estimate.low, estimate.high};
  json["sequences"] = Json::object();
  for (std::size_t s = 0; s < campaign.sequences.size(); ++s) {
    const SequenceScores& scores = tracker.sequences[s];
    json["sequences"][campaign.sequences[s].name] = {
        {"A", scores.accuracy},         {"F", scores.failures},    {"start_F", scores.start_failures},
        {"AO", scores.average_overlap}, {"failed", scores.failed}, {"overlaps", scores.overlaps}};
  }
  return json;
}

}  // namespace

Estimate plain(double value) { return {value, kNone, kNone}; }

std::string fixed(double value, int decimals) {
  if (std::isnan(value)) return "–";
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return std::string_view(text).find_first_of("123456789") == std::string_view::npos && text[0] == '-'
             ? text + 1
             : text;
}

std::vector<SummaryColumn> summary_columns(const Analysis& analysis) {
  std::vector<SummaryColumn> columns = {
      {true, "EAO", 3, false, "expected average overlap, as the legacy toolkit and the paper have it", {}},
      {true, "A", 3, false, "accuracy, the mean overlap while the tracker tracks", {}},
      {true, "F", 2, true, "failures of one run through all sequences", {}},
      {true, "AO", 3, false, "average overlap of one pass", {}},
      {true, "AUC", 3, false, "area under OTB's success plot", {}},
      {true, "P20", 3, false, "share of frames with a centre error of at most 20 px", {}},
      {true, "fps", 1, false, "frames per second", {}},
      {false, "TRE AUC", 3, false, "AUC of starts in 20 frames", {}},
      {false, "TRE P20", 3, false, "precision at 20 px of the same", {}},
      {false, "SRE AUC", 3, false, "AUC of 12 wrong start boxes", {}},
      {false, "SRE P20", 3, false, "precision at 20 px of the same", {}},
      {false, "MS EAO", 3, false, "expected average overlap of multi-start", {}},
      {false, "MS A", 3, false, "its accuracy", {}},
      {false, "MS R", 3, false, "its robustness, the share of frames before failures", {}}};
  for (const TrackerScores& tracker : analysis.trackers) {
    std::map<std::string, double> values{{"fps", tracker.frames_per_second}};
    if (tracker.supervised) {
      values["EAO"] = tracker.supervised->legacy_eao;
      values["A"] = tracker.supervised->legacy.accuracy;
      values["F"] = tracker.supervised->legacy.failures;
    }
    for (const auto& [protocol, score] : tracker.one_pass) {
      const std::string prefix = protocol == Protocol::Tre ? "TRE " : protocol == Protocol::Sre ? "SRE " : "";
      values[prefix + "AO"] = score.average_overlap;
      values[prefix + "AUC"] = score.auc();
      values[prefix + "P20"] = score.precision_at_20();
    }
    if (tracker.multi_start) {
      values["MS EAO"] = tracker.multi_start->eao;
      values["MS A"] = tracker.multi_start->score.accuracy;
      values["MS R"] = tracker.multi_start->score.robustness;
    }
    for (SummaryColumn& column : columns)
      if (const auto value = values.find(column.name); value != values.end() && !std::isnan(value->second))
        column.values[tracker.name] = plain(value->second);
    for (const auto& [measure, estimate] : tracker.estimates)
      std::ranges::find(columns, to_string(measure), &SummaryColumn::name)->values[tracker.name] = estimate;
  }
  std::erase_if(columns, [](const SummaryColumn& column) { return column.values.empty(); });
  return columns;
}

std::string summary_text(const Analysis& analysis) {
  std::size_t width = 7;
  for (const TrackerScores& tracker : analysis.trackers) width = std::max(width, tracker.name.size());
  const auto padded = [](const std::string& text, std::size_t letters, std::size_t to) {
    return std::string(letters < to ? to - letters : 0, ' ') + text;
  };
  const std::vector<SummaryColumn> columns = summary_columns(analysis);
  std::string text = "tracker" + std::string(width - 7, ' ');
  for (const SummaryColumn& column : columns) text += padded(column.name, column.name.size(), 9);
  text += "\n";
  for (const TrackerScores& tracker : analysis.trackers) {
    text += tracker.name + std::string(width - tracker.name.size(), ' ');
    for (const SummaryColumn& column : columns) {
      const auto value = column.values.find(tracker.name);
      const bool known = value != column.values.end();
      const std::string cell = known ? fixed(value->second.value, column.decimals) : "-";
      text += padded(cell, cell.size(), 9);
    }
    text += "\n";
  }
  return text;
}

Json report_json(const Campaign& campaign, const Analysis& analysis, const ReportOptions& options) {
  std::size_t frames = 0;
  Json json{{"dataset", campaign.dataset.string()},
            {"layout", to_string(campaign.layout)},
            {"options",
             {{"overlap", to_string(campaign.options.overlap)},
              {"bounded", campaign.options.bounded},
              {"boxes", campaign.options.boxes},
              {"starts", campaign.options.starts},
              {"jitter", campaign.options.jitter},
              {"seed", campaign.options.seed}}},
            {"protocols", Json::array()},
            {"sequences", Json::object()}};
  for (const Protocol protocol : campaign.protocols) json["protocols"].push_back(to_string(protocol));
  for (const Sequence& sequence : campaign.sequences) {
    json["sequences"][sequence.name] = sequence.length();
    frames += sequence.length();
  }
  json["frames"] = frames;
  json["eao_interval"] = json_of(analysis.supervised);
  json["multistart_interval"] = json_of(analysis.multi_start);
  json["practical_differences"] = analysis.practical;
  json["left_out"] = analysis.left_out;
  json["record"] = campaign.record;
  json["trackers"] = Json::array();
  for (const TrackerScores& tracker : analysis.trackers)
    json["trackers"].push_back(json_of(tracker, campaign, analysis.measured));
  json["differences"] = Json::array();
  for (const Difference& difference : analysis.differences)
    json["differences"].push_back({{"measure", to_string(difference.measure)},
                                   {"a", analysis.trackers[difference.a].name},
                                   {"b", analysis.trackers[difference.b].name},
                                   {"value", difference.estimate.value},
                                   {"low", difference.estimate.low},
                                   {"high", difference.estimate.high},
                                   {"significant", difference.significant}});
  if (options.paper) json["printed_in_the_paper"] = paper_json();
  return json;
}

std::map<std::string, std::string> report_csv(const Campaign& campaign, const Analysis& analysis) {
  std::map<std::string, std::string> files;

  const std::vector<SummaryColumn> columns = summary_columns(analysis);
  const auto has_interval = [](const SummaryColumn& column) {
    return std::ranges::any_of(column.values,
                               [](const auto& value) { return !std::isnan(value.second.low); });
  };
  std::vector<std::string> cells = {"tracker"};
  for (const SummaryColumn& column : columns) {
    cells.push_back(column.name);
    if (has_interval(column)) cells.insert(cells.end(), {column.name + " low", column.name + " high"});
  }
  std::string& summary = files["summary.csv"] = csv_line(cells);
  for (const TrackerScores& tracker : analysis.trackers) {
    cells = {text_cell(tracker.name)};
    for (const SummaryColumn& column : columns) {
      const auto value = column.values.find(tracker.name);
      const Estimate estimate = value == column.values.end() ? plain(kNone) : value->second;
      cells.push_back(exact(estimate.value));
      if (has_interval(column)) cells.insert(cells.end(), {exact(estimate.low), exact(estimate.high)});
    }
    summary += csv_line(cells);
  }

  std::string& sequences = files["sequences.csv"] = "tracker,sequence,frames,A,F,AO\n";
  std::string& attributes = files["attributes.csv"] = "tracker,attribute,A,F,EAO\n";
  std::string& curves = files["curves.csv"] = "tracker,curve,x,y\n";
  for (const TrackerScores& tracker : analysis.trackers) {
    for (std::size_t s = 0; s < campaign.sequences.size(); ++s) {
      const SequenceScores& scores = tracker.sequences[s];
      sequences += csv_line({text_cell(tracker.name), text_cell(campaign.sequences[s].name),
                             std::to_string(campaign.sequences[s].length()), exact(scores.accuracy),
                             exact(scores.failures), exact(scores.average_overlap)});
    }
    const auto curve = [&](const std::string& name, const auto& values, double first, double step) {
      for (std::size_t i = 0; i < values.size(); ++i)
        curves += csv_line({text_cell(tracker.name), text_cell(name),
                            exact(first + step * static_cast<double>(i)), exact(values[i])});
    };
    if (tracker.supervised) {
      for (const auto& [tag, attribute] : tracker.supervised->attributes)
        attributes += csv_line({text_cell(tracker.name), text_cell(tag), exact(attribute.score.accuracy),
                                exact(attribute.score.failures), exact(attribute.eao)});
      curve("EAO", tracker.supervised->legacy_curve, 1, 1);
      curve("EAO python", tracker.supervised->python_curve, 1, 1);
    }
    for (const auto& [protocol, score] : tracker.one_pass) {
      curve(std::string(to_string(protocol)) + " success", score.success, 0, 0.05);
      curve(std::string(to_string(protocol)) + " precision", score.precision, 0, 1);
    }
    if (tracker.multi_start) curve("multistart EAO", tracker.multi_start->curve, 1, 1);
  }

  std::string& differences = files["differences.csv"] = "measure,a,b,value,low,high,significant\n";
  for (const Difference& difference : analysis.differences)
    differences +=
        csv_line({std::string(to_string(difference.measure)), text_cell(analysis.trackers[difference.a].name),
                  text_cell(analysis.trackers[difference.b].name), exact(difference.estimate.value),
                  exact(difference.estimate.low), exact(difference.estimate.high),
                  difference.significant ? "yes" : "no"});
  return files;
}

}  // namespace asterism::bench
