#include "layouts.hpp"

#include <algorithm>
#include <array>
#include <asterism/solver/base/counted.hpp>
#include <cctype>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "ground_truth.hpp"
#include "otb_sequences.hpp"
#include "text.hpp"
#include "uav_sequences.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;
using detail::counted;
using Notes = std::vector<std::string>;

// --- Shared by the layouts

std::string trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return std::string(text.substr(first, text.find_last_not_of(kBlanks) - first + 1));
}

// The lines of a file without blanks around them; empty ones at the end are left out.
std::vector<std::string> lines_of(const fs::path& path) {
  std::vector<std::string> lines = tools::read_lines(path);
  for (std::string& line : lines) line = trimmed(line);
  while (!lines.empty() && lines.back().empty()) lines.pop_back();
  return lines;
}

struct Value {
  double value;
  std::size_t line;
};

// Numbers, one or several per line (LaSOT has all in one line).
std::vector<Value> values_of(const fs::path& path) {
  std::vector<Value> values;
  const std::vector<std::string> lines = lines_of(path);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> numbers = tools::parse_numbers(lines[i]);
    if (numbers.empty()) fail(path, i + 1, "a number expected, not \"" + lines[i].substr(0, 60) + "\"");
    for (const double number : numbers) {
      if (!std::isfinite(number)) fail(path, i + 1, "a number is not finite");
      values.push_back({number, i + 1});
    }
  }
  return values;
}

// "157 values, but 196 frames".
std::string counts(const std::string& values, std::size_t frames) {
  return values + ", but " + counted(frames, "frame");
}

// The values of all frames. `allowed` returns why a value is invalid, or nullptr. If there are too few, those
// of the last frames are `otherwise`, as in the VOT toolkit (the sequence bag of VOT2016 has such tags).
template <class Allowed>
std::vector<double> frame_values(const fs::path& path, std::size_t frames, double otherwise, Allowed allowed,
                                 Notes& notes) {
  std::vector<double> result;
  for (const Value& v : values_of(path)) {
    if (const char* reason = allowed(v.value)) fail(path, v.line, reason);
    result.push_back(v.value);
  }
  if (result.size() != frames) {
    std::string rest = "those beyond the last frame are left out";
    if (result.size() < frames) rest = "the rest is taken for " + std::to_string(static_cast<int>(otherwise));
    notes.push_back(path.string() + ": " + counts(counted(result.size(), "value"), frames) + ": " + rest);
    result.resize(frames, otherwise);
  }
  return result;
}

std::vector<bool> frame_flags(const fs::path& path, std::size_t frames, Notes& notes) {
  const auto allowed = [](double v) { return v == 0 || v == 1 ? nullptr : "0 or 1 expected"; };
  const std::vector<double> values = frame_values(path, frames, 0, allowed, notes);
  return {values.begin(), values.end()};
}

// The number that an image's name ends in.
std::optional<long> number_of(const fs::path& image) {
  const std::string stem = image.stem().string();
  const std::size_t digits = stem.find_last_not_of("0123456789") + 1;  // npos + 1 is 0
  long number = 0;
  const auto [end, error] = std::from_chars(stem.data() + digits, stem.data() + stem.size(), number);
  if (error != std::errc{}) return {};
  return number;
}

// The images of a folder or a pattern; their numbers must have no gap.
std::vector<fs::path> images_of(const fs::path& input) {
  std::vector<fs::path> images = tools::ImageSource::open(input.string()).images();
  if (images.empty()) fail(input, "no images");
  for (std::size_t i = 1; i < images.size(); ++i) {
    const auto before = number_of(images[i - 1]), here = number_of(images[i]);
    if (before && here && *here != *before + 1)
      fail(images[i], "frame " + std::to_string(*before + 1) + " is missing before it: fetch it again");
  }
  return images;
}

// Only those with the numbers first .. last.
std::vector<fs::path> images_of(const fs::path& folder, long first, long last) {
  std::vector<fs::path> images = images_of(folder);
  std::erase_if(images, [&](const fs::path& image) {
    const std::optional<long> number = number_of(image);
    return number && (*number < first || *number > last);
  });
  if (images.empty()) fail(folder, "none of the frames from " + std::to_string(first) + " on");
  return images;
}

// A single box is the first; the other frames are unknown.
void check_counts(Sequence& sequence, const fs::path& truth) {
  if (sequence.truth.size() == 1) sequence.truth.resize(sequence.images.size());
  if (sequence.images.size() == sequence.truth.size()) return;
  fail(truth, sequence.truth.size(),
       counted(sequence.truth.size(), "box", "boxes") + ", but " + counted(sequence.images.size(), "image") +
           " (" + sequence.images.front().string() + " to " + sequence.images.back().filename().string() +
           "): one of both is not whole, fetch it again");
}

Sequence sequence_of(std::string name, std::vector<fs::path> images, const fs::path& truth) {
  Sequence sequence;
  sequence.name = std::move(name);
  sequence.images = std::move(images);
  sequence.truth = tools::read_ground_truth(truth);
  return sequence;
}

void remove_truth(Sequence& sequence, const std::vector<bool>& where) {
  for (std::size_t t = 0; t < where.size(); ++t)
    if (where[t]) sequence.truth[t].reset();
}

// Reads the flags in files with that ending: each file becomes a tag, and flagged frames have no object.
void read_absences(Sequence& sequence, const fs::path& folder, std::initializer_list<const char*> names,
                   const std::string& ending, Notes& notes) {
  for (const char* name : names) {
    const fs::path file = folder / (name + ending);
    if (!fs::exists(file)) continue;
    sequence.tags[name] = frame_flags(file, sequence.length(), notes);
    remove_truth(sequence, sequence.tags[name]);
  }
}

bool has(const fs::path& folder, const std::string& file) { return fs::exists(folder / file); }
bool has_ground_truth(const fs::path& path) { return fs::is_directory(path) && has(path, "groundtruth.txt"); }

// --- VOT: SEQ/groundtruth.txt, color/00000001.jpg

// The key=value entries of a "sequence" file; empty if there is none.
std::map<std::string, std::string> properties_of(const fs::path& path) {
  std::map<std::string, std::string> properties;
  if (!fs::exists(path)) return properties;
  const std::vector<std::string> lines = lines_of(path);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].empty() || lines[i].front() == '#') continue;
    const std::size_t equal = lines[i].find('=');
    if (equal == std::string::npos) fail(path, i + 1, "key=value expected");
    properties[trimmed(lines[i].substr(0, equal))] = trimmed(lines[i].substr(equal + 1));
  }
  return properties;
}

bool is_vot(const fs::path& path) { return has_ground_truth(path) || fs::is_regular_file(path / "sequence"); }

void read_practical(Sequence& sequence, const fs::path& file, Notes& notes) {
  for (const Value& v : values_of(file)) sequence.practical.push_back(v.value);
  if (sequence.practical.size() == sequence.length()) return;
  notes.push_back(file.string() + ": " +
                  counts(counted(sequence.practical.size(), "value"), sequence.length()) + ": left out");
  sequence.practical.clear();
}

std::vector<Sequence> read_vot(const fs::path& folder, Notes& notes) {
  const auto properties = properties_of(folder / "sequence");
  const auto property = [&](const std::string& key, const std::string& otherwise) {
    const auto found = properties.find(key);
    return found == properties.end() ? otherwise : found->second;
  };
  const fs::path truth = folder / property("groundtruth", "groundtruth.txt");
  // Sequences with several kinds of images, such as depth or infrared, name those to track in.
  const std::string pattern = property("channels." + property("channel.default", "color"), "");
  Sequence sequence = sequence_of(name_of(folder), {}, truth);
  sequence.images = images_of(pattern.empty() ? folder : folder / pattern);
  const std::size_t boxes = sequence.length(), frames = sequence.images.size();
  if (boxes > 1 && boxes < frames) {  // as the toolkit does
    sequence.truth.resize(frames);
    notes.push_back(truth.string() + ": " + counts(counted(boxes, "region"), frames) +
                    ": the rest is unknown");
  }
  check_counts(sequence, truth);
  for (const fs::path& file : entries_of(folder)) {
    if (file.extension() != ".tag" && file.extension() != ".label") continue;
    const std::string tag = file.stem().string();
    if (is_utf8(tag))
      sequence.tags[tag] = frame_flags(file, frames, notes);
    else
      notes.push_back(file.string() + ": the name is not UTF-8: left out");
  }
  if (has(folder, "practical.value")) read_practical(sequence, folder / "practical.value", notes);
  return {std::move(sequence)};
}

// --- OTB: SEQ/groundtruth_rect.txt, img/

bool is_otb_truth(const fs::path& file) {
  return name_of(file).starts_with("groundtruth_rect") && file.extension() == ".txt";
}

bool is_otb(const fs::path& path) {
  return fs::is_directory(path) && std::any_of(fs::directory_iterator(path), fs::directory_iterator(),
                                               [](const auto& entry) { return is_otb_truth(entry.path()); });
}

std::vector<Sequence> read_otb(const fs::path& folder, Notes&) {
  const std::string name = name_of(folder);
  const auto known = std::find_if(std::begin(kOtbSequences), std::end(kOtbSequences),
                                  [&](const OtbSequence& s) { return s.name == name; });
  const OtbSequence published = known == std::end(kOtbSequences) ? OtbSequence{} : *known;
  const std::vector<fs::path> images = images_of(folder / "img", published.first, published.last);
  std::vector<Sequence> sequences;
  for (const fs::path& file : entries_of(folder)) {
    if (!is_otb_truth(file)) continue;
    // groundtruth_rect.2.txt: the second object
    const std::string object = file.stem().extension().string();
    Sequence sequence = sequence_of(object.empty() ? name : name + "-" + object.substr(1), images, file);
    if (sequence.truth.size() == images.size() + published.unused_lines)
      sequence.truth.erase(sequence.truth.begin(),
                           sequence.truth.begin() + static_cast<std::ptrdiff_t>(published.unused_lines));
    check_counts(sequence, file);
    std::istringstream attributes{std::string(published.attributes)};
    for (std::string attribute; attributes >> attribute;)
      sequence.tags[attribute] = std::vector<bool>(sequence.length(), true);
    sequences.push_back(std::move(sequence));
  }
  return sequences;
}

// --- Temple-Color-128: SEQ/SEQ_gt.txt, SEQ_frames.txt, img/

bool is_tc128(const fs::path& path) { return fs::is_directory(path) && has(path, name_of(path) + "_gt.txt"); }

std::vector<Sequence> read_tc128(const fs::path& folder, Notes&) {
  const std::string name = name_of(folder);
  long first = 0, last = std::numeric_limits<long>::max();
  if (const fs::path file = folder / (name + "_frames.txt"); fs::exists(file)) {
    const std::vector<Value> range = values_of(file);
    constexpr double kMost = 1e9;
    if (range.size() != 2 || !(range[0].value >= 0 && range[0].value <= range[1].value) ||
        range[1].value > kMost)
      fail(file, 1, "the numbers of the first and last frame expected");
    first = static_cast<long>(range[0].value);
    last = static_cast<long>(range[1].value);
  }
  const fs::path truth = folder / (name + "_gt.txt");
  Sequence sequence = sequence_of(name, images_of(folder / "img", first, last), truth);
  check_counts(sequence, truth);
  return {std::move(sequence)};
}

// --- GOT-10k: SEQ/groundtruth.txt, 00000001.jpg, absence.label

bool is_got10k(const fs::path& path) {
  return has_ground_truth(path) && (has(path, "absence.label") || has(path, "cover.label") ||
                                    has(path, "meta_info.ini") || name_of(path).starts_with("GOT-10k_"));
}

std::vector<Sequence> read_got10k(const fs::path& folder, Notes& notes) {
  const fs::path truth = folder / "groundtruth.txt";
  Sequence sequence = sequence_of(name_of(folder), images_of(folder), truth);
  check_counts(sequence, truth);
  if (const fs::path file = folder / "cut_by_image.label"; fs::exists(file))
    sequence.tags["cut_by_image"] = frame_flags(file, sequence.length(), notes);
  read_absences(sequence, folder, {"absence"}, ".label", notes);
  if (const fs::path file = folder / "cover.label"; fs::exists(file)) {
    const auto allowed = [](double v) {
      return v >= 0 && v <= 8 ? nullptr : "0 to 8 (eighths that are visible) expected";
    };
    std::vector<bool> hidden, occluded;
    for (const double v : frame_values(file, sequence.length(), 8, allowed, notes)) {
      hidden.push_back(v == 0);
      occluded.push_back(v < 8);
    }
    remove_truth(sequence, hidden);
    sequence.tags["occlusion"] = std::move(occluded);
  }
  return {std::move(sequence)};
}

// --- LaSOT: SEQ/groundtruth.txt, img/, full_occlusion.txt, out_of_view.txt

constexpr std::initializer_list<const char*> kLasotAbsences = {"full_occlusion", "out_of_view", "absent"};

bool is_lasot(const fs::path& path) {
  return has_ground_truth(path) && std::any_of(kLasotAbsences.begin(), kLasotAbsences.end(), [&](auto name) {
           return has(path, std::string(name) + ".txt");
         });
}

std::vector<Sequence> read_lasot(const fs::path& folder, Notes& notes) {
  const fs::path truth = folder / "groundtruth.txt";
  Sequence sequence = sequence_of(name_of(folder), images_of(folder / "img"), truth);
  check_counts(sequence, truth);
  read_absences(sequence, folder, kLasotAbsences, ".txt", notes);
  return {std::move(sequence)};
}

// --- TrackingNet: frames/VIDEO/0.jpg, anno/VIDEO.txt

fs::path trackingnet_truth(const fs::path& folder) {
  return folder.parent_path().parent_path() / "anno" / (name_of(folder) + ".txt");
}

bool is_trackingnet(const fs::path& path) {
  return name_of(path.parent_path()) == "frames" && fs::is_directory(path) &&
         fs::exists(trackingnet_truth(path));
}

std::vector<Sequence> read_trackingnet(const fs::path& folder, Notes&) {
  Sequence sequence = sequence_of(name_of(folder), images_of(folder), trackingnet_truth(folder));
  check_counts(sequence, trackingnet_truth(folder));
  return {std::move(sequence)};
}

// --- UAV123: data_seq/UAV123/VIDEO/000001.jpg, anno/UAV123/SEQ.txt

// The folder anno/SET for data_seq/SET/VIDEO.
fs::path uav_annotations(const fs::path& video) {
  const fs::path set = video.parent_path();
  return set.parent_path().parent_path() / "anno" / set.filename();
}

// The sequences on a video that have an annotation file.
std::vector<UavPart> uav_parts(const fs::path& video, const std::string& name) {
  // UAV123_10fps has every third frame.
  const long step = name_of(video.parent_path()) == "UAV123_10fps" ? 3 : 1;
  std::vector<UavPart> parts;
  for (const UavPart& part : kUavParts)
    if (part.video == name)
      parts.push_back({part.name, part.video, (part.first - 1) / step + 1, (part.last - 1) / step + 1});
  if (parts.empty()) parts.push_back({name, name, 0, std::numeric_limits<long>::max()});
  std::erase_if(parts, [&](const UavPart& part) {
    return !has(uav_annotations(video), std::string(part.name) + ".txt");
  });
  return parts;
}

bool is_uav123(const fs::path& path) {
  return name_of(path.parent_path().parent_path()) == "data_seq" && fs::is_directory(path) &&
         !uav_parts(path, name_of(path)).empty();
}

std::vector<Sequence> read_uav123(const fs::path& video, Notes&) {
  std::vector<Sequence> sequences;
  const std::string name = name_of(video);
  for (const UavPart& part : uav_parts(video, name)) {
    const fs::path truth = uav_annotations(video) / (std::string(part.name) + ".txt");
    sequences.push_back(sequence_of(std::string(part.name), images_of(video, part.first, part.last), truth));
    check_counts(sequences.back(), truth);
  }
  return sequences;
}

// --- NfS: SEQ/30/SEQ/00001.jpg, SEQ/30/SEQ.txt, and the same at 240 frames a second

bool is_nfs(const fs::path& path, const char* rate) {
  const fs::path folder = path.parent_path();
  return name_of(folder) == rate && name_of(folder.parent_path()) == name_of(path) &&
         fs::is_directory(path) && fs::exists(box_file(path));
}

// VATIC's lines: track, left, top, right, bottom, frame, lost, occluded, generated, "class". They may be
// those of the 240 frames a second even beside the images at 30 a second, of which then every eighth is used.
std::vector<Sequence> read_nfs(const fs::path& folder, Notes& notes) {
  Sequence sequence;
  sequence.name = name_of(folder);
  sequence.images = images_of(folder);
  const fs::path file = box_file(folder);
  const std::vector<std::string> lines = lines_of(file);
  std::vector<bool> out_of_view, occluded;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> v = tools::parse_numbers(lines[i].substr(0, lines[i].find('"')));
    if (v.size() < 9 || !std::all_of(v.begin(), v.begin() + 9, [](double d) { return std::isfinite(d); }))
      fail(file, i + 1, "track, left, top, right, bottom, frame, lost, occluded, generated expected");
    const cv::Rect2d box(v[1], v[2], v[3] - v[1], v[4] - v[2]);
    sequence.truth.push_back(box.empty() ? std::nullopt : std::optional(Region::rectangle(box)));
    out_of_view.push_back(v[6] != 0);
    occluded.push_back(v[7] != 0);
  }
  if (lines.empty()) fail(file, 1, "no annotation in the file");
  const std::size_t images = sequence.images.size();
  const auto each_eighth = [&](auto& values) {
    for (std::size_t t = 0; 8 * t < values.size(); ++t) values[t] = values[8 * t];
    values.resize((values.size() + 7) / 8);
  };
  if (const std::size_t eighths = (lines.size() + 7) / 8;
      lines.size() > images + 1 && eighths + 1 >= images && eighths <= images + 1) {
    each_eighth(sequence.truth);
    each_eighth(out_of_view);
    each_eighth(occluded);
  }
  if (const std::size_t boxes = sequence.length(); boxes == images + 1 || boxes + 1 == images) {
    notes.push_back(file.string() + ": " + counts(counted(boxes, "box", "boxes"), images) +
                    ": the last one is left out");
    sequence.images.resize(std::min(boxes, images));
    sequence.truth.resize(sequence.images.size());
  }
  check_counts(sequence, file);
  out_of_view.resize(sequence.length());
  occluded.resize(sequence.length());
  sequence.tags = {{"out_of_view", std::move(out_of_view)}, {"occlusion", std::move(occluded)}};
  return {std::move(sequence)};
}

// --- Plain: a folder of images or a video, NAME.txt beside it

bool is_plain(const fs::path& path) {
  return (fs::is_directory(path) || is_video(path)) && fs::is_regular_file(box_file(path));
}

std::vector<Sequence> read_plain(const fs::path& path, Notes& notes) {
  const fs::path truth = box_file(path);
  Sequence sequence = sequence_of(truth.stem().string(), {}, truth);
  tools::ImageSource source = tools::ImageSource::open(path.string());
  sequence.images = source.images();
  if (!sequence.images.empty()) {
    check_counts(sequence, truth);
    return {std::move(sequence)};
  }
  sequence.video = path;
  while (source.skip(1)) {
  }  // the length in a video's header is only an estimate
  const auto frames = static_cast<std::size_t>(source.position());
  if (frames == 0) fail(path, "no frame can be decoded");
  if (const auto missing = source.missing())
    notes.push_back(path.string() + ": frames are missing, about " + std::to_string(missing->count) +
                    ", the first after frame " + std::to_string(missing->after) +
                    ": boxes may belong to other frames");
  if (sequence.truth.size() == 1) sequence.truth.resize(frames);
  if (sequence.truth.size() != frames)
    fail(truth, sequence.truth.size(),
         counts(counted(sequence.truth.size(), "box", "boxes"), frames) + " in " + path.string() +
             ": a box a frame is needed, or the first alone");
  return {std::move(sequence)};
}

constexpr LayoutReader kReaders[] = {
    {Layout::Otb, "otb", is_otb, is_otb, read_otb, true},
    {Layout::Tc128, "tc128", is_tc128, is_tc128, read_tc128, true},
    {Layout::Got10k, "got10k", is_got10k, has_ground_truth, read_got10k},
    {Layout::Lasot, "lasot", is_lasot, has_ground_truth, read_lasot, true},
    {Layout::Vot, "vot", is_vot, is_vot, read_vot},
    {Layout::TrackingNet, "trackingnet", is_trackingnet, is_trackingnet, read_trackingnet},
    {Layout::Uav123, "uav123", is_uav123, is_uav123, read_uav123, true},
    {Layout::Nfs, "nfs", [](const fs::path& path) { return is_nfs(path, "30"); },
     [](const fs::path& path) { return is_nfs(path, "30"); }, read_nfs},
    {Layout::Nfs240, "nfs240", [](const fs::path& path) { return is_nfs(path, "240"); },
     [](const fs::path& path) { return is_nfs(path, "240"); }, read_nfs},
    {Layout::Plain, "plain", is_plain, is_plain, read_plain},
};

}  // namespace

std::span<const LayoutReader> layout_readers() { return kReaders; }

bool is_video(const fs::path& path) {
  static const std::set<std::string> kExtensions = {".3g2", ".3gp", ".asf", ".avi",  ".flv", ".m2ts", ".m4v",
                                                    ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts",  ".mxf",
                                                    ".ogv", ".ts",  ".vob", ".webm", ".wmv", ".y4m"};
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kExtensions.contains(extension) && fs::is_regular_file(path);
}

std::string name_of(const fs::path& path) { return path.filename().string(); }

fs::path box_file(const fs::path& path) {
  return path.parent_path() / ((fs::is_directory(path) ? path.filename() : path.stem()).string() + ".txt");
}

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder))
    if (!name_of(entry.path()).starts_with('.')) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end(),
            [](const fs::path& a, const fs::path& b) { return tools::natural_less(name_of(a), name_of(b)); });
  return entries;
}

}  // namespace asterism::bench
