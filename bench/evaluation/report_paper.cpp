// Figures that the DPT paper prints: its Tables 1 and 2, on VOT2014 and OTB.
#include <array>

#include "plots.hpp"
#include "report_internal.hpp"

namespace asterism::bench {
namespace {

/// A row of Table 1.
struct Variant {
  const char* name;
  double eao, accuracy, failures_per_sequence, rank, average_overlap;
};
constexpr Variant kVariants[] = {
    {"DPT", 0.39, 0.61, 0.47, 1.42, 0.486},
    {"DPT coarse", 0.36, 0.55, 0.49, 2.10, 0.442},
    {"DPT coarse, no segmentation (KCF)", 0.21, 0.57, 1.13, 3.06, 0.377},
    {"DPT star", 0.34, 0.57, 0.61, 2.06, 0.467},
    {"DPT local", 0.36, 0.62, 0.65, 1.46, 0.485},
    {"DPT 3x3, overlapping", 0.31, 0.60, 0.71, 1.82, 0.481},
    {"DPT 3x3, not overlapping", 0.31, 0.60, 0.73, 1.90, 0.481},
};

/// The attributes of Table 2 by their names in the data set, then the mean.
constexpr std::array<const char*, 8> kAttributes = {"camera_motion", "deformation",   "empty",
                                                    "illum_change",  "motion_change", "occlusion",
                                                    "size_change",   "average"};

/// A tracker of Table 2.
struct Peer {
  const char* name;
  std::array<double, 8> eao, accuracy, failures;
};
constexpr Peer kPeers[] = {
    {"DPT",
     {0.43, 0.31, 0.68, 0.64, 0.35, 0.52, 0.24, 0.39},
     {0.64, 0.60, 0.49, 0.63, 0.63, 0.62, 0.54, 0.61},
     {12.00, 17.00, 0.00, 1.00, 14.00, 2.00, 12.00, 11.97}},
    {"LGT",
     {0.32, 0.26, 0.62, 0.38, 0.31, 0.24, 0.27, 0.33},
     {0.44, 0.41, 0.51, 0.45, 0.46, 0.32, 0.43, 0.44},
     {15.20, 11.16, 0.00, 1.47, 10.47, 3.93, 7.40, 11.16}},
    {"DSST",
     {0.34, 0.19, 0.68, 0.72, 0.25, 0.39, 0.18, 0.30},
     {0.66, 0.56, 0.54, 0.74, 0.64, 0.63, 0.52, 0.62},
     {20.00, 28.00, 0.00, 1.00, 24.00, 3.00, 15.00, 19.28}},
    {"DGT",
     {0.30, 0.21, 0.68, 0.15, 0.30, 0.39, 0.23, 0.28},
     {0.56, 0.54, 0.67, 0.46, 0.58, 0.48, 0.57, 0.56},
     {19.00, 16.00, 0.00, 14.00, 14.00, 1.00, 6.00, 14.31}},
    {"SAMF",
     {0.31, 0.17, 0.69, 0.67, 0.24, 0.40, 0.16, 0.27},
     {0.65, 0.59, 0.56, 0.67, 0.66, 0.60, 0.56, 0.63},
     {24.00, 31.00, 0.00, 1.00, 25.00, 4.00, 18.00, 21.76}},
    {"MUSTER",
     {0.31, 0.17, 0.67, 0.72, 0.22, 0.42, 0.14, 0.26},
     {0.63, 0.55, 0.51, 0.73, 0.64, 0.61, 0.53, 0.61},
     {22.00, 31.00, 0.00, 1.00, 26.00, 3.00, 19.00, 21.39}},
    {"TGPR",
     {0.27, 0.16, 0.55, 0.49, 0.21, 0.33, 0.14, 0.24},
     {0.57, 0.53, 0.41, 0.57, 0.55, 0.61, 0.47, 0.54},
     {27.27, 37.07, 0.00, 3.47, 30.20, 5.00, 21.20, 25.76}},
    {"MEEM",
     {0.24, 0.15, 0.57, 0.55, 0.19, 0.24, 0.11, 0.22},
     {0.53, 0.52, 0.47, 0.54, 0.53, 0.57, 0.46, 0.52},
     {25.00, 33.00, 0.00, 2.00, 24.00, 3.00, 15.00, 22.04}},
    {"KCF",
     {0.23, 0.13, 0.47, 0.57, 0.18, 0.22, 0.12, 0.21},
     {0.57, 0.53, 0.56, 0.54, 0.57, 0.58, 0.47, 0.55},
     {34.00, 42.00, 0.00, 1.00, 34.00, 6.00, 27.00, 30.24}},
    {"HRP",
     {0.26, 0.13, 0.61, 0.50, 0.17, 0.23, 0.11, 0.20},
     {0.58, 0.50, 0.26, 0.66, 0.60, 0.47, 0.50, 0.55},
     {30.00, 41.00, 0.00, 4.00, 35.00, 5.00, 27.00, 29.13}},
};

NumberTable::Row printed(std::string name, std::vector<Estimate> values) {
  return {std::move(name) + " (printed)", std::move(values), "printed"};
}

std::string first_table(const Analysis& analysis) {
  NumberTable table{.corner = "Table 1",
                    .columns = {{"EAO", 2},
                                {"A", 2},
                                {"F a sequence", 2, true},
                                {"rank", 2, true, "mean of the ranks of accuracy and robustness"},
                                {"AO"}},
                    .rows = {},
                    .best = NumberTable::Best::None};
  for (const Variant& variant : kVariants)
    table.rows.push_back(printed(
        variant.name, {plain(variant.eao), plain(variant.accuracy), plain(variant.failures_per_sequence),
                       plain(variant.rank), plain(variant.average_overlap)}));
  for (const TrackerScores& tracker : analysis.trackers) {
    std::vector<Estimate> values(5, plain(kNone));
    if (const auto& scores = tracker.supervised) {
      const auto number = static_cast<double>(analysis.measured);
      values[0] = plain(scores->legacy_eao);
      values[1] = plain(scores->legacy.accuracy);
      values[2] = plain(scores->legacy.failures / number);
      values[3] = plain((scores->mean_accuracy_rank + scores->mean_robustness_rank) / 2);
    }
    if (const auto pass = tracker.one_pass.find(Protocol::Otb); pass != tracker.one_pass.end())
      values[4] = plain(pass->second.average_overlap);
    table.rows.push_back({tracker.name, std::move(values)});
  }
  return html(table);
}

/// One of the three figures of Table 2.
template <class Printed, class Measured, class Mean>
std::string second_table(const Analysis& analysis, const std::string& caption, int decimals,
                         const Printed& of_peer, const Measured& of_attribute, const Mean& mean) {
  NumberTable table{
      .corner = "Table 2: " + caption, .columns = {}, .rows = {}, .best = NumberTable::Best::None};
  for (const char* attribute : kAttributes) table.columns.push_back({spaced(attribute), decimals});
  for (const Peer& peer : kPeers) {
    std::vector<Estimate> values;
    for (const double value : of_peer(peer)) values.push_back(plain(value));
    table.rows.push_back(printed(peer.name, std::move(values)));
  }
  for (const TrackerScores& tracker : analysis.trackers) {
    if (!tracker.supervised) continue;
    std::vector<Estimate> values;
    for (const char* attribute : kAttributes) {
      const auto found = tracker.supervised->attributes.find(attribute);
      values.push_back(
          plain(found == tracker.supervised->attributes.end() ? kNone : of_attribute(found->second)));
    }
    values.back() = plain(mean(*tracker.supervised));
    table.rows.push_back({tracker.name, std::move(values)});
  }
  return html(table);
}

}  // namespace

std::string paper_section(const Campaign& campaign, const Analysis& analysis) {
  return "<p>Rows in italics are printed in A. Lukežič, L. Čehovin Zajc, M. Kristan, <i>Deformable Parts "
         "Correlation "
         "Filters for Robust Visual Tracking</i> (2018), Tables 1 and 2, of the 25 sequences of VOT2014 and, "
         "for AO, "
         "of OTB. They were not measured here. The other rows were, on " +
         std::to_string(campaign.sequences.size()) +
         " sequences of the data set named above: they compare only where the sequences are the same.</p>\n" +
         first_table(analysis) +
         second_table(
             analysis, "EAO", 2, [](const Peer& peer) { return peer.eao; },
             [](const LegacyScores& scores) { return scores.eao; },
             [](const SupervisedScores& scores) { return scores.legacy_eao; }) +
         second_table(
             analysis, "A", 2, [](const Peer& peer) { return peer.accuracy; },
             [](const LegacyScores& scores) { return scores.score.accuracy; },
             [](const SupervisedScores& scores) { return scores.mean_over_tags.accuracy; }) +
         second_table(
             analysis, "F", 2, [](const Peer& peer) { return peer.failures; },
             [](const LegacyScores& scores) { return scores.score.failures; },
             [](const SupervisedScores& scores) { return scores.mean_over_tags.failures; });
}

Json paper_json() {
  Json json{
      {"source", "Lukezic, Cehovin Zajc, Kristan 2018, Tables 1 and 2: VOT2014 and OTB, not measured here"},
      {"table_1", Json::object()},
      {"table_2", Json::object()}};
  for (const Variant& variant : kVariants)
    json["table_1"][variant.name] = {{"EAO", variant.eao},
                                     {"A", variant.accuracy},
                                     {"F_per_sequence", variant.failures_per_sequence},
                                     {"rank", variant.rank},
                                     {"AO", variant.average_overlap}};
  for (const Peer& peer : kPeers)
    for (std::size_t i = 0; i < kAttributes.size(); ++i)
      json["table_2"][peer.name][kAttributes[i]] = {
          {"EAO", peer.eao[i]}, {"A", peer.accuracy[i]}, {"F", peer.failures[i]}};
  return json;
}

}  // namespace asterism::bench
