#include "dataset.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "ground_truth.hpp"
#include "otb_sequences.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::pair<Layout, std::string_view>, 6> kNames = {{{Layout::Auto, "auto"},
                                                                        {Layout::Vot, "vot"},
                                                                        {Layout::Otb, "otb"},
                                                                        {Layout::Got10k, "got10k"},
                                                                        {Layout::Lasot, "lasot"},
                                                                        {Layout::Plain, "plain"}}};
constexpr int kDepth = 3;  // folders of folders: GOT-10k/val/GOT-10k_Val_000001

[[noreturn]] void fail(const fs::path& file, std::size_t line, const std::string& reason) {
  throw std::runtime_error(file.string() + ":" + std::to_string(line) + ": " + reason);
}
[[noreturn]] void fail(const fs::path& file, const std::string& reason) {
  throw std::runtime_error(file.string() + ": " + reason);
}

std::string_view trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

// The lines of a file without blanks around them; empty ones at the end are left out.
std::vector<std::string> lines_of(const fs::path& path) {
  std::ifstream file(path);
  if (!file) fail(path, std::strerror(errno));
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.emplace_back(trim(line));
  if (file.bad()) fail(path, lines.size() + 1, "cannot be read");
  while (!lines.empty() && lines.back().empty()) lines.pop_back();
  return lines;
}

struct Value {
  double value;
  std::size_t line;
};

// As many numbers as there are frames, one a line or several (LaSOT has all in one).
std::vector<Value> values_of(const fs::path& path, std::size_t frames) {
  std::vector<Value> values;
  const std::vector<std::string> lines = lines_of(path);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> numbers = tools::parse_numbers(lines[i]);
    if (numbers.empty()) fail(path, i + 1, "a number expected, not \"" + lines[i] + "\"");
    for (const double number : numbers) {
      if (!std::isfinite(number)) fail(path, i + 1, "a number is not finite");
      values.push_back({number, i + 1});
    }
  }
  if (values.size() != frames)
    fail(path, lines.size(),
         std::to_string(values.size()) + " values, but " + std::to_string(frames) + " frames");
  return values;
}

std::vector<bool> frame_flags(const fs::path& path, std::size_t frames) {
  std::vector<bool> flags;
  for (const Value& v : values_of(path, frames)) {
    if (v.value != 0 && v.value != 1) fail(path, v.line, "0 or 1 expected");
    flags.push_back(v.value == 1);
  }
  return flags;
}

// Entries of a folder in natural order without the hidden ones.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder))
    if (!entry.path().filename().string().starts_with('.')) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end(), [](const fs::path& a, const fs::path& b) {
    return tools::natural_less(a.filename().string(), b.filename().string());
  });
  return entries;
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

// Images of a folder or a pattern, of which none may be missing in between.
std::vector<fs::path> images_of(const fs::path& input) {
  std::vector<fs::path> images = tools::ImageSource::open(input.string()).images();
  if (images.empty()) fail(input, "no images");
  for (std::size_t i = 1; i < images.size(); ++i) {
    const auto before = number_of(images[i - 1]), here = number_of(images[i]);
    if (before && here && *here != *before + 1)
      fail(images[i], "frame " + std::to_string(*before + 1) + " is missing before it");
  }
  return images;
}

void check_counts(const Sequence& sequence, const fs::path& truth) {
  if (sequence.images.size() == sequence.truth.size()) return;
  fail(truth, sequence.truth.size(),
       std::to_string(sequence.truth.size()) + " boxes, but " + std::to_string(sequence.images.size()) +
           " images (" + sequence.images.front().string() + " to " +
           sequence.images.back().filename().string() + ")");
}

// --- VOT

// The entries of a "sequence" file, key=value; empty where there is none.
std::map<std::string, std::string> properties_of(const fs::path& path) {
  std::map<std::string, std::string> properties;
  if (!fs::exists(path)) return properties;
  const std::vector<std::string> lines = lines_of(path);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].empty() || lines[i].front() == '#') continue;
    const std::size_t equal = lines[i].find('=');
    if (equal == std::string::npos) fail(path, i + 1, "key=value expected");
    properties[std::string(trim(std::string_view(lines[i]).substr(0, equal)))] =
        std::string(trim(std::string_view(lines[i]).substr(equal + 1)));
  }
  return properties;
}

void read_tags(Sequence& sequence, const fs::path& folder) {
  for (const fs::path& file : entries_of(folder))
    if (file.extension() == ".tag" || file.extension() == ".label")
      sequence.tags[file.stem().string()] = frame_flags(file, sequence.length());
}

Sequence read_vot(const fs::path& folder) {
  Sequence sequence;
  sequence.name = folder.filename().string();
  const auto properties = properties_of(folder / "sequence");
  const auto property = [&](const std::string& key, const std::string& otherwise) {
    const auto found = properties.find(key);
    return found == properties.end() ? otherwise : found->second;
  };
  const fs::path truth = folder / property("groundtruth", "groundtruth.txt");
  sequence.truth = tools::read_ground_truth(truth);
  // Sequences with depth or infrared images say which images are those to track in.
  const std::string pattern = property("channels." + property("channel.default", "color"), "");
  sequence.images = images_of(pattern.empty() ? folder : folder / pattern);
  check_counts(sequence, truth);
  read_tags(sequence, folder);
  if (const fs::path file = folder / "practical.value"; fs::exists(file))
    for (const Value& v : values_of(file, sequence.length())) sequence.practical.push_back(v.value);
  return sequence;
}

// --- OTB

bool is_otb_truth(const fs::path& file) {
  const std::string name = file.filename().string();
  return name.starts_with("groundtruth_rect") && file.extension() == ".txt";
}

std::vector<Sequence> read_otb(const fs::path& folder) {
  const std::string name = folder.filename().string();
  std::vector<fs::path> images = images_of(folder / "img");
  const auto known = std::find_if(std::begin(kOtbSequences), std::end(kOtbSequences),
                                  [&](const OtbSequence& s) { return s.name == name; });
  const OtbSequence published = known == std::end(kOtbSequences) ? OtbSequence{} : *known;
  std::erase_if(images, [&](const fs::path& image) {
    const std::optional<long> number = number_of(image);
    return number && (*number < published.first || *number > published.last);
  });
  if (images.empty())
    fail(folder / "img", "none of the frames from " + std::to_string(published.first) + " on");

  std::vector<Sequence> sequences;
  for (const fs::path& file : entries_of(folder)) {
    if (!is_otb_truth(file)) continue;
    // groundtruth_rect.2.txt: the second object
    const std::string object = file.stem().extension().string();
    Sequence sequence;
    sequence.name = object.empty() ? name : name + "-" + object.substr(1);
    sequence.images = images;
    sequence.truth = tools::read_ground_truth(file);
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

// --- GOT-10k, LaSOT and plain files

// A single box is the first; the other frames are unknown.
void pad_single_box(Sequence& sequence, std::size_t frames) {
  if (sequence.truth.size() == 1) sequence.truth.resize(frames);
}

void remove_truth(Sequence& sequence, const std::vector<bool>& where) {
  for (std::size_t t = 0; t < where.size(); ++t)
    if (where[t]) sequence.truth[t].reset();
}

Sequence read_got10k(const fs::path& folder) {
  Sequence sequence;
  sequence.name = folder.filename().string();
  sequence.truth = tools::read_ground_truth(folder / "groundtruth.txt");
  sequence.images = images_of(folder);
  pad_single_box(sequence, sequence.images.size());
  check_counts(sequence, folder / "groundtruth.txt");
  for (const char* name : {"absence", "cut_by_image"}) {
    const fs::path file = folder / (std::string(name) + ".label");
    if (fs::exists(file)) sequence.tags[name] = frame_flags(file, sequence.length());
  }
  if (sequence.tags.contains("absence")) remove_truth(sequence, sequence.tags["absence"]);
  if (const fs::path file = folder / "cover.label"; fs::exists(file)) {
    std::vector<bool> hidden, occluded;
    for (const Value& v : values_of(file, sequence.length())) {
      if (v.value < 0 || v.value > 8) fail(file, v.line, "0 to 8 (eighths that are visible) expected");
      hidden.push_back(v.value == 0);
      occluded.push_back(v.value < 8);
    }
    remove_truth(sequence, hidden);
    sequence.tags["occlusion"] = std::move(occluded);
  }
  return sequence;
}

Sequence read_lasot(const fs::path& folder) {
  Sequence sequence;
  sequence.name = folder.filename().string();
  sequence.truth = tools::read_ground_truth(folder / "groundtruth.txt");
  sequence.images = images_of(folder / "img");
  check_counts(sequence, folder / "groundtruth.txt");
  for (const char* name : {"full_occlusion", "out_of_view"}) {
    const fs::path file = folder / (std::string(name) + ".txt");
    if (!fs::exists(file)) continue;
    sequence.tags[name] = frame_flags(file, sequence.length());
    remove_truth(sequence, sequence.tags[name]);
  }
  return sequence;
}

fs::path plain_truth(const fs::path& path) {
  return path.parent_path() / ((fs::is_directory(path) ? path.filename() : path.stem()).string() + ".txt");
}

Sequence read_plain(const fs::path& path) {
  const fs::path truth = plain_truth(path);
  Sequence sequence;
  sequence.name = truth.stem().string();
  sequence.truth = tools::read_ground_truth(truth);
  tools::ImageSource source = tools::ImageSource::open(path.string());
  sequence.images = source.images();
  if (!sequence.images.empty()) {
    pad_single_box(sequence, sequence.images.size());
    check_counts(sequence, truth);
    return sequence;
  }
  sequence.video = path;
  while (source.skip(1)) {
  }  // what a video's header says of its length is an estimate
  const auto frames = static_cast<std::size_t>(source.position());
  if (frames == 0) fail(path, "no frame can be decoded");
  pad_single_box(sequence, frames);
  if (sequence.truth.size() != frames)
    fail(truth, sequence.truth.size(),
         std::to_string(sequence.truth.size()) + " boxes, but " + std::to_string(frames) + " frames in " +
             path.string());
  return sequence;
}

// --- Where the sequences are

bool is_video(const fs::path& path) {
  static const std::set<std::string> kExtensions = {".avi", ".mp4",  ".mkv",  ".mov",
                                                    ".mpg", ".mpeg", ".webm", ".m4v"};
  return kExtensions.contains(path.extension().string()) && fs::is_regular_file(path);
}

// The layout of one sequence; Auto where `path` is none.
Layout layout_of(const fs::path& path) {
  const bool folder = fs::is_directory(path);
  const auto has = [&](const char* file) { return fs::exists(path / file); };
  if (folder) {
    const std::vector<fs::path> entries = entries_of(path);
    if (std::any_of(entries.begin(), entries.end(), is_otb_truth)) return Layout::Otb;
    if (has("groundtruth.txt")) {
      if (has("absence.label") || has("cover.label") || has("meta_info.ini")) return Layout::Got10k;
      return has("full_occlusion.txt") || has("out_of_view.txt") ? Layout::Lasot : Layout::Vot;
    }
    if (fs::is_regular_file(path / "sequence")) return Layout::Vot;
  }
  return (folder || is_video(path)) && fs::exists(plain_truth(path)) ? Layout::Plain : Layout::Auto;
}

struct Found {
  fs::path path;
  Layout layout;
};

void find_sequences(const fs::path& path, Layout wanted, int depth, std::vector<Found>& found) {
  const Layout layout = layout_of(path);
  if (layout != Layout::Auto) {
    // Told otherwise, a folder with groundtruth.txt can be read as any layout that has one.
    found.push_back({path, wanted == Layout::Auto ? layout : wanted});
    return;
  }
  if (!fs::is_directory(path) || depth == kDepth) return;
  const fs::path list = path / "list.txt";
  if (!fs::exists(list)) {
    for (const fs::path& entry : entries_of(path)) find_sequences(entry, wanted, depth + 1, found);
    return;
  }
  const std::vector<std::string> names = lines_of(list);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::size_t before = found.size();
    if (!names[i].empty()) find_sequences(path / names[i], wanted, kDepth, found);
    if (found.size() == before) fail(list, i + 1, "no sequence \"" + names[i] + "\"");
  }
}

std::vector<Sequence> read(const Found& found) {
  switch (found.layout) {
    case Layout::Otb:
      return read_otb(found.path);
    case Layout::Got10k:
      return {read_got10k(found.path)};
    case Layout::Lasot:
      return {read_lasot(found.path)};
    case Layout::Plain:
      return {read_plain(found.path)};
    default:
      return {read_vot(found.path)};
  }
}

}  // namespace

std::string_view to_string(Layout layout) {
  return std::find_if(kNames.begin(), kNames.end(), [&](const auto& n) { return n.first == layout; })->second;
}

Layout parse_layout(const std::string& name) {
  std::string known;
  for (const auto& [layout, text] : kNames) {
    if (text == name) return layout;
    known += (known.empty() ? "" : ", ") + std::string(text);
  }
  throw std::invalid_argument("unknown layout \"" + name + "\" (known: " + known + ")");
}

std::vector<Sequence> open_dataset(const fs::path& path, Layout layout,
                                   const std::vector<std::string>& only) {
  if (!fs::exists(path)) fail(path, "no such file or folder");
  // Without a trailing separator, which would hide the folder's name.
  const fs::path root = (path.has_filename() ? path : path.parent_path()).lexically_normal();
  std::vector<Found> found;
  find_sequences(fs::absolute(root), layout, 0, found);
  std::vector<Sequence> sequences;
  std::map<std::string, fs::path> names;
  for (const Found& f : found) {
    // Others are not read, whatever is wrong with them. The name of a sequence begins as its file's.
    const std::string begin = f.path.stem().string();
    if (!only.empty() &&
        std::none_of(only.begin(), only.end(), [&](const std::string& n) { return n.starts_with(begin); })) {
      continue;
    }
    for (Sequence& sequence : read(f)) {
      if (!only.empty() && std::find(only.begin(), only.end(), sequence.name) == only.end()) continue;
      const auto [other, added] = names.emplace(sequence.name, f.path);
      if (!added) fail(f.path, "another sequence of that name is " + other->second.string());
      sequences.push_back(std::move(sequence));
    }
  }
  for (const std::string& name : only)
    if (!names.contains(name)) fail(path, "no sequence \"" + name + "\"");
  if (sequences.empty()) fail(path, "no annotated sequence");
  return sequences;
}

cv::Mat FrameReader::operator()(std::size_t t) {
  if (t >= sequence_.length())
    throw std::out_of_range(sequence_.name + " has no frame " + std::to_string(t + 1));
  cv::Mat image;
  if (!sequence_.images.empty()) {
    const fs::path& file = sequence_.images[t];
    const tools::FrameImage frame = tools::read_frame(file, sequence_.range, size_);
    if (frame.damaged)
      damaged_.insert(file);
    else
      size_ = frame.pixels.size();
    try {
      return tools::to_bgr8(frame.pixels);
    } catch (const std::invalid_argument& error) {
      fail(file, error.what());
    }
  }
  if (!video_ || static_cast<std::size_t>(video_->position()) > t)
    video_ = tools::ImageSource::open(sequence_.video.string(), {.range = sequence_.range});
  if (!video_->skip(static_cast<int>(t) - video_->position()) || !video_->next(image))
    fail(sequence_.video, "frame " + std::to_string(t + 1) + " cannot be decoded");
  return image.clone();  // the decoder uses its image again
}

}  // namespace asterism::bench
