#include "campaign.hpp"

#include <algorithm>
#include <asterism/solver/base/counted.hpp>
#include <atomic>
#include <cctype>
#include <chrono>
#include <cstdint>
#include <exception>
#include <fstream>
#include <iterator>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <type_traits>
#include <utility>

#include "progress.hpp"
#include "text.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFile = "campaign.json";

// The digest of the ground truth: results hold for these regions only.
std::string truth_digest(const Sequence& sequence) {
  std::string text;
  for (const auto& truth : sequence.truth) text += truth ? to_string(*truth) + "\n" : "-\n";
  return digest(text);
}

Json to_json(const ProtocolOptions& options) {
  return {{"overlap", to_string(options.overlap)},
          {"bounded", options.bounded},
          {"boxes", options.boxes},
          {"starts", options.starts},
          {"jitter", options.jitter},
          {"seed", options.seed},
          {"range", options.range ? Json{options.range->black, options.range->white} : Json()},
          {"jpeg", options.jpeg > 0 ? Json(options.jpeg) : Json()}};
}

Json to_json(const Campaign& campaign) {
  Json json{{"dataset", campaign.dataset.string()}, {"layout", to_string(campaign.layout)},
            {"options", to_json(campaign.options)}, {"protocols", Json::array()},
            {"trackers", campaign.trackers},        {"sequences", Json::object()},
            {"unreadable", campaign.unreadable},    {"record", campaign.record}};
  for (const Protocol protocol : campaign.protocols) json["protocols"].push_back(to_string(protocol));
  std::map<std::string, Json> sequences;  // sorted, as looking up a member of a Json takes linear time
  for (const Sequence& sequence : campaign.sequences)
    sequences[sequence.name] = {{"frames", sequence.length()}, {"truth", truth_digest(sequence)}};
  json["sequences"] = sequences;
  return json;
}

Json read_json(const fs::path& file) {
  std::ifstream stream;
  if (fs::is_regular_file(file)) stream.open(file);
  if (!stream.is_open())
    throw std::runtime_error("no campaign in " + file.parent_path().string() + ": cannot read " +
                             file.filename().string());
  try {
    return parse_json(std::string(std::istreambuf_iterator<char>(stream), {}));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(file.string() + ": " + error.what());
  }
}

// A member that must be a number in [low, high], and an integer if T is one.
template <class T>
T number(const Json& json, const char* key, T low, T high) {
  const Json& value = json.at(key);
  const bool fits = std::is_integral_v<T> ? value.is_number_integer() : value.is_number();
  if (!fits || !(value.get<double>() >= static_cast<double>(low)) ||
      !(value.get<double>() <= static_cast<double>(high)))
    throw std::invalid_argument(std::string(key) + ": a number from " + Json(low).dump() + " to " +
                                Json(high).dump() + " expected, not " + value.dump());
  return value.get<T>();
}

// Reports use these members of a record's entries: each is absent or of its type.
void check_record(const Json& record) {
  if (!record.is_array()) throw std::invalid_argument("the record is not a list");
  for (const Json& entry : record) {
    if (!entry.is_object()) throw std::invalid_argument("an entry of the record is not an object");
    for (const char* key : {"command", "started", "version"})
      if (entry.contains(key) && !entry[key].is_string())
        throw std::invalid_argument(std::string(key) + " in the record: no text");
    for (const char* key : {"workers", "processes"})
      if (entry.contains(key)) number(entry, key, 0, 10'000);
    if (entry.contains("machine") && !entry["machine"].is_object())
      throw std::invalid_argument("machine in the record: no object");
    const Json notes = entry.value("notes", Json::array());
    if (!notes.is_array() || !std::ranges::all_of(notes, [](const Json& note) { return note.is_string(); }))
      throw std::invalid_argument("notes in the record: no list of texts");
  }
}

// Everything but the sequences, which are read from the data set.
Campaign from_json(const fs::path& folder, const Json& json) try {
  Campaign campaign;
  campaign.folder = folder;
  campaign.dataset = json.at("dataset").get<std::string>();
  campaign.layout = parse_layout(json.at("layout"));
  const Json& options = json.at("options");
  campaign.options = {.overlap = parse_overlap_rule(options.at("overlap")),
                      .bounded = options.at("bounded"),
                      .boxes = options.at("boxes"),
                      .starts = number(options, "starts", 1, kMostStarts),
                      .jitter = number(options, "jitter", 0.0, kMostJitter),
                      .seed = number(options, "seed", std::uint32_t{0}, ~std::uint32_t{0})};
  if (const Json range = options.value("range", Json()); !range.is_null()) {
    if (!range.is_array() || range.size() != 2 || !range[0].is_number() || !range[1].is_number())
      throw std::invalid_argument("range: two numbers expected, not " + range.dump());
    campaign.options.range = PixelRange{range[0], range[1]};
  }
  if (!options.value("jpeg", Json()).is_null()) campaign.options.jpeg = number(options, "jpeg", 1, 100);
  if (!json.at("protocols").is_array()) throw std::invalid_argument("protocols are not a list");
  for (const auto& protocol : json["protocols"])
    campaign.protocols.push_back(parse_protocol(protocol.get<std::string>()));
  campaign.trackers = json.at("trackers").get<std::map<std::string, std::string>>();
  std::ranges::sort(campaign.protocols);
  campaign.protocols.erase(std::unique(campaign.protocols.begin(), campaign.protocols.end()),
                           campaign.protocols.end());
  for (const auto& [name, tracker] : campaign.trackers)
    if (const std::string reason = reason_against_name(name); !reason.empty())
      throw std::invalid_argument(reason);
  campaign.record = json.at("record");
  check_record(campaign.record);
  if (!json.at("sequences").is_object()) throw std::invalid_argument("sequences are not an object");
  if (json.contains("unreadable"))
    campaign.unreadable = json["unreadable"].get<std::map<std::string, std::string>>();
  return campaign;
} catch (const Json::exception& error) {
  throw std::runtime_error((folder / kFile).string() + ": " + error.what());
} catch (const std::invalid_argument& error) {
  throw std::runtime_error((folder / kFile).string() + ": " + error.what());
}

bool has_results(const fs::path& folder, const std::string& tracker) {
  const fs::path results = folder / "results" / tracker;
  if (!fs::exists(results)) return false;
  return std::any_of(fs::recursive_directory_iterator(results), fs::recursive_directory_iterator(),
                     [](const auto& entry) { return entry.is_regular_file(); });
}

// Throws unless the results of both can share a folder.
void check_same(const fs::path& file, const Json& old, const Json& now) {
  const auto differs = [&](const std::string& what, const Json& before, const Json& after,
                           const std::string& or_else = {}) {
    throw std::runtime_error(file.string() + ": the results there are of another " + what + " (" +
                             before.dump() + ", now " + after.dump() + "): choose another folder" + or_else);
  };
  for (const auto& [name, value] : now["options"].items())
    if (const Json before = old["options"].value(name, Json()); name != "starts" && before != value)
      differs(name, before, value);
  using Members = std::map<std::string, Json>;
  const auto compare = [&](const char* key, const auto& report) {
    const auto before = old[key].get<Members>();
    for (const auto& [name, value] : now[key].get<Members>())
      if (const auto found = before.find(name); found != before.end() && found->second != value)
        report(name, found->second, value);
  };
  compare("sequences", [&](const std::string& name, const Json& before, const Json& value) {
    differs("sequence " + name, before, value);
  });
  compare("trackers", [&](const std::string& name, const Json& before, const Json& value) {
    if (has_results(file.parent_path(), name))
      differs("tracker " + name, before, value, " or --rerun " + name);
  });
}

struct Job {
  const std::string* tracker;
  std::size_t sequence;
  Run run;
};

// The images of the sequences at work, shared by the runs on them and dropped after the last run.
class SharedImages {
 public:
  explicit SharedImages(const std::vector<Sequence>& sequences)
      : sequences_(sequences), images_(sequences.size()) {}

  std::shared_ptr<SequenceImages> operator()(std::size_t sequence) {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<SequenceImages> images = images_[sequence].lock();
    if (!images) images_[sequence] = images = std::make_shared<SequenceImages>(sequences_[sequence]);
    return images;
  }

 private:
  const std::vector<Sequence>& sequences_;
  std::mutex mutex_;
  std::vector<std::weak_ptr<SequenceImages>> images_;
};

}  // namespace

fs::path Campaign::file(const std::string& tracker, const Sequence& sequence, const Run& run) const {
  return results_folder(folder, tracker, experiment_name(run.protocol), sequence.name) / run.file(sequence);
}

fs::path Campaign::errors_file(const std::string& tracker, const Sequence& sequence, const Run& run) const {
  const fs::path result = file(tracker, sequence, run);
  return result.parent_path() / (result.stem().string() + "_errors.log");
}

Trajectory Campaign::result(const std::string& tracker, const Sequence& sequence, const Run& run) const {
  const fs::path stored = file(tracker, sequence, run);
  if (!trajectory_exists(stored))
    throw std::runtime_error("no " + stored.string() + ": run it with --protocol " +
                             std::string(to_string(run.protocol)) + " first");
  Trajectory trajectory = read_trajectory(stored);
  if (trajectory.frames.size() != sequence.length())
    throw std::runtime_error(stored.string() + ": " + detail::counted(trajectory.frames.size(), "frame") +
                             ", but the sequence has " + std::to_string(sequence.length()));
  return trajectory;
}

std::string reason_against_name(const std::string& tracker) {
  const auto usable = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == '+';
  };
  if (!tracker.empty() && !tracker.starts_with('.') && std::ranges::all_of(tracker, usable)) return {};
  return "\"" + tracker + "\" cannot name a tracker: letters, digits, - _ . + alone";
}

Campaign read_campaign(const fs::path& folder, const fs::path& dataset) {
  const Json json = read_json(folder / kFile);
  Campaign campaign = from_json(folder, json);
  if (!dataset.empty()) campaign.dataset = fs::absolute(dataset);
  std::vector<std::string> names;
  for (const auto& [name, record] : json["sequences"].items())
    if (!campaign.unreadable.contains(name)) names.push_back(name);
  if (names.empty() && !campaign.unreadable.empty())
    throw std::runtime_error(folder.string() +
                             ": no sequence could be read: " + campaign.unreadable.begin()->second);
  campaign.sequences = open_dataset(campaign.dataset, campaign.layout, names).sequences;
  read_as(campaign.sequences, campaign.options);
  check_same(folder / kFile, json, to_json(campaign));
  return campaign;
}

void write_campaign(Campaign& campaign) {
  const fs::path file = campaign.folder / kFile;
  if (fs::exists(campaign.folder) && !fs::is_directory(campaign.folder))
    throw std::runtime_error(campaign.folder.string() + " is a file, not a folder");
  fs::create_directories(campaign.folder);
  // No other process may add its trackers between reading and writing.
  const FolderLock lock(campaign.folder, std::chrono::seconds(10));
  Json now = to_json(campaign);
  if (fs::exists(file)) {
    const Json old = read_json(file);
    const Campaign before = from_json(campaign.folder, old);
    check_same(file, old, now);
    for (const Protocol protocol : before.protocols)
      if (std::ranges::count(campaign.protocols, protocol) == 0) campaign.protocols.push_back(protocol);
    std::ranges::sort(campaign.protocols);
    campaign.trackers.insert(before.trackers.begin(), before.trackers.end());
    campaign.options.starts = std::max(campaign.options.starts, before.options.starts);
    Json record = before.record;
    record.insert(record.end(), campaign.record.begin(), campaign.record.end());
    campaign.record = std::move(record);
    campaign.unreadable = before.unreadable;
    for (const Sequence& sequence : campaign.sequences) campaign.unreadable.erase(sequence.name);
    now = to_json(campaign);
    auto sequences = now["sequences"].get<std::map<std::string, Json>>();
    sequences.merge(old["sequences"].get<std::map<std::string, Json>>());
    now["sequences"] = sequences;
  }
  write_atomically(file, now.dump(1) + "\n");
}

std::vector<std::string> unreadable_lines(const std::map<std::string, std::string>& unreadable) {
  std::vector<std::string> lines;
  for (const auto& [name, reason] : unreadable)
    lines.push_back(name + " cannot be read and has no score: " + printable(reason));
  return lines;
}

void record_unreadable(const Campaign& campaign, const std::map<std::string, std::string>& unreadable) {
  if (unreadable.empty()) return;
  const fs::path file = campaign.folder / kFile;
  const FolderLock lock(campaign.folder, std::chrono::seconds(10));
  Json json = read_json(file);
  for (const auto& [name, reason] : unreadable) json["unreadable"][name] = printable(reason);
  write_atomically(file, json.dump(1) + "\n");
}

void drop_results(const Campaign& campaign, const std::string& tracker) {
  fs::remove_all(campaign.folder / "results" / tracker);
}

CampaignTally run_campaign(const Campaign& campaign, const std::vector<std::string>& trackers,
                           const std::vector<Protocol>& protocols, const CampaignRun& how) {
  std::map<std::string, Start> starts;
  for (const std::string& name : trackers)
    starts[name] = evaluated_tracker(campaign.trackers.at(name), how.timeout).start;

  // The runs on one sequence follow each other, to share its images. The shard takes every n-th of all runs.
  CampaignTally tally;
  std::vector<Job> jobs;
  std::size_t number = 0, frames = 0;
  for (std::size_t s = 0; s < campaign.sequences.size(); ++s) {
    for (const Protocol protocol : protocols) {
      for (const Run& run : runs_of(campaign.sequences[s], protocol, campaign.options)) {
        for (const std::string& tracker : trackers) {
          if (static_cast<int>(number++ % static_cast<std::size_t>(how.shard.count)) != how.shard.index)
            continue;
          if (trajectory_exists(campaign.file(tracker, campaign.sequences[s], run))) {
            ++tally.kept;
            continue;
          }
          jobs.push_back({&tracker, s, run});
          frames += run.frames;
        }
      }
    }
  }

  SharedImages shared(campaign.sequences);
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;  // guards all below
  std::size_t done = 0, dropped = 0;
  std::exception_ptr failure;
  tools::Progress progress(static_cast<int>(frames));

  const auto work = [&] {
    std::shared_ptr<SequenceImages> images;  // kept from job to job
    try {
      for (std::size_t j; (j = next++) < jobs.size();) {
        const Job& job = jobs[j];
        const Sequence& sequence = campaign.sequences[job.sequence];
        std::size_t seen = 0;
        const auto drop = [&] {
          ++dropped;
          done += job.run.frames - seen;
        };
        {
          const std::lock_guard lock(mutex);
          if (tally.unreadable.contains(sequence.name)) {
            drop();
            continue;
          }
        }
        images = shared(job.sequence);
        const auto each_frame = [&] {
          const std::lock_guard lock(mutex);
          ++seen;
          progress.report(static_cast<int>(++done));
          return !how.stop() && !failure;
        };
        std::optional<RunResult> result;
        try {
          for (int left = is_external(campaign.trackers.at(*job.tracker)) ? how.retries : 0;; --left) {
            try {
              result = execute(starts.at(*job.tracker), *images, job.run, campaign.options, each_frame);
              if (!result) return;
              if (result->errors.empty() || left == 0) break;
            } catch (const UnusableTracker&) {
              if (left == 0) throw;
            }
            const std::lock_guard lock(mutex);
            done -= std::exchange(seen, 0);
          }
        } catch (const UnreadableSequence& error) {
          const std::lock_guard lock(mutex);
          tally.unreadable.emplace(sequence.name, error.what());
          drop();
          continue;
        }
        std::string errors;
        for (const std::string& error : result->errors) errors += error + "\n";
        const fs::path file = campaign.file(*job.tracker, sequence, job.run);
        fs::create_directories(file.parent_path());
        const fs::path log = campaign.errors_file(*job.tracker, sequence, job.run);
        if (errors.empty()) {
          fs::remove(log);  // left by an earlier run whose trajectory was removed
        } else {
          write_atomically(log, errors);
        }
        write_trajectory(file, result->trajectory);
        const std::lock_guard lock(mutex);
        done += job.run.frames - std::min(seen, job.run.frames);
        ++tally.runs;
        tally.failed += errors.empty() ? 0 : 1;
      }
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> pool;
    for (int w = 0; w < how.workers; ++w) pool.emplace_back(work);
  }
  if (failure) std::rethrow_exception(failure);
  tally.interrupted = tally.runs + dropped < jobs.size();
  return tally;
}

}  // namespace asterism::bench
