#pragma once

#include <map>
#include <string>
#include <vector>

#include "report.hpp"

namespace asterism::bench {

/// A figure of the summary.
struct SummaryColumn {
  bool main = true;  ///< false: in the second table
  std::string name;
  int decimals = 3;
  bool less_is_better = false;
  std::string meaning;
  std::map<std::string, Estimate> values;  ///< by tracker; missing intervals are NaN
};
/// The columns for which a tracker has a value.
std::vector<SummaryColumn> summary_columns(const Analysis& analysis);

/// "0.123", "–" for NaN.
std::string fixed(double value, int decimals);

Json report_json(const Campaign& campaign, const Analysis& analysis, const ReportOptions& options);
/// The CSV files by their names.
std::map<std::string, std::string> report_csv(const Campaign& campaign, const Analysis& analysis);

/// A frame of a tracker's loss with the ground truth and the tracker's region: a JPEG image in base64.
struct Picture {
  std::string tracker;
  Loss loss;
  std::string jpeg;
};
/// The dozen losses of greatest cost, with an equal share for each tracker if possible.
std::vector<Picture> worst_pictures(const Campaign& campaign, const Analysis& analysis);

/// The figures that the paper prints, as a section of the page.
std::string paper_section(const Campaign& campaign, const Analysis& analysis);
Json paper_json();

/// A table of figures for the page.
struct NumberTable {
  struct Column {
    std::string name;
    int decimals = 3;
    bool less_is_better = false;
    std::string meaning = {};
  };
  struct Row {
    std::string name;
    std::vector<Estimate> values;  ///< one per column
    std::string classes = {};
  };
  std::string corner;
  std::vector<Column> columns;
  std::vector<Row> rows;
  enum class Best { OfColumn, OfRow, None } best = Best::OfColumn;  ///< which values are marked
};
std::string html(const NumberTable& table);

/// An attribute's name as it is written for readers.
std::string spaced(std::string tag);

/// A figure without interval.
Estimate plain(double value);

}  // namespace asterism::bench
