#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "process.hpp"
#include "protocols.hpp"

namespace asterism::bench {

/// Trackers that are run on a data set, and the folder of their results, laid out as a VOT workspace
/// (FOLDER/results/TRACKER/EXPERIMENT/SEQUENCE/SEQUENCE_001.txt). FOLDER/campaign.json records what the
/// results depend on.
struct Campaign {
  std::filesystem::path folder;
  std::filesystem::path dataset;  ///< absolute
  Layout layout = Layout::Auto;
  ProtocolOptions options;
  std::map<std::string, std::string> trackers;  ///< name of the folder -> argument of evaluated_tracker
  std::vector<Protocol> protocols;              ///< those that have been run
  std::vector<Sequence> sequences;              ///< without those that are unreadable
  /// Sequences with a frame that could not be read when they were run last, and the reasons: they have no
  /// score.
  std::map<std::string, std::string> unreadable;
  Json record = Json::array();  ///< an entry per process that ran: command, machine, workers, date

  /// Where the result of a run is, or will be.
  std::filesystem::path file(const std::string& tracker, const Sequence& sequence, const Run& run) const;
  /// The file, beside a run's result, with the error that the tracker threw; absent if it threw none.
  std::filesystem::path errors_file(const std::string& tracker, const Sequence& sequence,
                                    const Run& run) const;
  /// The stored result of a run on a whole sequence (of Protocol::Vot or Protocol::Otb). Throws
  /// std::runtime_error if it is missing (it names the protocol to run) or of another length.
  Trajectory result(const std::string& tracker, const Sequence& sequence, const Run& run) const;
};

/// Why a tracker's name, which becomes that of a folder, cannot be used; empty if it can.
std::string reason_against_name(const std::string& tracker);

/// Reads FOLDER/campaign.json and the data set that it names, or the one at `dataset` if that is not empty.
/// Throws std::runtime_error for a damaged file, for values that `run` would refuse, and for a data set other
/// than that of the results.
Campaign read_campaign(const std::filesystem::path& folder, const std::filesystem::path& dataset = {});

/// Writes FOLDER/campaign.json. An existing file of the same data set and options is extended by trackers,
/// protocols, sequences, starts and the record; std::runtime_error, which names the setting, if results would
/// not fit together. A name without results may be given to another tracker.
void write_campaign(Campaign& campaign);

/// Campaign::unreadable for the user, a line each.
std::vector<std::string> unreadable_lines(const std::map<std::string, std::string>& unreadable);

/// Adds sequences that turned out to be unreadable to FOLDER/campaign.json, where the next `write_campaign`
/// of a campaign on them removes them.
void record_unreadable(const Campaign& campaign, const std::map<std::string, std::string>& unreadable);

/// Removes all results of a tracker.
void drop_results(const Campaign& campaign, const std::string& tracker);

struct CampaignRun {
  int workers = 1;  ///< runs at the same time
  Shard shard;
  std::function<bool()> stop;  ///< asked after each frame
  double timeout = 30;         ///< for each answer of an external tracker [s]
  int retries = 0;             ///< for a run in which an external tracker threw; the last one is stored
};
struct CampaignTally {
  std::size_t runs = 0;      ///< made now
  std::size_t kept = 0;      ///< found already stored
  std::size_t failed = 0;    ///< of those made now, runs in which the tracker threw
  bool interrupted = false;  ///< runs at work were dropped, and are made again by the next call
  std::map<std::string, std::string> unreadable = {};  ///< as Campaign::unreadable
};
/// Makes the runs of the given trackers and protocols on the campaign's sequences that have no stored result
/// yet, and stores each when it is complete, with progress on standard error. Apart from times, the results
/// do not depend on workers and shards. A run that meets a frame that cannot be read has no result, and no
/// further runs are made on that sequence. Throws for files that cannot be written, and UnusableTracker.
CampaignTally run_campaign(const Campaign& campaign, const std::vector<std::string>& trackers,
                           const std::vector<Protocol>& protocols, const CampaignRun& how);

}  // namespace asterism::bench
