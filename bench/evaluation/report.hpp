#pragma once

#include <filesystem>
#include <string>

#include "analysis.hpp"

namespace asterism::bench {

struct ReportOptions {
  bool paper = false;    ///< the figures that the DPT paper prints, beside the measured ones
  std::string baseline;  ///< a tracker that all others are compared with; empty: all with each other
};

/// Writes the analysis to the folder: report.html, a self-contained page without scripts; report.json with
/// all data; summary.csv, sequences.csv, attributes.csv, differences.csv and curves.csv; the charts over all
/// sequences as charts/TITLE.svg. The same results give the same files. Throws std::invalid_argument for an
/// unknown baseline, std::runtime_error for images that cannot be read and files that cannot be written.
void write_report(const Campaign& campaign, const Analysis& analysis, const std::filesystem::path& folder,
                  const ReportOptions& options = {});

/// The most important figures as a table for a terminal.
std::string summary_text(const Analysis& analysis);

}  // namespace asterism::bench
